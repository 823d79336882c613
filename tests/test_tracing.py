"""The engine, on functions of all kinds: in Python, columns, machine code and JavaScript."""

import gc
import math
import pickle
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from itertools import count, product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import python

from curriculum.common.tracing import (
    CompiledSteps,
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
from curriculum.common.tracing.counting import Counter
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.python import source_of
from curriculum.common.tracing.trace import fori_loop, trace_loop, while_loop

HERE = Path(__file__).name
MANY = 10**7  # steps that repay all that LLVM can do
STEPS = 150  # more than vmap just calls
X = np.array([[0.31, 0.72, 0.48], [0.55, 0.13, 0.87]])
Y = np.random.default_rng(0).uniform(0.1, 0.9, (3, 4))
SCALE = np.array([0.1, 2.0, 3.0])


# --- what numpy does, on x (2, 3), y (3, 4) and z (2, 3, 4) ---
def halved(a, least=0.3, most=30):
    return while_loop(lambda a: np.max(a) > least, lambda a: 0.5 * a, a, most=most, failure="slow")


def by_hand(a, least=0.3, most=30):
    for _ in range(most + 1):
        if a.max() <= least:
            return a
        a = 0.5 * a
    return np.nan * a


def known(a):
    return np.where(a <= a, a, -1.0)  # NaN is not


def nan(x):
    with np.errstate(all="ignore"):
        return 1e300 * x[0, 0] * 1e300 - 2e300 * x[0, 0] * 1e300


def edited(x, y):
    a = x.copy()
    a[0, 1:] = y[:2, 3]
    a[:, 0] *= 2.0
    a += y[:, 0]
    return np.add(a, 1.0, out=np.zeros(a.shape, like=x))


ROUNDED = """
    x**3 + x**-2 + x**1.5 + 2.0**x + np.power(x, y[:, 2])
    np.sin(x) + np.cos(y[:, 0]) + np.tan(x) + np.arctan2(x, y[:, 1] - 0.5)
    np.exp(x) + np.log(x) + np.tanh(x)
    vmap(lambda a, b: np.sin(a) + np.arctan2(b[1], b[0]))(y, x.T)
"""  # each library its own way
EXACT = """
    (x + 1.0) * 2.0 - x / 3.0 + 1.0 / x - -x + +x * (3.0 - x)
    (np.eye(3)[0] - x) * 2.0 + (np.eye(3)[1] + -x) / 3.0 - (x - np.eye(3)[2])
    x * y[:, 0] + x[:, :1] / y[0, :3] - y.T[:2, [2, 0, 1]]
    np.sqrt(x) + np.square(x) + x**2 + x**0.5 + x**-1 + abs(x - 0.5) + np.absolute(-x)
    edited(x, y)
    np.stack([x[0, 1] - x[1, 2], -y[2, 3] * x[1, 0], y[1, -1] / x[0, 0]])
    x[::-1, ::-1] + np.flip(y, axis=1)[:2, :3] + np.roll(x, 1, axis=1)
    np.moveaxis(z, 0, -1) + np.swapaxes(z, 0, 2).T[0, 0, 0]
    np.stack([x, x[:, [0, 1, 1]]], axis=1) + np.vstack([x, y.T[:, :3]])[:2, None]
    np.concatenate([x, y[:2]], axis=1) * np.hstack([y[:2, 1:], x, x[:, :1]])
    y.reshape(2, 6).ravel()[1:9:2] + np.repeat(x[0], 2)[2:] + np.tile(x[1], 2)[:4]
    np.broadcast_to(x[1], (4, 3)).T + np.expand_dims(x[0], 1) + np.ones_like(y)
    np.where(x < 0.4, x, np.where(x >= y[:, 1], 2.0, x * x))
    np.where(x < x[0], x, 2.0) + np.where(x <= x[0], 3.0, y[:2, :3])
    np.where(x > x[0], x, 2.0) - np.where(x >= x[0], 3.0, y[:2, :3])
    np.where(x < np.inf, x, 0.0) + np.maximum(x, -np.inf) + known(np.maximum(x, np.nan))
    np.where(x < nan(x), x, 1.0) + np.where(nan(x) >= x, x, y[:, 0])
    known(np.stack([np.maximum(nan(x), x), np.maximum(x, nan(x))]))
    known(np.stack([np.minimum(nan(x), x), np.minimum(x, nan(x))]))
    np.sum(x) + np.sum(z) - y.sum() * x
    np.sum(y, axis=0)
    y.sum(1)
    z.sum(axis=1, keepdims=True)
    np.sum(z, keepdims=True)[0] * x
    np.sum(z, axis=(0, 2))
    np.sum(z, axis=(-1, 0), keepdims=True)
    np.mean(z) - y.mean() * x
    np.mean(y, axis=0)
    y.mean(axis=1)
    np.mean(y, axis=1, keepdims=True)
    z.mean(axis=(2, 0))
    np.mean(z, axis=(0, -1), keepdims=True)
    np.linalg.norm(x) + np.linalg.norm(x[0]) - np.linalg.norm(y) * y
    np.linalg.norm(y, axis=0)
    np.linalg.norm(y, axis=1)
    np.linalg.norm(y, axis=1, keepdims=True)
    np.linalg.norm(z, axis=(0, 2), keepdims=True)
    np.max(y) - y.max(axis=0) + np.max(y, axis=1, keepdims=True)
    y.min() * np.min(y, axis=1) - np.min(x, axis=0, keepdims=True)
    np.maximum(x, 0.4) - np.minimum(y[:, 3], x)
    x @ y + x[0] @ y + (x @ y[:, 1])[:, None] + x[0] @ x[1]
    np.dot(x, y) - x.dot(y[:, :1]) + np.dot(y[:, 1], x[1])
    np.outer(x[0], y[1]) + np.inner(x, y.T)[1] - np.tensordot(x, y, 1)[0]
    np.einsum("ij,jk->k", x, y) + np.cumsum(y, axis=1)[2] + y.prod(axis=0)
    np.cross(x, y.T[:2]) + np.cross(x[0], x[1])
    np.diag(np.diag(x @ x.T)) @ x + np.trace(x @ x.T) + np.eye(3)[1]
    np.linalg.solve(y @ y.T + np.eye(3), y)
    np.linalg.solve(np.diag(y[1] + 2.0) + np.diag(x[0], 1) + np.diag(x[1], -1), y[0] - 0.5)
"""
LOOPS = {  # and the same without
    "fori_loop(3, lambda a, b: (b + np.sqrt(x[0, 0]), 0.5 * a), x[0], x[1])[0]": (
        "0.5 * x[1] + 1.5 * np.sqrt(x[0, 0])"
    ),
    "fori_loop(3, lambda a, b: (a + b * y[1], 0.5 * b), np.zeros(4), x[0, 0])[0]": (
        "1.75 * x[0, 0] * y[1]"  # what begins with zeros
    ),
    "fori_loop(2, lambda new, t1, _: (t1 * _, new + _, 0.5 * t1), x, x, x[::-1])[1]": (
        "x * x[::-1] + 0.5 * x"  # names that are taken
    ),
    "fori_loop(2, lambda t1, x_1, x: (t1 + x_1, 0.5 * x_1, x), x[0, 0], x[1, 1], x[0])[0] * x": (
        "(x[0, 0] + 1.5 * x[1, 1]) * x"
    ),
    "halved(y) + halved(x[0, 0] * y)": "by_hand(y) + by_hand(x[0, 0] * y)",
    "fori_loop(2, lambda a: halved(3.0 * a, 0.4) + 0.1, x)": (
        "by_hand(3.0 * (by_hand(3.0 * x, 0.4) + 0.1), 0.4) + 0.1"
    ),
    "vmap(lambda row, pair: row * np.sum(pair) + pair[1] - x[0, 0])(y, x.T)": (
        "y * x.sum(axis=0)[:, None] + x[1][:, None] - x[0, 0]"
    ),
    "vmap(lambda pair, row: (row[:1], np.outer(pair, row)))(x.T, y)[1]": (
        "x.T[:, :, None] * y[:, None, :]"
    ),
    "vmap(lambda row: row - np.min(row))(np.outer(x, y).reshape(18, 4))": (
        "np.outer(x, y).reshape(18, 4) - np.outer(x, y).reshape(18, 4).min(axis=1)[:, None]"
    ),
    "vmap(halved)(np.outer(y, SCALE))": "np.stack([by_hand(a) for a in np.outer(y, SCALE)])",
    "vmap(lambda a: fori_loop(2, lambda b: 2.0 * halved(b) + x[0, 0], a))(y)": (
        "np.stack([2.0 * by_hand(2.0 * by_hand(a) + x[0, 0]) + x[0, 0] for a in y])"
    ),
}
ENDLESS = {  # in some of its rows, or now and then; in JavaScript it throws an Error
    "known(vmap(lambda a: halved(a, 0.4, 1))(y)) + known(halved(y, 0.2, 1))": (
        "np.stack([known(by_hand(a, 0.4, 1)) for a in y]) + known(by_hand(y, 0.2, 1))"
    )
}


def listed(lines):
    return [line.strip() for line in lines.strip().splitlines()]


WRITTEN = [*listed(ROUNDED), *listed(EXACT), *LOOPS]  # in all languages
EVERY = [*WRITTEN, *ENDLESS]


@cache
def function(text, names="x, y, z"):
    """The function that a text is, as if it stood in the first line of this file."""
    return eval(compile(f"lambda {names}: {text}", __file__, "eval"), globals())


def of_pair(text):
    """The function of x and y that a text of x, y and z is."""
    return lambda x, y: function(text)(x, y, x[:, :, None] * y)


def after(x, y):  # chaotic, between 0 and 1
    return 3.7 * x * (1.0 - x), 3.6 * y * (1.0 - y)


@cache
def own(text):
    """x and y of many steps, and what is made of them by its own lines: (STEPS, ...) each."""
    x, y = X, Y
    rows = []
    for _ in range(STEPS):
        rows.append((x, y, np.asarray(of_pair(text)(ordered(x), ordered(y)))))
        x, y = after(x, y)
    return tuple(map(np.stack, zip(*rows, strict=True)))


def step_of(text):
    """A step with what is made in its state, and its start."""

    def step(x, y, made):
        return *after(x, y), of_pair(text)(x, y)

    return step, [X, Y, np.zeros(own(text)[2].shape[1:])]


def of_steps(text, machine_code):
    if machine_code:
        pytest.importorskip("llvmlite", reason="llvmlite is not installed")
    step, start = step_of(text)
    run = CompiledSteps(step, start, MANY, machine_code=machine_code)
    assert run.how == "machine code" if machine_code else "compiled to Python"
    return run(start, STEPS)[2][1:]


def live(state):
    return [np.ones(np.shape(x), bool) for x in state]


def node(sources):
    """The array `rows` in which several sources of JavaScript have left numbers."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    blocks = "".join(f"{{ {source} }}\n" for source in sources)
    write = "process.stdout.write(Buffer.from(new Float64Array(rows).buffer));"
    script = f"const rows = [];\n{blocks}{write}".encode()
    done = subprocess.run(["node", "-"], input=script, capture_output=True, check=True)
    return np.frombuffer(done.stdout)


@cache
def of_javascript():
    """{text: what it has made in all steps}; node takes long to begin, so it does so once."""
    sources = []
    ends = [0]
    for text in WRITTEN:
        step, start = step_of(text)
        program, _ = trace_loop(step, live(start))
        keep = f"state => rows.push(...state.slice({X.size + Y.size}))"
        state = np.concatenate(start, axis=None).tolist()
        call = f"f(new Float64Array({state}), {STEPS}, {keep});"
        sources.append(f"{javascript_of(program)} {call}")
        ends.append(ends[-1] + own(text)[2].size)
    return dict(zip(WRITTEN, np.split(node(sources), ends[1:-1]), strict=True))


LANGUAGES = {
    "Python": partial(of_steps, machine_code=False),
    "machine code": partial(of_steps, machine_code=True),
    "columns": lambda text: vmap(of_pair(text))(*own(text)[:2]),
    "JavaScript": lambda text: of_javascript()[text].reshape(own(text)[2].shape),
}


@pytest.mark.parametrize("text", EVERY)
def test_what_is_asked_of_numpy_means_the_same_on_plain_arrays(text):
    plainly = of_pair((LOOPS | ENDLESS).get(text, text))
    for x, y, made in zip(*own(text), strict=True):
        expected = plainly(x.copy(), y.copy())
        assert np.shape(expected) == made.shape
        np.testing.assert_allclose(made, expected, rtol=1e-11, atol=1e-13)


CASES = [*product(EVERY, LANGUAGES)][:-1]  # the last one is ENDLESS, in JavaScript


@pytest.mark.parametrize(("text", "language"), CASES)
def test_what_is_asked_of_numpy_has_the_bits_of_its_own_lines_in_each_language(text, language):
    near = 1e-9 if text in listed(ROUNDED) else 0.0
    np.testing.assert_allclose(LANGUAGES[language](text), own(text)[2], near, near)


@pytest.fixture(params=["compiled to Python", "machine code"])
def language(request, monkeypatch):
    """What each step is compiled to, as its report says."""
    if request.param == "machine code":
        pytest.importorskip("llvmlite", reason="llvmlite is not installed")
    monkeypatch.setattr(llvm, "START", -np.inf if request.param == "machine code" else np.inf)
    return request.param


def test_a_loop_that_does_not_end_in_time_is_an_error_in_javascript():
    def turns(needed, n):
        def another(needed, n):
            return needed, n + 1.0

        return while_loop(lambda y, n: n < y, another, needed, n, most=7, failure="slow")

    program, _ = trace_loop(turns, live([0.0, 0.0]))
    sources = []
    for needed in 7.0, 8.0:
        call = f"f(new Float64Array([{needed}, 0.0]), 1, state => rows.push(state[1]));"
        catch = "catch (why) { rows.push(why.message === 'slow' ? -1.0 : -2.0); }"
        sources.append(f"{javascript_of(program)} try {{ {call} }} {catch}")
    assert node(sources).tolist() == [7.0, -1.0]


ORDERED = """
    np.sum(x, axis=1, keepdims=True) + x.sum(axis=0) + x.mean(-1)[:, None]
    np.sum(x, axis=(0, 1), keepdims=True) * np.sum(x) - np.mean(x)
    x @ x[0] + x[:, :2] @ x[:2, 1] + np.dot(x.T[0], x.T[1])
    np.tile(x, (1, 9)) @ np.tile(x.T, (9, 2))
    np.inner(x, x) + np.tensordot(x, x.T, 1) + np.einsum("ij,kj->ik", x, x) + np.trace(x)
    x[:, np.argsort(x[0])] + np.sum(x > 0.5) + x[x > 0.5].sum()
    x[:0].sum() + np.dot(x, 2.0) + np.stack([x, x])[0]
"""


@pytest.mark.parametrize("shape", [(50, 31), (3, 500), (500, 3)])
@pytest.mark.parametrize("text", listed(ORDERED))
def test_ordered_arrays_add_from_first_to_last(text, shape):
    x = np.random.default_rng(4).normal(size=shape)
    objects = x.astype(object)  # whose sums numpy leaves in order
    made = function(text, "x")
    np.testing.assert_array_equal(made(ordered(x)), made(objects))
    assert np.linalg.norm(ordered(x)) == np.sqrt(np.sum(objects.ravel() ** 2))


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


def test_sums_of_a_single_row_are_no_view_of_it():
    x = ordered(np.ones((1, 500)))
    sums = np.sum(x, axis=0)
    sums += 1.0
    assert np.all(x == 1.0) and np.all(sums == 2.0)


def test_an_operation_is_counted_as_often_as_it_is_done():
    """In rows that are side by side once, and a loop in rows as often as the longest takes."""

    def step(x, y):
        rows = vmap(lambda row: halved(2.0 * row))(x)  # 3 in each
        return rows + 0.0, fori_loop(5, lambda y: x[0, 0] / 3.0 * np.sqrt(y), y)

    start = [np.array([[0.1, 0.2, 0.0], [0.3, 0.7, 0.5], [0.1, 0.1, 0.5]]), np.array([0.3, 0.4])]
    program, _ = trace_loop(step, live(start))
    counter = Counter(program)
    assert counter.varies
    for size, turns in (0.5, 2), (1.0, 3), (8.0, 6):  # until 2 * 0.7 * size is at most 0.3
        test = 2 + 1  # two maxima and a comparison
        expected = 3 + turns * (test + 3) + test + 1 + 5 * (2 + 2)
        assert counter([size * start[0], start[1]]) == expected


# --- what the loop around a step does ---
def fall(q, v, m, force, dt):
    v = v + dt * force(q, v) / m
    return q + dt * v, v


def drive(step, edit="", steps=800):
    """Each state of two balls that fall through air, with what a reader edits in step i."""
    edited = function(f"dict({edit})", "i, ball")
    ball = SimpleNamespace(q=1.0 * X, v=X[::-1] - 0.5, m=np.array([[2.0], [0.7]]), dt=0.01)
    ball.wind = 0.0
    ball.drag = lambda q, v: -0.1 * v
    ball.draw = np.random.default_rng(1).random
    ball.calls = count()
    ball.kept = [1.0]
    ball.force = lambda q, v: ball.drag(q, v) + [ball.wind, -9.81, 0.0]
    rows = []
    for i in range(steps):
        vars(ball).update(edited(i, ball))
        ball.q, ball.v = step(ball.q, ball.v, ball.m, ball.force, ball.dt)
        rows.append([ball.q.copy(), ball.v.copy()])
    return np.array(rows)


def copy(x):
    return ordered(x.copy()) if isinstance(x, np.ndarray) else x


def keep(kept, x):
    kept.append(x)
    return -0.1 * kept[-2] * x


KEEPS_CHANGING = "dt = 0.01 / (1 + i)"
BRANCHES = "drag = lambda q, v: -q if q[0, 0] > 1.2 else -v"
OBEYED = {  # edits as a reader makes them, and the first argument that is another: (step, name)
    "": None,
    "m = ball.m.copy(), q = np.asfortranarray(ball.q)": None,
    "v = np.multiply(ball.v, 0.999, out=ball.v)": (1, "v"),
    "q = ball.q + (i == 1)": (1, "q"),
    "v = ball.v + (i == 2)": (2, "v"),
    "v = ball.v + (i == 400)": (400, "v"),
    "v = ball.v + (i == 799)": (799, "v"),
    "v = ball.v + ball.draw((2, 3))": (1, "v"),
    "q = ball.q * [1, 1, i > 0], v = ball.v * [1, 1, i > 0] + [0, 0, i == 9]": (9, "v"),
    "m = np.add(ball.m, i == 400, out=ball.m)": (400, "m"),
    "m = ball.m + (i in (77, 400))": (77, "m"),
    "dt = np.add(ball.dt, 0.01 * (i == 9), ball.dt if i else 0 * X[0, :1])": (9, "dt"),
    "dt = 0.01 * (i != 400)": (400, "dt"),
    "dt = np.nan if i == 400 else 0.01": (400, "dt"),
    "dt = 0.01 / (1 + i // 110)": (110, "dt"),
    "force = [np.add, np.subtract][i > 500]": (501, "force"),
    "drag = lambda q, v: np.multiply(v, -0.5, out=v)": None,
    KEEPS_CHANGING: (1, "dt"),
    BRANCHES: None,
}


@pytest.mark.parametrize("edit", OBEYED)
def test_what_the_loop_does_is_obeyed_and_its_first_change_is_named(edit, language):
    fast = compiled(fall, 800)
    slow = compiled(fall, 800)
    rows = drive(fast, edit)
    with plain():
        np.testing.assert_array_equal(drive(slow, edit), rows)
    np.testing.assert_array_equal(rows, drive(lambda *x: fall(*map(copy, x)), edit))
    assert fast.done().change == slow.done().change == OBEYED[edit]
    assert fast.report.steps == slow.report.steps == 800 and slow.report.how == "not compiled"
    is_compiled = edit not in (KEEPS_CHANGING, BRANCHES)
    assert (fast.report.how == language) == fast.report.is_compiled == is_compiled
    if is_compiled and OBEYED[edit] in (None, (400, "v")):  # few are computed in vain
        assert 800 <= fast.report.timed < 800 + 800 // 8


CHANGED = {  # what a step reads besides, and the steps of which one is said to differ
    "wind = 0.1 * i": [1],
    "wind = 3.0 * (300 <= i < 400)": range(300, 333),
    "wind = 3.0 * (i > 500)": range(501, 534),
    "wind = 3.0 * (i == 799)": [799],
    "wind = 1e-10 * (600 < i < 634)": range(601, 634),
    "drag = lambda q, v: np.sin(v) * (0.1 + 1e-6 * (i > 500))": range(501, 534),
    "drag = lambda q, v: -ball.draw() * v": [0],
    "drag = lambda q, v: v * (ball.draw() < 0.1)": range(800),
    "drag = lambda q, v: -0.1 * next(ball.calls) * v": [0],
}


@pytest.mark.parametrize("edit", CHANGED)
def test_what_changes_beside_the_arguments_is_said_of_the_step_that_differs(edit, language):
    with pytest.raises(StepChanged, match="--plain") as error:
        drive(compiled(fall, 800), edit)
    assert int(str(error.value).split()[1]) in CHANGED[edit]


def test_a_step_that_keeps_something_from_call_to_call_is_told_to_run_plainly(language):
    with pytest.raises(StepChanged, match="--plain"):
        drive(compiled(fall, 800), "drag = lambda q, v: keep(ball.kept, q)")


@pytest.mark.parametrize("steps", [1, 7, 300, 4000, 100_000])
def test_the_first_step_the_last_and_one_of_each_part_are_compared(steps):
    comparisons = Comparisons(steps)
    found = [n for n in range(2 * steps) if comparisons.is_due(n)]
    first = steps // 3
    row = np.flatnonzero(comparisons.are_due(first, 2 * steps - first))
    assert [n for n in found if n >= first] == (first + row).tolist()
    found = [n for n in found if n < steps]
    assert found[0] == 0 and found[-1] == steps - 1
    assert np.max(np.diff(found), initial=0) <= min(max(1, steps // 25), 2000)


@pytest.mark.parametrize("errors", [(RuntimeError, ArithmeticError, ValueError), Exception])
def test_no_except_of_a_readers_hides_that_a_step_has_changed(errors):
    mass = 1.0
    step = compiled(lambda x: 0.9 * x / mass, 500)
    x = np.ones(2)
    with pytest.raises(StepChanged, match="^step 2[0-2]"):
        for i in range(500):
            mass = 1.0 + (i >= 200)
            try:
                x = step(x)
            except errors:
                break
        assert errors is Exception  # which takes all
        step.done()


@pytest.mark.parametrize("really", [False, True])
def test_steps_that_are_taken_again_tell_what_has_changed_since(really):
    wind = np.array([0.3, 0.0, 0.0])

    def push(q):
        return wind * q.sum()

    step = compiled(lambda q: 0.99 * q + 0.01 * push(q), 300, notes=push)
    states = [X]
    with plain(really):
        for _ in range(300):
            states.append(step(states[-1]))
        states = np.array(states)
        assert step.done().steps == 300 and step.differing([states], 24) is None
        wind[1] = 1e-3
        assert step.differing([states], 24) == 0
        wind[1] = 0.0
        assert step.differing([states[::2]], 24) == 0  # a loop that keeps every second state
        states[-1, 1, 2] += 1e-9
        assert step.differing([states], 24) == 299


@pytest.mark.parametrize("really", [False, True])
def test_a_force_that_was_another_as_it_was_noted_is_named_by_its_step(really):
    load = 0.0
    step = compiled(lambda q: 0.99 * q, 300, notes=lambda q: q + load)  # it moves nothing
    states = [X]
    with plain(really):
        for i in range(300):
            load = 2.0 * (i >= 150)
            states.append(step(states[-1]))
        assert step.differing([np.array(states)], 24) == 0
        load = 0.0
        assert 150 <= step.differing([np.array(states)], 24) < 300


def test_steps_and_functions_of_many_are_compared_and_few_are_called():
    many = np.ones((120, 2))
    for late in [False, True, True], [False, False, True]:  # as it is traced, compared, and again
        changes = iter(late)
        with pytest.raises(StepChanged):
            vmap(lambda x, changes=changes: x + next(changes))(many)
    calls = count(1.0)
    with pytest.raises(StepChanged):
        CompiledSteps(lambda x: x * next(calls), many[:1], 10, machine_code=False)(many[:1], 10)
    few = vmap(lambda x: x * next(calls))(many[:3])
    assert np.diff(few, axis=0).tolist() == [[1.0, 1.0]] * 2
    x = np.random.default_rng(1).uniform(size=(1025, 3))  # a block and one more
    np.testing.assert_array_equal(vmap(np.square)(x), x * x)


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


# --- what is not compiled ---
def runs_compiled():
    """Whether steps are compiled here."""
    step = compiled(lambda x: 0.5 * x, 100)
    step(1.0)
    return step.report.is_compiled


def test_plain_reaches_threads_that_begin_to_work_in_it_and_no_others():
    with ThreadPoolExecutor(1) as before, ThreadPoolExecutor(1) as after:
        assert before.submit(runs_compiled).result()
        with plain(), ThreadPoolExecutor(1) as inside:
            assert not inside.submit(runs_compiled).result() and not runs_compiled()
            assert before.submit(runs_compiled).result()
            with plain(False), ThreadPoolExecutor(1) as inner:
                assert not inner.submit(runs_compiled).result() and not runs_compiled()
            with ThreadPoolExecutor(1) as later:
                assert not later.submit(runs_compiled).result()
        with plain(False), ThreadPoolExecutor(1) as inside:
            assert inside.submit(runs_compiled).result()
        assert after.submit(runs_compiled).result() and runs_compiled()


def test_a_block_in_which_nothing_is_compiled_may_begin_midway():
    calls = []

    def step(x):
        calls.append(x)
        return 0.5 * x

    fast = compiled(step, 1000)
    x = np.float64(1.0)
    for _ in range(100):
        x = fast(x)
    vmap(step)(np.ones((200, 2)))
    assert len(calls) < 60
    calls.clear()
    with plain():
        for _ in range(50):
            x = fast(x)
        assert vmap(step)(np.ones((200, 2))).sum() == 200.0
    assert x == 0.5**150 and len(calls) == 250


REFUSED = {  # steps, and what is said of them
    "0.9 * x if x[0] > 0.5 else 1.1 * x": "branches",
    "0.9 * np.sort(x)": "branches",
    "x / max(x[0], x[1])": "np.maximum",
    "0.5 * np.nan_to_num(x)": "np.nan_to_num",
    "x - 0.1 * np.floor(x)": "np.floor",
    "np.multiply(x, 0.5, out=np.zeros(3))": "like=",
    "np.where(x == 1.0, 2.0, 0.5 * x)": "equal",
    "0.5 * x + (x > 0.5) * 0.1": "comparison",
    "0.5 * x if isinstance(x[0], float) else x": "kind",
    "0.5 * x * x[0].item()": "item",
    "x * np.array(x.tolist(), float)": "plain number",
    "x * math.sin(x[1]) + int(x[0])": "plain number",
    "0.1 * np.add.reduce(x) * x": "np.sum",
    "0.1 * x.sum(initial=0.5) * x": "np.sum",
}


@pytest.mark.parametrize("is_caught", [False, True])
@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_traced_runs_as_it_stands_and_names_its_line(text, is_caught):
    own = function(text, "x")

    def caught(x):
        try:
            return own(x)
        except Exception:
            return 0.5 * x

    fast = compiled(caught if is_caught else own, 10)
    start = np.array([1.0, 0.5, 0.3])
    np.testing.assert_array_equal(fast(start), own(ordered(start)))
    how = fast.report.how
    assert not fast.report.is_compiled and REFUSED[text] in how
    assert "once more" in how and f"({HERE}, line 1)" in how  # what counts or draws was called


WRONG = {  # steps of x and y, and what x is
    "x[:, None]": np.ones(3),
    "(x, y[:1])": np.ones(3),
    "None": np.ones(3),
    "(0.5 * x, y)": np.ones(3, np.float32),
    "(x, y)": np.ones(3, int),
    "(np.array(x), y)": [1.0, 1.0, 1.0],
    "2 * x": [1.0],
}


@pytest.mark.parametrize("really", [False, True])
@pytest.mark.parametrize("text", WRONG)
def test_a_state_is_of_arrays_of_float64_and_a_step_returns_their_shapes(text, really):
    with plain(really), pytest.raises(NotAState):
        compiled(function(text, "x, y"), 10)(WRONG[text], np.ones(2))


FAILING = {
    "diverged": lambda x: x * x,
    "diverged ": lambda x: 6e3 * x + 0.0 * x**20,  # compiled, what is times zero vanishes
    "not a number": lambda x: np.where(x > 3.0, np.nan, 1.1 * x),
    "divide": lambda x: x / (x - 2.5),
    "log": lambda x: np.log(x - 1.6) + 2.0,
    "scalar divide": lambda x: x + np.linalg.solve(np.outer(x, x)[:1, :1] - 2.25, x[:1]),
    "no end": lambda x: (
        20.0 + while_loop(lambda y: y[1] > 0.5, abs, x - 19.0, most=3, failure="no end")
    ),
}


@pytest.mark.parametrize("word", FAILING)
def test_a_failed_step_is_nan_and_so_are_all_after_it_and_it_says_why(word, language):
    def run(step):
        rows = [np.array([1.5, 2.5])]
        for _ in range(60):
            rows.append(step(rows[-1]))
        good = np.count_nonzero(np.isfinite(rows).all(axis=1))
        assert np.isfinite(rows[:good]).all() and np.isnan(rows[good:]).all() and good < 60
        return good, step.done().failure

    fast = compiled(FAILING[word], 6000)
    slow = compiled(FAILING[word], 6000)
    with plain():
        expected = run(slow)
    assert run(fast) == expected and fast.report.how == language
    line = f"({HERE}, line {FAILING[word].__code__.co_firstlineno})"
    assert word.strip() in expected[1]
    assert expected[1].endswith(line) == (word in ("divide", "scalar divide", "log"))


# --- what is known of it afterwards ---
def test_pythons_collector_is_off_only_while_a_step_is_compiled():
    seen = []

    def step(x):
        seen.append(gc.isenabled())
        return 0.5 * x

    compiled(step, 10)(np.ones(3))
    compiled(np.sort, 10)(np.ones(3))  # which cannot be
    vmap(step)(np.ones((100, 3)))
    assert gc.isenabled() and set(seen) == {True, False}  # its own lines, and the traces


def test_a_pace_is_that_of_most_long_stretches_and_of_all_steps_if_there_are_none():
    report = Report()
    assert math.isnan(report.pace)
    report.time(1, 3e-6)
    report.time(1, 5e-6)
    assert report.pace == pytest.approx(4.0)
    for many, seconds in ((8, 1.0), (500, 1e-3), (500, 2e-3), (500, 9.0)):  # others ran, too
        report.time(many, seconds)
    assert report.pace == pytest.approx(4.0)  # 2 ms for 500 steps
    report.go_plain("changed")
    assert math.isnan(report.pace)


def test_a_report_can_be_pickled_and_has_the_time_of_what_was_computed():
    step = compiled(fall, 4000)
    drive(step, steps=400)  # as a loop does that ends with a break
    report = pickle.loads(pickle.dumps(step.done()))
    assert report == step.report and report.is_compiled and report.source.startswith("def f(")
    assert 400 == report.steps <= report.timed <= 400 + 4000 // 8
    assert sum(many for many, _ in report.stretches) <= report.timed and report.pace > 0.0


def test_steps_of_one_block_are_compiled_alike():
    pytest.importorskip("llvmlite", reason="llvmlite is not installed")

    def kinds(*steps):
        found = []
        for many in steps:
            step = compiled(lambda x: 3.7 * x * (1.0 - x), many)
            step(X)
            found.append(step.report.how)
        return found

    python, machine = kinds(100, 10**6)
    assert (python, machine) == ("compiled to Python", "machine code")
    with plain(False):
        assert kinds(10**6, 100) == [machine, machine]
        with plain(False):
            assert kinds(100) == [machine]
    with plain(False):
        assert kinds(100, 10**6) == [python, python]
    assert kinds(100, 10**6) == [python, machine]


@pytest.mark.parametrize("text", [WRITTEN[0], WRITTEN[-1], WRITTEN[-3]])
def test_a_tape_knows_about_how_many_lines_of_python_it_becomes(text):
    step, start = step_of(text)
    program, _ = trace_loop(step, live(start))
    lines = source_of(program).count("\n")
    assert 0.8 * lines < program.tape.lines < 1.5 * lines + 10


def test_llvmlite_that_fails_is_named_each_time_and_python_takes_its_place(monkeypatch):
    binding = pytest.importorskip("llvmlite.binding", reason="llvmlite is not installed")

    def parse_assembly(text):
        raise RuntimeError("of another\nversion")

    monkeypatch.setattr(llvm, "FAILED", [])
    monkeypatch.setattr(binding, "parse_assembly", parse_assembly)
    for _ in range(2):
        step = compiled(fall, 200_000)
        np.testing.assert_array_equal(drive(step, steps=30), drive(fall, steps=30))
        assert step.report.how.endswith("RuntimeError: of another version")
        assert step.report.is_compiled


def test_it_needs_nothing_but_numpy_and_nothing_of_ours():
    loaded = python("-c", "import sys, curriculum.common.tracing; print(*sys.modules)").stdout
    others = {x for x in loaded.split() if "tracing" not in x}
    assert {x for x in others if x.startswith("curriculum")} == {"curriculum", "curriculum.common"}
    assert {x for x in others if x.partition(".")[0] in ("llvmlite", "scipy", "rerun")} == set()
