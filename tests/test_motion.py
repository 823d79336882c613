"""The motion: the chapter's numbers, closed forms, an independent formulation, orders and limits, each measured."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import constraints as c

REFERENCE = json.loads((Path(c.HERE) / c.CHAPTER / "studies" / "reference.json").read_text(encoding="utf-8"))


def table(dt=0.005):
    return c.hold_table(dt)


def positions_at(system, times, integrator, hold, dt):
    """(K, N, 3) positions at `times`, which the step divides."""
    steps = [round(t / dt) for t in times]
    return c.simulate(system, integrator, hold, dt, steps[-1], steps)["kept"]["q"]


def true_error(name, integrator, hold, dt, until=5.0):
    """Largest distance of a particle from where Lagrange's equations in joint angles put it (studies/reference.py)."""
    times = [t for t in REFERENCE["times"] if t <= until]
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(times)]
    q = positions_at(c.build_system(name), times, integrator, hold, dt)
    return np.max(np.linalg.norm(q[..., :2] - truth, axis=-1))


def orders(errors):
    """Observed order between neighbours of a ladder that halves dt."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize(
    ("system", "integrator", "mode", "worst", "final", "drift"),
    [
        ("double", "semi_implicit", "none", "0.384", "0.384", "0.43"),
        ("double", "semi_implicit", "baumgarte", "0.023", "0.0014", "0.32"),
        ("pendulum", "rk4", "none", "8.8e-06", None, "1.2e-05"),
    ],
)
def test_the_chapters_numbers(system, integrator, mode, worst, final, drift):
    run = c.simulate(c.build_system(system), integrator, table()[mode])
    for found, expected in (("max_violation", worst), ("final_violation", final), ("energy_rel_max", drift)):
        if expected:
            digits = len(expected.split("e")[0].lstrip("0.").replace(".", ""))
            assert f"{float(run[found]):.{digits}g}" == f"{float(expected):.{digits}g}"


def test_neighbouring_seeds_part():
    tips = [c.simulate(c.build_system("double", seed), hold=20.0)["q"][-1] for seed in (0, 1)]
    assert f"{np.linalg.norm(tips[0] - tips[1]):.1f}" == "1.1"


def test_none_drifts_over_three_times_as_far_as_baumgarte_on_every_chapter_scene():
    for name in c.SYSTEMS:
        for seed in range(3):
            none, helped = (c.simulate(c.build_system(name, seed), hold=w)["max_violation"] for w in (0.0, 20.0))
            assert none > 3.0 * helped


def test_the_pendulum_keeps_time_with_the_complete_elliptic_integral():
    """Period 4 K(sin(phi_0/2)) sqrt(L/g), K by Gauss's mean; the bob is at rest again on its own side after it."""
    system = c.build_system("pendulum")
    x, y, _ = system["q0"][0]
    k = math.sin(0.5 * math.atan2(x, -y))
    a, b = 1.0, math.sqrt(1.0 - k * k)
    while abs(a - b) > 1e-15:
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    period = 4.0 * (math.pi / (2.0 * a)) / math.sqrt(9.81)
    steps = 4000
    run = c.simulate(system, "rk4", table()["project"], period / steps, steps)
    assert np.abs(run["q"] - system["q0"]).max() < 1e-11
    assert np.abs(run["v"]).max() < 1e-9


@pytest.mark.parametrize("name", c.SYSTEMS)
def test_rk4_meets_the_closed_form_and_the_independent_formulation(name):
    """The single pendulum against Jacobi's elliptic functions, the others against joint angles in 44 digits."""
    assert REFERENCE["cases"][name]["error"] < 1e-30
    assert true_error(name, "rk4", table()["project"], 0.001) < 2e-8


@pytest.mark.parametrize(
    ("integrator", "mode", "low", "high", "dts"),
    [
        ("euler", "none", 0.9, 1.2, [0.001, 0.0005, 0.00025]),
        ("semi_implicit", "none", 0.9, 1.1, [0.001, 0.0005, 0.00025]),
        ("semi_implicit", "project", 0.9, 1.1, [0.001, 0.0005, 0.00025]),
        ("rk4", "none", 3.9, 4.6, [0.005, 0.0025, 0.00125]),
        ("rk4", "project", 3.9, 4.6, [0.0025, 0.00125, 0.000625]),
    ],
)
def test_order_on_the_trajectory(integrator, mode, low, high, dts):
    found = orders([true_error("double", integrator, table(dt)[mode], dt, 2.0) for dt in dts])
    assert (low < found).all() and (found < high).all(), found


@pytest.mark.parametrize(("integrator", "low", "high"), [("semi_implicit", 0.9, 1.1), ("rk4", 3.95, 5.0)])
def test_order_on_the_rods(integrator, low, high):
    system = c.build_system("double")
    ladder = [0.005, 0.0025, 0.00125]
    found = orders([c.simulate(system, integrator, 0.0, dt, round(5 / dt))["max_violation"] for dt in ladder])
    assert (low < found).all() and (found < high).all(), found


def test_impulse_beats_baumgarte_tenfold_at_the_same_price():
    runs = {mode: c.simulate(c.build_system("double"), hold=table()[mode]) for mode in ("baumgarte", "impulse")}
    for key in ("max_violation", "energy_rel_max"):
        assert runs["baumgarte"][key] > 10.0 * runs["impulse"][key]


@pytest.mark.parametrize("integrator", ["semi_implicit", "rk4"])
def test_project_holds_rods_and_their_rates(integrator):
    for name in c.SYSTEMS:
        system = c.build_system(name)
        run = c.simulate(system, integrator, table()["project"])
        assert run["max_violation"] < 1e-10
        assert np.abs(c.constraint_terms(system, run["q"], run["v"])[2]).max() < 1e-10


def test_semi_implicit_with_project_keeps_energy_without_a_trend():
    """100 s: within 6e-3, no slope beyond the noise of block means, and half of it at half the step."""
    system, worst = c.build_system("double"), []
    for dt in (0.005, 0.0025):
        run = c.simulate(system, hold=table(dt)["project"], dt=dt, steps=round(100 / dt), keep=range(0, 40001, 10))
        error = run["kept"]["energy"]
        worst.append(float(run["energy_rel_max"]))
        blocks = error[: len(error) // 20 * 20].reshape(20, -1).mean(axis=1)  # 5 s each: their scatter is the noise
        when = np.arange(20) - 9.5
        slope = (when @ blocks) / (when @ when)
        noise = np.std(blocks - blocks.mean() - slope * when, ddof=2) / np.sqrt(when @ when)
        assert abs(slope) < 3.0 * noise
    assert worst[0] < 6e-3
    assert 0.4 < worst[1] / worst[0] < 0.6


@pytest.mark.parametrize("integrator", c.STABILITY_LIMIT)
def test_baumgarte_holds_up_to_the_stability_limit(integrator):
    """A pendulum at rest, its rod 1e-9 m too long: below dt w = limit the error dies, above it grows. By bisection."""
    hanging = c.make_system([[0.0, -1.0 - 1e-9, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)], [1.0])
    low, high = 0.1, 4.0
    while high - low > 1e-3:
        z = 0.5 * (low + high)
        run = c.simulate(hanging, integrator, z / 0.005, 0.005, 3000)
        low, high = (low, z) if run["final_violation"] > 1e-9 else (z, high)
    assert low == pytest.approx(c.STABILITY_LIMIT[integrator], rel=0.02)


def test_a_run_that_blows_up_stops_and_keeps_what_was_true():
    system = c.build_system("double")
    run = c.simulate(system, hold=40.0, dt=0.05, steps=4000, keep=range(4001))
    assert run["stopped"] == f"diverged at step {run['steps'] + 1}" and run["steps"] < 50
    assert np.isfinite(run["q"]).all() and run["max_violation"] == run["kept"]["violation"].max() < np.inf
    assert list(run["kept"]["step"]) == list(range(run["steps"] + 1))


def test_every_step_is_measured_whatever_is_kept():
    """The worst rod error of a run equals the largest of all its states, block edges included."""
    system = c.build_system("double")
    run = c.simulate(system, steps=3000, keep=range(3001))
    kept = run["kept"]
    assert run["max_violation"] == c.constraint_violation(system, kept["q"]).max() == kept["violation"].max()
    assert run["energy_rel_max"] == np.abs(kept["energy"]).max()
    few = c.simulate(system, steps=3000, keep=[0, 7, 2048, 3000])
    assert np.array_equal(few["kept"]["q"], kept["q"][[0, 7, 2048, 3000]]) and np.array_equal(few["q"], run["q"])


def test_an_ensemble_is_its_members():
    system = c.build_system("triple")
    starts = np.stack([c.build_system("triple", seed)["q0"] for seed in range(4)])
    together = c.simulate({**system, "q0": starts, "v0": np.zeros_like(starts)}, hold=20.0, steps=200)
    for seed in range(4):
        alone = c.simulate(c.build_system("triple", seed), hold=20.0, steps=200)
        assert np.abs(alone["q"] - together["q"][seed]).max() < 1e-12
        assert abs(alone["max_violation"] - together["max_violation"][seed]) < 1e-13
