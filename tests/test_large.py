"""Many rods, by arrays: what is written out and what is not, and bodies held by too many rods."""

import constraints as c
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.studies._runs import make_system, run

import numpy as np
import pytest


def star(n):
    """n particles on rods that all feel each other."""
    return make_system(
        [[k + 1, k % 7, k % 5] for k in range(n)],
        np.zeros((n, 3)),
        np.ones(n),
        [(0, -1), *spokes(n)],
    )


def spokes(n):
    return [(k, 0) for k in range(1, n)]


def test_few_rods_that_all_feel_each_other_are_not_written_out():
    assert large.takes(star(30)) and not large.takes(star(10))
    found = run(star(30), steps=2, dt=0.001)
    assert found.way == "by arrays: dense LU" and found.violations[-1] < 1e-5


def test_particles_without_rods_fall_and_cost_little():
    """Many of them are arrays, and a chain with a loose one is no chain."""
    rods = large.CHAIN + 5
    position = [[k + 1.0, 0.0, 0.0] for k in range(2 * large.LINKAGE + 1)]
    pairs = [(k, k - 1) for k in range(rods)]
    for n in (rods + 1, len(position)):
        system = make_system(position[:n], np.zeros((n, 3)), np.ones(n), pairs)
        assert large.takes(system) == (n > rods + 1) and not large.of(system).chain
        found = run(system, "rk4", "project", 0.01, 10)
        assert found.q[-1, -1] == pytest.approx([n, -0.5 * 9.81 * 0.1**2, 0.0], abs=1e-12)


def test_a_long_chain_finds_its_way_back():
    found = run(c.build_system("chain", links=10_000), hold="project", steps=2)
    assert not found.stopped and found.violations.max() < 1e-11


def test_numbers_that_overflow_within_a_step_stop_a_run_with_a_sentence():
    """The sparse solver has an error of its own for that."""
    pytest.importorskip(
        "scipy", reason="the sparse solver of large linkages: pip install -e '.[large]'"
    )
    assert "no finite tensions" in run(star(large.LINKAGE + 1), "rk4", dt=1e80, steps=1).stopped


@pytest.mark.parametrize("n", [11, 13], ids=["dense", "sparse"])
def test_rods_too_many_by_arrays_keep_a_body_rigid(n):
    """All tied to all, and turning: a third of the rods would do, and which of them carry the load
    is open."""
    if n == 13:
        pytest.importorskip(
            "scipy", reason="the sparse solver of large linkages: pip install -e '.[large]'"
        )
    rng = np.random.default_rng(0)
    q, turn = rng.normal(size=(n, 3)), rng.normal(size=3)
    system = make_system(
        q, np.cross(turn, q), rng.uniform(1.0, 2.0, n), [(i, j) for i in range(n) for j in range(i)]
    )
    assert large.takes(system) and ("dense" in large.way(system)) == (n == 11)
    jac, _, _, jdotv = c.constraint_terms(system, q, system["v0"])
    a = c.make_force(system, 0.0)(q, system["v0"]) / system["m"]
    assert np.abs(jac @ a.ravel() + jdotv).max() < 1e-6 * np.abs(jdotv).max()
