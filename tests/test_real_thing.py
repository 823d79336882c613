"""Other engines' models of our systems, the rules that race, and what the tables make of a race."""

import math

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs, real_thing, speed_vs_error
from curriculum.ch3_4_constraints.tables import spread

import numpy as np
import pytest


@pytest.mark.parametrize("rods, dt", [(1, 0.005), (4, 0.005), (25, 0.005), (3, 0.05)])
def test_soft_is_mujocos_equality_constraint_of_a_tendon(rods, dt):
    """All fields with a name here, some per cent off the rods; at 0.05 s both take two steps."""
    pytest.importorskip("mujoco", reason="the extra compare brings it")
    rng = np.random.default_rng(rods)
    for _ in range(5):
        rows = real_thing.names(peers.random_chain(rng, rods), dt)
        assert len(rows) == 8 and max(row["largest gap"] for row in rows) < 1e-12


@pytest.mark.parametrize("name", c.SYSTEMS)
def test_mujocos_joint_angles_give_the_same_motion(name):
    pytest.importorskip("mujoco", reason="the extra compare brings it")
    task = _runs.Task(c.build_system(name), 4, 0.25, None)
    theirs, ours = peers.run_hinges(task, 1000)[1], peers.run_ours(task, 5, "gauss", "none")[1]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_gauss_meets_the_high_precision_of_a01_and_rk4_at_its_step_not_even_the_low_one():
    """Outputs are those of the closed form, which is at the bottom after Gamma(1/4)^2 / sqrt(16 pi)
    of sqrt(L / g): a quarter of the lemniscate's length."""
    quarter = math.gamma(0.25) ** 2 / math.sqrt(16.0 * math.pi * 9.81)
    xy = real_thing.level_pendulum(quarter * np.array([0.0, 1.0, 2.0, 401.0]))
    np.testing.assert_allclose(xy, [[1, 0], [0, -1], [-1, 0], [0, -1]], rtol=0, atol=1e-11)
    task = real_thing.a01(2000.0 if peers.NATIVE else 60.0)
    for mode in ("none", "project"):
        assert task.error(peers.run_ours(task, 2, "gauss", mode)[1]) < 1e-2 * real_thing.HIGH
    assert task.error(peers.run_ours(task, 2, "rk4", "project")[1]) > 100.0 * real_thing.HIGH


def test_heyoka_comes_to_the_same_motion_the_finer_it_goes():
    pytest.importorskip("heyoka", reason="the extra peers brings it")
    task = _runs.double()
    far, near = (task.error(peers.run_heyoka(task, tol)[1]) for tol in (1e-3, 1e-16))
    assert near < 1e-8 * far


def test_the_cost_that_is_counted_is_linear_systems_solved():
    """rk4: four; midpoint6: (6 / 2)^2 + 1; a projection adds its rounds, and one for velocities."""
    system = c.build_system("double")
    for rule, forces in (("rk4", 4.0), ("midpoint6", 10.0)):
        none, both = (speed_vs_error.solves(system, rule, m, 0.01, 20) for m in ("none", "project"))
        assert none == forces and 2.0 <= both - none <= 5.0


def test_a_race_is_won_by_the_least_time_and_its_bars_are_ours_over_theirs(monkeypatch):
    """A climb ends at what reaches the error; of two ladders the quicker one goes on."""
    clock = iter(np.arange(0.0, 1000.0, 0.008))  # s: between two looks, what a job takes in all
    monkeypatch.setattr(real_thing.time, "perf_counter", lambda: next(clock))
    task = _runs.Task(c.build_system("pendulum"), 1, 1.0, lambda q: float(q[0, 0, 0]))

    def jobs(*rungs):
        return {s: lambda s=s, x=x: (s, np.array([[[x, 0.0]]])) for s, x in rungs}

    slow = jobs((0.5, 1.0), (2.0, 1e-4), (6.0, 1e-4))
    racers = {"ours": [slow, jobs((1.0, 1e-4), (3.0, 0.0))], "heyoka": [slow]}
    limits = ("ours", "heyoka", 0, 0.6), ("ours", "heyoka", 1, 1.5), ("ours", "nobody", 0, 1.0)
    rows, bars = real_thing.race(task, racers, {1e-3: limits, 1e-5: ()}, 2)
    found = [(row["to"], row["who"], row["setting"], row["ours/it"]) for row in rows]
    near = [("1e-03", "ours", 1.0, 1.0), ("1e-03", "heyoka", 2.0, 0.5)]
    assert found == [*near, ("1e-05", "ours", 3.0, 1.0)]
    assert [(share, limit) for _, share, limit in bars] == [(0.5, 0.6), (pytest.approx(1.0), 1.5)]


def test_a_table_tells_the_median_and_its_quartiles_in_order():
    assert spread([5.0, 1.0, 4.0, 2.0, 3.0], "us") == {"us": 3.0, "us q1": 2.0, "us q3": 4.0}


def test_a_method_is_ahead_if_none_has_both_fewer_solves_and_a_smaller_error():
    cost = [(4, 1e-3), (5, 1e-3), (6, 1e-6), (7, 1e-5), (9, 1e-14), (10, 1e-15)]
    rows = [{"solves": solves, "error": error} for solves, error in cost]
    found = speed_vs_error.ahead(rows)  # below rounding all errors are equal
    assert [row["solves"] for row in found] == [4, 6, 9]
