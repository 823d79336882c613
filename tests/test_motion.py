"""The motion: the chapter's numbers, closed forms, another formulation, orders and limits."""

import json
import math

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, make_system, run

import numpy as np
import pytest

REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def true_error(name, rule, mode, dt, until=5.0):
    """Largest distance of a particle from where angles put it (studies/reference.py)."""
    steps = [round(t / dt) for t in REFERENCE["times"] if t <= until]  # which the step divides
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(steps)]
    found = run(c.build_system(name), rule, mode, dt, steps[-1], steps)
    return np.max(np.linalg.norm(found.q[..., :2] - truth, axis=-1))


def orders(errors):
    """Observed order between neighbours of a ladder that halves dt."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


@pytest.mark.parametrize(
    ("name", "mode", "worst"),
    [
        ("double", "none", 0.384014620396),
        ("double", "baumgarte", 0.023470285993),
        ("triple", "none", 0.403663129450),
    ],
)
def test_the_published_script_finds_the_same_twelve_digits(name, mode, worst):
    assert round(float(run(c.build_system(name), hold=mode).violations.max()), 12) == worst


def test_the_chapters_other_numbers():
    """As it prints them: final rod errors and energies, and what RK4 leaves of the pendulum's."""
    none, helped = (run(c.build_system("double"), hold=mode) for mode in ("none", "baumgarte"))
    assert f"{none.violations[-1]:.3f} {helped.violations[-1]:.4f}" == "0.384 0.0014"
    assert [f"{drift(c.build_system('double'), found):.2f}" for found in (none, helped)] == [
        "0.43",
        "0.32",
    ]
    swing = run(c.build_system("pendulum"), "rk4")
    assert (
        f"{swing.violations.max():.1e} {drift(c.build_system('pendulum'), swing):.1e}"
        == "8.8e-06 1.2e-05"
    )


def test_neighbouring_seeds_part_and_a_generator_is_as_good_as_a_seed():
    drawn = c.build_system("double", np.random.default_rng(1))
    assert np.array_equal(drawn["q0"], c.build_system("double", 1)["q0"])
    tips = [run(system, hold=20.0).tip[-1] for system in (c.build_system("double", 0), drawn)]
    assert f"{np.linalg.norm(tips[0] - tips[1]):.1f}" == "1.1"


def test_none_drifts_over_three_times_as_far_as_baumgarte_on_every_chapter_scene():
    for name in c.SYSTEMS:
        for seed in range(3):
            none, helped = (
                run(c.build_system(name, seed), hold=w).violations.max() for w in (0.0, 20.0)
            )
            assert none > 3.0 * helped


def test_the_pendulum_keeps_time_with_the_complete_elliptic_integral():
    """Period 4 K(sin(phi_0/2)) sqrt(L/g), K by Gauss's mean: then the bob is where it began."""
    system = c.build_system("pendulum")
    x, y, _ = system["q0"][0]
    k = math.sin(0.5 * math.atan2(x, -y))
    a, b = 1.0, math.sqrt(1.0 - k * k)
    while abs(a - b) > 1e-15:
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    period = 4.0 * (math.pi / (2.0 * a)) / math.sqrt(9.81)
    swing = run(system, "rk4", "project", period / 4000, 4000)
    assert np.abs(swing.q[-1] - system["q0"]).max() < 1e-11
    assert np.abs(swing.v[-1]).max() < 1e-9


@pytest.mark.parametrize("name", REFERENCE["cases"])
def test_rk4_meets_the_closed_form_and_the_independent_formulation(name):
    """The pendulum against Jacobi's functions, the others against angles, to more digits."""
    assert REFERENCE["cases"][name]["error"] < 1e-16
    assert true_error(name, "rk4", "project", 0.001) < 2e-8


@pytest.mark.parametrize(
    ("rule", "mode", "low", "high", "dts"),
    [
        ("euler", "none", 0.9, 1.2, [0.001, 0.0005, 0.00025]),
        ("semi_implicit", "none", 0.9, 1.1, [0.001, 0.0005, 0.00025]),
        ("semi_implicit", "project", 0.9, 1.1, [0.001, 0.0005, 0.00025]),
        ("rk4", "none", 3.9, 4.6, [0.005, 0.0025, 0.00125]),
        ("rk4", "project", 3.9, 4.6, [0.0025, 0.00125, 0.000625]),
    ],
)
def test_order_on_the_trajectory(rule, mode, low, high, dts):
    found = orders([true_error("double", rule, mode, dt, 2.0) for dt in dts])
    assert (low < found).all() and (found < high).all(), found


@pytest.mark.parametrize(("rule", "low", "high"), [("semi_implicit", 0.9, 1.1), ("rk4", 3.95, 5.0)])
def test_order_on_the_rods(rule, low, high):
    ladder = [0.005, 0.0025, 0.00125]
    found = orders(
        [
            run(c.build_system("double"), rule, 0.0, dt, round(5 / dt)).violations.max()
            for dt in ladder
        ]
    )
    assert (low < found).all() and (found < high).all(), found


def test_impulse_beats_baumgarte_tenfold_with_as_many_forces():
    system = c.build_system("double")
    baumgarte, impulse = (run(system, hold=mode) for mode in ("baumgarte", "impulse"))
    assert baumgarte.violations.max() > 10.0 * impulse.violations.max()
    assert drift(system, baumgarte) > 10.0 * drift(system, impulse)


@pytest.mark.parametrize("rule", ["semi_implicit", "rk4"])
def test_project_holds_rods_and_their_rates(rule):
    for name in c.SYSTEMS:
        system = c.build_system(name)
        found = run(system, rule, "project")
        assert found.violations.max() < 1e-10
        assert np.abs(c.constraint_terms(system, found.q[-1], found.v[-1])[2]).max() < 1e-10


@pytest.mark.parametrize(("rule", "dt"), [("semi_implicit", 0.05), ("rk4", 0.1)])
def test_project_finds_the_way_back_from_long_steps(rule, dt):
    found = run(c.build_system("double"), rule, "project", dt, 400)
    assert not found.stopped and not found.halved and found.violations.max() < 1e-10


def test_semi_implicit_with_project_keeps_energy_without_a_trend():
    """100 s: within 6e-3, no slope beyond the noise of block means, half at half the step."""
    system, worst = c.build_system("double"), []
    for dt in (0.005, 0.0025):
        found = run(system, hold="project", dt=dt, steps=round(100 / dt))
        worst.append(drift(system, found))
        error = found.energies[1:] / energy_scale(system)
        blocks = error.reshape(20, -1).mean(axis=1)  # 5 s each: their scatter is the noise
        when = np.arange(20) - 9.5
        slope = (when @ blocks) / (when @ when)
        noise = np.std(blocks - blocks.mean() - slope * when, ddof=2) / np.sqrt(when @ when)
        assert abs(slope) < 3.0 * noise
    assert worst[0] < 6e-3
    assert 0.4 < worst[1] / worst[0] < 0.6


@pytest.mark.parametrize("rule", c.STABILITY_LIMIT)
def test_baumgarte_holds_up_to_the_stability_limit(rule):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)], [1.0])
    low, high = 0.1, 4.0
    while high - low > 1e-4:
        z = 0.5 * (low + high)
        found = run(hanging, rule, z / 0.005, 0.005, 20000)
        low, high = (low, z) if found.violations[-1] > 1e-9 else (z, high)
    assert low == pytest.approx(c.STABILITY_LIMIT[rule], rel=1e-3)


@pytest.mark.parametrize(
    ("rule", "mode"), [("semi_implicit", 20.0), ("rk4", "project"), ("gauss", "none")]
)
def test_an_ensemble_is_its_members(rule, mode):
    starts = np.stack([c.build_system("triple", seed)["q0"] for seed in range(4)])
    ensemble = c.build_system("triple") | {"q0": starts, "v0": np.zeros_like(starts)}
    together = run(ensemble, rule, mode, steps=200)
    for seed in range(4):
        alone = run(c.build_system("triple", seed), rule, mode, steps=200)
        for many, single in zip((*together[:3], together.q), (*alone[:3], alone.q), strict=True):
            assert np.abs(many[:, seed] - single).max() < 1e-12
