"""Studies of what is hard, and of what engines do: what they judge by is so."""

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.studies import _flat_pose as flat
from curriculum.ch3_4_constraints.studies import hard_cases as hard
from curriculum.ch3_4_constraints.studies import real_thing as real

DT = 0.005


@pytest.mark.parametrize("name", ["spin", "windows", "upright"])
def test_perturbed_starts_are_on_the_rods_and_differ_as_it_is_told(name):
    system = c.build_system(name)
    (v0, m0), *others = hard.starts(system, 9)
    assert v0 is system["v0"] and m0 is system["m"]
    for k, (v, m) in enumerate(others, 1):
        _, _, gdot, _ = c.constraint_terms(system, system["q0"], v)
        assert np.abs(gdot).max() < 1e-12 * (1.0 + np.abs(v).max())
        share = np.abs(m / m0 - 1.0).max()
        assert 0.0 < share < 2e-14 if k % 2 else 0.05 < share < 0.3
        assert (np.abs(v - v0).max() > 1e-3) == (k % 2 == 0 and name != "upright")


IS_HELD = [(0.009, 0.09, 1, True), (0.011, 0.0, 1, False), (0.0, 0.11, 1, False), (0, 0, 0, False)]


@pytest.mark.parametrize(("stretch", "energy", "more", "held"), IS_HELD)
def test_a_start_is_lost_by_rods_by_energy_or_by_an_end(stretch, energy, more, held):
    system = c.build_system("pendulum")

    def run(q, v, m, dt, steps):  # all at once it has left its rod, and is fast
        v = [0.0, np.sqrt(2.0 * energy * 9.81), 0.0]
        return np.tile(q * (1.0 + stretch), (steps + more, 1, 1)), np.tile(v, (steps + more, 1, 1))

    assert hard.is_held(system, run, system["v0"], system["m"], DT, 1.0) == held


def test_gauss_takes_the_way_that_joint_angles_take_on_which_no_crank_changes_sides():
    """RK4 in one coordinate, the masses' path s in m: its acceleration is gravity's share."""
    first, extra, h = 1.1, 1e-3, 2.5e-4

    def at(angle):
        return flat.ends(angle, flat.second_angle(angle, extra))

    def slope(state):
        angle, speed = state
        tangent = (at(angle + 1e-6) - at(angle - 1e-6)) / 2e-6
        stretch = np.linalg.norm(tangent)
        return np.array([speed / stretch, -9.81 * np.sum(tangent[..., 1]) / stretch])

    state, ways = np.array([first, 0.0]), [at(first)]
    for _ in range(4000):
        k1 = slope(state)
        k2 = slope(state + 0.5 * h * k1)
        k3 = slope(state + 0.5 * h * k2)
        k4 = slope(state + h * k3)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        ways.append(at(state[0]))
    assert state[0] < -0.5  # it has passed the flat pose
    assert flat.to_the_left(np.array(ways)).max() < 0.0
    system = flat.four_bar(extra) | {"q0": at(first), "v0": np.zeros((2, 3))}
    assert c.constraint_violation(system, at(first)) < 1e-12
    run = c.run_method(system, "project", "gauss", DT, 200)
    assert np.allclose(run.q, ways[::20], atol=1e-7)


def test_soft_is_mujocos_tendon_in_every_quantity_and_connect_has_jdotv(capsys):
    pytest.importorskip("mujoco", reason="a peer: pip install -e '.[peers]'")
    real.who_has_jdotv()
    *_, share, _, _, _, _, _, tendon, _ = capsys.readouterr().out.split()
    assert float(share) == pytest.approx(100.0) and float(tendon) < 1e-11  # per cent, m/s^2
    system = real.random_chain(np.random.default_rng(1), 4)
    data = real.mujoco_tendons(system)
    for _, field, mine in real.ours(system):
        its = getattr(data, field).reshape(mine.shape)
        assert np.abs(mine - its).max() < 1e-12 * np.abs(mine).max(), field


W = 2.0 * np.pi * min(60.0, 0.25 / DT)  # rad/s
SOFT, SHARE = DT * W * (4.0 + DT * W), 0.1**2 / (4.0 * np.pi**2)
SWEEPS = {  # bias rate in 1/s, mass scale and impulse scale, in the engines' own words
    "Box2D v3.1.1": (W / (4.0 + DT * W), SOFT / (1.0 + SOFT), 1.0 / (1.0 + SOFT)),
    "Jolt v5.5.0": (0.0, 1.0, 0.0),
    "Drake v1.56.0": (0.5 / DT, 1.0 / (1.0 + SHARE), SHARE / (1.0 + SHARE)),
}


@pytest.mark.parametrize("name", SWEEPS)
def test_an_engines_row_is_what_its_sweeps_end_at(name):
    """There a sweep changes no impulse: -mass (speed + bias) - impulse scale x impulse = 0."""
    system, row = real.random_chain(np.random.default_rng(2), 3), real.engines(DT)[name]
    q, v, m, force = system["q0"], system["v0"], system["m"], c.make_force(system, row)
    q_next, v_next = c.semi_implicit_step(q, v, m, force, DT)
    jac, _, _, _ = c.constraint_terms(system, q, v)
    axes = jac / c.rod_lengths(system, q)[:, None]
    impulse = np.linalg.lstsq(axes.T, (m * (v_next - v - DT * c.GRAVITY)).ravel())[0]
    bias, mass, scale = SWEEPS[name]
    aim = axes @ v_next.ravel() + bias * c.rod_errors(system, q)
    effective = np.sum(axes**2 / np.repeat(m, 3), axis=1)  # 1/kg
    assert np.allclose(mass * aim / effective + scale * impulse, 0.0, atol=1e-9)
    if row.post_step:
        q_end, v_end = row.post_step(system, q, q_next, v_next, DT)
        ratio = c.constraint_violation(system, q_end) / c.constraint_violation(system, q_next)
        assert ratio == pytest.approx({"Box2D v3.1.1": 1.0, "Jolt v5.5.0": 0.64}[name], rel=0.03)
        assert np.allclose(jac @ v_end.ravel(), 0.0) == (name == "Jolt v5.5.0")


def test_a_peer_that_is_not_installed_or_fails_is_a_line(monkeypatch, capsys):
    monkeypatch.setattr(flat, "mujoco_shares_right", None)
    monkeypatch.setattr(real, "mujoco_tendons", None)
    missing = "mujoco is not installed and left out: pip install -e '.[peers]'"
    for installed, line in (True, "failed: 'NoneType' object is not callable"), (False, missing):
        for study in flat, real:
            monkeypatch.setattr(study, "find_spec", lambda _, found=installed: found)
        flat.show({})
        real.main(["--quick"])
        out = capsys.readouterr().out
        assert out.count(line) == 2 and "efc_J" not in out and "Drake" in out
