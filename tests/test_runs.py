"""What a run leaves behind: every step measured, what was to be kept, how it ended and how long."""

from itertools import count
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common import compiled, steps
from curriculum.common.compiled import Compiled
from curriculum.common.ruler import Truth
from curriculum.common.runs import distance
from curriculum.common.steps import Plain
from curriculum.common.trace import Stop

import numpy as np
import pytest


def test_a_force_made_for_another_step_is_refused():
    system = c.build_system("double")
    for mode in ("impulse", "soft"):
        force = c.make_force(system, mode)
        with pytest.raises(ValueError, match="is for steps of 0.005 s, not of 0.008 s"):
            c.simulate(c.semi_implicit_step, system, force, 0.008, 1)


def test_a_run_that_blows_up_stops_and_keeps_what_was_true():
    found = run(c.build_system("double"), hold=40.0, dt=0.05, keep=range(4001))
    assert found.stopped == f"diverged at step {len(found.tip)}" and len(found.tip) < 50
    assert found.kind == "diverged" and found.note == found.stopped
    assert list(found.kept) == list(range(len(found.tip)))
    assert all(np.isfinite(x).all() for x in (*found[:3], found.q, found.v))


def test_what_is_not_finite_ends_a_run_before_it_starts_or_there(monkeypatch):
    """Energy tells first: Euler moves q by the old v, so that rods are right for one more step."""
    system = c.build_system("pendulum")
    with pytest.raises(ValueError, match="finite"):
        run(system | {"v0": np.array([[0.0, 0.0, np.nan]])}, "euler", steps=1)
    monkeypatch.setattr(c, "external_force", lambda *_: np.array([[0.0, -1e200, 0.0]]))
    found = run(system, "euler", steps=5)
    assert found.stopped == "diverged at step 1" and np.isfinite(found.energies).all()


@pytest.mark.parametrize("way", [Compiled, Plain])
def test_a_step_that_gives_up_ends_a_run_with_its_words(way):
    def tired(q, v, m, force, dt):
        if q[0, 1] < -0.1:
            raise Stop("it is too far down", "height")
        return c.rk4_step(q, v, m, force, dt)

    system = c.build_system("pendulum")
    found = c.simulate(tired, system, c.make_force(system, 0.0), 0.01, 90, way=way)
    assert found.stopped == f"stopped at step {len(found.tip)}: it is too far down"
    assert found.kind == "height" and 1 < len(found.tip) < 30 and found.halved == 0


@pytest.mark.parametrize(("rule", "count"), [("semi_implicit", 20000), ("gauss", 300)])
def test_every_step_is_measured_whatever_is_kept(rule, count):
    """The three series are those of all states, from the start on and over the edges of blocks."""
    system = c.build_system("double")
    tip, violations, energies, *_ = full = run(system, rule, steps=count, keep=range(count + 1))
    assert np.array_equal(full.kept, np.arange(count + 1))
    assert np.array_equal(full.q[0], system["q0"]) and np.array_equal(tip, full.q[:, -1])
    assert np.abs(violations - c.constraint_violation(system, full.q)).max() < 1e-14
    assert np.abs(energies - c.energy(system, full.q, full.v)).max() < 1e-12
    some = [0, 7, count - 60, count]
    few, last = (run(system, rule, steps=count, keep=keep) for keep in (some, ()))
    assert np.array_equal(few.q, full.q[some]) and np.array_equal(few.v, full.v[some])
    assert np.array_equal(few.violations, violations) and np.array_equal(last.q, full.q[-1:])
    assert np.array_equal(few.at(7), full.q[7]) and few.at(8) is None


def test_the_pace_is_the_time_of_the_steps_over_their_number(monkeypatch):
    """By a clock that says one second has gone by, whenever it is asked for the second time."""
    clock = SimpleNamespace(perf_counter=count().__next__)
    for module in (steps, compiled):
        monkeypatch.setattr(module, "time", clock)
    system = c.build_system("double")
    assert run(system, steps=4).pace == 250000.0
    assert run(system, steps=4, way=Plain).pace == 1e6
    found = run(system, hold=40.0, dt=0.05, steps=16)  # in one block: what blows up is not slow
    assert found.stopped and found.pace == pytest.approx(1e6 / 16)


def test_a_summary_is_rounded_and_knows_its_error():
    system = c.build_system("double")
    found = run(system, hold="none", steps=100, keep=[50])
    moved = found.at(50) + [[0.0, 3e-3, 4e-3], [0.0, 0.0, 1e-3]]
    assert distance(found.at(50), moved) == pytest.approx(5e-3, rel=1e-12)
    row = found.summary(2.0, Truth(50, moved, 1e-12))
    assert row["error"] == pytest.approx(5e-3, rel=1e-9) and row["stopped"] is None
    assert row["final_violation"] == round(float(found.violations[-1]), 12)
    swing = np.abs(found.energies - found.energies[0]).max()
    assert row["energy_rel_max"] == pytest.approx(0.5 * swing, abs=1e-12)
    assert found.summary(2.0, Truth(51, moved))["error"] is None
    assert found.summary(2.0, Truth(50))["error"] is None
    halved = found._replace(halved=2, stopped="diverged at step 9")
    assert halved.note == "took 2 steps in halves, and diverged at step 9"
