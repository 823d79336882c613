"""The physics: forces against other formulations, motions against closed forms, bits everywhere."""

import __future__

import json
import math
import pickle
import re
import tempfile
from functools import partial
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT, python
from independent import acceleration, incidence_and_rods, motion

import constraints as c
from curriculum.ch3_4_constraints.mechanics.reference import MAX_RODS, Reference, find_reference
from curriculum.ch3_4_constraints.mechanics.stability import (
    force_calls,
    grows,
    is_explicit,
    stability_limit,
)
from curriculum.ch3_4_constraints.mechanics.systems import SceneError
from curriculum.ch3_4_constraints.results import table
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import NotAState, Report, compiled

METHODS = c.make_methods(dt=0.005)
REFERENCE = json.loads((ROOT / "tests/reference.json").read_text(encoding="utf-8"))


def row(n):
    return [(k, k - 1) for k in range(n)]


def make_system(q, pairs, anchors=((0.0, 0.0, 0.0),), v=0.0, m=1.0):
    """A system whose rods are as long as their ends are apart."""
    q = np.array(q, float)
    anchors = np.array(anchors, float)
    ends = {-1 - k: anchor for k, anchor in enumerate(anchors)} | dict(enumerate(q))
    lengths = np.array([math.dist(ends[i], ends[j]) for i, j in pairs])
    system = {"q0": q, "v0": v + 0.0 * q, "m": np.reshape(m + 0.0 * q[:, 0], (-1, 1))}
    return system | {"pairs": pairs, "lengths": lengths, "anchors": anchors}


def at_random(pairs):
    """Particles, masses and velocities at random."""
    rng = np.random.default_rng(3)
    n = 1 + max(pairs)[0]
    q, v = rng.normal(size=(2, n, 3))
    return make_system(q, pairs, rng.normal(size=(3, 3)), v, rng.uniform(0.1, 10.0, n))


def told(system, name, integrator, dt, steps):
    """A run's row of metrics.json, and what is said of it beside the table."""
    run = c.run_method(system, name, integrator, dt, steps)
    found = c.summary(system, run, METHODS[name], Reference(1, ""))
    return found, " ".join(table.doubts(found, run))


ASKED = {  # of gddot by each method: Jdot v, damping, stiffness, regularization
    "none": (1.0, 0.0, 0.0, 0.0),
    "baumgarte": (1.0, 40.0, 400.0, 0.0),  # w = 20 rad/s
    "impulse": (0.0, 200.0, 200.0**2, 0.0),  # dt = 5 ms
    "soft": (0.0, 2.0 / 0.019, 1.0 / 0.00038, 0.05 / 0.95),  # p = 0.95, t = 20 ms
    "project": (1.0, 0.0, 0.0, 0.0),
}


def cable(rods, sag, heavier):
    """A parabola, of masses that are 1 kg and `heavier` by turns; rods of 1 m, sag by its span."""
    x = np.linspace(0.0, 1.0, rods + 1)
    q = rods * np.stack([x, -4.0 * sag * x * (1.0 - x), 0.0 * x], axis=1)
    m = np.where(np.arange(1, rods) % 2, 1.0, heavier)
    return make_system(q[1:-1], [*row(rods - 1), (rods - 2, -2)], [q[0], q[-1]], m=m)


STAR = [(0, -1), *((k, 0) for k in range(1, 12))]  # whose rods are all coupled
LINKAGE = [*row(4), (3, -2), (2, -3), (3, 0)]
GRAPHS = [row(1), row(7), STAR, [*row(4), (3, 0)], LINKAGE]
TIGHT = [(2, 1e-4, 1.0), (12, 0.02, 1000.0), (50, 0.001, 1.0), (150, 0.001, 1000.0)]


@pytest.mark.parametrize("name", ASKED)
def test_the_force_is_that_of_the_least_constraint(name):
    """On trees and loops, their rods right or too long, under loads, and on tight cables."""
    rng = np.random.default_rng(4)
    systems = [c.build_system("braced"), *(cable(*how) for how in TIGHT)]  # one has a rod too many
    for pairs, stretch in product(GRAPHS, (1.0, 1.02)):
        system = at_random(pairs)
        load = 20.0 * rng.normal(size=system["q0"].shape)  # N
        systems.append(system | {"lengths": system["lengths"] / stretch, "load": load})
    for system in systems:
        pulled = c.GRAVITY * system["m"] + system.get("load", 0.0)
        expected = acceleration(system, pulled, *ASKED[name])
        force = METHODS[name].make_force(system)
        off = force(system["q0"], system["v0"]) / system["m"] - expected
        # a cable pulls with up to 2,500 times its weight, and A, in which the pose is squared,
        # is rounded
        assert np.max(np.abs(off)) < 1e-7 * max(9.81, np.max(np.abs(expected)))


def in_place(q, v, m, force, dt):
    """semi_implicit, which edits its arguments, and sees that nothing leaves the plane."""
    v += dt * force(q, v) / m
    v *= [1.0, 1.0, 0.0]
    q += dt * v
    return q, v


def test_an_integrator_may_edit_its_arguments_under_project(monkeypatch):
    monkeypatch.setitem(c.INTEGRATORS, "mine", in_place)
    run = partial(c.run_method, c.build_system("double"), "project", dt=0.005, steps=50)
    assert np.array_equal(run("mine").q, run("semi_implicit").q)


def test_a_rod_pulls_with_the_weight_and_the_centripetal_load():
    """At the bottom that is m (g + v^2 / L). Without anchors a bob hangs on the pivot."""
    system = make_system([[0, -2, 0]], row(1), v=[[3, 0, 0]], m=4)
    del system["anchors"]
    pulls = c.tensions(system, system["q0"], system["v0"], c.make_force(system))
    assert pulls == pytest.approx([4.0 * (9.81 + 4.5)])


def test_energy_is_that_of_height_speed_and_load():
    """m (v^2/2 + 9.81 y) - F . q, summed: masses, heights and loads that all differ."""
    system = make_system([[1, -2, 3], [0.5, 4, -1]], row(2), v=[[1, 2, 2], [0, -3, 4]], m=[2, 0.5])
    system["load"] = np.array([[3.0, -1.0, 0.5], [0.0, 20.0, 7.0]])
    by_hand = 2.0 * (4.5 - 2.0 * 9.81) - (3.0 + 2.0 + 1.5) + 0.5 * (12.5 + 4.0 * 9.81) - 73.0
    assert c.energy(system, system["q0"], system["v0"]) == pytest.approx(by_hand, rel=1e-14)


def test_a_loaded_pendulum_hangs_aslant_and_swings_about_there():
    """A load of F to the side is gravity of sqrt(g^2 + (F/m)^2), at an angle atan(F / m g)."""
    m = 2.0
    length = 1.5
    load = 11.0
    g = math.hypot(9.81, load / m)
    across = np.array([load / m, -9.81, 0.0]) / g
    hanging = make_system([length * across], row(1), m=m) | {"load": [[load, 0.0, 0.0]]}
    found, _ = told(hanging, "none", "rk4", 0.005, 400)
    assert found["energy_rel_max"] < 1e-12 and found["tension_max"] == pytest.approx(m * g)
    assert found["tip_final"] == pytest.approx(length * across, abs=1e-12)
    swing = 1e-3  # rad, of amplitude
    aside = length * (
        math.cos(swing) * across + math.sin(swing) * np.array([9.81, load / m, 0]) / g
    )
    period = 2.0 * math.pi * math.sqrt(length / g) * (1.0 + swing**2 / 16.0)
    start = make_system([aside], row(1), m=m) | {"load": [[load, 0.0, 0.0]]}
    run = c.run_method(start, "project", "rk4", period / 400.0, 400)
    assert np.max(np.abs(run.q[-1] - aside)) < 1e-9
    assert np.max(np.abs(run.q[200] - aside)) == pytest.approx(2.0 * swing * length, rel=0.2)
    exact = reference_of(start, period / 800.0, 1600)
    assert exact.step * period / 800.0 == pytest.approx(2.0, abs=period) and exact.q is not None


AT = REFERENCE["times"].index(2.0)
PLACES = {name: np.array(case["positions"][AT]) for name, case in REFERENCE["cases"].items()}
ORDERS = [  # an integrator, the longest of three steps in s, and the order
    (c.euler_step, 0.001, 1),
    (c.semi_implicit_step, 0.001, 1),
    (c.rk4_step, 0.0025, 4),
    (make_gauss(3), 0.025, 6),
]


def errors_of(step_fn, dt, parts):
    """In m after 2 s, beside where joint angles put the particles, of steps of dt / k s."""
    double = c.build_system("double")
    errors = []
    step_fn = c.stabilized(step_fn, double, METHODS["project"])
    for k in parts:
        steps = round(2.0 * k / dt)
        step = compiled(step_fn, steps)
        run = c.simulate(step, double, c.make_force(double), dt / k, steps)
        errors.append(np.max(np.abs(run.q[-1, :, :2] - PLACES["double"])))
    return np.array(errors)


@pytest.mark.parametrize(("step_fn", "dt", "order"), ORDERS)
def test_halving_the_step_shows_the_order(step_fn, dt, order):
    errors = errors_of(step_fn, dt, (1, 2, 4))
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(order, abs=0.7)


@pytest.mark.parametrize("integrator", c.INTEGRATORS)
def test_each_integrator_of_the_table_comes_nearer_to_the_true_motion(integrator):
    """One that is added without a row in ORDERS, too."""
    first, second = errors_of(c.INTEGRATORS[integrator], 0.002, (1, 4))
    assert second < max(0.5 * first, 1e-10)


def test_the_published_course_has_the_same_figures():
    """Recorded by its own script: the worst rod error, that at the end, and energy."""
    settings = "semi_implicit", 0.005, 4000
    published = {"none": [0.384014620396, 0.384014620396, 0.427091167688]}
    published["baumgarte"] = [0.023470285993, 0.001436710083, 0.32484945881]
    for name, figures in published.items():
        row, _ = told(c.build_system("double"), name, *settings)
        found = [row[key] for key in ("max_violation", "final_violation", "energy_rel_max")]
        assert found == pytest.approx(figures, rel=0.0, abs=3e-12)  # it solves by LAPACK
    starts = [c.build_system("double", seed) for seed in (0, 1)]
    ends = [c.run_method(start, "baumgarte", *settings).tip[-1] for start in starts]
    assert f"{math.dist(*ends):.3f}" == "1.117"
    row, _ = told(c.build_system("pendulum"), "none", "rk4", 0.005, 4000)
    assert f"{row['max_violation']:.2e}" == "8.79e-06"


DRIFT = [  # method, integrator, and g of a rod that spins at v m/s in steps of dt s
    ("none", "semi_implicit", lambda dt, v, w: -0.5 * dt * v * v),  # after 1 s
    ("baumgarte", "semi_implicit", lambda dt, v, w: -dt * v * v / w),
    ("baumgarte", "euler", lambda dt, v, w: dt * v * v / w),
    ("impulse", "semi_implicit", lambda dt, v, w: 0.5 * dt * dt * v * v),
]


@pytest.mark.parametrize(("name", "integrator", "expected"), DRIFT)
def test_a_spinning_rod_is_off_by_what_the_derivation_says(name, integrator, expected):
    rod = make_system([[1, 0, 0]], row(1), v=[[0, 5, 0]])
    dt = 0.0005
    w = 50.0
    rod["load"] = -rod["m"] * c.GRAVITY  # it floats
    run = c.run_method(rod, name, integrator, dt, 2000, baumgarte=w)
    speed = np.linalg.norm(run.v[-1])  # under euler it grows
    g = 0.5 * (np.sum(run.q[-1] ** 2) - 1.0)
    assert g == pytest.approx(expected(dt, speed, w), rel=0.02, abs=1e-9)


LIMITS = {  # of dt w
    "euler": 2.0,
    "semi_implicit": 2.0 * (math.sqrt(2.0) - 1.0),
    "rk4": -min(np.roots([1 / 24, 1 / 6, 1 / 2, 1]), key=lambda root: abs(root.imag)).real,
}


@pytest.mark.parametrize("integrator", LIMITS)
def test_baumgarte_is_stable_up_to_the_limit_of_theory(integrator):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    assert stability_limit(c.INTEGRATORS[integrator]) == pytest.approx(LIMITS[integrator], rel=1e-8)
    assert not grows(c.INTEGRATORS[integrator], 0.999 * LIMITS[integrator])
    assert grows(c.INTEGRATORS[integrator], 1.001 * LIMITS[integrator])
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], row(1)) | {"lengths": np.ones(1)}
    for share in (0.999, 1.001):
        w = share * LIMITS[integrator] / 0.005
        run = c.run_method(hanging, "baumgarte", integrator, 0.005, 20_000, baumgarte=w)
        assert (run.violations[-1] < 1e-9) == (share < 1.0)


def test_what_is_asked_of_an_integrator_is_asked_of_one_that_edits_arrays_with_three_axes():
    for _ in range(2):
        assert is_explicit(in_place) and force_calls(in_place) == 1
        assert stability_limit(in_place) == stability_limit(c.semi_implicit_step)


def test_project_keeps_rods_and_its_energy_does_not_grow_but_halves_with_the_step():
    worst = []
    for dt in (0.005, 0.0025):
        found, _ = told(c.build_system("double"), "project", "semi_implicit", dt, round(50.0 / dt))
        assert found["max_violation"] < 2e-12
        worst.append(found["energy_rel_max"])
    assert worst[1] / worst[0] == pytest.approx(0.5, abs=0.1)


def test_project_puts_right_rods_and_speeds_wherever_they_are():
    system = at_random(LINKAGE)
    system["lengths"] = system["lengths"] / 1.01
    for shift in (0.0, 1e7):  # m
        system = system | {"q0": system["q0"] + shift, "anchors": system["anchors"] + shift}
        q, v = c.project(system, system["q0"], system["q0"], system["v0"], 1.0)
        _, g, gdot, _ = c.constraint_terms(system, q, v)
        assert np.max(np.abs(g)) < 1e-11 + 1e-14 * shift
        assert np.max(np.abs(gdot)) < 1e-11


def test_gauss_divides_a_step_that_does_not_converge_and_can_be_pickled():
    step_fn = pickle.loads(pickle.dumps(c.INTEGRATORS["gauss"]))
    still = np.zeros((1, 3))
    q, v = step_fn(still + 1.0, still, 1.0, lambda q, v: -900.0 * q, 1.0)  # 30 rad in a step
    assert np.allclose(q, math.cos(30.0), atol=1e-3)
    assert np.allclose(v, -30.0 * math.sin(30.0), atol=1e-2)
    q, v = step_fn(still, still, 1.0, lambda q, v: np.nan * q, 1.0)  # no part is short enough
    assert np.isnan([q, v]).all()


def reference_of(system, dt=0.005, steps=4000, others=None, **how):
    """The reference for a run of so many steps; others(q, v) -> (N, 3) in N acts besides."""
    system = c.mechanics.check_system(system, c.PIVOT)
    rods = c.make_force(system)

    def force(q, v):
        return rods(q, v) if others is None else rods(q, v) + others(q, v)

    taken = Report(**{"is_compiled": True} | how)
    run = SimpleNamespace(dt=dt, q=np.zeros((steps + 1, 1, 3)), step=taken)
    return find_reference(system, force, c.project, [run])


def test_the_reference_is_of_the_longest_run_and_of_two_seconds_at_most():
    double = c.mechanics.check_system(c.build_system("double"), c.PIVOT)
    runs = []
    for steps in (10, 90, 40):  # two were lost
        q = np.zeros((steps + 1, 2, 3))
        runs.append(SimpleNamespace(dt=0.01, q=q, step=Report(is_compiled=True)))
    found = find_reference(double, c.make_force(double), c.project, runs)
    assert (found.step, found.at) == (90, "at 0.9 s")
    assert found.error(runs[0].q) is None
    where = np.repeat(found.q[None], 91, axis=0)
    where[-1, 1] = where[-1, 1] + [0.03, 0.0, -0.04]
    assert found.error(where) == pytest.approx(0.05)
    assert reference_of(double, 0.01, 1000).step == 200


def measured(q, v, violations, energies):
    """A Run whose measures are given."""
    measures = {"violations": np.array(violations), "energies": np.array(energies)}
    return SimpleNamespace(q=q, v=v, tip=q[:, -1], **measures)


def test_an_outcome_knows_what_its_rods_may_have_to_bear_and_how_quick_it_is():
    """A bob of 2 kg on 0.5 m, under a load of 5 N, from 1 to 3 m/s in 0.1 s; g is 2 m/s^2."""
    q = np.array([[[0.0, 0.0, 0.0]], [[0.1, 0.0, 0.0]], [[-0.05, 0.0, 0.0]]])
    v = np.array([[[1.0, 0.0, 0.0]], [[3.0, 0.0, 0.0]], [[3.0, 0.0, 0.0]]])
    run = measured(q, v, np.zeros(3), np.zeros(3))
    step = SimpleNamespace(report=Report(timed=2, seconds=6e-6))
    system = {"m": np.array([[2.0]]), "lengths": np.array([0.5]), "load": [[3.0, -4.0, 0.0]]}
    done = c.mechanics.Outcome(run, system, 0.1, step, np.array([0.0, -1.2, 1.6]))
    assert done.loads == pytest.approx(2.0 * 2.0 + 5.0 + 2.0 * 9.0 / 0.5 + 2.0 * 20.0)
    assert done.time_scale == pytest.approx(0.05 / 3.0)
    assert done.pace == pytest.approx(3.0) and done.stopped is None


ENDS = [  # energies, whether states end in NaN, why a step failed, and how the run is told
    ([1.0, np.inf, 2.0, 2.0], False, None, "lost at 0 s: diverged"),
    ([1.0, 1.0, np.nan, np.nan], True, "it is torn", "lost at 0.1 s: it is torn"),
    ([1.0, 1.0, np.nan, np.nan], True, None, "its loop ended at 0.1 s"),
    ([1.0, 1.0, 1.0, 1.0], False, None, None),
]


def test_an_outcome_ends_where_rods_are_a_hundred_times_as_long_as_all_together():
    q = np.zeros((4, 1, 3))
    step = SimpleNamespace(report=Report())
    system = {"m": np.ones((1, 1)), "lengths": np.array([0.5, 1.5])}
    for worst, told in ((199.0, None), (201.0, "lost at 0.1 s: diverged")):
        run = measured(q, q, [0.0, 0.1, worst, 0.1], np.zeros(4))
        assert c.mechanics.Outcome(run, system, 0.1, step, c.GRAVITY).lost == told


@pytest.mark.parametrize(("energies", "ends", "failure", "told"), ENDS)
def test_an_outcome_says_when_and_why_its_run_ended(energies, ends, failure, told):
    q = np.zeros((4, 1, 3))
    if ends:
        q[2:] = np.nan
    step = SimpleNamespace(report=Report(failure=failure))
    run = measured(q, q, np.zeros(4), energies)
    done = c.mechanics.Outcome(
        run, {"m": np.ones((1, 1)), "lengths": np.ones(1)}, 0.1, step, c.GRAVITY
    )
    assert done.stopped == told
    assert done.lost == (told if told and told.startswith("lost") else None)
    assert len(done.q) == len(done.energies) == (4 if told is None else 1 + (energies[1] == 1.0))


SCALED = ("double", 2.0**-10, 1.0), ("double", 1.0, 2.0**10)


@pytest.mark.parametrize(("name", "size", "gravity"), [*product(PLACES, [1.0], [1.0]), *SCALED])
def test_gauss_and_the_reference_are_where_joint_angles_put_them(name, size, gravity):
    """In metres and millimetres, and under a load of 1023 weights: then times are 1/32."""
    system = c.build_system(name)
    dt = 0.005 * math.sqrt(size / gravity)
    system = system | {key: size * system[key] for key in ("q0", "lengths", "anchors")}
    system["load"] = (gravity - 1.0) * c.GRAVITY * system["m"]
    run = c.run_method(system, "project", "gauss", 5.0 * dt, 80)
    found = reference_of(system, dt, 400)
    for q in (run.q[-1], found.q):
        assert np.max(np.abs(q[:, :2] / size - PLACES[name])) < 1e-12
    assert found.step == 400 and found.uncertainty < 1e-11
    assert found.error(found.q[None]) is None  # of a run that ends sooner


THROWN = [*product([1.0], (20, 60, 450, 3000), (0.01, 0.1)), (1e-6, 2e4, 1e-3), (1e3, 0.7, 2.0)]


@pytest.mark.parametrize(("length", "speed", "time"), THROWN)
def test_the_reference_of_a_thrown_pendulum_is_within_its_uncertainty(length, speed, time):
    """The angle is 2 am(speed t / 2, k), k^2 = 4 g / (L speed^2), thrown from the bottom."""
    special = pytest.importorskip("scipy.special", reason="scipy is not installed")
    sn, cn, *_ = special.ellipj(0.5 * speed * time, 4.0 * 9.81 / (length * speed * speed))
    exact = length * np.array([2.0 * sn * cn, sn * sn - cn * cn, 0.0])
    pendulum = make_system([[0, -length, 0]], row(1), v=[[speed * length, 0, 0]])
    found = reference_of(pendulum, time / 20.0, 20)
    assert np.linalg.norm(found.q[0] - exact) <= found.uncertainty < 1e-9


@pytest.mark.parametrize("far", [1e3, 1e4])
def test_far_from_the_origin_a_reference_is_as_sure_as_rounding_lets_it_be(far):
    near = reference_of(make_system([[0.6, -0.8, 0.0]], row(1)))
    found = reference_of(make_system([[0.6 + far, -0.8, 0.0]], row(1), [[far, 0.0, 0.0]]))
    off = np.linalg.norm(found.q - [far, 0.0, 0.0] - near.q)
    assert off <= found.uncertainty + near.uncertainty < 1e-9
    assert found.uncertainty > 10.0 * near.uncertainty


# About the line of its rods of 1 m a bob swings on 10 um: w = sqrt(g / 10 um) is far quicker.
SMALL = make_system([[0, 0, 1e-5]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])
MOTIONS = [(SMALL, 0.01), *product(map(at_random, GRAPHS), [0.2])]


@pytest.mark.parametrize(("system", "time"), MOTIONS)
def test_motion_in_space_is_as_another_integrator_says(system, time):
    q = system["q0"]
    _, v = c.project(system, q, q, system["v0"], 1.0)  # which keeps lengths
    thrown = system | {"v0": v}
    found = reference_of(thrown, time / 20.0, 20)
    off = np.linalg.norm(found.q - motion(thrown, time), axis=1)
    assert np.max(off) < 1e-10 + found.uncertainty < 2e-10


def test_a_reference_that_is_not_known_has_a_reason_and_a_stiff_start_is_none():
    double = c.build_system("double")
    far = make_system([[1e8 + 1, 0, 0]], row(1), [[1e8, 0, 0]])  # m: x is rounded to 15 nm
    unknown = {
        "not agree to a nanometre": reference_of(far),
        "shorter steps do not agree": reference_of(c.build_system("peaucellier")),
        f"more than {MAX_RODS} rods": reference_of(c.build_system("chain", links=MAX_RODS + 1)),
        "more than 20000 steps": reference_of(make_system([[0, -1, 0]], row(1), v=[[1e5, 0, 0]])),
        "steps are not compiled": reference_of(double, is_compiled=False),
        "the loop edits what its steps take": reference_of(double, edited=True),
        "cannot be compiled": reference_of(double, others=lambda q, v: q if q[0, 1] < -1 else -q),
        "is not a number": reference_of(double, others=lambda q, v: np.nan * q),
    }
    assert reference_of(c.build_system("heavy_tip")).uncertainty < 1e-9
    for why, found in unknown.items():
        assert why in found.why


CRANKS = [[0, 0, 0], [2, 0, 0], [0.7, 1.1, 0]]  # three, and one would be too many for a square
TIED = [(1, 0), (2, 1), (2, 0), (0, -1), (1, -2), (2, -3)]
TRIPLE = make_system(np.add(CRANKS, [0.8, -0.6, 0.0]), TIED, CRANKS)


def test_forces_that_only_drift_makes_are_marked_or_are_not_there():
    """Equal cranks swing as one pendulum, so no rod carries more than 1.8 x 9.81 N."""
    for method in ("project", "none"):
        found, words = told(TRIPLE, method, "rk4", 0.005, 4000)
        assert (found["tension_max"], words) == (pytest.approx(17.658, rel=2e-3), "")
    assert told(cable(2, 0.001, 1.0), "project", "rk4", 0.005, 40)[1] == ""  # 250 times its weight
    stiff = c.build_system("pendulum")  # its one rod repeats nobody
    run = c.run_method(stiff, "baumgarte", "rk4", 0.005, 4000, baumgarte=500.0)
    method = c.make_methods(0.005, baumgarte=500.0)["baumgarte"]
    words = table.doubts(c.summary(stiff, run, method, Reference(1, "")), run)
    assert len(words) == 1 and "a rod's force reaches 650 N, 13 times all weights" in words[0]


def pulls_by_svd(system, run, asked, k):
    """The pulls (C,) in N at state k that give what is asked of gddot.

    Of those that do, the ones whose forces on particles, squared and summed, are least.
    """
    now = system | {"q0": np.array(run.q[k]), "v0": np.array(run.v[k])}
    weight = np.array(system["m"] * c.GRAVITY)
    rods = system["m"] * acceleration(now, weight, *asked) - weight
    incidence, d = incidence_and_rods(now)
    d = d / np.linalg.norm(d, axis=1)[:, None]
    rows = np.einsum("kn,kx->knx", incidence[:, : len(rods)], d).reshape(len(d), -1)
    ends = np.linalg.norm(rows, axis=1)  # the root of how many particles it pulls at: 1 or 2
    return -np.linalg.lstsq((rows / ends[:, None]).T, np.ravel(rods), rcond=1e-6)[0] / ends


BLOCK = [(0, -1), (1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2), (4, 0), (4, 1), (4, 2), (4, 3)]
REDUNDANT = {
    "cranks": TRIPLE | {"m": np.array([[3.0], [0.2], [1.0]])},
    "a block in space": at_random(BLOCK) | {"v0": np.zeros((5, 3))},  # one rod too many
}


@pytest.mark.parametrize("dt", [0.005, 2e-5])
@pytest.mark.parametrize("name", REDUNDANT)
def test_the_pulls_of_redundant_rods_are_the_smallest_that_give_the_force(name, dt):
    system = c.mechanics.check_system(REDUNDANT[name], c.PIVOT)
    for method, asked in ASKED.items():
        if method in ("impulse", "soft"):
            asked = SHORT[method](dt)
        run = c.run_method(system, method, "semi_implicit", dt, 40)
        force = c.make_methods(dt)[method].make_force(system)
        for k in (0, 17, 40):
            found = c.tensions(system, run.q[k], run.v[k], force)
            expected = pulls_by_svd(system, run, asked, k)
            assert np.max(np.abs(found - expected)) < 1e-4 * np.max(np.abs(expected))


SHORT = {  # what is asked with steps of dt s
    "impulse": lambda dt: (0.0, 1.0 / dt, 1.0 / dt**2, 0.0),
    "soft": lambda dt: (0.0, 2.0 / (0.95 * 0.02), 1.0 / (0.95 * 0.0004), 0.05 / 0.95),
}


@pytest.mark.parametrize("dt", [0.001, 0.005])
def test_windows_that_fall_through_their_flat_pose_pull_with_what_a_pendulum_does(dt):
    """All bobs share one acceleration, so couplers carry nothing: m (5 g + v^2) at the bottom."""
    system = c.build_system("windows")
    found, _ = told(system, "project", "gauss", dt, round(5.0 / dt))
    assert found["tension_max"] == pytest.approx(5.0 * 9.81 + 1.0, rel=2e-5)
    assert found["tension_between"] < 1e-3


def test_a_strut_that_pushes_is_as_hard_as_a_rod_that_pulls():
    system = make_system([[0.0, 1.5, 0.0]], row(1), m=4.0)  # on top of the pivot
    found, _ = told(system, "none", "semi_implicit", 0.005, 9)
    assert found["tension_max"] == pytest.approx(4.0 * 9.81)
    pull = c.tensions(system, system["q0"], system["v0"], c.make_force(system))
    assert pull == pytest.approx([-4.0 * 9.81])


def test_a_force_that_peaks_between_steps_is_told_as_over():
    """At steps of 20 ms it is 453 N. At 0.5 ms it is what joint angles say, 548 N at 3.35 s."""
    whip = c.build_system("chain", 3, links=5)
    coarse, _ = told(whip, "project", "gauss", 0.02, 200)
    assert table.force(coarse) == "over 450"
    fine, _ = told(whip, "project", "gauss", 0.0005, 8000)
    assert table.force(fine) == "548"


def test_pulls_that_hang_on_rounding_are_not_known():
    """A bob on a line between two rods, 1 nm below it: 1e-9 of the force is all that is told."""
    system = make_system([[0.0, -1e-9, 0.0]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])
    force = 9.81 * np.array([[0.0, 1.0, 0.0]])

    def rods(q, v):
        return c.external_force(system, q, v) + force

    assert np.isnan(c.tensions(system, system["q0"], system["v0"], rods)).all()
    slack = make_system([[0.0, -1e-2, 0.0]], [(0, -1), (0, -2)], [[-1, 0, 0], [1, 0, 0]])
    found = c.tensions(slack, slack["q0"], slack["v0"], rods)
    assert found == pytest.approx([490.5 * math.hypot(1.0, 0.01)] * 2, rel=1e-4)


def test_what_a_run_returns_goes_through_a_pool_of_processes():
    code = """
import constraints as c
from multiprocessing import get_context
def run(seed):
    return c.run_method(c.build_system("double", seed), "project", "rk4", 0.005, 40)
if __name__ == "__main__":
    with get_context("spawn").Pool(2) as pool:
        for seed, done in enumerate(pool.map(run, range(2))):
            alone = run(seed)
            assert (alone.q == done.q).all() and (done.tip == tuple(done)[0]).all()
            assert done.step.how == "compiled to Python" and done.step.source and done.pace > 0.0
            assert not done.step.edited and done.step.is_compiled
            assert done.time_scale == alone.time_scale
        print("done")
"""
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder, "pool.py")
        script.write_text(code)
        done = python(script, variables={"PYTHONPATH": str(ROOT)})
    assert (done.stdout, done.stderr) == ("done\n", "")


def test_m_g_l_is_of_what_moves_and_without_gravity_of_how_fast_it_is():
    system = make_system([[3, 0, 0], [3, 4, 0]], row(2), v=[[0, 2, 0], [0, 2, 0]], m=[2, 0.5])
    assert c.mechanics.m_g_L(system, c.GRAVITY) == pytest.approx(2.5 * 9.81 * 7.0)
    assert c.mechanics.m_g_L(system, 1e-3 * c.GRAVITY) == pytest.approx(2.5e-3 * 9.81 * 7.0)
    assert c.mechanics.m_g_L(system, 0.0 * c.GRAVITY) == pytest.approx(0.5 * 2.5 * 4.0)
    assert c.mechanics.m_g_L(system | {"v0": 0.0 * system["v0"]}, 0.0 * c.GRAVITY) == 1.0
    corner = [[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5]]
    held = [(0, -1), (1, -2), (1, -3), (1, -4), (1, 2)]  # particle 1 is pinned by three rods
    system = make_system([[3, 0, 0], [4, 4, 4], [4, 4, 6]], held, corner, m=[2.0, 1e9, 1.0])
    assert c.mechanics.m_g_L(system, c.GRAVITY) == pytest.approx(3.0 * 9.81 * 5.0)
    held += [(3, -2), (3, -3), (1, 3)]  # which helps to pin particle 3
    places = [*system["q0"], [9, 9, 1]]
    system = make_system(places, held, corner, m=[2.0, 1e9, 1.0, 1e8])
    assert c.mechanics.m_g_L(system, c.GRAVITY) == pytest.approx(3.0 * 9.81 * 5.0)
    flat = make_system([[1, -1, 0]], [(0, -1), (0, -2), (0, -3)], [[0, 0, 0], [2, 0, 0], [3, 0, 0]])
    rods = 2.0 * math.sqrt(2.0) + math.sqrt(5.0)  # out of their plane it swings
    assert c.mechanics.m_g_L(flat, c.GRAVITY) == pytest.approx(9.81 * rods)
    pinned = make_system([[4, 4, 4]], [(0, -1), (0, -2), (0, -3)], corner[1:], m=3.0)
    assert c.mechanics.m_g_L(pinned, c.GRAVITY) > 3.0 * 9.81  # of all, if nothing moves


def test_energy_is_conserved_if_it_counts_all_work():
    system = at_random(row(3)) | {"load": np.array([[1.0, 0.0, 2.0]] * 3)}

    def answer(others, spring=0.0):
        def force(system, q, v=None):
            return c.external_force(system, q, v) + others(q, v)

        def energy(system, q, v):
            return c.energy(system, q, v) + 0.5 * spring * np.sum(q * q, axis=(-2, -1))

        return c.mechanics.conserves(system, force, energy)

    assert answer(lambda q, v: 0.0)
    assert answer(lambda q, v: np.cross(v, [0.0, 3.0, 0.0]))  # does no work
    assert answer(lambda q, v: -5.0 * q, spring=5.0)
    assert not answer(lambda q, v: -5.0 * q)
    assert not answer(lambda q, v: -1e-3 * v)
    assert not answer(lambda q, v: np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0]]))
    assert not answer(lambda q, v: np.where(q < -0.5, 1.0, 0.0))  # it acts in places only


@pytest.mark.parametrize("shift", [0.0, 1.0, 1e4])
def test_gauss_and_the_reference_of_a_bob_at_rest_are_the_same_wherever_the_origin_is(shift):
    anchors = [[-0.3, 0.7, 0.2], [0.6, 0.5, -0.4], [0.0, 0.9, 0.1]]
    for held in (anchors, [[0.0, 1.0, 0.0]]):
        pairs = [(0, -1 - k) for k in range(len(held))]
        still = make_system(np.add([[0, 0, 0]], shift), pairs, np.add(held, shift))
        run = c.run_method(still, "none", "gauss", 0.05, 40)
        assert run.stopped is None and np.max(np.abs(run.q - still["q0"])) < 1e-12 + 1e-15 * shift
        found = reference_of(still)
        assert np.max(np.abs(found.q - still["q0"])) < 1e-15 + found.uncertainty < 1e-9


@pytest.mark.parametrize("name", ["tight_cable", "spin", "heavy_tip", "jansen_leg", "windows"])
def test_large_forces_that_are_right_have_no_mark(name):
    for method in METHODS:
        _, words = told(c.build_system(name), method, "semi_implicit", 0.005, 400)
        assert "force" not in words


@pytest.mark.parametrize("bobs", [1, 2, 3])
def test_functions_of_ones_own_that_return_something_else_are_named(bobs, monkeypatch):
    system = c.build_system("chain", links=bobs)
    for wrong in (lambda q, *_: q, lambda q, v, *_: (q, v, q, v), lambda q, v, *_: (q[0], v[0])):
        monkeypatch.setitem(c.INTEGRATORS, "mine", wrong)
        told = r"^a step must return arrays of the shapes \[\(|to unpack \(expected 2"
        with pytest.raises((NotAState, ValueError), match=told):
            c.run_method(system, "none", "mine", 0.005, 10)
    theirs = {
        "external_force": lambda system, q, v: c.GRAVITY,
        "energy": lambda system, q, v: np.sum(system["m"] * v * v),
        "constraint_violation": lambda system, q: np.max(q),
    }
    for name, wrong in theirs.items():
        with monkeypatch.context() as patch, pytest.raises(SceneError, match=name):
            patch.setattr(c, name, wrong)
            c.run_method(system, "none", "rk4", 0.005, 10)


def test_a_post_step_that_returns_something_else_is_named(monkeypatch):
    """One bob's place would be taken for all, and the run would go on."""

    def torn(system, q_start, q, v, dt):
        return q[0], v

    mine = c.Method(c.make_force, "tears", torn)
    monkeypatch.setattr(c, "make_methods", lambda *_, **__: {"mine": mine})
    with pytest.raises(NotAState, match=r"\[\(2, 3\), \(2, 3\)\], and not \[\(3,\), \(2, 3\)\]$"):
        c.run_method(c.build_system("double"), "mine", "rk4", 0.005, 10)


REFUSED = [  # a method, an integrator, dt in s, steps, and what is said of them
    ("impulse", "rk4", 0.005, 9, "impulse is not made for rk4"),
    ("none", "rk4", 0.0, 9, "dt is 0.0; must be a finite number of seconds > 0"),
    ("none", "rk4", math.nan, 9, "dt is NaN; must be a finite number of seconds > 0"),
    ("none", "rk4", "1", 9, 'dt is "1"; must be a finite number of seconds > 0'),
    ("none", "rk4", 0.005, 0, "steps is 0; must be a whole number >= 1"),
    ("none", "rk4", 0.005, 2.5, "steps is 2.5; must be a whole number >= 1"),
]


@pytest.mark.parametrize(("name", "integrator", "dt", "steps", "words"), REFUSED)
def test_from_python_too_what_cannot_run_is_refused(name, integrator, dt, steps, words):
    with pytest.raises(ValueError, match=f"^{re.escape(words)}"):
        c.run_method(c.build_system("double"), name, integrator, dt, steps)


@pytest.mark.parametrize("dt", [5e-3, 5e-5])
def test_a_step_is_long_beside_a_motion_that_is_far_quicker_than_its_rods(dt):
    run = c.run_method(SMALL, "none", "semi_implicit", dt, 1000)
    assert (dt / run.time_scale > table.LONG) == (dt * math.sqrt(9.81 / 1e-5) > 0.2)


BY_HAND = [*product(METHODS, ["semi_implicit"]), ("baumgarte", "rk4"), ("none", "gauss")]


@pytest.mark.parametrize(("name", "integrator"), BY_HAND)
def test_a_loop_by_hand_over_the_file_without_its_report_has_the_bits_of_a_run(name, integrator):
    """So the published course's generator of figures executes it."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    file = {"__file__": str(ROOT / "constraints.py"), "__name__": "generator"}
    prefix = source[: source.index("# --- region: report ---")]
    as_the_course_does = __future__.annotations.compiler_flag  # in a name that is no module's
    exec(compile(prefix, "constraints.py", "exec", as_the_course_does), file)
    hand = SimpleNamespace(**file)
    system = c.build_system("double")
    method = hand.make_methods(0.005)[name]
    step_fn = hand.stabilized(hand.INTEGRATORS[integrator], system, method)
    force = method.make_force(system)
    run = c.run_method(system, name, integrator, 0.005, 20)
    q = system["q0"]
    v = system["v0"]
    for i in range(20):
        q, v = step_fn(q, v, system["m"], force, 0.005)
        assert np.array_equal([q, v], [run.q[i + 1], run.v[i + 1]])
        assert hand.energy(system, q, v) == run.energies[i + 1]
        assert hand.constraint_violation(system, q) == run.violations[i + 1]
    assert all(map(np.array_equal, hand.simulate(step_fn, system, force, 0.005, 20), run))


BITS = """
import hashlib, sys
if "slow" in sys.argv:
    sys.modules["llvmlite"] = None
import constraints as c
from curriculum.common.tracing import plain
every = [("windows", method, "semi_implicit") for method in c.make_methods(dt=1.0)]
for name, *how in [*every, ("double", "project", "gauss")]:
    with plain("plain" in sys.argv):
        steps = 20 if "plain" in sys.argv else 4000
        run = c.run_method(c.build_system(name), *how, 0.005, steps)
    assert len(sys.argv) > 1 or run.step.how == "machine code"
    for states in run.q[:20], run.q:  # plainly it takes the first steps only
        print(name, *how, hashlib.sha256(states.tobytes()).hexdigest())
"""


def test_bits_are_the_same_over_kernels_and_compilers_and_in_plain_numpy():
    pytest.importorskip("llvmlite", reason="an extra: pip install -e '.[fast]'")

    def bits(*words, **variables):
        done = python("-c", BITS, *words, variables=variables)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    usual = bits()
    assert bits("slow", NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR") == usual
    plain = bits("plain", OPENBLAS_CORETYPE="Prescott", OPENBLAS_NUM_THREADS="2")
    assert plain[::2] == usual[::2]


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
    for method in METHODS:
        run = c.run_method(system, method, "semi_implicit", 0.005, 100)
        off = np.max(np.abs(run.q[:, -1, 1] - height))
        assert off < (1e-2 if method == "soft" else 1e-9) and not run.stopped
        force = METHODS[method].make_force(system)
        pulls = c.tensions(system, run.q[-1], run.v[-1], force)
        assert pulls.shape == system["lengths"].shape
