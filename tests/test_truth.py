"""The true motion: where other equations put the particles, and unknown where nobody can tell."""

import math
from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from independent import motion
from machines import GRAPHS, QUICK, at_random, four_bar, make_system, parallelogram, row, thrown

import constraints as c
from curriculum.ch3_4_constraints.rods import truth
from curriculum.ch3_4_constraints.rods.choice import known_path
from curriculum.ch3_4_constraints.rods.truth import MAX_RODS, Path, find_truth
from curriculum.common.tracing import Report

SCENES = *c.CHAINS, "fourbar_coupler", "jansen_leg"


def run_of(steps, dt=0.005, unlike=None, is_compiled=True):
    """What the true motion asks of a run."""
    q = np.zeros((steps + 1, 1, 3))
    return SimpleNamespace(dt=dt, q=q, unlike=unlike, report=Report(is_compiled=is_compiled))


def truth_of(system, dt=0.005, steps=4000, **how):
    system = c.rods.check_system(system, c.PIVOT)
    return find_truth(c.this_chapter(), system, [run_of(steps, dt, **how)])


SCALED = ("double", 2.0**-10, 1.0), ("double", 1.0, 2.0**10)


@pytest.mark.parametrize(("name", "size", "gravity"), [*product(SCENES, [1.0], [1.0]), *SCALED])
def test_the_true_motion_is_where_another_integrator_puts_it(name, size, gravity):
    """In metres and millimetres, and under a load of 1023 weights: then times are 1/32."""
    system = c.build_system(name)
    (expected,) = motion(system, [2.0])
    system = system | {key: size * system[key] for key in ("q0", "lengths", "anchors")}
    system["load"] = (gravity - 1.0) * c.GRAVITY * system["m"]
    found = truth_of(system, 0.005 * math.sqrt(size / gravity), 400)
    assert np.max(np.abs((found.q / size - expected)[:, :2])) < 1e-12  # it drifts along z
    assert found.step == 400 and found.uncertainty < 1e-11


THROWN = [
    *product([1.0], (20, 450), (0.01, 0.1)),
    (1, 3000, 0.01),
    (1e-6, 2e4, 1e-3),
    (1e3, 0.7, 2),
]


@pytest.mark.parametrize(("length", "speed", "time"), THROWN)
def test_a_thrown_pendulum_is_within_the_uncertainty(length, speed, time):
    """The angle is 2 am(speed t / 2, k), k^2 = 4 g / (L speed^2), thrown from the bottom."""
    special = pytest.importorskip("scipy.special", reason="scipy is not installed")
    sn, cn, *_ = special.ellipj(0.5 * speed * time, 4.0 * 9.81 / (length * speed * speed))
    exact = length * np.array([2.0 * sn * cn, sn * sn - cn * cn, 0.0])
    pendulum = make_system([[0, -length, 0]], row(1), v=[[speed * length, 0, 0]])
    found = truth_of(pendulum, time / 20.0, 20)
    assert np.linalg.norm(found.q[0] - exact) <= found.uncertainty < 1e-9


@pytest.mark.parametrize("far", [1e3, 1e4])
def test_far_from_the_origin_it_is_as_sure_as_rounding_lets_it_be(far):
    near = truth_of(make_system([[0.6, -0.8, 0.0]], row(1)))
    found = truth_of(make_system([[0.6 + far, -0.8, 0.0]], row(1), [[far, 0.0, 0.0]]))
    off = np.linalg.norm(found.q - [far, 0.0, 0.0] - near.q)
    assert off <= found.uncertainty + near.uncertainty < 1e-9
    assert found.uncertainty > 10.0 * near.uncertainty


@pytest.mark.parametrize("shift", [0.0, 1.0, 1e4])
def test_a_bob_at_rest_stays_wherever_the_origin_is(shift):
    anchors = [[-0.3, 0.7, 0.2], [0.6, 0.5, -0.4], [0.0, 0.9, 0.1]]
    for held in (anchors, [[0.0, 1.0, 0.0]]):
        pairs = [(0, -1 - k) for k in range(len(held))]
        still = make_system(np.add([[0, 0, 0]], shift), pairs, np.add(held, shift))
        found = truth_of(still)
        assert np.max(np.abs(found.q - still["q0"])) < 1e-15 + found.uncertainty < 1e-9


def nothing(q, v):
    return 0.0


def drag(q, v):
    return -0.3 * v * np.sqrt(np.sum(v * v))


MOTIONS = [(thrown(at_random(pairs)), 0.2, nothing) for pairs in GRAPHS]
MOTIONS += [(thrown(at_random(row(3))), 0.3, drag)]
MOTIONS += [(QUICK, 0.01, nothing), (four_bar(), 0.4, nothing)]


@pytest.mark.parametrize(("system", "time", "others"), MOTIONS)
def test_motion_in_space_under_loads_and_a_readers_force_is_as_another_integrator_says(
    system, time, others, monkeypatch
):
    usual = c.external_force
    monkeypatch.setattr(
        c, "external_force", lambda system, q, v: usual(system, q, v) + others(q, v)
    )
    found = truth_of(system, time / 20.0, 20)
    off = np.linalg.norm(found.q - motion(system, [time], others)[-1], axis=1)
    assert np.max(off) < 1e-10 + found.uncertainty < 2e-10


def test_it_is_of_the_longest_run_and_of_two_seconds_at_most_or_twenty_swings_of_a_short_rod():
    double = c.build_system("double")
    runs = [run_of(steps, 0.01) for steps in (10, 90, 40)]  # two were lost
    found = find_truth(c.this_chapter(), double, runs)
    assert found.step == 90 and found.error(runs[0].q) is None
    where = np.repeat(found.q[None], 91, axis=0)
    where[-1, 1] = where[-1, 1] + [0.03, 0.0, -0.04]
    assert found.error(where) == pytest.approx(0.05)
    assert truth_of(double, 0.01, 1000).step == 200
    short = make_system([[0.004, 0, 0]], row(1))
    assert truth_of(short, 1e-4, 9999).step == round(20.0 * math.sqrt(0.004 / 9.81) / 1e-4)


# --- what is not known ---
def circled(q, length):
    """q (3,) moved along its rod to a length."""
    return length * np.array(q) / np.linalg.norm(q)


@pytest.mark.parametrize("digits", [4, 6])
def test_where_rods_do_not_fit_both_readings_of_the_start_are_within_the_uncertainty(digits):
    """Lengths may be right, and places rounded; or places right, and lengths rounded."""
    first = circled([0.6, -0.2, 0.5], 0.7)
    second = first + circled([0.1, -0.8, -0.3], 0.4)
    typed = make_system(np.round([first, second], digits), row(2), m=[2.0, 0.3])
    moved = circled(typed["q0"][0], 0.7)
    moved = np.array([moved, moved + circled(typed["q0"][1] - typed["q0"][0], 0.4)])
    found = truth_of(typed | {"lengths": np.array([0.7, 0.4])}, 0.01, 100)
    readings = [typed, typed | {"q0": moved, "lengths": np.array([0.7, 0.4])}]
    off = [np.max(np.linalg.norm(found.q - motion(x, [1.0])[-1], axis=1)) for x in readings]
    assert 1e-9 < max(off) < found.uncertainty + 1e-10 < 10.0 ** (2 - digits)


def test_a_parallelogram_goes_through_its_flat_pose_only_if_its_numbers_close_exactly():
    """Then its bobs swing as one pendulum does; else it may go on with its cranks crossed."""
    exact = truth_of(parallelogram(0.0), 0.005, 200)
    pendulum = make_system([[-1.2, -1.6, 0.0]], row(1), v=[6.4, -4.8, 0.0])
    expected = motion(pendulum, [1.0])[-1] + [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
    assert np.max(np.abs(exact.q - expected)) < 1e-9
    lengths = np.array([2.0, 3.0, 2.0])
    turned = parallelogram(0.0) | {"pairs": [(0, -1), (0, 1), (1, -2)], "lengths": lengths}
    assert np.max(np.abs(truth_of(turned, 0.005, 200).q - expected)) < 1e-9
    for off in (1e-12, 1e-9):
        assert truth_of(parallelogram(off), 0.005, 200).q is None
        assert truth_of(parallelogram(off), 0.005, 20).q is not None  # it is not there in 0.1 s


def broken(force):
    """A chapter whose force is force(q, v)."""
    return c.this_chapter()._replace(make_force=lambda system: force)


def far(x):
    """A pendulum that is x m away."""
    return make_system([[x + 1, 0, 0]], row(1), [[x, 0, 0]])


UNKNOWN = {  # a word of the reason: the system, and what else is so
    "rounding": (far(1e5), {}),
    "known to": (far(1e8), {}),  # where x is rounded to 15 nm
    "converge": (c.build_system("peaucellier"), {}),
    f"{MAX_RODS} rods": (c.build_system("chain", links=MAX_RODS + 1), {}),
    "20,000": (make_system([[0, -1, 0]], row(1), v=[[1e5, 0, 0]]), {}),
    "not compiled": (c.build_system("double"), {"is_compiled": False}),
    "changes m": (c.build_system("double"), {"unlike": "its loop changes m from step 3 on"}),
    "in line": (parallelogram(1e-14), {"steps": 200}),
    "fit": (make_system([[0.6, -0.8, 0]], row(1)) | {"lengths": np.array([1.01])}, {}),
}


@pytest.mark.parametrize(("word", "case"), UNKNOWN.items())
def test_where_it_is_not_known_a_reason_says_why(word, case):
    system, how = case
    found = truth_of(system, **how)
    assert found.q is None and word in found.why


def test_of_as_many_rods_as_may_be_it_is_known(monkeypatch):
    monkeypatch.setattr(truth, "MAX_RODS", 2)
    assert truth_of(c.build_system("double")).q is not None


def test_a_force_that_is_not_a_number_or_branches_leaves_it_unknown():
    double = c.build_system("double")
    for word, force in {"number": lambda q, v: np.nan * q, "compiled": branching}.items():
        found = find_truth(broken(force), double, [run_of(100)])
        assert found.q is None and word in found.why


def branching(q, v):
    return q if q[0, 1] < -1 else -q


# --- the path ---
@pytest.mark.parametrize("name", SCENES)
def test_the_path_is_known_at_all_times(name):
    system = c.build_system(name)
    path, why = known_path(c.this_chapter(), system, 0.005, 4000, None)
    assert why == "" and path.seconds == 2.0 and 256 < len(path.q) <= 513
    expected = motion(system, np.arange(len(path.q)) * path.grid)
    assert np.max(np.abs((path.q - expected)[..., :2])) < 1e-12 + path.uncertainty < 1e-10


def test_a_run_is_off_by_the_worst_of_all_times_that_its_steps_share_with_the_path():
    """The path is known at 0, 0.1, ... 0.8 s, and x is the time; a run's x is off by some of it."""
    times = 0.1 * np.arange(9)
    path = Path(0.1, times[:, None, None] * [1.0, 0.0, 0.0], 0.0)

    def off(dt, steps, part, errors):
        x = dt * float(part) * np.arange(steps + 1.0)
        for k, error in errors.items():
            x[k] += error
        return path.off(x[:, None, None] * [1.0, 0.0, 0.0], dt, part)

    whole = Fraction(1)
    assert off(0.1, 8, whole, {5: 0.3, 8: 0.1}) == pytest.approx(0.3)  # not the last
    assert off(0.05, 16, whole, {5: 9.0, 6: -0.2}) == pytest.approx(0.2)  # 0.25 s is not known
    assert off(0.2, 4, whole, {3: 0.4}) == pytest.approx(0.4)
    assert off(0.2, 3, whole, {}) == math.inf  # it was lost before
    assert off(0.1, 11, Fraction(3, 4), {4: 0.5, 5: 9.0}) == pytest.approx(0.5)
    assert off(0.1, 8, whole, {3: math.nan}) == math.inf
    assert Path(0.1).off(times, 0.1) is None
