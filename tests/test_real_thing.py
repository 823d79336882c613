"""Beside the real thing: MuJoCo's acceleration, rod force and motion, from models that share no code with ours."""

import subprocess
import sys

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import real_thing

mujoco = pytest.importorskip("mujoco", reason="compares with MuJoCo: pip install -e '.[compare]'")


@pytest.mark.parametrize("rods", [1, 2, 3, 4, 25])  # 25: arrays instead of the loop over floats
def test_soft_is_mujocos_tendon_equality(rods):
    """qacc and efc_force of mj_forward, at states some per cent off the rods; MuJoCo drops Jdot v, and so does soft."""
    rng = np.random.default_rng(rods)
    for _ in range(10):
        system = peers.random_chain(rng, rods)
        ours = {field: value for (_, field), value in real_thing.ours_named(system, 0.005).items()}
        theirs = peers.named(system, 0.005, {field: value.shape for field, value in ours.items()})
        for field, value in ours.items():
            np.testing.assert_allclose(value, theirs[field], rtol=0, atol=1e-12 * np.abs(value).max(), err_msg=field)


def test_soft_keeps_mujocos_lower_bound_of_two_steps():
    """With dt over half the time constant MuJoCo takes two steps instead of it."""
    system = peers.random_chain(np.random.default_rng(0), 3)
    model = peers.tendons(system, 0.05)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
    mujoco.mj_forward(model, data)
    force = c.constraint_force(system, system["q0"], system["v0"], c.hold_table(0.05)["soft"])
    found = (force + system["weight"]) / system["m"]
    np.testing.assert_allclose(found, data.qacc.reshape(-1, 3), rtol=0, atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("name", ["pendulum", "double", "triple"])
def test_joint_angles_give_the_same_motion(name):
    """MuJoCo's hinges cannot stretch a rod; after a second both are where they should be, to 1e-9 m."""
    task = peers.Task(c.build_system(name), 4, 0.25, None)
    _, _, theirs = peers.run_hinges(task, 1000)
    run = c.simulate(task.system, "gauss", c.hold_table()["none"], 0.05, 20, range(5, 21, 5))
    np.testing.assert_allclose(run["kept"]["q"][..., :2], theirs, rtol=0, atol=1e-9)


def test_the_reference_of_a01_is_the_swing():
    """Jacobi's functions against gauss over a few seconds, and against themselves half a period later."""
    pytest.importorskip("scipy", reason="A01 takes Jacobi's elliptic functions from scipy")
    truth, doubt = real_thing.swing((0.5 * np.arange(1, 11)).tolist())
    assert doubt < 1e-14
    system = c.make_system([[1.0, 0.0, 0.0]], np.zeros((1, 3)), [1.0], [(0, -1)])
    run = c.simulate(system, "gauss", c.hold_table()["none"], 0.05, 100, range(10, 101, 10))
    np.testing.assert_allclose(run["kept"]["q"][..., :2], truth, rtol=0, atol=1e-12)


def test_the_study_needs_no_engine_to_be_imported():
    code = "import sys, curriculum.ch3_4_constraints.studies.real_thing; print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], cwd=c.HERE, check=True, capture_output=True, text=True).stdout
    assert not {"mujoco", "exudyn", "scipy"} & set(loaded.split())


def test_without_mujoco_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setattr(real_thing, "has", lambda name: name != "mujoco")
    with pytest.raises(SystemExit) as end:
        real_thing.main(["--quick"])
    assert end.value.code == 2
    out, err = capsys.readouterr()
    assert not out and err.count("\n") == 1 and "pip install -e '.[compare]'" in err
