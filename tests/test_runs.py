"""What a run leaves behind: every step measured, what was to be kept, how it ended and how long."""

from itertools import count
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common import compiled, steps
from curriculum.common.ruler import Truth
from curriculum.common.trace import Stop

import numpy as np
import pytest

DOUBLE, PENDULUM = c.build_system("double"), c.build_system("pendulum")


def test_a_run_that_could_not_be_right_is_refused():
    for mode in ("impulse", "soft"):
        with pytest.raises(ValueError, match="is for steps of 0.005 s, not of 0.008 s"):
            c.simulate(c.semi_implicit_step, DOUBLE, c.make_force(DOUBLE, mode), 0.008, 1)
    with pytest.raises(ValueError, match="does not fit rk4"):
        run(DOUBLE, "rk4", "impulse", steps=1)
    with pytest.raises(ValueError, match="finite"):
        run(PENDULUM | {"v0": np.array([[0.0, 0.0, np.nan]])}, steps=1)


def test_a_run_that_blows_up_stops_and_keeps_what_was_true(monkeypatch):
    found = run(DOUBLE, hold=40.0, dt=0.05, keep=range(4001))
    assert found.stopped == found.note == f"diverged at step {len(found.tip)}"
    assert found.kind == "diverged" and list(found.kept) == list(range(len(found.tip)))
    assert len(found.tip) < 50
    assert all(np.isfinite(x).all() for x in (*found[:3], found.q, found.v))
    # energy tells first: Euler moves q by the old v, so that rods are right for one more step
    monkeypatch.setattr(c, "external_force", lambda *_: np.array([[0.0, -1e200, 0.0]]))
    found = run(PENDULUM, "euler", steps=5)
    assert found.stopped == "diverged at step 1" and np.isfinite(found.energies).all()


@pytest.mark.parametrize("way", [compiled.Compiled, steps.Plain])
def test_a_step_that_gives_up_ends_a_run_with_its_words(way):
    def tired(q, v, m, force, dt):
        if q[0, 1] < -0.1:
            raise Stop("it is too far down", "height")
        return c.rk4_step(q, v, m, force, dt)

    found = c.simulate(tired, PENDULUM, c.make_force(PENDULUM, 0.0), 0.01, 90, way=way)
    assert found.stopped == f"stopped at step {len(found.tip)}: it is too far down"
    assert found.kind == "height" and 1 < len(found.tip) < 30 and found.halved == 0


@pytest.mark.parametrize(("rule", "count"), [("semi_implicit", 20000), ("gauss", 300)])
def test_every_step_is_measured_whatever_is_kept(rule, count):
    """The three series are those of all states, from the start on and over the edges of blocks."""
    full = run(DOUBLE, rule, steps=count, keep=range(count + 1))
    same, some = np.array_equal, [0, 7, count - 60, count]
    assert same(full.kept, np.arange(count + 1)) and same(full.q[0], DOUBLE["q0"])
    assert same(full.tip, full.q[:, -1])
    assert np.abs(full.violations - c.constraint_violation(DOUBLE, full.q)).max() < 1e-14
    assert np.abs(full.energies - c.energy(DOUBLE, full.q, full.v)).max() < 1e-12
    few = run(DOUBLE, rule, steps=count, keep=some)
    assert same(few.q, full.q[some]) and same(few.v, full.v[some])
    assert same(few.violations, full.violations) and same(few.at(7), full.q[7])


def test_the_pace_is_the_time_of_the_steps_over_their_number(monkeypatch):
    """By a clock that says one second has gone by, whenever it is asked for the second time."""
    clock = count()
    for module in (steps, compiled):
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=clock.__next__))
    assert run(DOUBLE, steps=4).pace == 250000.0
    assert run(DOUBLE, steps=4, way=steps.Plain).pace == 1e6
    found = run(DOUBLE, hold=40.0, dt=0.05, steps=16)  # in one block: what blows up is not slow
    assert found.stopped and found.pace == pytest.approx(1e6 / 16)


def test_a_summary_is_rounded_and_knows_its_error():
    found = run(DOUBLE, steps=100, keep=[50])
    moved = found.at(50) + [[0.0, 3e-3, 4e-3], [0.0, 0.0, 1e-3]]
    row = found.summary(2.0, Truth(50, moved, 1e-12))
    assert row["error"] == pytest.approx(5e-3, rel=1e-9) and row["stopped"] is None
    assert row["final_violation"] == round(float(found.violations[-1]), 12)
    swing = np.abs(found.energies - found.energies[0]).max()
    assert row["energy_rel_max"] == pytest.approx(0.5 * swing, abs=1e-12)
    assert [found.summary(2.0, x)["error"] for x in (Truth(51, moved), Truth(50))] == [None, None]
    halved = found._replace(halved=2, stopped="diverged at step 9")
    assert halved.note == "took 2 steps in halves, and diverged at step 9"
