"""The physics: forces against other formulations, motions against closed forms."""

import math
import pickle
import re
from functools import partial
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from independent import acceleration, motion, smallest_pulls, weight
from machines import BLOCK, GRAPHS, LINKAGE, TRIPLE, at_random, cable, make_system, row

import constraints as c
from curriculum.ch3_4_constraints.rods.run import conserving, largest_force
from curriculum.ch3_4_constraints.rods.stability import grows, stability_limit
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.ch3_4_constraints.rods.truth import Truth
from curriculum.common.errors import Refused
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import NotAState, compiled


# --- the force ---
def asked(dt=0.005):
    """Of gddot by each method: Jdot v, damping, stiffness, regularization."""
    tau = max(0.02, 2.0 * dt)  # s
    return {
        "none": (1.0, 0.0, 0.0, 0.0),
        "baumgarte": (1.0, 40.0, 400.0, 0.0),  # w = 20 rad/s
        "impulse": (0.0, 1.0 / dt, 1.0 / dt**2, 0.0),
        "soft": (0.0, 2.0 / (0.95 * tau), 1.0 / (0.95 * tau**2), 0.05 / 0.95),  # p = 0.95
        "project": (1.0, 0.0, 0.0, 0.0),
    }


TIGHT = [(2, 1e-4, 1.0), (12, 0.02, 1000.0), (50, 0.001, 1.0), (150, 0.001, 1000.0)]


@pytest.mark.parametrize("dt", [0.005, 0.03])
@pytest.mark.parametrize("name", asked())
def test_the_force_is_that_of_the_least_constraint(name, dt):
    """On trees and loops, their rods right or too long, under loads, and on tight cables."""
    rng = np.random.default_rng(4)
    systems = [c.build_system("braced"), *(cable(*how) for how in TIGHT)]  # one has a rod too many
    for pairs, stretch in product(GRAPHS, (1.0, 1.02)):
        system = at_random(pairs)
        load = 20.0 * rng.normal(size=system["q0"].shape)  # N
        systems.append(system | {"lengths": system["lengths"] / stretch, "load": load})
    for system in systems:
        expected = acceleration(system, weight(system), *asked(dt)[name])
        force = c.make_methods(dt)[name].make_force(system)
        off = force(system["q0"], system["v0"]) / system["m"] - expected
        # a cable pulls with up to 2,500 times its weight, and A, in which the pose is squared,
        # is rounded
        assert np.max(np.abs(off)) < 1e-7 * max(9.81, np.max(np.abs(expected)))


def test_a_rod_pulls_with_the_weight_and_the_centripetal_load_and_a_strut_pushes():
    """At the bottom that is m (g + v^2 / L). Without anchors a bob hangs on the pivot."""
    below = make_system([[0, -2, 0]], row(1), v=[[3, 0, 0]], m=4)
    del below["anchors"]
    above = make_system([[0.0, 1.5, 0.0]], row(1), m=4.0)
    for system, expected in ((below, 4.0 * (9.81 + 4.5)), (above, -4.0 * 9.81)):
        pulls = c.tensions(system, system["q0"], system["v0"], c.make_force(system))
        assert pulls == pytest.approx([expected])


REDUNDANT = {
    "cranks": TRIPLE | {"m": np.array([[3.0], [0.2], [1.0]])},
    "a block in space": at_random(BLOCK) | {"v0": np.zeros((5, 3))},  # one rod too many
}


@pytest.mark.parametrize("dt", [0.005, 2e-5])
@pytest.mark.parametrize("name", REDUNDANT)
def test_the_pulls_of_redundant_rods_are_the_smallest_that_give_the_force(name, dt):
    system = c.rods.check_system(REDUNDANT[name], c.PIVOT)
    for method, wanted in asked(dt).items():
        run = c.run_method(system, method, "semi_implicit", dt, 40)
        force = c.make_methods(dt)[method].make_force(system)
        for k in (0, 17, 40):
            now = system | {"q0": np.array(run.q[k]), "v0": np.array(run.v[k])}
            found = c.tensions(system, run.q[k], run.v[k], force)
            held = now["m"] * acceleration(now, weight(now), *wanted) - weight(now)
            expected = smallest_pulls(now, held)
            assert np.max(np.abs(found - expected)) < 1e-4 * np.max(np.abs(expected))


def force_of(run, system, name, dt):
    """The largest force in N of a run under a method, as the table has it."""
    return c.summary(system, run, c.make_methods(dt)[name], Truth(1, ""))["tension_max"]


@pytest.mark.parametrize("dt", [0.001, 0.005])
def test_windows_that_fall_through_their_flat_pose_pull_with_what_a_pendulum_does(dt):
    """All bobs share one acceleration, so couplers carry nothing: m (5 g + v^2) at the bottom."""
    system = c.build_system("windows")
    run = c.run_method(system, "project", "rk4", dt, round(5.0 / dt))
    assert force_of(run, system, "project", dt) == pytest.approx(5.0 * 9.81 + 1.0, rel=2e-5)


def test_forces_of_more_than_one_state_in_a_thousand_that_are_not_known_leave_no_figure():
    def most(*hardest):
        """Of a run in whose states the first bob's x is what a rod pulls with."""
        q = np.zeros((len(hardest), 2, 3))
        q[:, 0, 0] = hardest

        def pulls(system, q, v, force):
            return q[0, 0] * np.array([1.0, -0.5])

        run = SimpleNamespace(q=q, v=np.zeros_like(q))
        return largest_force(system, run, pulls, c.make_force(system), c.external_force)

    system = c.build_system("double")
    assert most(1.0, *[-7.0] * 998, np.nan) == 7.0  # one of a thousand
    assert most(1.0, *[-7.0] * 997, np.nan, np.nan) is None
    between = make_system([[0.0, -1e-9, 0.0]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])
    lift = -weight(between)
    pulls = c.tensions(between, *start(between), lambda q, v: weight(between) + lift)
    assert np.isnan(pulls).all()  # a bob on a line, 1 nm below it: 1e-9 of the force tells
    slack = make_system([[0.0, -1e-2, 0.0]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])
    pulls = c.tensions(slack, *start(slack), lambda q, v: weight(slack) + lift)
    assert pulls == pytest.approx([490.5 * math.hypot(1.0, 0.01)] * 2, rel=1e-4)


def start(system):
    return system["q0"], system["v0"]


def test_a_method_whose_force_is_all_in_its_post_step_has_no_figure(monkeypatch):
    free = c.Method(lambda system: partial(c.external_force, system), "moves", c.project)
    monkeypatch.setattr(c, "make_methods", lambda *_, **__: {"free": free})
    system = c.build_system("double")
    run = c.run_method(system, "free", "semi_implicit", 0.005, 100)
    assert run.violations.max() < 1e-11 and force_of(run, system, "free", 0.005) is None


@pytest.mark.parametrize("turn", [0.0, 0.001, 1.0])  # rad/s
@pytest.mark.parametrize("name", c.make_methods())
def test_a_dumbbell_that_falls_pulls_as_it_turns_and_rounding_is_nothing(name, turn):
    q = np.array([[1.0, 2.0, 3.0], [1.3, 2.5, 3.8]])
    across = np.cross(q[1] - q[0], [0.0, 0.0, turn])
    system = make_system(q, [(1, 0)], v=[[0, 0, 0], across], m=[3e-9, 0.7e-9])
    run = c.run_method(system, name, "semi_implicit", 0.001, 50)
    reduced = 2.1e-9 / 3.7  # kg
    pull = reduced * np.sum(across**2) / system["lengths"][0]
    found = force_of(run, system, name, 0.001)
    assert (found == 0.0) if turn == 0.0 else (pull * 0.9 < found < pull * 1.6)


# --- energy ---
def test_energies_are_measured_by_the_larger_of_m_g_l_and_what_is_there_at_the_start():
    slow = make_system([[3, 0, 0], [3, 4, 0]], row(2), v=[[0, 2, 0], [0, 2, 0]], m=[2, 0.5])
    assert energy_scale(slow, c.GRAVITY) == pytest.approx(2.5 * 9.81 * 7.0)
    assert energy_scale(slow | {"v0": 10.0 * slow["v0"]}, c.GRAVITY) == 0.5 * 2.5 * 400.0
    assert energy_scale(slow | {"v0": 0.0 * slow["v0"]}, 0.0 * c.GRAVITY) == 1.0


def test_energy_is_conserved_if_it_counts_all_work():
    system = at_random(row(3)) | {"load": np.array([[1.0, 0.0, 2.0]] * 3)}
    q, v = np.random.default_rng(1).normal(size=(2, 40, 3, 3))

    def answer(others, spring=0.0):
        def force(system, q, v):
            return c.external_force(system, q, v) + others(q, v)

        def energy(system, q, v):
            return c.energy(system, q, v) + 0.5 * spring * np.sum(q * q)

        return conserving(system, force, energy)(q, v)

    assert answer(lambda q, v: 0.0)
    assert answer(lambda q, v: np.cross(v, [0.0, 3.0, 0.0]))  # does no work
    assert answer(lambda q, v: -5.0 * q, spring=5.0)
    assert not answer(lambda q, v: -5.0 * q)
    assert not answer(lambda q, v: -1e-3 * v)
    assert not answer(lambda q, v: np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0]]))
    assert not answer(lambda q, v: np.where(q < -2.5, -v, 0.0))  # it acts in few places


# --- integrators ---
ORDERS = [  # an integrator, the longest of three steps in s, and the order
    (c.euler_step, 0.001, 1),
    (c.semi_implicit_step, 0.001, 1),
    (c.rk4_step, 0.0025, 4),
    (make_gauss(3), 0.025, 6),
]


@pytest.mark.parametrize(("step_fn", "dt", "order"), ORDERS)
def test_halving_the_step_shows_the_order(step_fn, dt, order):
    """After 2 s, beside where other equations put the particles."""
    double = c.build_system("double")
    (expected,) = motion(double, [2.0])
    step_fn = c.stabilized(step_fn, double, c.make_methods()["project"])
    errors = []
    for part in (1, 2, 4):
        steps = round(2.0 * part / dt)
        force = c.make_force(double)
        q, _ = c.trajectory(compiled(step_fn, steps), double, force, dt / part, steps)
        errors.append(np.max(np.abs(q[-1] - expected)))
    halved = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert halved == pytest.approx(order, abs=0.7)


def in_place(q, v, m, force, dt):
    """semi_implicit, which edits its arguments, and sees that nothing leaves the plane."""
    v += dt * force(q, v) / m
    v *= [1.0, 1.0, 0.0]
    q += dt * v
    return q, v


def test_an_integrator_may_edit_its_arguments(monkeypatch):
    monkeypatch.setitem(c.INTEGRATORS, "mine", in_place)
    for name in "none", "project":
        run = partial(c.run_method, c.build_system("double"), name, dt=0.005, steps=50)
        assert np.array_equal(run("mine").q, run("semi_implicit").q)
    assert stability_limit(in_place) == stability_limit(c.semi_implicit_step)


def test_gauss_divides_a_step_that_does_not_converge_and_can_be_pickled():
    step_fn = pickle.loads(pickle.dumps(make_gauss(8)))
    still = np.zeros((1, 3))
    q, v = step_fn(still + 1.0, still, 1.0, lambda q, v: -900.0 * q, 1.0)  # 30 rad in a step
    assert np.allclose(q, math.cos(30.0), atol=1e-3)
    assert np.allclose(v, -30.0 * math.sin(30.0), atol=1e-2)
    far = 1e7  # m: however far from the origin a bob swings by a millimetre
    q, v = step_fn(still + far + 1e-3, still, 1.0, lambda q, v: -900.0 * (q - far), 1.0)
    assert np.allclose(q - far, 1e-3 * math.cos(30.0), atol=1e-6)
    q, v = step_fn(still, still, 1.0, lambda q, v: np.nan * q, 1.0)  # no part is short enough
    assert np.isnan([q, v]).all()


# --- drift, and what holds it ---
def test_the_published_course_has_the_same_figures():
    """Recorded by its own script: the worst rod error, that at the end, and energy."""
    settings = "semi_implicit", 0.005, 4000
    published = {"none": [0.384014620396, 0.384014620396, 0.427091167688]}
    published["baumgarte"] = [0.023470285993, 0.001436710083, 0.32484945881]
    for name, figures in published.items():
        run = c.run_method(c.build_system("double"), name, *settings)
        energy = np.max(np.abs(run.energies - run.energies[0])) / (2.0 * 9.81 * 2.0)
        found = np.max(run.violations), run.violations[-1], energy
        assert found == pytest.approx(figures, rel=0.0, abs=3e-12)  # it solves by LAPACK
    starts = [c.build_system("double", seed) for seed in (0, 1)]
    ends = [c.run_method(start, "baumgarte", *settings).tip[-1] for start in starts]
    assert f"{math.dist(*ends):.3f}" == "1.117"
    run = c.run_method(c.build_system("pendulum"), "none", "rk4", 0.005, 4000)
    assert f"{np.max(run.violations):.2e}" == "8.79e-06"


DRIFT = [  # method, integrator, and g of a rod that spins at v m/s in steps of dt s
    ("none", "semi_implicit", lambda dt, v, w: -0.5 * dt * v * v),  # after 1 s
    ("baumgarte", "semi_implicit", lambda dt, v, w: -dt * v * v / w),
    ("baumgarte", "euler", lambda dt, v, w: dt * v * v / w),
    ("impulse", "semi_implicit", lambda dt, v, w: 0.5 * dt * dt * v * v),
]


@pytest.mark.parametrize(("name", "integrator", "expected"), DRIFT)
def test_a_spinning_rod_is_off_by_what_the_derivation_says(name, integrator, expected):
    rod = make_system([[1, 0, 0]], row(1), v=[[0, 5, 0]], m=3.0)
    dt = 0.0005
    w = 50.0
    rod["load"] = -rod["m"] * c.GRAVITY  # it floats
    run = c.run_method(rod, name, integrator, dt, 2000, baumgarte=w)
    speed = np.linalg.norm(run.v[-1])  # under euler it grows
    g = 0.5 * (np.sum(run.q[-1] ** 2) - 1.0)
    assert g == pytest.approx(expected(dt, speed, w), rel=0.02, abs=1e-9)


def test_a_rod_that_falls_grows_by_the_square_of_its_speed_and_hanging_soft_gives_a_fifth_of_a_mm():
    """0.245 mm after a fall of 1 m in steps of 5 ms: g is dt^2 |u|^2 / 2 more in each."""
    level = make_system([[1, 0, 0]], row(1))
    run = c.run_method(level, "none", "semi_implicit", 0.005, 200)
    grown = np.diff(0.5 * np.sum(run.q[:, 0] ** 2, axis=1))
    assert grown[1:] == pytest.approx(0.5 * 0.005**2 * np.sum(run.v[2:, 0] ** 2, axis=1), rel=1e-9)
    hanging = make_system([[0, -1, 0]], row(1), m=7.0)
    run = c.run_method(hanging, "soft", "semi_implicit", 0.005, 800)
    assert run.violations[-1] == pytest.approx(0.05 * 0.02**2 * 9.81, rel=1e-2)


LIMITS = {  # of dt w
    "euler": 2.0,
    "semi_implicit": 2.0 * (math.sqrt(2.0) - 1.0),
    "rk4": -min(np.roots([1 / 24, 1 / 6, 1 / 2, 1]), key=lambda root: abs(root.imag)).real,
}


@pytest.mark.parametrize("integrator", LIMITS)
def test_baumgarte_is_stable_up_to_the_limit_of_theory(integrator):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    step_fn = c.INTEGRATORS[integrator]
    assert stability_limit(step_fn) == pytest.approx(LIMITS[integrator], rel=1e-8)
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], row(1)) | {"lengths": np.ones(1)}
    for share in (0.999, 1.001):
        w = share * LIMITS[integrator] / 0.005
        assert grows(step_fn, 0.005 * w) == (share > 1.0)
        run = c.run_method(hanging, "baumgarte", integrator, 0.005, 20_000, baumgarte=w)
        assert (run.violations[-1] < 1e-9) == (share < 1.0)


def test_project_keeps_rods_and_its_energy_does_not_grow_but_halves_with_the_step():
    worst = []
    for dt in (0.005, 0.0025):
        run = c.run_method(
            c.build_system("double"), "project", "semi_implicit", dt, round(50.0 / dt)
        )
        assert np.max(run.violations) < 2e-12
        worst.append(np.max(np.abs(run.energies - run.energies[0])))
    assert worst[1] / worst[0] == pytest.approx(0.5, abs=0.1)


def test_project_puts_right_rods_and_speeds_wherever_they_are():
    system = at_random(LINKAGE)
    system["lengths"] = system["lengths"] / 1.01
    for shift in ([0.0, 0.0, 0.0], [1e7, 0.0, 1e7], [-1e7, 2e7, -1e7]):  # m
        system = system | {"q0": system["q0"] + shift, "anchors": system["anchors"] + shift}
        q, v = c.project(system, system["q0"], system["q0"], system["v0"], 1.0)
        _, g, gdot, _ = c.constraint_terms(system, q, v)
        assert np.max(np.abs(g)) < 1e-11 + 1e-14 * np.max(np.abs(shift))
        assert np.max(np.abs(gdot)) < 1e-11


@pytest.mark.parametrize("name", ["double", "cable"])
def test_a_row_that_a_reader_adds_to_j_is_obeyed_by_all_methods(name, monkeypatch):
    """A rail: the last particle keeps its height. Soft gives there, too."""
    system = c.build_system(name)
    terms = c.constraint_terms
    height = system["q0"][-1, 1]

    def with_rail(system, q, v):
        jac, g, gdot, jdotv = terms(system, q, v)
        row = np.zeros(q.shape, like=q)
        row[-1, 1] = 1.0
        rail = q[-1, 1] - height, v[-1, 1], 0.0
        more = [np.append(x, y) for x, y in zip((g, gdot, jdotv), rail, strict=True)]
        return np.vstack([jac, row.ravel()]), *more

    monkeypatch.setattr(c, "constraint_terms", with_rail)
    for method in c.make_methods():
        run = c.run_method(system, method, "semi_implicit", 0.005, 100)
        off = np.max(np.abs(run.q[:, -1, 1] - height))
        assert off < (1e-2 if method == "soft" else 1e-9) and not run.stopped
        force = c.make_methods()[method].make_force(system)
        pulls = c.tensions(system, run.q[-1], run.v[-1], force)
        assert pulls.shape == system["lengths"].shape


# --- what is no system, no step or no measure ---
NO_STATES = (  # of a bob's place would be made those of all, and the run would go on
    lambda q, *_: q,
    lambda q, v, *_: (q, v, q, v),
    lambda q, v, *_: (q[0], v[0]),
    lambda q, v, *_: (q[0], v),
)


@pytest.mark.parametrize("bobs", [1, 2, 3])
def test_functions_of_ones_own_that_return_something_else_are_named(bobs, monkeypatch):
    system = c.build_system("chain", links=bobs)
    for wrong in NO_STATES:
        monkeypatch.setitem(c.INTEGRATORS, "mine", wrong)
        with pytest.raises((NotAState, ValueError)):
            c.run_method(system, "none", "mine", 0.005, 10)
    torn = c.Method(c.make_force, "tears", lambda system, q_start, q, v, dt: (q[0], v))
    with monkeypatch.context() as patch, pytest.raises((NotAState, ValueError)):
        patch.setattr(c, "make_methods", lambda *_, **__: {"mine": torn})
        c.run_method(system, "mine", "rk4", 0.005, 10)
    theirs = {
        "external_force": lambda system, q, v: c.GRAVITY,
        "energy": lambda system, q, v: system["m"] * v * v,
        "constraint_violation": c.rod_lengths,
    }
    for name, wrong in theirs.items():
        with monkeypatch.context() as patch, pytest.raises(Refused, match=name):
            patch.setattr(c, name, wrong)
            c.run_method(system, "none", "rk4", 0.005, 10)


REFUSED = [  # a method, an integrator, dt in s, steps, and what is named
    ("impulse", "rk4", 0.005, 9, "impulse"),
    ("none", "rk4", 0.0, 9, "dt"),
    ("none", "rk4", math.nan, 9, "dt"),
    ("none", "rk4", "1", 9, "dt"),
    ("none", "rk4", 0.005, 0, "steps"),
    ("none", "rk4", 0.005, 2.5, "steps"),
]


@pytest.mark.parametrize(("name", "integrator", "dt", "steps", "named"), REFUSED)
def test_from_python_too_what_cannot_run_is_refused(name, integrator, dt, steps, named):
    with pytest.raises(ValueError, match=f"^{named}"):
        c.run_method(c.build_system("double"), name, integrator, dt, steps)


# --- what the report says of its numbers ---
W, TAU, STEP = 20.0, 0.02, 0.005  # of baumgarte, of soft, of both
OFF = {"baumgarte": STEP / W, "impulse": STEP**2 / 2.0, "soft": TAU**2 - TAU * STEP}  # times |u|^2
LAGS = {"none": 0.0, "baumgarte": -STEP / W, "soft": TAU**2 - TAU * STEP}  # g is this times |u|^2
LATE = {"none": 0.0, "baumgarte": 2.0 / W, "soft": 2.0 * TAU}  # s


def followed(name):
    """Of a double pendulum for 20 s: the energy that it gained, lambda, g and |u|^2 of each rod."""
    system = c.build_system("double")
    run = c.run_method(system, name, "semi_implicit", STEP, 4000)
    force = c.make_methods(STEP)[name].make_force(system)
    terms = [c.constraint_terms(system, q, v) for q, v in zip(run.q, run.v, strict=True)]
    _, g, _, square = (np.array(x) for x in zip(*terms, strict=True))
    pulls = [c.tensions(system, q, v, force) for q, v in zip(run.q, run.v, strict=True)]
    lam = -np.array(pulls) / [c.rod_lengths(system, q) for q in run.q]
    return run.energies[-1] - run.energies[0], lam, g, square


@pytest.mark.parametrize("name", LAGS)
def test_energy_that_a_method_adds_is_the_work_of_rods_whose_lengths_follow_late(name):
    added, lam, g, square = followed(name)

    def work(g):
        return np.sum(0.5 * (lam[:-1] + lam[1:]) * np.diff(g, axis=0))

    assert abs(added) > 10.0 and work(g) == pytest.approx(added, rel=0.01)
    if name == "none":
        assert np.min(np.diff(g, axis=0)) > -1e-15
        return
    at_once = LAGS[name] * square
    late = round(LATE[name] / STEP)
    assert abs(work(at_once)) < 0.15 * abs(added)
    then = np.concatenate([np.repeat(at_once[:1], late, axis=0), at_once[:-late]])
    assert work(then) == pytest.approx(added, rel=0.1)


@pytest.mark.parametrize("name", OFF)
def test_a_rod_is_as_far_off_as_the_script_says_and_its_formula_bounds_that(name):
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    words = rf"#     {name} .* ([\d.]+) m/s +([\d.]+) mm too (short|long) +([\d.]+) mm\n"
    speed, bound, sense, measured = re.search(words, source).groups()
    system = c.build_system("double")
    run = c.run_method(system, name, "semi_implicit", STEP, 4000)
    u = np.diff(run.v, axis=1)  # of the lower rod's ends
    fastest = np.max(np.sum(u * u, axis=-1))
    errors = np.array([c.rod_lengths(system, q)[1] - 1.0 for q in run.q])
    worst = errors[np.argmax(np.abs(errors))]
    assert (worst < 0.0) == (sense == "short")
    assert f"{np.sqrt(fastest):.1f}" == speed
    assert f"{1e3 * OFF[name] * fastest:.2g}" == bound
    assert f"{1e3 * abs(worst):.1f}" == measured and np.max(run.violations) == abs(worst)


def test_the_limit_that_the_script_names_is_that_of_its_integrator():
    limit = stability_limit(c.semi_implicit_step)
    said = f"# At z = {limit:.2f}, w = {limit / STEP:.0f} rad/s at 5 ms, "
    assert said in (ROOT / "constraints.py").read_text(encoding="utf-8")
