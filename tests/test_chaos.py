"""The study of many seeds: its starts, its counts, its exponent, its bytes and its memory."""

import tracemalloc

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.studies import chaos

STEPS, DT = 400, 0.005


@pytest.mark.parametrize("name", ["pendulum", "double", "triple", "chain"])
def test_the_starts_are_those_of_build_system(name):
    system = chaos.ensemble(name, range(20))
    for seed in (0, 1, 7, 19):
        alone = c.build_system(name, seed)
        assert system["q0"][seed].tobytes() == alone["q0"].tobytes()
        assert system["v0"][seed].tobytes() == alone["v0"].tobytes()


def test_the_ordering_is_that_of_single_runs():
    dt, steps, ratios = 0.01, 20, []  # where the seeds disagree about 3x; later all are over it
    for seed in range(50):
        runs = (c.simulate(c.build_system("double", seed), hold=h, dt=dt, steps=steps) for h in (0.0, 20.0))
        none, baumgarte = (float(run["max_violation"]) for run in runs)
        ratios.append(none / baumgarte)
    row = chaos.ordering(chaos.ensemble("double", range(50)), dt, steps, chunk=20)
    assert (row["seeds"], row["none > baumgarte"]) == (50, sum(ratio > 1.0 for ratio in ratios))
    assert 0 < row["over 3x"] < 50
    assert row["over 3x"] == sum(ratio > 3.0 for ratio in ratios)
    assert row["50 %"] == pytest.approx(float(np.median(ratios)), rel=1e-9)


def test_the_same_bytes_twice_and_in_any_chunk():
    system = chaos.ensemble("double", range(50))
    assert all(row["same bytes twice"] and row["farthest apart m"] < 1e-11 for row in chaos.consistency(system, DT))
    assert chaos.ordering(system, DT, STEPS, chunk=50) == chaos.ordering(system, DT, STEPS, chunk=7)


@pytest.mark.parametrize("links, square", [(1, 1.0), (2, 2.0 + 2.0**0.5)])
def test_the_exponent_of_pendulums_on_end(links, square):
    upright = chaos.ensemble(["pendulum", "double"][links - 1], range(4))
    upright["q0"] = np.zeros_like(upright["q0"]) + np.arange(1.0, links + 1.0)[:, None] * [0.0, 1.0, 0.0]
    rates, rods, _ = chaos.growth(upright, 4.0, 2.0, DT)
    assert rates.shape == (4, 4)
    assert rates == pytest.approx((9.81 * square) ** 0.5, rel=1e-3)
    assert rods < 1e-12


def test_memory_does_not_grow_with_steps():
    system, peaks = chaos.ensemble("double", range(1000)), []
    for steps in (10, 500, 2000):
        tracemalloc.start()
        chaos.ordering(system, DT, steps, chunk=1000)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.2 * peaks[1], peaks
