"""The unroller: what it compiles computes what the function computes, to the last bit, and it knows
when it cannot."""

import math
import operator
from itertools import chain

import constraints as c
from curriculum.ch3_4_constraints.recording import pulls
from curriculum.ch3_4_constraints.studies._runs import make_system, run, scene
from curriculum.common.arrays import ArrayFunction
from curriculum.common.loops import repeat
from curriculum.common.motion import Motion, Unrolled, followed, source
from curriculum.common.trace import FUNCTIONS, Program, Untraceable

import numpy as np
import pytest


class Number:
    """A Python float that numpy can ask for its square root, as it asks the entries of an object
    array."""

    def __init__(self, x):
        self.x = float(x)

    def __abs__(self):
        return Number(abs(self.x))

    def __neg__(self):
        return Number(-self.x)

    def __le__(self, other):
        return self.x <= other


def number(x):
    return x.x if isinstance(x, Number) else float(x)


OPERATIONS = {name: getattr(operator, name) for name in ("add", "sub", "mul", "truediv", "pow")}
for name, operation in OPERATIONS.items():

    def method(operation, swapped):
        def apply(a, b):
            if isinstance(b, np.ndarray) and b.ndim:
                return NotImplemented
            if type(b) is int and b == 0 and operation is OPERATIONS["mul"]:
                return 0  # the zeros of J, of which there are many
            a, b = (b, a) if swapped else (a, b)
            return Number(operation(number(a), number(b)))

        return apply

    setattr(Number, f"__{name}__", method(operation, False))
    setattr(Number, f"__r{name}__", method(operation, True))
for name in FUNCTIONS:
    setattr(Number, name, lambda a, name=name: Number(getattr(math, name)(a.x)))


def of_numbers(function, *arrays):
    """The results of the same lines on object arrays of Python's floats."""
    results = function(*(np.vectorize(Number, otypes=[object])(a) for a in arrays))
    return [np.vectorize(number, otypes=[float])(a) for a in results]


def nothing_still(*arrays):
    return [np.zeros(a.shape, dtype=bool) for a in arrays]


def heron(x):
    """Square roots of positive numbers by Heron's rule, until they settle: a loop that has nothing
    to do with rods."""

    def body(y):
        following = 0.5 * (y + x / y)
        return following, np.sum((following - y) * (following - y)) / 1e-20

    return (repeat(body, 1.0 + 0.0 * x, 50, "no root"),)


EXAMPLES = {
    "polynomial": lambda x: (1.0 - 2.0 * x + x * x * x / 3.0, -x),
    "matrix": lambda x: (x @ x.T @ np.array([[0.0, 1.0], [2.0, 3.0]]), x.sum(axis=0) / 7.0),
    "functions": lambda x: (
        np.sin(x) * np.exp(-x) + np.sqrt(x) ** 3,
        np.tanh(-x) - np.log(x) ** 2.0,
        abs(-x),
    ),
    "by parts": lambda x: (
        np.concatenate([x[:1] - x[1:], x[1:] - x[:1]]),
        2.0 / (x + 1.0) - (x - x),
    ),
    "powers": lambda x: ((x**3.0) ** 2.0, 2.0 ** (x**2.0), (-x) ** 2.0 - -(x**2.0)),
    "roots": heron,
}


OF_LIBRARIES = "functions", "powers"


@pytest.mark.parametrize("name", EXAMPLES)
def test_any_function_of_small_arrays_is_compiled_exactly(name):
    x = np.array([[0.3, 1.7, 2.9], [0.011, 5.5, 3.3]])
    program, expected = Unrolled(EXAMPLES[name], *nothing_still(x)), of_numbers(EXAMPLES[name], x)
    stacked, plain = program(np.stack([x, 0.5 * x + 0.1, x])), EXAMPLES[name](x)
    for exact, number, array, numpy in zip(expected, program(x), stacked, plain, strict=True):
        assert np.array_equal(number, exact) and np.allclose(numpy, exact, rtol=1e-13, atol=1e-13)
        for member in (array[0], array[2]):  # numpy's sine and powers are its own
            assert (
                np.allclose(member, exact, rtol=1e-14)
                if name in OF_LIBRARIES
                else np.array_equal(member, exact)
            )


def test_a_loop_in_arrays_stops_each_member_where_it_would_stop_alone():
    x = np.array([[[1e-6, 4.0, 9.0]], [[2.0, 2.0, 2.0]], [[1e8, 1.0, 1e-8]]])
    roots = Unrolled(heron, *nothing_still(x[0]))
    for together, alone in zip(roots(x)[0], x, strict=True):
        assert np.array_equal(together, roots(alone)[0])
    assert np.allclose(roots(x)[0], np.sqrt(x), rtol=1e-12)


def test_a_loop_changes_all_it_changes_at_once():
    """What follows may be made of what is replaced; and the size that ends it may be a negative
    number."""

    def body(x):
        return np.array([[0.5 * x[0, 1], x[0, 0]]]), -(5.0 - x[0, 0] - x[0, 1])

    loop = Unrolled(lambda x: (repeat(body, x, 50, "no end"),), np.zeros((1, 2), dtype=bool))
    x = np.array([[[8.0, 3.0]], [[0.5, 0.5]], [[-3.0, 90.0]]])
    for together, alone in zip(loop(x)[0], x, strict=True):
        assert np.array_equal(together, loop(alone)[0]) and np.array_equal(
            together, repeat(body, alone, 50, "no end")
        )


def test_a_loop_that_does_not_end_says_so():
    with pytest.raises(FloatingPointError, match="no root"):
        Unrolled(heron, *nothing_still(np.ones((1, 1))))(np.array([[1e40]]))


def test_what_is_not_needed_is_not_done():
    """Products with zero, with one, repeated ones and those that nobody asks for vanish."""
    still = [np.array([[False, False, True]])]
    program = Program(
        lambda x: ((x * np.array([[0.0, 1.0, 5.0]])).sum() * 1.0 + 0.0 * (x / 3.0),), *still
    )
    assert program.inputs == ["x_0_0", "x_0_1"]
    assert not program.tape.ancestry([s for a in program.results for s in a.flat])
    twice = Program(lambda x: (x * 2.5 + 1.0, 2.5 * x + 1.0), np.zeros((1, 1), dtype=bool))
    assert [sign for sign, *_ in twice.tape.nodes.values()] == ["*", "+"]


@pytest.mark.parametrize(
    "function",
    [
        lambda q, v: q if q[0, 0] > 0.0 else -q,
        lambda q, v: np.where(q > 0.0, q, v),
        lambda q, v: np.maximum(q, v),
        lambda q, v: float(q[0, 0]) * v,
        lambda q, v: q / np.linalg.norm(v, axis=-1, keepdims=True),
        lambda q, v: np.arcsinh(q),
    ],
)
def test_a_force_that_cannot_be_traced_runs_in_plain_numpy_with_the_same_answer(
    function, monkeypatch
):
    system = c.build_system("double")
    system["v0"] = np.ones_like(system["q0"]) * [0.0, 1.0, 0.0]
    monkeypatch.setattr(
        c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY + 0.1 * function(q, v)
    )
    with np.errstate(all="ignore"):
        found = run(system, "semi_implicit", "none", steps=20)
        assert found.way.startswith("in plain numpy, which is slower: ")
        q, v, force = system["q0"], system["v0"], c.make_force(system, 0.0)
        for _ in range(20):
            q, v = c.semi_implicit_step(q, v, system["m"], force, 0.005)
    assert np.array_equal(found.q[-1], q) and np.array_equal(found.v[-1], v)


@pytest.mark.parametrize("branches", [True, False])
def test_a_motor_on_one_particle_is_felt_by_that_state_alone(branches, monkeypatch):
    """f (N, 3) is a force of one state, also where many states are at hand: to the stages of gauss,
    in a recording."""

    def motor(system, q, v):
        f = system["m"] * c.GRAVITY + 0.0 * v
        f[1, 0] = f[1, 0] - 3.0 * v[0, 0] * (2.0 if branches and q[0, 0] > 0.5 else 1.0)
        return f

    monkeypatch.setattr(c, "external_force", motor)
    system, holds = c.build_system("double"), c.hold_table()
    runs = {"none": run(system, "rk4", "none", 0.002, 100, range(0, 101, 20))}
    truth = run(system, "gauss", "none", 0.02, 10)
    assert np.abs(truth.q[-1] - runs["none"].q[-1]).max() < (1e-4 if branches else 1e-9)
    alone = [
        c.tensions(system, *state, holds["none"])
        for state in zip(runs["none"].q, runs["none"].v, strict=True)
    ]
    assert np.allclose(
        pulls(c.tensions, system, runs, holds)["none"], alone, rtol=1e-12, atol=1e-12
    )


def test_a_force_that_draws_random_numbers_is_not_frozen(monkeypatch):
    system, rng = c.build_system("double"), np.random.default_rng(0)
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * rng.normal(size=3))
    assert "the same thing each time" in run(system, steps=3).way


def test_drag_and_wind_run_at_full_speed(monkeypatch):
    system = c.build_system("triple")

    def drag(system, q, v):
        speed = np.sqrt(np.sum(v * v, axis=-1, keepdims=True) + 1e-12)
        return system["m"] * c.GRAVITY - 0.2 * speed * v + np.sin(q) * np.array([0.1, 0.0, 0.0])

    monkeypatch.setattr(c, "external_force", drag)
    unrolled = run(system, "rk4", "baumgarte", steps=100)
    assert unrolled.way == "unrolled"
    q, v, force = system["q0"], system["v0"], c.make_force(system, 20.0)
    for _ in range(100):
        q, v = c.rk4_step(q, v, system["m"], force, 0.005)
    assert np.abs(unrolled.q[-1] - q).max() < 1e-12


SCENES = [
    "heavy_tip",
    "light_tip",
    "spin",
    "upright",
    "windows",
    "braced",
    "cable",
    "jansen_leg",
    "fourbar_coupler",
]


@pytest.mark.parametrize("mode", c.hold_table())
@pytest.mark.parametrize("name", [*c.SYSTEMS, *SCENES])
def test_every_step_is_compiled_to_the_last_bit(name, mode):
    """Numbers and arrays, against the same lines on Python's floats, and to rounding against
    numpy's own."""
    system = c.build_system(name) if name in c.SYSTEMS else scene(name)
    hold, q, v = c.hold_table()[mode], system["q0"], system["v0"]
    for rule in ("euler", "semi_implicit", "rk4"):
        step, force = followed(c.INTEGRATORS[rule], hold.after, system), c.make_force(system, hold)

        def one(q, v, step=step, force=force, system=system):
            return step(q, v, system["m"], force, 0.005)

        expected, plain = of_numbers(one, q, v), one(q, v)
        still = Motion(step, system["m"], force, 0.005, q, v).still
        for stack in (slice(0, 0), slice(0, 3)):
            states = (np.stack([x, x, x])[stack] if stack.stop else x for x in (q, v))
            for found, right in zip(Unrolled(one, *still)(*states), expected, strict=True):
                assert np.array_equal(found, np.broadcast_to(right, found.shape))
        scale = max(np.abs(x).max() for x in expected)
        assert max(np.abs(a - b).max() for a, b in zip(expected, plain, strict=True)) < 1e-9 * scale


def test_the_generated_code_is_names_of_operations_and_floats_only():
    """A scene file stays data: whatever it is called and holds, the code has names of places and
    numbers."""
    for name in ("windows", "light_tip"):
        system, hold = scene(name), c.hold_table()["project"]
        written = source(
            followed(c.rk4_step, hold.after, system), system, c.make_force(system, hold), 0.01
        )
        words = set(chain.from_iterable(line.split() for line in written.splitlines()))
        assert "__" not in written and "import" not in words and name not in written


def test_the_step_of_the_pendulum_is_the_textbook_formula():
    system = c.build_system("pendulum")
    written = source(c.semi_implicit_step, system, c.make_force(system, 0.0), 0.005)
    assert len(written.splitlines()) <= 12
    assert "v_0_0 * v_0_0 + v_0_1 * v_0_1" in written and "q_0_0 * q_0_0 + q_0_1 * q_0_1" in written


def test_what_stays_zero_is_not_modelled_and_what_does_not_is():
    planar, spatial = c.build_system("double"), c.build_system("double")
    spatial["v0"] = spatial["v0"] + [0.0, 0.0, 0.1]
    for system, axes in ((planar, 2), (spatial, 3)):
        motion = Motion(
            c.semi_implicit_step,
            system["m"],
            c.make_force(system, 0.0),
            0.005,
            system["q0"],
            system["v0"],
        )
        assert len(motion.live) == 2 * 2 * axes
    assert np.abs(run(spatial, steps=100).q[-1][:, 2]).max() > 1e-3


EDITS = [("m", [[3.0], [1.0]]), ("lengths", [1.0, 0.999]), ("pairs", [(0, -1), (1, -1)])]


@pytest.mark.parametrize("key, value", EDITS)
def test_an_edited_system_is_obeyed(key, value):
    """By the force already made and by the next run."""
    system = c.build_system("double")
    force, before = c.make_force(system, 20.0), run(system, hold=20.0, steps=10)
    was = force(system["q0"], system["v0"])
    system[key] = value if key == "pairs" else np.array(value)
    assert not np.allclose(force(system["q0"], system["v0"]), was)
    assert not np.allclose(run(system, hold=20.0, steps=10).q[-1], before.q[-1])


def test_a_dict_typed_by_hand_runs():
    system = {
        "q0": np.array([[1.0, 0.0, 0.0]]),
        "v0": np.zeros((1, 3)),
        "m": np.ones((1, 1)),
        "pairs": [(0, -1)],
        "lengths": np.ones(1),
    }
    tip, violations, energies, *_ = c.simulate(
        c.rk4_step, system, c.make_force(system, 0.0), 0.005, 100
    )
    assert tip.shape == (101, 3) and violations.shape == energies.shape == (101,)
    assert violations.max() < 1e-8 and np.ptp(energies) < 1e-6


def test_an_integrator_of_ones_own_may_branch():
    """Then its force is unrolled, and what it computes is what plain lines compute."""
    system = c.build_system("double")

    def careful(q, v, m, force, dt):
        a = force(q, v) / m
        if np.abs(a).max() > 15.0:
            return c.rk4_step(q, v, m, force, dt)
        return q + dt * v, v + dt * a

    found = run(system, careful, 0.0, steps=200)
    assert (
        found.way
        == "the force unrolled, the step not: it branches on a value, or wants one as a plain number"
    )
    q, v, force = system["q0"], system["v0"], c.make_force(system, 0.0)
    for _ in range(200):
        q, v = careful(q, v, system["m"], force, 0.005)
    assert np.abs(found.q[-1] - q).max() < 1e-10


def test_few_buffers_hold_what_a_step_of_many_members_needs():
    still = [np.tile([False, False, True], (2, 1))] * 2
    system = c.build_system("double")
    force = c.make_force(system, 0.0)
    program = Program(lambda q, v: c.rk4_step(q, v, system["m"], force, 0.005), *still)
    assert ArrayFunction(program).count < 0.2 * len(program.tape.nodes)


def test_the_unroller_refuses_what_a_symbol_cannot_do():
    with pytest.raises(Untraceable, match="branches on a value"):
        Program(lambda x: (x * (x[0, 0] == 1.0),), np.zeros((1, 1), dtype=bool))


def test_zero_lengths_of_time_and_far_away_systems(monkeypatch):
    """`project` asks for no more than rounding allows: ten kilometres away a rod is right to 1e-12
    m or so."""
    system = c.build_system("double")
    far = np.array([1e4, -3e3, 0.0])
    moved = make_system(
        system["q0"] + far, system["v0"], [1.0, 1.0], system["pairs"], system["lengths"], [far]
    )
    here, there = (run(s, "rk4", "project", 0.005, 400) for s in (system, moved))
    assert not there.stopped and np.abs(there.q[-1] - far - here.q[-1]).max() < 1e-6
