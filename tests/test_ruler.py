"""The ruler: gauss against high-precision references that share neither its formulation nor its rule."""

import json

import numpy as np
import pytest

import constraints as c
from curriculum.common.gauss import collocation, make_gauss

REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def error(name, rule, dt, until=5.0, mode="project"):
    """The largest distance of a particle from the reference at its sample times up to `until`, in m."""
    times = [t for t in REFERENCE["times"] if t <= until]
    keep = [round(t / dt) for t in times]
    run = c.simulate(c.build_system(name), rule, c.hold_table()[mode], dt, keep[-1], keep)
    assert not run["stopped"]
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(times)]
    return np.linalg.norm(run["kept"]["q"][..., :2] - truth, axis=-1).max()


@pytest.mark.parametrize("name", c.SYSTEMS)
@pytest.mark.parametrize("mode", ["none", "project"])
def test_gauss_is_true_to_a_trillionth_of_a_metre(name, mode):
    assert error(name, "gauss", 0.025, mode=mode) < 1e-12


@pytest.mark.parametrize(("stages", "dt"), [(1, 0.01), (2, 0.02), (3, 0.05), (4, 0.0625)])
def test_order_is_twice_the_stages(stages, dt):
    errors = [error("double", make_gauss(stages, 2), step, 1.0, "none") for step in (dt, dt / 2, dt / 4)]
    found = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert 2 * stages - 0.4 < found[-1] < 2 * stages + 0.4, found


@pytest.mark.parametrize("stages", [1, 2, 5, 8, 12])
def test_collocation_integrates_every_polynomial_it_claims_to(stages):
    """a = t^p over three steps gives v = t^(p+1)/(p+1) and q = t^(p+2)/((p+1)(p+2)); q's last p at the ends only."""
    to_q, to_v, times, ahead = collocation(stages, 3)
    nodes = times[: 3 * stages]
    for p in range(stages):
        assert np.abs(to_v @ nodes**p - times ** (p + 1) / (p + 1)).max() < 1e-14 * 3 ** (p + 1)
        gap = np.abs(to_q @ nodes**p - times ** (p + 2) / ((p + 1) * (p + 2)))
        assert (gap if p < stages - 1 else gap[3 * stages :]).max() < 1e-14 * 3 ** (p + 2)
    for p in range(max(1, stages // 2)):
        assert np.abs(ahead @ nodes[:stages] ** p - nodes[stages : 2 * stages] ** p).max() < 1e-9


def test_stages_taken_along_change_the_cost_and_not_the_result():
    """Windows of 1 and of 5 steps end at the same numbers, to where the iteration stops."""
    alone, along = (
        c.simulate(c.build_system("double"), make_gauss(8, window, 1e-13), 0.0, 0.05, 100) for window in (1, 5)
    )
    assert c.distance(alone["q"], along["q"]) < 1e-12


def test_a_caller_may_move_the_state_between_steps():
    """The memory of a run is a guess, nothing else: from any state the next step is that of a rule without a past."""
    system, used = c.build_system("double"), make_gauss()
    force, q, v = c.make_force(system, 0.0), system["q0"], system["v0"]
    for k in range(10):
        q, v = used(q, v, system["m"], force, 0.05)
        v = v * (1.0 + 0.2 * (-1) ** k)
        fresh = make_gauss()(q, v, system["m"], force, 0.05)
        assert np.abs(np.array(fresh) - np.array(make_gauss(8, 1)(q, v, system["m"], force, 0.05))).max() < 1e-12
        assert np.abs(np.array(fresh) - np.array(used(q, v, system["m"], force, 0.05))).max() < 1e-12


def test_where_the_stages_do_not_settle_it_says_so():
    run = c.simulate(c.build_system("double"), "gauss", 0.0, 0.5, 20)
    assert run["stopped"].startswith("stopped at step ") and "at dt 0.5" in run["stopped"]
    system = c.build_system("double")
    with pytest.raises(FloatingPointError, match="do not settle"):
        c.INTEGRATORS["gauss"](system["q0"], system["v0"], system["m"], c.make_force(system, 0.0), 5.0)


def test_the_ruler_knows_its_own_error():
    truth, known = c.true_position(c.build_system("double"), 2.0)
    reference = np.array(REFERENCE["cases"]["double"]["positions"])[REFERENCE["times"].index(2.0)]
    assert np.linalg.norm(truth[:, :2] - reference, axis=1).max() < 1e-12
    assert known < 1e-12


@pytest.mark.parametrize("tol", [1e-4, 1e-9])
def test_tol_is_met(tol, capsys, tmp_path):
    flags = ["--integrator", "gauss", "--tol", str(tol), "--steps", "1000", "--no-rerun", "--out", str(tmp_path)]
    c.main([*flags, "--stabilization", "none"])
    result = json.loads((tmp_path / "metrics.json").read_text())
    assert result["results"]["none"]["error"] <= tol
    assert result["dt"] > 0.005 and result["dt"] * result["steps"] == pytest.approx(5.0, abs=result["dt"])
    capsys.readouterr()
