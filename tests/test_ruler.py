"""The ruler: gauss against high-precision references that share neither its formulation nor its
rule."""

import json

import constraints as c
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common.gauss import collocation, make_gauss
from curriculum.common.motion import Pieces, distance
from curriculum.common.ruler import settle, true_position

import numpy as np
import pytest
from numpy.polynomial import legendre

REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def measured(name, rule, dt, until=5.0, mode="project"):
    """The largest distance of a particle from the reference at its sample times up to `until`, in
    m; and the Run."""
    keep = [round(t / dt) for t in REFERENCE["times"] if t <= until]
    found = run(c.build_system(name), rule, mode, dt, keep[-1], keep)
    assert not found.stopped
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(keep)]
    return np.linalg.norm(found.q[..., :2] - truth, axis=-1).max(), found


def ruled(name, seconds):
    """true_position of a chapter scene."""
    return true_position(
        lambda rule, dt, steps: run(c.build_system(name), rule, "project", dt, steps), seconds
    )


@pytest.mark.parametrize("name", REFERENCE["cases"])
@pytest.mark.parametrize("mode", ["none", "project"])
def test_gauss_is_true_to_a_trillionth_of_a_metre(name, mode):
    error, found = measured(name, "gauss", 0.025, mode=mode)
    assert error < 1e-12 and found.halved == 0


@pytest.mark.parametrize(("stages", "dt"), [(1, 0.01), (2, 0.025), (3, 0.05), (4, 0.0625)])
def test_order_is_twice_the_stages(stages, dt):
    errors = [
        measured("double", make_gauss(stages, 2), step, 1.0, "none")[0]
        for step in (dt, dt / 2, dt / 4)
    ]
    found = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert 2 * stages - 0.4 < found[-1] < 2 * stages + 0.4, found


@pytest.mark.parametrize("stages", [1, 2, 5, 8, 12])
def test_collocation_integrates_every_polynomial_it_claims_to(stages):
    """t^p up to the nodes, once and twice; over a step up to p = 2 * stages - 1; and what a
    polynomial ends in."""
    nodes, weights, once, twice, last = collocation(stages)
    for p in range(2 * stages):
        assert abs(weights @ nodes**p - 1.0 / (p + 1)) < 1e-15
    for p in range(stages):
        assert np.abs(once @ nodes**p - nodes ** (p + 1) / (p + 1)).max() < 1e-15
        if p < stages - 1:
            assert np.abs(twice @ nodes**p - nodes ** (p + 2) / ((p + 1) * (p + 2))).max() < 1e-15
    terms = last.T @ legendre.legvander(2.0 * nodes - 1.0, stages - 1)
    assert np.abs(terms - np.eye(stages)[-2:]).max() < 1e-14


def test_stages_taken_along_change_the_cost_and_not_the_result():
    """Windows of 1 and of 5 steps end at the same numbers, to where the iteration stops."""
    alone, along = (
        run(c.build_system("double"), make_gauss(8, n, 1e-13), 0.0, 0.05, 100).q[-1] for n in (1, 5)
    )
    assert distance(alone, along) < 1e-12


@pytest.mark.parametrize(("name", "dt"), [("pendulum", 0.5), ("double", 0.2)])
def test_a_step_ahead_that_runs_away_is_guessed_anew(name, dt):
    """Else it would drag down a step that needs no halves when it is taken alone."""
    for window in (1, 4, 8):
        assert run(c.build_system(name), make_gauss(8, window), 0.0, dt, round(4 / dt)).halved == 0


def test_a_caller_may_move_the_state_and_change_the_step():
    """What a run remembers is a guess, nothing else: the next step is that of a rule without a
    past."""
    system, rule = c.build_system("double"), c.INTEGRATORS["gauss"]
    q, v, m = system["q0"], system["v0"], system["m"]
    force = Pieces(c.make_force(system, 0.0), m, np.zeros(q.shape, dtype=bool))
    for k in range(12):
        dt = (0.05, 0.02)[k // 3 % 2]
        fresh = make_gauss(8, 1)(q, v, m, c.make_force(system, 0.0), dt)
        q, v = rule(q, v, m, force, dt)
        assert np.abs(np.array(fresh) - np.array([q, v])).max() < 1e-12
        v = v * (1.0 + 0.2 * (-1) ** k)
    assert force.memory


def test_a_rule_remembers_nothing_between_runs():
    first, _, again = (
        run(c.build_system(name), "gauss", 0.0, 0.05, 20) for name in ("double", "triple", "double")
    )
    assert np.array_equal(first.q, again.q)


@pytest.mark.parametrize(
    ("name", "mode", "halved"), [("double", "project", 1), ("triple", "none", 3)]
)
def test_a_step_too_long_for_its_stages_is_taken_in_halves_and_counted(name, mode, halved):
    error, found = measured(name, "gauss", 0.25, mode=mode)
    assert error < 1e-4 and halved <= found.halved < len(found.tip) - 1
    assert found.violations.max() < 1e-4
    assert run(c.build_system(name), "gauss", mode, 1.0, 5).halved == 5  # however often each was


def test_where_halves_do_not_help_it_says_so():
    found = run(c.build_system("double"), "gauss", 0.0, 100.0, 20)
    assert (
        found.stopped.startswith("stopped at step 1: the Gauss stages do not ")
        and "at dt 0.39" in found.stopped
    )
    system = c.build_system("double")
    with pytest.raises(FloatingPointError, match="the Gauss stages do not .* at dt 5"):
        c.INTEGRATORS["gauss"](
            system["q0"], system["v0"], system["m"], c.make_force(system, 0.0), 5.0
        )


def test_the_ruler_knows_its_own_error():
    truth, known = ruled("double", 2.0)
    reference = np.array(REFERENCE["cases"]["double"]["positions"])[REFERENCE["times"].index(2.0)]
    assert np.linalg.norm(truth[:, :2] - reference, axis=1).max() < 1e-12
    assert known < 1e-12


def test_the_ruler_knows_a_place_to_a_nanometre_or_not_at_all():
    """Chaos decides: after 10 s its first two steps still differ by more, after 20 s all do."""
    truth, known = ruled("triple", 10.0)
    assert truth is not None and known < 1e-9
    assert ruled("triple", 20.0) == (None, np.inf)


@pytest.mark.parametrize("tol", [1e-4, 1e-9])
def test_tol_is_met_and_noted(tol, capsys, tmp_path):
    flags = [
        "--integrator",
        "gauss",
        "--tol",
        str(tol),
        "--steps",
        "1000",
        "--no-rerun",
        "--out",
        str(tmp_path),
    ]
    c.main([*flags, "--stabilization", "none"])
    found = json.loads((tmp_path / "metrics.json").read_text())
    assert found["tol"] == tol and found["results"]["none"]["error"] <= tol
    assert found["dt"] > 0.005 and found["dt"] * found["steps"] == pytest.approx(
        5.0, abs=found["dt"]
    )
    capsys.readouterr()


@pytest.mark.parametrize("dt", [1e3, 9e11])
def test_the_ruler_does_not_follow_a_step_that_is_too_long_for_it(dt, tmp_path):
    c.main(["--no-rerun", "--dt", str(dt), "--steps", "2", "--out", str(tmp_path)])
    rows = json.loads((tmp_path / "metrics.json").read_text())["results"].values()
    assert [row["error"] for row in rows] == [None] * 5


def test_the_rulers_budget_counts_every_step_and_every_half_of_one():
    """At 10 m/s and more the first rung takes nearly all its steps in halves, and there is no
    second."""
    system, asked = c.build_system("spin"), []

    def counted(rule, dt, steps):
        asked.append(steps)
        found = run(system, rule, "project", dt, steps)
        assert found.halved or found.stopped
        return found

    assert true_position(counted, 2.0, 125) == (None, np.inf)
    assert asked == [40] and true_position(counted, 2.0, 119) == (None, np.inf) and asked == [40]


def test_the_ruler_leaves_out_what_is_done_by_arrays():
    system = c.build_system("chain", links=large.CHAIN + 1)

    def simulate(*_):
        raise AssertionError("a run of the ruler")

    def case(mode, rule, dt):
        return None, system, None, dt

    rule, dt, steps, truth = settle(simulate, case, ["none"], "rk4", 0.005, 400, None)
    assert (rule, dt, steps, truth) == ("rk4", 0.005, 400, (400, None, np.inf))
