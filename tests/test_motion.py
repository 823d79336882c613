"""The motion: the chapter's numbers, closed forms, another formulation, orders and limits."""

from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, make_system, run

import numpy as np
import pytest
from test_ruler import measured


# fmt: off
@pytest.mark.parametrize(("name", "rule", "mode", "digits", "published"), [
    ("pendulum", "rk4", "none", "{0:.1e} {2:.1e}", "8.8e-06 1.2e-05"),
    ("double", "semi_implicit", "none", "{:.12f} {:.3f} {:.2f}", "0.384014620396 0.384 0.43"),
    ("double", "semi_implicit", "baumgarte", "{:.12f} {:.4f} {:.2f}", "0.023470285993 0.0014 0.32"),
    ("triple", "semi_implicit", "none", "{:.12f}", "0.403663129450"),
])  # fmt: on
def test_the_published_script_finds_the_same_digits(name, rule, mode, digits, published):
    """Of the worst rod error, the last one, and the energy error."""
    system = c.build_system(name)
    found = run(system, rule, mode)
    numbers = found.violations.max(), found.violations[-1], drift(system, found)
    assert digits.format(*numbers) == published


@pytest.mark.parametrize(("name", "seed"), [*product(c.SYSTEMS, range(3))])
def test_baumgarte_beats_none_threefold_and_impulse_it_tenfold(name, seed):
    system = c.build_system(name, seed)
    none, helped, impulse = (run(system, hold=mode) for mode in ("none", "baumgarte", "impulse"))
    assert none.violations.max() > 3.0 * helped.violations.max()
    assert helped.violations.max() > 10.0 * impulse.violations.max()
    assert drift(system, helped) > 10.0 * drift(system, impulse)


def test_neighbouring_seeds_part_and_a_generator_is_as_good_as_a_seed():
    starts = (c.build_system("double", seed) for seed in (0, np.random.default_rng(1), 1))
    one, drawn, other = (run(start, hold="baumgarte").tip[-1] for start in starts)
    assert np.array_equal(drawn, other) and f"{np.linalg.norm(one - other):.1f}" == "1.1"


LADDERS = [  # the longest step of each, in s, is halved twice; then what the order lies between
    ("euler", "none", 0.001, 0.9, 1.2),
    ("semi_implicit", "none", 0.001, 0.9, 1.1),
    ("semi_implicit", "project", 0.001, 0.9, 1.1),
    ("rk4", "none", 0.005, 3.9, 4.6),
    ("rk4", "project", 0.0025, 3.9, 4.6),
]


@pytest.mark.parametrize(("rule", "mode", "dt", "low", "high"), LADDERS)
def test_halving_the_step_shows_the_order(rule, mode, dt, low, high):
    """Of the distance from where angles put the particles, which know of no rods."""
    errors = [measured("double", rule, step, 2.0, mode)[0] for step in (dt, dt / 2, dt / 4)]
    found = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (low < found).all() and (found < high).all(), found


@pytest.mark.parametrize(("rule", "dt"), [("rk4", 0.005), ("semi_implicit", 0.05), ("rk4", 0.1)])
def test_project_holds_rods_and_their_rates_and_finds_back_from_long_steps(rule, dt):
    system = c.build_system("double")
    found = run(system, rule, "project", dt, round(20.0 / dt))
    assert not found.stopped and not found.halved and found.violations.max() < 1e-10
    assert np.abs(c.constraint_terms(system, found.q[-1], found.v[-1])[2]).max() < 1e-10


def test_semi_implicit_with_project_keeps_energy_without_a_trend():
    """100 s: within 6e-3, no slope beyond the noise of block means, half at half the step."""
    system, worst = c.build_system("double"), []
    for dt in (0.005, 0.0025):
        found = run(system, hold="project", dt=dt, steps=round(100 / dt))
        worst.append(drift(system, found))
        error = found.energies[1:] / energy_scale(system)
        blocks = error.reshape(20, -1).mean(axis=1)  # 5 s each: their scatter is the noise
        (slope, _), spread = np.polyfit(np.arange(20), blocks, 1, cov=True)
        assert abs(slope) < 3.0 * np.sqrt(spread[0, 0])
    assert worst[0] < 6e-3 and 0.4 < worst[1] / worst[0] < 0.6


@pytest.mark.parametrize("rule", c.STABILITY_LIMIT)
def test_baumgarte_holds_up_to_the_stability_limit(rule):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)], [1.0])
    for share in (0.999, 1.001):
        found = run(hanging, rule, share * c.STABILITY_LIMIT[rule] / 0.005, 0.005, 20000)
        assert (found.violations[-1] < 1e-9) == (share < 1.0)
