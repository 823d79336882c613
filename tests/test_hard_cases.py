"""The table of hard cases: the outcome of every cell that is no close call, and what the text says about them."""

import constraints as c
from curriculum.ch3_4_constraints.studies import hard_cases

import numpy as np
import pytest

# the largest dt that holds; None: none of the ladder; columns as in hard_cases.METHODS
OUTCOME = {
    "long_chain": [0.02, 0.02, 0.02, None, 0.02, 0.02, 0.02, 0.02],
    "heavy_tip": [0.002, 0.005, 0.005, None, 0.005, 0.005, 0.005, 0.01],
    "light_tip": [None, 0.001, 0.01, None, 0.02, 0.02, 0.02, 0.02],
    "spin": [None, None, 0.002, None, 0.005, 0.005, 0.005, 0.01],
    "upright": [0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02],
    "windows": [0.0005, 0.005, 0.02, 0.01, 0.02, 0.02, 0.02, 0.02],
    "braced": [0.002, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02, 0.02],
    "cable": [0.02, 0.02, 0.02, 0.01, 0.02, 0.02, 0.02, 0.02],
}


def scene(name):
    return c.build_system(str(c.HERE / c.CHAPTER / f"scenes/{name}.json"))


@pytest.mark.parametrize("name", OUTCOME)
def test_every_cell_that_is_no_close_call(name):
    cells = hard_cases.study([name])[name].values()
    firm = [(cell["dt"], dt) for cell, dt in zip(cells, OUTCOME[name], strict=True) if not cell["borderline"]]
    assert len(firm) >= 4
    assert [found for found, _ in firm] == [dt for _, dt in firm]


def test_the_taut_cable_is_refused_with_the_reason():
    shown = []
    table = hard_cases.study(["taut_cable"], show=shown.append)
    assert "no finite tension" in table["taut_cable"]["refused"] and "refused" in shown[-1]


def test_nothing_but_rounding_could_tip_the_upright_pendulum_and_it_does_not():
    for integrator, mode in hard_cases.METHODS:
        run = c.simulate(scene("upright"), integrator, c.hold_table(0.005)[mode], 0.005, 400)
        assert np.abs(run["q"][:, 0]).max() < 1e-9


@pytest.mark.parametrize(("integrator", "dt", "seconds"), [("gauss", 0.02, 10.0), ("rk4", 0.005, 2.0)])
def test_windows_pass_the_flat_pose_with_their_energy(integrator, dt, seconds):
    system, steps = scene("windows"), round(seconds / dt)
    run = c.simulate(system, integrator, c.hold_table(dt)["project"], dt, steps, range(steps + 1))
    assert not run["stopped"]
    heights = run["kept"]["q"][..., 1]
    assert heights.min() < -0.99 and heights.max() > 0.99  # it went through
    assert run["energy_rel_max"] < 1e-9 and run["max_violation"] < 1e-10


@pytest.mark.parametrize("name", ["jansen_leg", "fourbar_coupler"])
def test_linkages_of_robotics_fall_for_ten_seconds_without_losing_a_length(name):
    run = c.simulate(scene(name), "rk4", c.hold_table(0.01)["project"], 0.01, 1000)
    assert not run["stopped"] and run["max_violation"] < 1e-10
