"""The engine, on functions of all kinds: compiled to Python, machine code and JavaScript."""

import gc
import math
import pickle
import re
import shutil
import subprocess
from functools import partial
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import python

from curriculum.common.tracing import (
    NotAState,
    Report,
    StepChanged,
    compiled,
    llvm,
    ordered,
    plain,
    vmap,
)
from curriculum.common.tracing.compare import Comparisons
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.python import source_of
from curriculum.common.tracing.trace import fori_loop, trace_loop, while_loop

HERE = Path(__file__).name


def lorenz(x):
    def slope(x):
        turn = x[0] * (28.0 - x[2]) - x[1]
        return np.stack([10.0 * (x[1] - x[0]), turn, x[0] * x[1] - 8.0 / 3.0 * x[2]])

    return x + 0.01 * slope(x + 0.005 * slope(x))


def spring(q, v):
    """Masses on springs that are stiffer when pressed."""
    v = v + 0.01 * np.where(q > 0.0, -3.0, -40.0) * q
    return q + 0.01 * v, v


def swing(q, v):
    v = v - 0.01 * np.sin(q)
    return q + 0.01 * v, v


STARTS = {
    lorenz: [np.array([1.0, 2.0, 20.0])],
    spring: [np.array([[1.0, 0.0], [-0.3, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])],
    swing: [np.array([2.0, 0.1]), np.array([0.0, 0.5])],
}


def states(step, start, steps, edit=lambda i, *state: state):
    """All states of an ordinary loop (steps + 1, numbers)."""
    state = tuple(start)
    rows = [np.concatenate(start, axis=None)]
    for i in range(steps):
        made = step(*state)
        state = edit(i, *made) if isinstance(made, tuple) else edit(i, made)
        rows.append(np.concatenate(state, axis=None))
    return np.array(rows)


@pytest.fixture(params=["compiled to Python", "machine code"])
def language(request, monkeypatch):
    if request.param == "machine code":
        pytest.importorskip("llvmlite", reason="llvmlite is not installed")
    monkeypatch.setattr(llvm, "START", -np.inf if request.param == "machine code" else np.inf)
    return request.param


def node(program, numbers, steps):
    """All states (steps + 1, numbers) of a program in JavaScript, or what it complains about."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    script = f"""{javascript_of(program)}
        const state = new Float64Array({numbers}), rows = [...state];
        f(state, {steps}, row => rows.push(...row));
        process.stdout.write(Buffer.from(new Float64Array(rows).buffer));"""
    done = subprocess.run(["node", "-"], input=script.encode(), capture_output=True, timeout=120)
    return done.stderr.decode() or np.frombuffer(done.stdout).reshape(steps + 1, -1)


def check_all_alike(step, start, steps, language, tolerance=0.0):
    """That plain numpy, a language and JavaScript give the same states."""
    with plain():
        expected = states(compiled(step, steps), start, steps)
    fast = compiled(step, steps)
    np.testing.assert_allclose(states(fast, start, steps), expected, tolerance, tolerance)
    assert fast.report.how == language and fast.report.seconds > 0.0
    program, _ = trace_loop(step, [np.ones(x.shape, bool) for x in start])
    made = node(program, expected[0].tolist(), steps)
    np.testing.assert_allclose(made, expected, tolerance, tolerance)
    np.testing.assert_allclose(states(step, start, 40), expected[:41], rtol=1e-9)


@pytest.mark.parametrize("step", STARTS)
def test_a_step_has_the_bits_of_plain_numpy_in_every_language(step, language):
    # each library rounds its sine as it likes
    check_all_alike(step, STARTS[step], 10_000, language, 1e-7 if step is swing else 0.0)


A = np.array([[1.0, 2.0, 0.5], [0.0, 3.0, -1.0], [0.25, 0.0, 1.0]])


def halved(x, halve=lambda x: 0.5 * x):
    return while_loop(lambda x: np.max(x) > 0.5, halve, x, most=30, failure="no end")


def bounds_of_nan(x):
    """Whether a bound is NaN, if one of two numbers is; and what is less, of NaN and of equals."""
    with np.errstate(all="ignore"):
        huge = 1e300 * x[0] * 1e300
        one = x[0]
        nan = huge - 2.0 * huge
    bounds = np.maximum(nan, one), np.maximum(one, nan), np.minimum(nan, one), np.minimum(one, nan)
    less = [nan < one, one < nan, nan >= one, one <= nan, one < one, one <= one]
    less += [bound <= bound for bound in bounds]
    return x * sum(2.0**-k * np.where(is_less, 1.0, 0.5) for k, is_less in enumerate(less))


def COSY(t):
    return 0.4 * t * t + 0.3


KEPT = {
    "arithmetic": lambda x: (x + 1.0) * 2.0 - x / 3.0 + 1.0 / x - -x + np.add(x, 1.0, out=x.copy()),
    "entries": lambda x: np.stack([abs(x[0] - x[1]), x[2] * (x[1] - x[0]), -x[0] - x[2]]),
    "roots": lambda x: np.sqrt(x) + np.square(x) + x**2 + x**0.5 + x**-1,
    "powers": lambda x: x**3 + x**-2 + x**1.5 + 2.0**x + np.stack([x[0] ** 2, x[1] ** 3, x[2]]),
    "sines": lambda x: np.sin(x) + np.cos(x[0]) + np.tan(x) + np.arctan2(x, x[::-1] - 1.0),
    "exp": lambda x: np.exp(x) + np.log(x) + np.tanh(x),
    "bounds": lambda x: np.maximum(x, 0.9) - np.minimum(x[0], x) + np.max(np.outer(x, x), axis=1),
    "nested": lambda x: vmap(lambda t: fori_loop(2, partial(fori_loop, 2, np.square), t))(x),
    "names": lambda x: vmap(lambda t, _: fori_loop(2, lambda t1: 0.5 * t1 + _, t))(x, x),
    "words": lambda x: fori_loop(2, lambda new, this: (0.5 * new + this * this, new), x, x[::-1])[
        1
    ],
    "numbers": lambda x: vmap(lambda t: fori_loop(3, lambda t: fori_loop(2, COSY, t), t))(x),
    "in place": lambda x: x - halved(x, lambda y: np.add(y, -0.1, y)),
    "where": lambda x: np.where(x < 0.9, x, np.where(x >= 1.2, 2.0, x * x)) + (x / x.min()),
    "sums": lambda x: x / np.sum(x) + np.sum(np.outer(x, x).reshape(1, 3, 3), axis=(0, -1)),
    "means": lambda x: x - np.mean(x) + np.outer(x, x).mean(axis=1, keepdims=True).T[0],
    "products": lambda x: A @ x + x @ A + np.dot(x, x) + (A @ np.outer(x, x)).dot(x),
    "lengths": lambda x: np.cross(x, x[::-1]) + np.linalg.norm(np.outer(x, x), axis=1),
    "shapes": lambda x: np.concatenate([x[:1], np.outer(x, x)[1:, 2]]).reshape(3, 1).ravel(),
    "zeros": lambda x: np.diag(np.diag(np.outer(x, x))) @ x + np.zeros(3, like=x) + x,
    "sines in rows": lambda x: vmap(lambda y, z: np.sin(y) + np.arctan2(z, y))(x, x[::-1]),
    "rows": lambda x: vmap(lambda y, row: y * np.sum(row))(x, np.outer(x, x)),
    "solve": lambda x: np.linalg.solve(A + np.diag(x), np.outer(x, x)) @ np.linalg.solve(A, x),
    "nan": bounds_of_nan,
    "loops in rows": lambda x: vmap(halved)(np.outer(x, np.arange(35.0)).T)[-3:, 0],
}


@pytest.mark.parametrize("name", KEPT)
def test_numpy_stays_compiled_and_many_have_the_bits_of_each(name, language):
    def step(x):
        made = KEPT[name](x)
        return 0.7 + 0.5 * made / (1.0 + abs(made))  # between 0.2 and 1.2

    near = 1e-9 if name in ("powers", "sines", "sines in rows", "exp") else 0.0
    check_all_alike(step, [np.array([0.7, 1.0, 1.3])], 40, language, near)
    for size in (1, 120, 1025):  # the last is a block and one more
        many = ordered(np.random.default_rng(1).uniform(0.5, 1.5, (size, 3)))
        ends = slice(None) if size < 1000 else [0, 1023, 1024]
        each = [step(x) for x in many[ends]]
        np.testing.assert_allclose(vmap(step)(many)[ends], each, near, near)


ORDERED = {
    "sums": lambda x: np.sum(x, axis=1, keepdims=True) + x.sum(axis=0) + np.mean(x, axis=-1),
    "all": lambda x: np.sum(x, axis=(0, 1), keepdims=True) * np.sum(x, keepdims=True)[0, 0],
    "products": lambda x: x @ x[0] + x[0] @ x + np.dot(x[0], x[1]) + x @ x,
    "large products": lambda x: np.tile(x, (1, 9)) @ np.tile(x, (9, 2)),
    "choices": lambda x: x[np.argsort(x[0])] + np.sum(x > 0.5) + x[x > 0.5].sum(),
    "nothing": lambda x: x[:0].sum() + np.dot(x, 2.0) + np.stack([x, x])[0],
}


@pytest.mark.parametrize("name", ORDERED)
def test_ordered_arrays_add_from_first_to_last(name):
    x = np.random.default_rng(4).normal(size=(50, 50))
    objects = x.astype(object)  # whose sums numpy leaves in order
    np.testing.assert_array_equal(ORDERED[name](ordered(x)), ORDERED[name](objects))
    assert np.linalg.norm(ordered(x)) == np.sqrt(np.sum(objects.ravel() ** 2))
    with pytest.raises(ValueError, match="solve takes"):
        np.linalg.solve(ordered(x), x[0, :2])


@pytest.mark.parametrize("shape", [(300, 900), (900, 300), (40, 60)])
def test_a_product_adds_from_first_to_last_however_many_of_its_terms_are_zero(shape):
    rows, inner = shape
    draw = np.random.default_rng(0)
    a = np.where(draw.random(shape) < 0.02, draw.normal(size=shape), 0.0)
    for b in (draw.normal(size=inner), draw.normal(size=(inner, 9))):
        sums = np.zeros((rows, *b.shape[1:]))
        for k in range(inner):
            sums += np.multiply.outer(a[:, k], b[k])
        np.testing.assert_array_equal(ordered(a) @ b, sums)


def test_pythons_collector_is_off_only_while_a_step_is_compiled():
    seen = []

    def step(x):
        seen.append(gc.isenabled())
        return 0.5 * x

    compiled(step, 10)(np.ones(3))
    compiled(lambda x: np.sort(x), 10)(np.ones(3))  # which cannot be
    vmap(step)(np.ones((100, 3)))
    assert gc.isenabled() and set(seen) == {True, False}  # its own lines, and the traces


def test_sums_of_a_single_row_are_no_view_of_it():
    x = ordered(np.ones((1, 500)))
    sums = np.sum(x, axis=0)
    sums += 1.0
    assert np.all(x == 1.0) and np.all(sums == 2.0)


EDITS = {
    "nothing": lambda i, q, v: (q, v),
    "in place": lambda i, q, v: (q, np.multiply(v, 0.999, out=v)),
    "as another holds it": lambda i, q, v: (np.asfortranarray(q), np.asfortranarray(v)),
    "after the first step": lambda i, q, v: (q, v + [0.0, float(i == 0)]),
    "after the second": lambda i, q, v: (q, v + [0.0, float(i == 1)]),
    "if i == 1000": lambda i, q, v: (q, v + [0.0, float(i == 1000)]),
    "before the last step": lambda i, q, v: (q, v + [0.0, float(i == 1198)]),
}


@pytest.mark.parametrize("edit", EDITS)
def test_what_the_loop_does_is_obeyed_and_known(edit, language):
    def rows(step):
        return states(step, STARTS[spring], 1200, EDITS[edit]).tolist()

    fast = compiled(spring, 1100)
    slow = compiled(spring, 1100)  # it may be called more often
    assert rows(fast) == rows(spring)
    with plain():
        assert rows(slow) == rows(spring)
    fast = fast.report
    slow = slow.report
    assert (fast.how, fast.is_compiled) == (language, True)
    assert (slow.how, slow.is_compiled, slow.timed) == ("plain numpy", False, 1200)
    assert fast.edited == slow.edited == (edit not in ("nothing", "as another holds it"))
    if edit != "in place":  # few steps are computed that are not handed out
        assert 1200 <= fast.timed < 1200 + 1100 // 8
    paces = [1e6 * seconds / many for many, seconds in fast.stretches]
    paces = paces or [1e6 * fast.seconds / fast.timed]  # of steps taken one by one
    assert 0.0 < min(paces) <= fast.pace <= max(paces)


def fall(q, v, m, force, dt):
    v = v + dt * force(q, v) / m
    return q + dt * v, v


OTHERS = {
    "nothing": lambda i, m, force, dt: (m.copy(), force, 0.01 + 0.0),
    "mass in place": lambda i, m, force, dt: (np.add(m, i == 333, out=m), force, dt),
    "another step": lambda i, m, force, dt: (m, force, 0.01 if i < 333 else 0.005),
    "dt in place": lambda i, m, f, dt: (m, f, np.add(dt, 0.01 * (i == 333), dt if i else 0 * m)),
    "another force": lambda i, m, force, dt: (m, np.subtract if i > 500 else np.add, dt),
    "eight in all": lambda i, m, force, dt: (m, force, 0.01 / (1 + i // 75)),
    "another at each step": lambda i, m, force, dt: (m, force, 0.01 / (1 + i)),
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_arguments_are_obeyed_wherever_they_change(name, language):
    def run(step):
        q = np.ones(2)
        v = np.zeros(2)
        m = np.array([1.0, 2.0])
        force = np.add
        dt = 0.01
        rows = []
        for i in range(600):
            m, force, dt = OTHERS[name](i, m, force, dt)
            q, v = step(q, v, m, force, dt)
            rows.append([*q, *v])
        return rows

    fast = compiled(fall, 600)
    assert run(fast) == run(fall)
    how = "plain numpy, after a trial: its arguments keep changing" if "each" in name else language
    assert (fast.report.how, fast.report.edited) == (how, name != "nothing")
    if "each" in name:  # the first 8 were compiled, and took another time
        assert fast.report.timed == 600 - 8


@pytest.mark.parametrize("many", [None, 3, 300])
def test_a_function_may_edit_its_arguments_and_the_callers_stay(many):
    def edits(x, m):
        x += m
        m *= 2.0
        return x

    x = np.ones((2, many or 1, 2))
    step = vmap(edits) if many else compiled(edits, 100)
    for _ in range(3):
        np.testing.assert_array_equal(step(*x), 2.0)
        assert (x == 1.0).all()


def test_a_block_in_which_nothing_is_compiled_may_begin_midway_and_hold_another():
    calls = []

    def step(x):
        calls.append(x)
        return 0.5 * x

    fast = compiled(step, 1000)
    many = np.ones((200, 2))
    half = states(fast, [1.0], 100)[-1:]  # a number
    assert len(calls) < 50 and vmap(step)(many).sum() == 200.0 and len(calls) < 60
    calls.clear()
    with plain():
        with plain(False):
            fast(half[0])
        half = states(fast, half, 49)[-1:]
        assert len(calls) == 50 and half[0, 0] == 0.5**149
        assert vmap(step)(many).sum() == 200.0 and len(calls) == 250


@pytest.mark.parametrize("size", [1.0, 1e-11, 1e-6])
@pytest.mark.parametrize("steps", [7, 300, 2500])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9])
def test_what_a_step_reads_may_not_change_for_a_25th_part_of_the_run(share, steps, size, language):
    long = max(1, steps // 25)
    first = int(share * (steps - 1 - long))
    mass = {}

    def step(x):
        return x + 0.1 / mass["now"] - 0.001 * (np.sin(x) if size == 1e-6 else x)

    def change(i, x):
        mass["now"] = 1.0 + size * (first <= i < first + long)
        return (x,)

    change(-1, None)
    with pytest.raises(StepChanged, match=r"^step \d+ gives something else.*--plain") as error:
        states(compiled(step, steps), [np.array([1.0])], steps, change)
    assert first < int(str(error.value).split()[1]) <= first + long


@pytest.mark.parametrize("steps", [1, 7, 300, 4000, 100_000])
def test_the_same_steps_are_compared_wherever_a_stretch_begins(steps):
    whole = np.array(Comparisons(steps).are_due(0, steps))
    for cut in {steps // 3, steps // 2 + 1, steps - 1}:
        parts = [Comparisons(steps).are_due(*part) for part in ((0, cut), (cut, steps - cut))]
        np.testing.assert_array_equal(whole, sum(parts, []))
    found = np.flatnonzero(whole)
    assert found[0] == 0 and found[-1] == steps - 1
    assert np.max(np.diff(found), initial=0) <= min(max(1, steps // 25), 2000)


SIZES = {
    "one": (lorenz, STARTS[lorenz]),
    "several": (spring, STARTS[spring]),
    "rows": (vmap(lorenz), [np.ones((8, 3))]),
}


@pytest.mark.parametrize("name", SIZES)
def test_a_tape_knows_about_how_many_lines_of_python_it_becomes(name):
    function, start = SIZES[name]
    program, _ = trace_loop(function, [np.full(x.shape, True) for x in start])
    lines = source_of(program).count("\n")
    assert 0.8 * lines < program.tape.lines < 1.5 * lines + 10


def test_a_change_in_the_last_step_is_found():
    mass = {"now": 1.0}

    def change(i, x):
        mass["now"] = 1.0 + (i == 997)
        return (x,)

    with pytest.raises(StepChanged, match="^step 998 "):
        states(compiled(lambda x: x + mass["now"], 999), [np.array([1.0])], 999, change)


KEEPING = {
    "a number": (lambda kept, x: x + kept, "step 0 gives something else"),
    "a symbol": (lambda kept, x: 0.5 * (x + kept - kept), "keeps something from call to call"),
}


@pytest.mark.parametrize("what", KEEPING)
def test_a_step_that_keeps_something_is_told_to_run_plainly(what):
    function, words = KEEPING[what]
    kept = [0.0]

    def step(x):
        before = kept[0]
        kept[0] = x
        return function(before, x)

    with pytest.raises(StepChanged, match=f"{words}.*--plain"):
        states(compiled(step, 20), [np.ones(2)], 20)


def drive(compile_step, edit, steps=800):
    """All states of a ball that falls through air, with what a reader edits in its loop."""
    ball = SimpleNamespace(q=np.array([1.0, 2.0]), v=np.array([0.5, 0.0]), m=np.array([2.0]))
    ball.dt = 0.01
    ball.wind = 0.0
    ball.drag = lambda q, v: -0.1 * v
    ball.draw = np.random.default_rng(1).random
    ball.calls = count()
    ball.kept = [1.0]
    ball.force = lambda q, v: ball.drag(q, v) + [ball.wind, -9.81]
    step = compile_step(fall, steps)
    rows = []
    for i in range(steps):
        vars(ball).update(edit(i, ball))
        ball.q, ball.v = step(ball.q, ball.v, ball.m, ball.force, ball.dt)
        rows.append([*ball.q, *ball.v])
    return np.array(rows)


def swallow(q):
    try:
        return -q if q[0] > 3.0 else 2.0 - q
    except Exception:
        return 2.0 - q


def keep(kept, x):
    kept.append(x)
    return -0.1 * kept[-2] * x


READERS = {  # edits as a reader makes them, and which step is said to differ, if one does
    "bounce": (lambda i, ball: {"v": abs(ball.v)} if ball.q[1] < -1.0 else {}, ""),
    "kick": (lambda i, ball: {"v": ball.v + 1.0} if i == 400 else {}, ""),
    "noise": (lambda i, ball: {"v": ball.v + ball.draw(2)}, ""),
    "mass": (lambda i, ball: {"m": np.add(ball.m, i == 400, out=ball.m)}, ""),
    "shorter": (lambda i, ball: {"dt": 0.01 if i < 400 else 0.005}, ""),
    "no time": (lambda i, ball: {"dt": 0.01 * (i != 400)}, ""),
    "no number": (lambda i, ball: {"dt": np.nan if i == 400 else 0.01}, ""),
    "another force": (lambda i, ball: {"force": lambda q, v: -q} if i == 400 else {}, ""),
    "clock": (lambda i, ball: {"wind": 0.1 * i}, "1 "),
    "gust": (lambda i, ball: {"wind": 3.0 * (300 <= i < 400)}, r"3[0-2]\d "),
    "for good": (lambda i, ball: {"wind": 3.0 * (i > 500)}, r"5[0-2]\d "),
    "last gust": (lambda i, ball: {"wind": 3.0 * (i == 799)}, "799 "),
    "draws": (lambda i, ball: {"drag": lambda q, v: -ball.draw() * v}, "0 "),
    "rare draws": (lambda i, ball: {"drag": lambda q, v: v * (ball.draw() < 0.1)}, r"\d+ "),
    "calls": (lambda i, ball: {"drag": lambda q, v: -0.1 * next(ball.calls) * v}, "0 "),
    "memory": (lambda i, ball: {"drag": lambda q, v: keep(ball.kept, q)}, "0 "),
    "branch": (lambda i, ball: {"drag": lambda q, v: -q if q[0] > 1.2 else -v}, ""),
    "hidden branch": (lambda i, ball: {"drag": lambda q, v: swallow(q)}, r"\d+ "),
    "plain number": (lambda i, ball: {"drag": lambda q, v: -math.cos(q[0]) * v}, ""),
    "its argument": (lambda i, ball: {"drag": lambda q, v: np.multiply(v, -0.5, out=v)}, ""),
}


@pytest.mark.parametrize("name", READERS)
def test_what_a_reader_edits_gives_the_figures_of_plain_numpy_or_is_said(name):
    edit, told = READERS[name]
    if told:
        with pytest.raises(StepChanged, match=f"^step {told}.*--plain"):
            drive(compiled, edit)
    else:
        with plain():
            expected = drive(compiled, edit)
        np.testing.assert_array_equal(drive(compiled, edit), expected)


def test_a_pace_is_that_of_most_long_stretches_and_of_all_steps_if_there_are_none():
    report = Report()
    report.time(1, 3e-6)
    report.time(1, 5e-6)
    assert report.pace == pytest.approx(4.0)
    for many, seconds in ((8, 1.0), (500, 1e-3), (500, 2e-3), (500, 9.0)):  # others ran, too
        report.time(many, seconds)
    assert report.pace == pytest.approx(4.0)  # 2 ms for 500 steps
    report.go_plain("changed")
    assert math.isnan(report.pace)


def test_what_a_loop_leaves_can_be_pickled_and_its_pace_is_of_the_steps_that_were_computed():
    step = compiled(fall, 4000)
    state = np.ones(2), np.zeros(2)
    for _ in range(400):  # as a loop does that ends with a break
        state = step(*state, np.array([1.0, 2.0]), np.add, 0.01)
    report = pickle.loads(pickle.dumps(step.report))
    assert report == step.report and report.is_compiled and report.source.startswith("def f(")
    assert 400 <= report.timed <= 400 + 4000 // 8
    assert sum(many for many, _ in report.stretches) <= report.timed and report.pace > 0.0
    assert math.isnan(compiled(fall, 10).report.pace)


def test_steps_of_one_block_are_compiled_alike():
    pytest.importorskip("llvmlite", reason="llvmlite is not installed")

    def how(*names):
        steps = {"long": (spring, STARTS[spring]), "short": (lambda x: 0.5 * x, [np.ones(2)])}
        hows = []
        for name in names:
            function, start = steps[name]
            step = compiled(function, 200_000)
            step(*start)
            hows.append(step.report.how)
        return hows

    python = "compiled to Python"
    machine = "machine code"
    assert how("long", "short") == [machine, python]
    with plain(False):
        assert how("long", "short") == [machine, machine]
        with plain(False):
            assert how("short") == [machine]
    with plain(False):
        assert how("short", "long") == [python, python]
    assert how("short", "long") == [python, machine]


def test_llvmlite_that_fails_is_named_each_time_and_python_takes_its_place(monkeypatch):
    binding = pytest.importorskip("llvmlite.binding", reason="llvmlite is not installed")

    def parse_assembly(text):
        raise RuntimeError("of another\nversion")

    monkeypatch.setattr(llvm, "FAILED", [])
    monkeypatch.setattr(binding, "parse_assembly", parse_assembly)
    for _ in range(2):
        step = compiled(spring, 200_000)
        rows = states(step, STARTS[spring], 30)
        np.testing.assert_array_equal(rows, states(spring, STARTS[spring], 30))
        failed = "compiled to Python, as llvmlite fails: RuntimeError: of another version"
        assert step.report.how == failed and step.report.is_compiled


FAILING = {
    "diverged": lambda x: x * x,
    "diverged ": lambda x: 1e9 * x + 0.0 * (x * x),  # compiled, what is times zero vanishes
    "not a number: divide by zero encountered in divide (LINE)": lambda x: x / (x - 2.5),
    "not a number: invalid value encountered in log (LINE)": lambda x: np.log(x - 1.6) + 2.0,
    "not a number: divide by zero encountered in scalar divide (LINE)": lambda x: (
        x + np.linalg.solve(np.outer(x, x)[:1, :1] - 2.25, x[:1])
    ),
    "no end": lambda x: 20.0 + halved(x - 19.0, lambda y: y),  # as soon as x > 19.5
}


@pytest.mark.parametrize("words", FAILING)
def test_a_failed_step_is_nan_and_so_are_all_after_it_and_it_says_why(words, language):
    def run(step):
        rows = states(step, [np.array([1.5, 2.5])], 60)
        good = np.isfinite(rows).all(axis=1)
        assert np.isnan(rows[~good]).all() and (np.diff(good.astype(int)) <= 0).all()
        return good.sum(), re.sub(rf"{HERE}, line \d+", "LINE", step.report.failure)

    with plain():
        expected = run(compiled(FAILING[words], 6000))
    fast = compiled(FAILING[words], 6000)
    assert run(fast) == expected and fast.report.how == language
    assert expected[0] < 60 and expected[1] == words.strip()


def turns(x):
    """How many turns of 7 at most a loop takes that needs x."""
    y, n = while_loop(lambda y, n: n < y, lambda y, n: (y, n + 1.0), x, 0.0, most=7, failure="slow")
    return n


@pytest.mark.parametrize("needed, expected", [(0.0, 0.0), (7.0, 7.0), (8.0, np.nan)])
def test_a_loop_takes_at_most_so_many_turns_in_every_language(needed, expected, language):
    def step(x, n):
        return x, n + turns(x)

    fast = compiled(step, 40)
    x = np.float64(needed)
    zero = np.float64(0.0)
    np.testing.assert_array_equal([turns(x), fast(x, zero)[1]], expected)
    program, _ = trace_loop(step, [np.ones(()), np.ones(())])
    ends = node(program, [needed, 0.0], 1)
    assert "Error: slow" in ends if needed == 8.0 else ends[1, 1] == expected
    assert fast.report.failure == ("slow" if needed == 8.0 else None)
    many = np.arange(5000) % 13.0  # which leave the loop each in its turn
    np.testing.assert_array_equal(vmap(turns)(many)[many == needed], expected)


REFUSED = {
    "branches": lambda x: 0.9 * x if x[0] > 0.5 else 1.1 * x,
    "np.sort": lambda x: 0.9 * np.sort(x),
    "np.nan_to_num": lambda x: 0.5 * np.nan_to_num(x),
    "0.0 * q": lambda x: np.multiply(x, 0.5, out=np.zeros(3)),
    "np.floor": lambda x: x - 0.1 * np.floor(x),
    "equal": lambda x: np.where(x == 1.0, 2.0, 0.5 * x),
    "unsupported operand": lambda x: 0.5 * x + (x > 0.5) * 0.1,
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_cannot_be_traced_runs_as_it_stands_and_names_its_line(word):
    step = compiled(REFUSED[word], 10)
    start = np.array([1.0, 0.5, 0.3])
    np.testing.assert_array_equal(step(start), REFUSED[word](start))
    assert step.report.how.startswith("plain numpy, after a trial: ") and word in step.report.how
    line = re.search(rf"\({HERE}, line (\d+)\)$", step.report.how)[1]
    assert int(line) == REFUSED[word].__code__.co_firstlineno


def test_a_step_that_returns_other_shapes_than_a_state_is_refused_compiled_or_not():
    for returned in (lambda x, y: x[:, None], lambda x, y: (x, y[:1]), lambda x, y: None):
        for really in (False, True):
            with plain(really), pytest.raises(NotAState, match="^a step must return arrays of"):
                compiled(returned, 10)(np.ones(3), np.ones(2))


def test_it_needs_nothing_but_numpy_and_nothing_of_ours():
    loaded = python("-c", "import sys, curriculum.common.tracing; print(*sys.modules)").stdout
    others = {x for x in loaded.split() if "tracing" not in x}
    assert {x for x in others if x.startswith("curriculum")} == {"curriculum", "curriculum.common"}
    assert "llvmlite" not in others
