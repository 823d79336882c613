"""Beside the real thing: other engines' models of our systems, and the rules and truths that the
studies race with."""

import json
import subprocess
import sys
from functools import partial
from importlib.util import find_spec

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import real_thing, speed_vs_error
from curriculum.ch3_4_constraints.studies._race import extrapolated_midpoint, run_ours
from curriculum.ch3_4_constraints.studies._runs import run

import numpy as np
import pytest

REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def needs(package, extra):
    """The mark of a test that cannot run without a package."""
    return pytest.mark.skipif(
        not find_spec(package), reason=f"needs {package}: pip install -e '.[{extra}]'"
    )


@needs("mujoco", "compare")
@pytest.mark.parametrize(
    ("rods", "dt"), [(1, 0.005), (2, 0.005), (4, 0.005), (25, 0.005), (3, 0.05)]
)
def test_soft_is_mujocos_tendon_equality(rods, dt):
    """Every field of mj_forward that has a name here, some per cent off the rods; at 0.05 s both
    take two steps."""
    rng = np.random.default_rng(rods)
    for _ in range(10):
        system = peers.random_chain(rng, rods)
        ours = {field: value for (_, field), value in real_thing.ours_named(system, dt).items()}
        theirs = peers.named(system, dt, {field: value.shape for field, value in ours.items()})
        for field, value in ours.items():
            np.testing.assert_allclose(
                value, theirs[field], rtol=0, atol=1e-12 * np.abs(value).max(), err_msg=field
            )


@needs("mujoco", "compare")
@pytest.mark.parametrize("name", c.SYSTEMS)
def test_mujocos_joint_angles_give_the_same_motion(name):
    """MuJoCo's hinges cannot stretch a rod; within a second both are where they should be, to 1e-9
    m."""
    task = peers.Task(c.build_system(name), 4, 0.25, None)
    theirs, ours = peers.run_hinges(task, 1000)[1], run_ours(task, 5, "none", "gauss")[1]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


@needs("pymunk", "peers")
def test_chipmunk_comes_to_the_same_motion_as_its_steps_get_shorter():
    task = real_thing.double()
    far, near = (task.error(peers.run_pymunk(task, per)[1]) for per in (100, 1000))
    assert near < 0.15 * far < 0.01


@needs("scipy", "compare")
def test_the_truth_of_a01_is_the_swing():
    """Jacobi's functions against gauss over a few seconds, and against themselves half a period
    later."""
    truth, doubt = real_thing.swing((0.5 * np.arange(1, 11)).tolist())
    assert doubt < 1e-14
    found = run(real_thing.level(), "gauss", "none", 0.05, 100, range(10, 101, 10))
    np.testing.assert_allclose(found.q[..., :2], truth, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "order"),
    [
        *[(partial(extrapolated_midpoint, order), order) for order in (4, 6, 8)],
        pytest.param(peers.dop853, 8, marks=needs("scipy", "compare")),
    ],
)
def test_the_rules_that_race_with_ours_are_of_their_order(make, order):
    task = real_thing.double()
    coarse, fine = (task.error(run_ours(task, per, "none", make())[1]) for per in (10, 20))
    assert order - 0.2 < np.log2(coarse / fine) < order + 0.2


def test_the_cost_that_is_counted_is_linear_systems_solved():
    """Four for a step of rk4, (6 / 2)^2 + 1 for midpoint6; a projection adds its rounds, and one
    for the velocities."""
    system = c.build_system("double")
    for rule, forces in (("rk4", 4.0), ("midpoint6", 10.0)):
        step = speed_vs_error.RULES[rule]
        none, project = (
            speed_vs_error.solves(system, step, mode, 0.01, 20) for mode in ("none", "project")
        )
        assert none == forces and 2.0 <= project - none <= 5.0


@pytest.mark.parametrize("name", ["fourbar_coupler", "jansen_leg"])
def test_loops_move_as_their_one_angle_says(name):
    """studies/reference.py has no multiplier: gauss with project ends within rounding of it, rk4 at
    its order."""
    system, truth = c.build_system(name), np.array(REFERENCE["cases"][name]["positions"])

    def error(rule, per, samples):
        found = run(
            system, rule, "project", 0.25 / per, per * samples, range(per, per * samples + 1, per)
        )
        return np.abs(found.q[..., :2] - truth[:samples]).max()

    assert error("gauss", 10, len(truth)) < 1e-13
    coarse, fine = (error("rk4", per, 8) for per in (100, 200))
    assert fine < 1e-8 and 3.5 < np.log2(coarse / fine) < 4.5


def test_the_study_needs_no_engine_to_be_imported():
    code = (
        "import sys, curriculum.ch3_4_constraints.studies.real_thing; print(*sorted(sys.modules))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", code], cwd=c.HERE, check=True, capture_output=True, text=True
    ).stdout
    assert not set(real_thing.ENGINES) & set(loaded.split())


def test_without_mujoco_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(real_thing, "has", lambda name: name != "mujoco")
    with pytest.raises(SystemExit) as end:
        real_thing.main(["--quick"])
    assert end.value.code == 2
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and "pip install -e '.[compare]'" in err
