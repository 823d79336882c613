"""Studies: what is measured is so, of ours and of their peers."""

import re
from fractions import Fraction

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.rods import choice, truth
from curriculum.ch3_4_constraints.rods.schemes import Rung, Scheme
from curriculum.ch3_4_constraints.site import work_precision
from curriculum.ch3_4_constraints.studies import __main__ as studies
from curriculum.ch3_4_constraints.studies import hard_cases as hard
from curriculum.ch3_4_constraints.studies import race
from curriculum.ch3_4_constraints.studies import real_thing as real
from curriculum.ch3_4_constraints.studies import speed_vs_error as speed
from curriculum.ch3_4_constraints.studies._schemes import all_schemes
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step
from curriculum.common.errors import Refused

DT = 0.005  # s
PEER = "a peer: pip install -e '.[fast,peers]'"


def checked(name):
    return c.rods.check_system(c.build_system(name), c.PIVOT)


def path_of(system, seconds):
    """The true motion of a system, every 5 ms."""
    return truth.true_path(c.this_chapter(), system, DT, round(seconds / DT), 0.0)


@pytest.mark.parametrize("name", [name for name, peers in studies.STUDIES.items() if peers])
def test_a_peer_that_is_missing_is_told_and_how_to_get_it(name, monkeypatch, capsys):
    peer = studies.STUDIES[name][-1]
    monkeypatch.setattr(studies, "find_spec", lambda x: x != peer or None)
    with pytest.raises(SystemExit, match="2"):
        studies.main([name])
    assert re.search(rf"{peer} .*pip install -e '.*peers.*'\n$", capsys.readouterr().err)


@pytest.mark.parametrize("name", studies.STUDIES)
def test_help_needs_no_peer(name, monkeypatch, capsys):
    monkeypatch.setattr(studies, "find_spec", lambda x: None)
    with pytest.raises(SystemExit, match="0"):
        studies.main([name, "--help"])
    assert f"studies {name} " in capsys.readouterr().out


def test_xpbd_pulls_rods_to_their_lengths_and_moves_no_centre_of_mass():
    d = np.array([[0.0, 0.3, 0.1], [1.0, 0.5, 0.0]])
    pair = {"m": np.array([[0.7], [2.0]]), "pairs": [(1, 0)], "lengths": np.array([1.1])}
    pair |= {"q0": d, "v0": np.array([[1.0, -2.0, 0.0], [0.5, 0.0, 3.0]])}
    q, v = xpbd_step(pair, d, pair["v0"], DT)
    assert np.linalg.norm(q[1] - q[0]) == pytest.approx(1.1, abs=1e-14)
    fall = DT * (pair["v0"] + DT * c.GRAVITY)
    assert np.allclose(pair["m"].T @ (q - d), pair["m"].T @ fall, rtol=0.0, atol=1e-14)
    assert np.allclose(v, (q - d) / DT)
    hung = pair | {"pairs": [(0, -1), (1, 0)], "lengths": np.array([0.4, 1.1])}
    hung["anchors"] = np.array([[0.0, 0.0, 0.2]])
    once = xpbd_step(hung, d, pair["v0"], DT, substeps=2)
    q, v = xpbd_step(hung, *xpbd_step(hung, d, pair["v0"], 0.5 * DT), 0.5 * DT)
    assert np.array_equal(once, [q, v]) and np.linalg.norm(q[1] - q[0]) == pytest.approx(1.1)


# --- speed against error ---
@pytest.fixture(scope="module")
def measured():
    pytest.importorskip("mujoco", reason=PEER)
    return speed.measure("double", [1e-2])


def test_the_rows_of_the_chapters_integrators_are_those_of_choose_whoever_stands_beside(measured):
    system = checked("double")
    answer = choice.choose(c.this_chapter(), system, 1e-2, speed.DT, speed.STEPS, {})
    rows = {row.rung.scheme.integrator: row for row in measured.answers[1e-2].rows}
    assert len(answer.rows) == 3
    for row in answer.rows:
        other = rows[row.rung.scheme.integrator]
        assert (other.rung, other.twice) == (row.rung, row.twice)
    assert {x.integrator for x in measured.lines} >= {*c.INTEGRATORS, "gauss", "XPBD"}


def test_each_line_has_an_error_and_the_time_of_a_second_of_motion_for_each_step(measured):
    (line,) = [x for scheme, x in measured.lines.items() if str(scheme) == "rk4 with none"]
    errors, paces = np.transpose(line)[:, -3:]
    assert np.allclose(errors[:-1] / errors[1:], 16.0, rtol=0.1)
    assert np.allclose(paces[1:] / paces[:-1], 2.0, rtol=1e-9) and 0.0 < paces[0] < 1e-3


def test_a_row_is_an_integrator_and_a_cell_its_work_and_its_step_to_a_goal():
    scheme = Scheme("semi_implicit", "impulse", None)
    rung = Rung(scheme, 0.0025, 20.0, 9e-3, 3e-4, 2e-3, 26400.0, 20.0, None)
    row = choice.Row(rung, rung, 9.81e-6 / 26400.0, False, False)
    answer = choice.Answer(1e-2, "", verdict=row, rows=[row])
    nobody = answer._replace(rows=[], verdict=None)
    found = speed.Measured("toy", 2.0, {1e-2: answer, 1e-3: nobody}, {scheme: []})
    _, goals, line = speed.lines_of(found)
    assert goals.split() == ["1", "cm", "1", "mm"]
    assert line.split() == ["semi", "impulse", "9.8/2.5", "-"]


THROWN = {"q0": np.outer([1.0, 2.0], [0.6, 0.8, 0.0]), "v0": np.outer([3.0, 6.0], [-0.8, 0.6, 0.0])}
LOADED = [  # a scene, its start, MuJoCo's row, steps in s, and how near it is to ours, in m
    ("double", THROWN, "hinges", 0.0025, 1e-8),
    ("double", THROWN, "tendons, hard", 0.00125, 1e-3),
    ("jansen_leg", {}, "connect, hard", 0.0025, 1e-4),
]


@pytest.mark.parametrize(("scene", "start", "name", "dt", "off"), LOADED)
def test_mujocos_particles_move_as_ours_and_bear_their_loads(scene, start, name, dt, off):
    pytest.importorskip("mujoco", reason=PEER)
    without = checked(scene) | start
    load = np.random.default_rng(3).normal(0.0, 4.0, without["q0"].shape) * [1.0, 1.0, 0.0]
    system = without | {"load": load}
    path = path_of(system, 0.5)
    rung = speed.Peer(system, name).take(dt, 0.5, path, off)
    assert rung.places < off and rung.rods < off and rung.held == 0.5 and rung.operations > 0.0
    assert truth.distance(path.q[-1], path_of(without, 0.5).q[-1]) > 100.0 * off


def test_a_peer_takes_parts_of_a_step_as_it_takes_shorter_steps():
    pytest.importorskip("mujoco", reason=PEER)
    peer = speed.Peer(checked("double"), "hinges")
    path = path_of(peer.system, 0.5)
    for dt in 2.0 * DT, 0.25 * DT:
        half = peer.take(dt, 0.5, path, 1.0, Fraction(1, 2))
        whole = peer.take(0.5 * dt, 0.5, path, 1.0)
        assert half.dt == whole.dt and half.places == pytest.approx(whole.places, rel=0.1)
        assert peer.take(dt, 0.5, path, 1.0, Fraction(3, 4)).places < 1e-5


def test_a_loop_is_closed_by_connects_and_what_has_none_needs_hinges_only():
    for scene, closed in ("double", "hinges"), ("jansen_leg", "connect"):
        assert {x.name.partition(",")[0] for x in speed.peers(checked(scene))} == {
            closed,
            "tendons",
        }


def test_a_peer_is_refused_a_force_that_it_does_not_have(monkeypatch):
    pytest.importorskip("mujoco", reason=PEER)
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY - v)
    with pytest.raises(Refused, match="external_force"):
        speed.Peer(checked("double"), "hinges").model(DT)


def test_a_diagram_has_a_line_for_each_scheme_in_colour_if_it_is_advised(measured):
    answer = measured.answers[1e-2]
    measured = measured._replace(answers={work_precision.MAIN: answer})  # whose rows are named
    drawing = work_precision.diagram(measured)
    styles = re.findall(r'd="M[^"]*L[^"]*" style="([^"]*)"', drawing)
    lines = [x for x in styles if "width:5" in x or "opacity" in x]
    others = [x for x in lines if "opacity" in x]
    assert len(lines) == len(measured.lines)
    assert len(lines) - len(others) == len(answer.rows)
    assert all("stroke:var(--reference)" in x for x in others)
    halos = re.findall(r"stroke:var\(--(\w+)\);stroke-width:9px;fill:var", drawing)
    assert halos == ["paper"] * len(answer.rows)  # their names are legible on other lines


# --- race ---
def test_who_races_ends_within_the_error_and_the_ratios_are_printed(monkeypatch, capsys):
    for peer in "llvmlite", "heyoka":
        pytest.importorskip(peer, reason=PEER)
    monkeypatch.setattr(race, "TURNS", 3)
    race.main([])
    rows = capsys.readouterr().out.splitlines()
    for goal, row in zip(race.SETTINGS, rows, strict=True):
        mine, theirs = map(float, re.findall(r"([\d.]+) µs", row))
        ratio = float(row.split()[-1])
        assert row.startswith(f"{goal:.0e} m") and ratio == pytest.approx(mine / theirs, abs=0.02)
    monkeypatch.setattr(race, "SETTINGS", {1e-6: race.SETTINGS[1e-3]})
    with pytest.raises(SystemExit, match="2"):
        race.main([])
    assert "1e-06 m" in capsys.readouterr().err


def test_a_turn_is_in_microseconds():
    assert race.turn(lambda: (3e-6, None)) == pytest.approx(3.0)


# --- hard cases ---
BOBS = {  # at rest and level, on rods of 1 m and 3 m
    "q0": np.array([[1.0, 0.0, 0.0], [4.0, 0.0, 0.0]]),
    "v0": np.zeros((2, 3)),
    "m": np.array([[0.5], [2.0]]),
    "pairs": [(0, -1), (1, 0)],
    "lengths": np.array([1.0, 3.0]),
    "anchors": np.zeros((1, 3)),
}
MASSES = np.array([[0.7], [3.0]])  # kg, of a start
M_G_L = (0.7 + 3.0) * 9.81 * (1.0 + 3.0)  # J
FAST = 0.5 * 3.0 * 30.0**2  # J, more than that
HELD = [  # speed in m/s, how much too long the last rod ends, J gained, states that are missing
    (4.0, 0.009, 0.09 * M_G_L, 0, True),
    (4.0, -0.011, 0.0, 0, False),
    (4.0, 0.011, 0.0, 0, False),
    (4.0, 0.0, 0.11 * M_G_L, 0, False),
    (4.0, 0.0, -0.11 * M_G_L, 0, False),
    (4.0, 0.0, 0.0, 1, False),
    (30.0, 0.0, 0.09 * FAST, 0, True),
    (30.0, 0.0, 0.11 * FAST, 0, False),
]


@pytest.mark.parametrize(("speed", "stretch", "gained", "missing", "held"), HELD)
def test_a_start_is_lost_by_rods_by_energy_or_by_an_end(speed, stretch, gained, missing, held):
    start = np.zeros((2, 3))
    start[1, 2] = speed

    def run(q, v, m, dt, steps):  # all stays but for the last state
        q = np.tile(q, (steps + 1, 1, 1))
        v = np.tile(v, (steps + 1, 1, 1))
        q[-1, 1, 0] += stretch
        v[-1, 1, 2] = np.sqrt(speed**2 + 2.0 * gained / MASSES[1, 0])
        return q[missing:], v[missing:]

    assert hard.is_held(BOBS, run, start, MASSES, DT, 1.0) == held


def test_a_cell_is_the_largest_step_that_holds_all_or_how_many_the_smallest_holds():
    def cell(*most):
        return hard.cell(lambda start, dt: dt <= start, [(x,) for x in most])

    assert (cell(1.0, 0.011, 0.3), cell(0.0006)) == ("0.01", "0.0005")
    assert (cell(0.0, 1.0, 0.0006), cell(0.0, 1e-4)) == ("2/3", "-")


@pytest.mark.parametrize("name", ["double", "triple", "upright", "spin", "jansen_leg", "windows"])
def test_a_start_is_as_it_is_or_rounded_or_pushed_as_its_rods_allow(name):
    system = c.build_system(name)
    first, rounded, pushed = hard.starts(system, 3)
    own = system["v0"], system["m"]
    assert all(map(np.array_equal, first, own))
    for x, mine in zip(rounded, own, strict=True):
        assert np.allclose(x, mine, rtol=2e-14, atol=0.0)
    v, m = pushed
    assert 0.05 < np.max(np.abs(m / system["m"] - 1.0)) < 0.3
    assert np.max(np.abs(v - system["v0"])) > 1e-4
    assert not v[:, hard.axes(system) == 0.0].any()  # hinges
    _, _, gdot, _ = c.constraint_terms(system, system["q0"], v)
    assert np.allclose(gdot, 0.0, atol=1e-9 * (1.0 + np.max(np.abs(v))))


def test_in_space_a_start_is_pushed_along_all_axes():
    system = BOBS | {"q0": BOBS["q0"][:, [1, 2, 0]]}  # level, along z
    v, _ = hard.starts(system, 3)[2]
    assert np.min(np.abs(v[:, :2])) > 0.01 and np.allclose(v[:, 2], 0.0, atol=1e-12)


def test_a_step_that_is_compiled_once_runs_with_each_starts_masses_and_step():
    (scheme,) = [x for x in all_schemes() if str(x) == "semi_implicit with impulse"]
    system = c.build_system("heavy_tip")
    v, m = hard.starts(system, 3)[2]
    run = hard.compiled_for(system, scheme.step)
    for dt in 0.002, 0.001:
        q, _ = run(system["q0"], v, m, dt, 50)
        own = system | {"m": m, "v0": v}
        exact = c.run_method(own, "impulse", "semi_implicit", dt, 50)
        assert np.allclose(q, exact.q, rtol=0.0, atol=1e-10)


# --- the real thing ---
def test_soft_is_mujocos_tendon_where_rods_are_right_and_nearly_where_they_are_not():
    pytest.importorskip("mujoco", reason=PEER)
    assert max(real.gaps(real.random_chain(np.random.default_rng(1), 4)).values()) < 1e-12
    off = real.gaps(real.random_chain(np.random.default_rng(1), 4, 0.01))
    assert 1e-4 < off["lambda |d|", "efc_force"] < 0.02


@pytest.mark.parametrize("name", ["impulse", "soft"])
def test_our_own_rows_are_the_pages_methods_and_the_worst_of_a_run_is_told(name):
    system = c.build_system("triple", 5)
    run = c.run_method(system, name, "semi_implicit", DT, 600)
    gained = np.max(np.abs(run.energies - run.energies[0])) / (3.0 * 9.81 * 3.0)
    (row,) = [x for engine, x in real.engines(DT).items() if engine.startswith(f"ours, {name}")]
    assert real.worst(system, row, 600) == pytest.approx([np.max(run.violations), gained], rel=1e-6)


W = 2.0 * np.pi * min(60.0, 0.25 / DT)  # rad/s
SOFT = DT * W * (4.0 + DT * W)
SHARE = 0.1**2 / (4.0 * np.pi**2)
SWEEPS = {  # in the engines' own words: bias rate in 1/s, mass scale, impulse scale, and what a
    # second pass leaves of the error
    "Box2D v3.1.1": (W / (4.0 + DT * W), SOFT / (1.0 + SOFT), 1.0 / (1.0 + SOFT), 1.0),
    "Jolt v5.5.0": (0.0, 1.0, 0.0, 0.64),
    "Drake v1.56.0": (0.5 / DT, 1.0 / (1.0 + SHARE), SHARE / (1.0 + SHARE), 1.0),
}


@pytest.mark.parametrize("name", SWEEPS)
def test_an_engines_row_is_what_its_sweeps_end_at(name):
    """There a sweep changes no impulse: -mass (speed + bias) - impulse scale x impulse = 0."""
    bias, mass, scale, left = SWEEPS[name]
    system = real.random_chain(np.random.default_rng(2), 3, 0.03)
    method = real.engines(DT)[name].method
    q = system["q0"]
    m = system["m"]
    q_next, v_next = c.semi_implicit_step(q, system["v0"], m, method.make_force(system), DT)
    jac, g, _, _ = c.constraint_terms(system, q, system["v0"])
    size = c.rod_lengths(system, q)
    axes = jac / size[:, None]
    push = (m * (v_next - system["v0"] - DT * c.GRAVITY)).ravel()
    impulse = np.linalg.lstsq(axes.T, push)[0]
    aim = axes @ v_next.ravel() + bias * g / size  # theirs is |d| - L, to first order the same
    effective = np.sum(axes**2 / np.repeat(m, 3), axis=1)  # 1/kg
    assert np.allclose(mass * aim / effective + scale * impulse, 0.0, atol=1e-9)
    if method.post_step:
        q_end, v_end = method.post_step(system, q, q_next, v_next, DT)
        ratio = c.constraint_violation(system, q_end) / c.constraint_violation(system, q_next)
        assert ratio == pytest.approx(left, rel=0.03)
        is_held = np.allclose(c.constraint_terms(system, q_end, v_end)[2], 0.0)
        assert is_held == (name == "Box2D v3.1.1")
