"""The engine, on functions of all kinds: compiled to Python, machine code and JavaScript."""

import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import python

from curriculum.common.tracing import (
    StepFailed,
    ahead,
    compiled,
    fori_loop,
    llvm,
    ordered,
    plain,
    vmap,
    while_loop,
)
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.trace import trace_loop

HERE = Path(__file__).name


def lorenz(x):
    """Lorenz's equations by the midpoint rule."""

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


def root(x):
    """x = (y, t): the root of y^3 + y = t as t grows, by Newton's method from the last one."""

    def off(y):
        return y * y * y + y - x[1]

    def newton(y):
        return y - off(y) / (3.0 * y * y + 1.0)

    y = while_loop(lambda y: np.abs(off(y)) > 1e-10, newton, x[0], most=30, failure="no root")
    return np.stack([y, x[1] + 0.01])


STARTS = {
    lorenz: [np.array([1.0, 2.0, 20.0])],
    spring: [np.array([[1.0, 0.0], [-0.3, 0.0]]), np.array([[0.0, 0.0], [2.0, 0.0]])],
    swing: [np.array([2.0, 0.1]), np.array([0.0, 0.5])],
    root: [np.array([0.0, 0.5])],
}


def states(step, start, steps, edit=lambda i, state: state):
    """All states of an ordinary loop (steps + 1, numbers)."""
    state, rows = tuple(start), [np.concatenate(start, axis=None)]
    for i in range(steps):
        made = step(*state)
        state = edit(i, made if isinstance(made, tuple) else (made,))
        if state is None:
            break
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
    assert fast.how == language and fast.seconds > 0.0
    program, _ = trace_loop(step, [np.ones(x.shape, bool) for x in start])
    made = node(program, expected[0].tolist(), steps)
    np.testing.assert_allclose(made, expected, tolerance, tolerance)
    np.testing.assert_allclose(states(step, start, 40), expected[:41], rtol=1e-9)


@pytest.mark.parametrize("steps", [500, 30_000])
@pytest.mark.parametrize("step", STARTS)
def test_a_step_has_the_bits_of_plain_numpy_in_every_language(step, steps, language):
    # each library rounds its sine as it likes
    check_all_alike(step, STARTS[step], steps, language, 1e-7 if step is swing else 0.0)


A = np.array([[1.0, 2.0, 0.5], [0.0, 3.0, -1.0], [0.25, 0.0, 1.0]])


KEPT = {
    "arithmetic": lambda x: (x + 1.0) * 2.0 - x / 3.0 + 1.0 / x - -x + np.add(x, 1.0, out=x.copy()),
    "entries": lambda x: np.stack([abs(x[0] - x[1]), x[2] * (x[1] - x[0]), -x[0] - x[2]]),
    "roots": lambda x: np.sqrt(x) + np.square(x) + x**2 + x**0.5 + x**-1,
    "powers": lambda x: x**3 + x**-2 + x**1.5 + 2.0**x + np.stack([x[0] ** 2, x[1] ** 3, x[2]]),
    "sines": lambda x: np.sin(x) + np.cos(x[0]) + np.tan(x) + np.arctan2(x, x[::-1] - 1.0),
    "exp": lambda x: np.exp(x) + np.log(x) + np.tanh(x),
    "bounds": lambda x: np.maximum(x, 0.9) - np.minimum(x[0], x) + np.max(np.outer(x, x), axis=1),
    "nested": lambda x: vmap(lambda t: fori_loop(2, partial(fori_loop, 2, np.square), t))(x),
    "names": lambda x: vmap(lambda t, _: fori_loop(2, lambda y: 0.5 * y + _, t))(x, x),
    "in place": lambda x: (
        x - while_loop(lambda y: y[0] > 0.5, lambda y: np.add(y, -0.1, y), x, 9, "")
    ),
    "clip": lambda x: np.clip(x, 0.6, 1.2) + np.clip(x, None, 1.1) + np.clip(x[0], 0.1, 0.2),
    "where": lambda x: np.where(x < 0.9, x, np.where(x >= 1.2, 2.0, x * x)) + (x / x.min()),
    "sums": lambda x: x / np.sum(x) + np.sum(np.outer(x, x).reshape(1, 3, 3), axis=(0, -1)),
    "means": lambda x: x - np.mean(x) + np.outer(x, x).mean(axis=1, keepdims=True).T[0],
    "products": lambda x: A @ x + x @ A + np.dot(x, x) + (A @ np.outer(x, x)).dot(x),
    "lengths": lambda x: np.cross(x, x[::-1]) + np.linalg.norm(np.outer(x, x), axis=1),
    "shapes": lambda x: np.concatenate([x[:1], np.outer(x, x)[1:, 2]]).reshape(3, 1).ravel(),
    "zeros": lambda x: np.diag(np.diag(np.outer(x, x))) @ x + np.zeros(3, like=x) + x,
    "rows": lambda x: vmap(lambda y, row: y * np.sum(row))(x, np.outer(x, x)),
    "fori_loop": lambda x: fori_loop(3, lambda y, z: (0.5 * z, y), x, 2.0 * x)[0],
    "loops in rows": lambda x: vmap(halved)(np.outer(x, np.arange(35.0)).T)[-3:, 0],
}


def halved(x):
    return while_loop(lambda x: np.max(x) > 0.5, lambda x: 0.5 * x, x, 30, "")


@pytest.mark.parametrize("name", KEPT)
def test_numpy_stays_compiled(name, language):
    def step(x):
        made = KEPT[name](x)
        return 0.7 + 0.5 * made / (1.0 + abs(made))  # between 0.2 and 1.2

    near = 1e-9 if name in ("powers", "sines", "exp") else 0.0
    check_all_alike(step, [np.array([0.7, 1.0, 1.3])], 40, language, near)


ORDERED = {
    "sums": lambda x: np.sum(x, axis=1, keepdims=True) + x.sum(axis=0) + np.mean(x, axis=-1),
    "products": lambda x: x @ x[0] + x[0] @ x + np.dot(x[0], x[1]) + x @ x,
    "choices": lambda x: x[np.argsort(x[0])] + np.sum(x > 0.5) + x[x > 0.5].sum(),
    "nothing": lambda x: x[:0].sum() + np.dot(x, 2.0) + np.stack([x, x])[0],
}


@pytest.mark.parametrize("name", ORDERED)
def test_ordered_arrays_add_from_first_to_last(name):
    x = np.random.default_rng(4).normal(size=(50, 50))
    objects = x.astype(object)  # whose sums numpy leaves in order
    np.testing.assert_array_equal(ORDERED[name](ordered(x)), ORDERED[name](objects))
    assert np.linalg.norm(ordered(x)) == np.sqrt(np.sum(objects.ravel() ** 2))
    with pytest.raises(ValueError, match="matmul"):
        ordered(x) @ x[0, :2]


def damped_in_place(i, state):
    state[1][:] *= 0.999
    return state


def printed_until_it_breaks(i, state):
    print(i, *state)
    return state if i < 60 else None


EDITS = {
    "a factor": damped_in_place,
    "a factor with i": lambda i, state: (state[0], state[1] * (1.0 + 1e-4 * np.cos(i))),
    "if i == 1000": lambda i, state: (state[0], state[1] + [0.0, float(i == 1000)]),
    "print, break": printed_until_it_breaks,
}


@pytest.mark.parametrize("edit", EDITS)
def test_what_the_loop_does_is_obeyed(edit, language, capsys):
    def obeyed(step):
        made = states(step, STARTS[spring], 1200, EDITS[edit])
        return made.tolist(), capsys.readouterr().out

    fast, slow = compiled(spring, 1100), compiled(spring, 1100)  # it may be called more often
    expected = obeyed(spring)
    assert obeyed(fast) == expected
    with plain():
        assert obeyed(slow) == expected
    assert (fast.how, slow.how) == (language, "plain numpy")


def test_a_block_in_which_nothing_is_compiled_may_begin_midway(language):
    calls = []

    def step(x):
        calls.append(x)
        return 0.5 * x

    fast, x = compiled(step, 1000), np.ones(1)
    for _ in range(100):
        x = fast(x)
    calls.clear()
    with plain():
        for _ in range(50):
            x = fast(x)
    assert len(calls) == 50 and x[0] == 0.5**150
    assert type(x) is type(fast(x)) is np.ndarray
    assert compiled(swing, 3)(np.zeros(0), np.zeros(0))[1].shape == (0,)


def test_no_steps_are_computed_but_those_asked_for(language, monkeypatch):
    made, computed = ahead.CompiledSteps, []
    rows = made.rows
    monkeypatch.setattr(made, "rows", lambda run, x, n: computed.append(n) or rows(run, x, n))
    for steps in 1, 17, 2001, 4100:
        computed.clear()
        states(compiled(swing, steps), STARTS[swing], steps)
        assert sum(computed) == steps


@pytest.mark.parametrize("changed_at, found", [(3, 4), (700, 2000), (2350, 2499)])
def test_what_is_changed_midway_is_found_and_said(changed_at, found):
    mass = {"now": 1.0}

    def step(x):
        return x + 0.1 / mass["now"] - 0.001 * x

    def change(i, state):
        mass["now"] = 1.0 if i < changed_at else 2.0
        return state

    fast = compiled(step, 2500)
    made = states(fast, [np.array([1.0])], 2500, change)
    assert f"plain numpy from step {found} on" in fast.how
    for i, x in enumerate(made[:-1]):
        mass["now"] = 2.0 if i >= found else 1.0
        np.testing.assert_array_equal(made[i + 1], step(x))


def endless(x, most=30):
    x = x + 1.0
    return while_loop(lambda y: np.max(y) > 19.5, lambda y: y + 1.0, x, most, "no end")


FAILING = [
    lambda x: x * x,
    lambda x: 1.0 / (x - x),
    lambda x: np.log(-x),
    lambda x: 1e9 * x + 0.0 * (x * x),  # compiled, what is multiplied by zero vanishes
    endless,
    lambda x: np.where(np.abs(endless(x) - x) < 10.0, endless(x), x + 1.0),  # NaN is not less
    lambda x: (endless(x), x + 1.0)[1],
]


@pytest.mark.parametrize("step", FAILING)
def test_a_step_that_fails_ends_the_run_and_says_why(step, language):
    def end(step):
        made = []
        with pytest.raises(StepFailed) as why:
            states(step, [np.array([1.5, 2.5])], 100, lambda i, state: made.append(state) or state)
        assert np.isfinite(made).all()
        return len(made), str(why.value)

    with plain():
        expected = end(compiled(step, 100))
    assert end(compiled(step, 100)) == expected
    assert expected[1] == ("no end" if step in FAILING[-3:] else "diverged")


@pytest.mark.parametrize("many", [None, 3, 300])
def test_an_error_of_a_readers_function_is_raised_in_its_line(many):
    def wrong(x):
        return x + "one"

    with pytest.raises(TypeError) as why:
        vmap(wrong)(np.ones((many, 2))) if many else compiled(wrong, 100)(np.ones(2))
    assert why.traceback[-1].path.name == HERE


def branching(x):
    if x[0] > 0.5:
        return 0.9 * x
    return 1.1 * x


REFUSED = {
    "branches": branching,
    "np.sort": lambda x: 0.9 * np.sort(x),
    "np.linalg.solve": lambda x: np.linalg.solve(np.eye(3) * 2.0, x),
    "np.floor": lambda x: x - 0.1 * np.floor(x),
    "equal": lambda x: np.where(x == 1.0, 2.0, 0.5 * x),
    "comparison": lambda x: 0.5 * x + (x > 0.5) * 0.1,
    "plain number": lambda x: np.array([float(x[0]), 0.5, 0.3]),
    "other shapes": lambda x: x[:, None],
}


@pytest.mark.parametrize("word", REFUSED)
def test_what_cannot_be_traced_runs_as_it_stands_and_names_its_line(word):
    step, start = compiled(REFUSED[word], 10), np.array([1.0, 0.5, 0.3])
    np.testing.assert_array_equal(step(start), REFUSED[word](start))
    assert step.how.startswith("plain numpy: ") and word in step.how
    if word != "other shapes":
        line = re.search(rf"\({HERE}, line (\d+)\)$", step.how)[1]
        assert int(line) - REFUSED[word].__code__.co_firstlineno in (0, 1)


def test_a_crowd_has_the_bits_of_its_members(language):
    def body(x, most):
        x = lorenz(x)
        return x, np.maximum(most, np.max(np.abs(x)))

    x = np.random.default_rng(1).normal(size=(137, 3)) + [0.0, 0.0, 20.0]
    every = np.array([states(lorenz, [start], 20)[1:] for start in x])
    for run in partial(fori_loop, 20, vmap(body)), vmap(partial(fori_loop, 20, body)):
        end, most = run(x, np.zeros(137))
        np.testing.assert_array_equal(end, every[:, -1])
        np.testing.assert_array_equal(most, np.max(np.abs(every), axis=(1, 2)))


def test_members_leave_a_loop_each_in_its_turn(language):
    def halvings(x):
        def body(state):
            return np.stack([0.5 * state[0], state[1] + 1.0])

        state = np.stack([x, 0.0 * x])
        return while_loop(lambda state: state[0] > 1.0, body, state, 30, "")[1]

    turns = np.arange(5000.0) % 131.0 - 10.0
    expected = np.where(turns < 30.0, np.maximum(turns, 0.0), np.nan)  # which have not ended
    np.testing.assert_array_equal(vmap(halvings)(2.0**turns), expected)


def test_it_needs_nothing_but_numpy_and_nothing_of_ours():
    loaded = python("-c", "import sys, curriculum.common.tracing; print(*sys.modules)").stdout
    others = {x for x in loaded.split() if "tracing" not in x}
    assert {x for x in others if x.startswith("curriculum")} == {"curriculum", "curriculum.common"}
    assert "llvmlite" not in others


def test_few_steps_of_a_long_program_are_not_built():
    assert not llvm.repays(operations=10**7, lines=10_000)
    assert llvm.repays(operations=10**9, lines=10_000)


@pytest.mark.parametrize("found", [None, "broken"])
def test_without_llvmlite_all_is_the_same(found, monkeypatch):
    monkeypatch.setattr(llvm, "FAILED", [])
    monkeypatch.setattr(llvm, "START", -np.inf)
    monkeypatch.setattr(llvm, "find_spec", lambda name: found)
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    step, expected = compiled(lorenz, 100), states(lorenz, STARTS[lorenz], 100)
    np.testing.assert_array_equal(states(step, STARTS[lorenz], 100), expected)
    assert step.how == "compiled to Python"
    crowd = np.tile(STARTS[lorenz], (200, 1))
    np.testing.assert_array_equal(fori_loop(100, vmap(lorenz), crowd)[7], expected[-1])
