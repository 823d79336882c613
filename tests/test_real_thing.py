"""Other engines' models of our systems, the rules that race, and what the tables make of a race."""

import json
from importlib.util import find_spec

import constraints as c
from curriculum.ch3_4_constraints import tables
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _race, real_thing, speed_vs_error
from curriculum.ch3_4_constraints.studies._runs import run

import numpy as np
import pytest

REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def needs(package):
    """The mark of a test that cannot run without a package."""
    extra = real_thing.ENGINES[package]
    why = f"needs {package}: pip install -e '.[{extra}]'"
    return pytest.mark.skipif(not find_spec(package), reason=why)


@needs("mujoco")
@pytest.mark.parametrize("rods, dt", [(1, 0.005), (4, 0.005), (25, 0.005), (3, 0.05)])
def test_soft_is_mujocos_equality_constraint_of_a_tendon(rods, dt):
    """All fields with a name here, some per cent off the rods; at 0.05 s both take two steps."""
    rng = np.random.default_rng(rods)
    for _ in range(5):
        system = peers.random_chain(rng, rods)
        ours = {field: value for (_, field), value in real_thing.ours_named(system, dt).items()}
        theirs = peers.named(system, dt, {field: value.shape for field, value in ours.items()})
        for field, x in ours.items():
            np.testing.assert_allclose(x, theirs[field], 0, 1e-12 * np.abs(x).max(), err_msg=field)


@needs("mujoco")
@pytest.mark.parametrize("name", c.SYSTEMS)
def test_mujocos_joint_angles_give_the_same_motion(name):
    task = peers.Task(c.build_system(name), 4, 0.25, None)
    theirs, ours = peers.run_hinges(task, 1000)[1], _race.run_ours(task, 5, "none", "gauss")[1]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


PEERS = {  # a coarse and a fine setting, and which share of the error the fine one may have
    "pymunk": ((100,), (1000,), 0.15),
    "exudyn": ((50, 1e-8), (500, 1e-8), 0.02),
    "scipy": ((1e-6,), (1e-13,), 1e-4),
    "heyoka": ((1e-3,), (1e-16,), 1e-8),
}


@pytest.mark.parametrize("package", [pytest.param(x, marks=needs(x)) for x in PEERS])
def test_a_peer_comes_to_the_same_motion_the_finer_it_goes(package):
    (*settings, share), task = PEERS[package], real_thing.double()
    job = getattr(peers, f"run_{package}")
    far, near = (task.error(job(task, *setting)[1]) for setting in settings)
    assert near < share * far


@needs("scipy")
def test_the_truth_of_a01_is_the_swing():
    truth, doubt = real_thing.swing((0.5 * np.arange(1, 11)).tolist())
    assert doubt < 1e-14
    found = run(real_thing.level(), "gauss", "none", 0.05, 100, range(10, 101, 10))
    np.testing.assert_allclose(found.q[..., :2], truth, rtol=0, atol=1e-12)


def test_the_cost_that_is_counted_is_linear_systems_solved():
    """Four for a step of rk4, (6 / 2)^2 + 1 for midpoint6; a projection adds its rounds, and one
    for the velocities."""
    system = c.build_system("double")
    for rule, forces in (("rk4", 4.0), ("midpoint6", 10.0)):
        none, both = (speed_vs_error.solves(system, rule, m, 0.01, 20) for m in ("none", "project"))
        assert none == forces and 2.0 <= both - none <= 5.0


@pytest.mark.parametrize("name", ["fourbar_coupler", "jansen_leg"])
def test_loops_move_as_their_one_angle_says(name):
    """gauss with project ends within rounding of studies/reference.py, rk4 at its order."""
    system, truth = c.build_system(name), np.array(REFERENCE["cases"][name]["positions"])

    def error(rule, per, n):
        found = run(system, rule, "project", 0.25 / per, per * n, range(per, per * n + 1, per))
        return np.abs(found.q[..., :2] - truth[:n]).max()

    assert error("gauss", 10, len(truth)) < 1e-13
    coarse, fine = (error("rk4", per, 8) for per in (100, 200))
    assert fine < 1e-8 and 3.5 < np.log2(coarse / fine) < 4.5


def test_a_race_is_won_by_the_least_time_and_its_bars_are_ours_over_theirs(monkeypatch):
    clock = iter(np.arange(0.0, 1000.0, 0.008))  # s: between two looks, what a job takes in all
    monkeypatch.setattr(_race.time, "perf_counter", lambda: next(clock))
    task = peers.Task(c.build_system("pendulum"), 1, 1.0, lambda q: float(q[0, 0, 0]))
    spot = np.array([[[1e-4, 0.0]]])
    seconds = {"ours, quick": 1.0, "ours, slow": 2.0, "peer": 4.0}
    ladders = {who: {"x": lambda s=s: (s, spot)} for who, s in seconds.items()}
    targets = {"near": (1e-3, {"peer": (0.3, 1.5)}), "far": (1e-5, {})}
    _, rows, bars = _race.race("", task, ladders, targets, 9.0, 2)
    assert [row["ours/it"] for row in rows] == [1.0, 0.5, 0.25] and rows[2]["who"] == "peer"
    assert [(share, limit) for _, share, limit in bars] == [(0.25, 0.3), (pytest.approx(1.0), 1.5)]


def test_a_table_tells_the_median_and_its_quartiles_in_order():
    assert tables.spread([5.0, 1.0, 4.0, 2.0, 3.0], "us") == {"us": 3.0, "us q1": 2.0, "us q3": 4.0}


def test_a_method_is_ahead_if_none_has_both_fewer_solves_and_a_smaller_error():
    cost = [(4, 1e-3), (5, 1e-3), (6, 1e-6), (7, 1e-5), (9, 1e-13), (10, 1e-14)]
    rows = [{"solves": solves, "error": error} for solves, error in cost]
    found = speed_vs_error.ahead(rows, 1e-12)  # below that all errors are equal
    assert [row["solves"] for row in found] == [4, 6, 9]
