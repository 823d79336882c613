"""Studies: what is measured is so, and so is what is said and drawn of it."""

import argparse
import json
import re
from functools import partial

import numpy as np
import pytest
from conftest import ROOT

import constraints as c
from curriculum.ch3_4_constraints import make
from curriculum.ch3_4_constraints.mechanics import systems
from curriculum.ch3_4_constraints.pictures import work_precision
from curriculum.ch3_4_constraints.studies import __main__ as studies
from curriculum.ch3_4_constraints.studies import hard_cases as hard
from curriculum.ch3_4_constraints.studies import race
from curriculum.ch3_4_constraints.studies import real_thing as real
from curriculum.ch3_4_constraints.studies import speed_vs_error as speed

DT = 0.005  # s
PEER = "a peer: pip install -e '.[fast,peers]'"
REFERENCE = json.loads((ROOT / "tests/reference.json").read_text(encoding="utf-8"))
SCENES = {name: c.build_system(name) for name in speed.SCENES}


@pytest.mark.parametrize("name", [name for name, peers in studies.STUDIES.items() if peers])
def test_a_peer_that_is_missing_is_told_and_how_to_get_it(name, monkeypatch, capsys):
    peer = studies.STUDIES[name][-1]
    monkeypatch.setattr(studies, "find_spec", lambda x: x != peer or None)
    with pytest.raises(SystemExit, match="2"):
        studies.main([name])
    told = f"error: {peer} is not installed: pip install -e '.[fast,peers]'\n"
    assert capsys.readouterr().err.endswith(told)


@pytest.mark.parametrize("name", studies.STUDIES)
def test_help_needs_no_peer(name, monkeypatch, capsys):
    monkeypatch.setattr(studies, "find_spec", lambda x: None)
    monkeypatch.setattr("sys.argv", ["studies"])
    with pytest.raises(SystemExit, match="0"):
        studies.main([name, "--help"])
    assert capsys.readouterr().out.startswith(f"usage: studies {name} [flags]\n")


# --- speed against error ---
@pytest.mark.parametrize("steps", [1, speed.STRETCH, 2 * speed.STRETCH + 1])
def test_a_run_ends_when_it_should_however_many_steps_it_takes(steps):
    system = SCENES["double"] | {"v0": np.array([[1.0, -2.0, 0.0], [0.5, 3.0, 0.0]])}
    seconds, q = speed.ours(system, 5.0, lambda q, v, dt: (q + dt * v, v))(steps)
    assert np.allclose(q, system["q0"] + 5.0 * system["v0"], rtol=0.0, atol=1e-9) and seconds > 0.0


def timings(integrator, method, *rows):
    """{Solver: Timings} of rows of a step in s, an error in m and a time in s."""
    solver = speed.Solver(integrator, method)
    return {solver: [speed.Timing(solver, dt, error, 0.0, [took]) for dt, error, took in rows]}


def test_a_sentence_names_who_is_quickest_and_who_as_quick_with_ms_of_all_steps_and_of_one():
    """A setting counts if the next finer one is as good."""
    found = timings("rk4", "slow", (0.01, 1e-7, 0.3), (0.005, 1e-8, 0.6))
    found |= timings("rk4", "quick", (0.005, 1e-7, 0.0021), (0.0025, 1e-8, 0.0042))
    found |= timings("semi_implicit", "near", (0.005, 1e-7, 0.0023), (0.0025, 1e-8, 0.0044))
    found |= timings("rk4", "lucky", (0.02, 1e-7, 1e-6), (0.01, 0.1, 2e-6))
    assert speed.quickest(found, 1e-6) == "to 1 µm: rk4 quick 2.1/5, semi near 2.3/5"
    assert speed.quickest(found, 1e-9) == "to 1 nm: nobody"
    found |= timings("rk4", "better", (0.005, 1e-9, 0.0022), (0.0025, 1e-9, 0.0044))
    assert speed.quickest(found, 1e-6).startswith("to 1 µm: rk4 better 2.2/5, rk4 quick")


def test_references_are_where_joint_angles_have_the_particles():
    """The ten four-bars of windows stay parallelograms: each crank is the same pendulum."""
    for name in "double", "jansen_leg":
        known, gap = speed.reference(SCENES[name], speed.SCENES[name])
        k = REFERENCE["times"].index(speed.SCENES[name])
        exact = np.array(REFERENCE["cases"][name]["positions"][k])
        assert np.abs(known[:, :2] - exact).max() < 1e-12 and gap < 1e-12
    crank = c.build_system("pendulum") | {"q0": np.eye(3)[[1]], "v0": np.eye(3)[[0]]}
    moved = c.run_method(crank, "project", "gauss", 0.01, 100).q[-1]
    known, _ = speed.reference(SCENES["windows"], 1.0)
    assert speed.distance(known, SCENES["windows"]["anchors"] + moved) < 1e-11


PEERS = [  # a scene, a row of MuJoCo's, steps, and how near it is to ours, in m
    ("double", "hinges", 2000, 1e-8),
    ("double", "tendons, hard", 4000, 5e-3),
    ("jansen_leg", "connect, hard", 800, 1e-5),
    ("jansen_leg", "tendons, hard", 800, 1e-3),
    ("windows", "connect", 400, 2e-3),
]


@pytest.mark.parametrize(("scene", "name", "steps", "off"), PEERS)
def test_mujocos_hinges_connects_and_tendons_move_as_particles_on_rods(scene, name, steps, off):
    pytest.importorskip("mujoco", reason=PEER)
    system = SCENES[scene]
    seconds = speed.SCENES[scene]
    exact, _ = speed.reference(system, seconds)
    _, q = speed.peers(system, seconds)["MuJoCo", name](steps)
    assert speed.distance(q, exact) < off


RIGID = [row for row in PEERS if row[1] != "connect"]  # which gives under a load


@pytest.mark.parametrize(("scene", "name", "steps", "off"), RIGID)
def test_mujocos_particles_bear_the_loads_of_ours(scene, name, steps, off):
    pytest.importorskip("mujoco", reason=PEER)
    load = np.random.default_rng(3).normal(0.0, 4.0, SCENES[scene]["q0"].shape) * [1.0, 1.0, 0.0]
    system = SCENES[scene] | {"load": load}
    without, _ = speed.reference(SCENES[scene], 0.5)
    exact, _ = speed.reference(system, 0.5)
    _, q = speed.peers(system, 0.5)["MuJoCo", name](steps)
    assert speed.distance(q, exact) < off < 0.3 * speed.distance(without, exact)


@pytest.mark.parametrize(("scene", "closed"), [("double", "hinges"), ("jansen_leg", "connect")])
def test_a_loop_is_closed_by_connects_and_what_has_none_needs_hinges_only(scene, closed):
    methods = {x.method.partition(",")[0] for x in speed.peers(SCENES[scene], 1.0)}
    assert methods == {closed, "tendons"}


def test_a_force_that_mujocos_peers_would_leave_out_is_refused(monkeypatch):
    pytest.importorskip("mujoco", reason=PEER)
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY - v)
    with pytest.raises(argparse.ArgumentTypeError, match="gravity and the system's load only"):
        speed.peers(SCENES["double"], 1.0)["MuJoCo", "hinges"](10)


def drawn(*more):
    """What is drawn of lines of order 1 and 4, of a peer and of some more lines."""
    steps = [0.02 * 0.5**k for k in range(12)]
    found = {}
    for integrator, order in ("semi_implicit", 1), ("rk4", 4):
        for method in "none", "project":
            rows = [(dt, 30.0 * dt**order, 1e-5 / dt) for dt in steps]
            found |= timings(integrator, method, *rows)
    found |= timings("MuJoCo", "hinges", *[(dt, 30.0 * dt**4, 1e-3 / dt) for dt in steps])
    for line in more:
        found |= line
    measured = speed.Measured("double", 5.0, found, speed.GOALS, 1e-13, 1.0, {}, 0.005, 5)
    return work_precision.text_of(measured, speed.winners), found


def lines_of(text):
    """[(points (n, 2), style)] of the lines of three points or more in a drawing."""
    lines = []
    for data, style in re.findall(r'd="M([-\d L]+)" style="([^"]*)"', text):
        points = np.array([point.split() for point in data.split("L")], float)
        if len(points) > 2:
            lines.append((points, style))
    return lines


def test_a_diagram_rises_to_the_right_as_an_order_has_it():
    """Half the step takes twice the time, and has 1/2 or 1/16 of the error."""
    text, _ = drawn()
    slopes = []
    for points, _ in lines_of(text):
        wide, high = points[4] - points[0]
        slopes.append(-high / wide)
    slopes = sorted(slopes)
    assert np.allclose(slopes[-1], 4.0 * np.array(slopes[:3]), rtol=0.05)


def test_a_diagram_names_what_is_quickest_in_its_colour_and_leaves_the_others_grey():
    quick = timings("rk4", "baumgarte", (0.02, 5e-4, 1e-5), (0.01, 4e-4, 2e-5))
    text, found = drawn(quick)
    colours = dict(re.findall(r'style="[^"]*fill:var\(--(\w+)\)">([\w ]+), [\d.]+ ms<', text))
    winners = {goal: speed.winners(found, goal)[0] for goal in speed.GOALS[:3]}
    assert winners[1e-3].solver == ("rk4", "baumgarte")
    assert winners[1e-6].solver == ("rk4", "none")
    assert set(colours.values()) >= {str(x.solver) for x in winners.values()}
    assert "double: quickest to 1 mm is rk4 baumgarte<" in text
    bold = re.findall(r"<text [^>]*font-weight:bold[^>]*>([^<]*)<", text)
    assert "1 mm" in bold and f"rk4 baumgarte, {1e3 * winners[1e-3].dt:g} ms" in bold
    grey = [style for _, style in lines_of(text) if "--reference" in style]
    assert len(grey) == len(found) - len({x.solver for x in winners.values()})
    peer = work_precision.shown(found["MuJoCo", "hinges"])
    assert text.count(work_precision.OPEN) == len(peer) > 5
    assert "open circles: MuJoCo" in text and ">MuJoCo hinges<" in text


def test_a_small_scene_is_asked_for_its_coarsest_goal():
    found = timings("rk4", "none", (0.02, 5e-7, 1e-5), (0.01, 4e-7, 2e-5))
    measured = speed.Measured("flea", 0.1, found, [1e-6, 1e-9], 1e-13, 1.0, {}, 0.005, 5)
    text = work_precision.text_of(measured, speed.winners)
    assert "flea: quickest to 1 µm is rk4 none<" in text and ">1 mm<" not in text
    nobody = measured._replace(goals=[1e-9])
    assert "flea: quickest to 1 nm is nobody<" in work_precision.text_of(nobody, speed.winners)
    far = nobody._replace(found=timings("rk4", "none", (0.02, 9.0, 1e-5)))
    assert "flea: quickest to 1 nm is nobody<" in work_precision.text_of(far, speed.winners)


def test_words_of_a_diagram_are_read_on_a_phone():
    """350 pixels remain of 390 between the margins of a page; 11 is the least."""
    text, _ = drawn()
    wide = float(re.search(r'viewBox="0 0 (\d+)', text)[1])
    sizes = [float(x) for x in re.findall(r"font(?:-size)?: (\d+)px", text)]
    size = max(sizes)
    assert min(sizes) * 350.0 / wide >= 11.0
    for x, anchor, words in re.findall(
        r'<text x="(\d+)"[^>]*text-anchor="(\w+)"[^>]*>([^<]*)<', text
    ):
        half = 0.25 * size * len(words)  # letters are half as wide as high
        left = float(x) - {"start": 0.0, "middle": half, "end": 2.0 * half}[anchor]
        assert left >= 0.0 and left + 2.0 * half <= wide, words


def test_a_name_that_no_table_has_is_drawn_like_the_others():
    other = work_precision.look(speed.Solver("MuJoCo", "hinges"))
    assert work_precision.look(speed.Solver("rk5", "none")) == other
    looks = [work_precision.look(x) for x in speed.SOLVERS if x.integrator != "XPBD"]
    assert len({*looks}) == len(looks)


def only_rk4(monkeypatch, methods=("none",)):
    solvers = [speed.Solver("rk4", method) for method in methods]
    monkeypatch.setattr(speed, "SOLVERS", {x: speed.SOLVERS[x] for x in solvers})


def quick_study(tmp_path, *flags):
    speed.main(
        ["--system", "pendulum", "--seconds", "0.5", "--quick", "--out", str(tmp_path), *flags]
    )


def test_a_scene_of_ones_own_is_printed_and_written_with_its_diagram(tmp_path, capsys, monkeypatch):
    only_rk4(monkeypatch, ["none", "project"])
    scene = tmp_path / "swing.json"
    scene.write_text(
        json.dumps(
            {
                "anchors": [[0, 0, 0]],
                "particles": [{"position": [0.0, 0.0, 0.3]}, {"position": [0.2, 0.0, 0.3]}],
                "rods": [{"pair": [0, -1]}, {"pair": [1, 0]}],
            }
        )
    )
    quick_study(tmp_path / "out", "--system", str(scene))
    printed = capsys.readouterr().out
    text = (tmp_path / "out" / speed.TEXT).read_text("utf-8")
    assert text in printed and text.startswith("swing, 0.5 s; the reference is known to ")
    why = "its hinges are for scenes in the plane z = 0"
    if speed.find_spec("mujoco") is None:
        why = "mujoco is not installed"
    assert f"MuJoCo hinges is not there: {why}" in text
    for solver in speed.SOLVERS:
        assert re.search(rf"^{solver} +\d", text, re.M)
    assert re.search(r"^to 1 mm: rk4 (none|project) ", text, re.M)
    picture = (tmp_path / "out" / speed.DIAGRAM).read_text("utf-8")
    assert "swing: quickest to 1 mm is rk4" in picture


def test_a_scene_that_nobody_knows_for_so_long_is_followed_for_less(tmp_path, capsys, monkeypatch):
    only_rk4(monkeypatch)
    known = speed.choice.truth.true_motion

    def true_motion(system, force, project, dt, last):
        found = known(system, force, project, dt, last)
        return found if last * dt < 0.3 else found._replace(q=None)

    monkeypatch.setattr(speed.choice.truth, "true_motion", true_motion)
    quick_study(tmp_path)
    printed = capsys.readouterr().out
    assert "nobody knows where it is after 0.5 s: so it is followed for 0.25 s" in printed
    assert "\npendulum, 0.25 s; " in printed


@pytest.mark.parametrize(("size", "goals"), [(2.0, 5), (0.02, 4), (1e-4, 3)])
def test_what_is_as_large_as_the_scene_is_no_goal(size, goals, monkeypatch):
    only_rk4(monkeypatch)
    monkeypatch.setattr(speed, "find_spec", lambda name: None)
    rows = {"q0": np.array([[size, 0.0, 0.0]]), "lengths": np.array([size])}
    system = systems.check_system(c.build_system("pendulum") | rows, c.PIVOT)
    measured = speed.measure("swing", system, 0.1 * np.sqrt(size), 0.02, 1)
    assert tuple(measured.goals) == speed.GOALS[-goals:]


def test_mujoco_need_not_be_there(tmp_path, capsys, monkeypatch):
    only_rk4(monkeypatch)
    monkeypatch.setattr(speed, "find_spec", lambda name: None)
    quick_study(tmp_path)
    said = "MuJoCo hinges is not there: mujoco is not installed: pip install -e '.[fast,peers]'"
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--seconds", "2"], "argument --seconds: is for --system"),
        (["--out", "here"], "argument --out: is for --system"),
        (["--system", "double", "--picture"], "argument --picture: is for the chapter's scenes"),
        (["--system", "doubel"], "argument --system: 'doubel': no scene and no file"),
        (["--system", "chain12.json"], "no scene and no file"),
    ],
)
def test_a_wrong_scene_for_the_study_is_one_line(flags, said, capsys):
    with pytest.raises(SystemExit, match="2"):
        speed.main(flags)
    assert said in capsys.readouterr().err


# --- race ---
def test_who_races_ends_within_the_error_and_the_ratios_are_printed(capsys):
    for peer in "llvmlite", "heyoka":
        pytest.importorskip(peer, reason=PEER)
    race.main([])
    rows = capsys.readouterr().out.splitlines()
    for goal, row in zip(race.SETTINGS, rows, strict=True):
        mine, theirs, ratio = map(
            float, re.findall(r"([\d.]+) µs.*?([\d.]+) µs  ratio ([\d.]+)", row)[0]
        )
        assert row.startswith(f"{goal:.0e} m") and ratio == pytest.approx(mine / theirs, abs=0.01)
    known, _ = speed.reference(race.SYSTEM, race.SECONDS)
    for run in partial(race.gauss(8, 9), 90), race.taylor(1e-14):
        assert speed.distance(run()[1], known) < 1e-11


def test_a_setting_that_is_not_within_its_error_does_not_race(monkeypatch, capsys):
    for peer in "llvmlite", "heyoka":
        pytest.importorskip(peer, reason=PEER)
    monkeypatch.setattr(race, "SETTINGS", {1e-6: race.SETTINGS[1e-3]})
    with pytest.raises(SystemExit, match="2"):
        race.main([])
    out, err = capsys.readouterr()
    assert out == "" and "a setting is no longer within 1e-06 m: change SETTINGS" in err


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
HELD = [  # how much too long the last rod ends, in m; energy gained, in J; states that are missing
    (0.009, 0.09 * M_G_L, 0, True),
    (-0.011, 0.0, 0, False),
    (0.011, 0.0, 0, False),
    (0.0, 0.11 * M_G_L, 0, False),
    (0.0, -0.11 * M_G_L, 0, False),
    (0.0, 0.0, 1, False),
]


def is_held(speed, stretch, gained, missing):
    """What is_held says of a run whose last bob keeps its speed in m/s, but for the last state."""
    start = np.zeros((2, 3))
    start[1, 2] = speed

    def run(q, v, m, dt, steps):
        q = np.tile(q, (steps + 1, 1, 1))
        v = np.tile(v, (steps + 1, 1, 1))
        q[-1, 1, 0] += stretch
        v[-1, 1, 2] = np.sqrt(speed**2 + 2.0 * gained / MASSES[1, 0])
        return q[missing:], v[missing:]

    return hard.is_held(BOBS, run, start, MASSES, DT, 1.0)


@pytest.mark.parametrize(("stretch", "gained", "missing", "held"), HELD)
def test_a_start_is_lost_by_rods_by_energy_or_by_an_end(stretch, gained, missing, held):
    assert is_held(4.0, stretch, gained, missing) == held


def test_a_fast_start_is_held_to_its_kinetic_energy():
    kinetic = 0.5 * 3.0 * 30.0**2  # J
    assert is_held(30.0, 0.0, 0.09 * kinetic, 0) and not is_held(30.0, 0.0, 0.11 * kinetic, 0)


def test_a_cell_is_the_largest_step_that_holds_all_or_how_many_the_smallest_holds():
    def held(most, dt):
        return dt <= most

    assert hard.cell(held, [(1.0,), (0.011,), (0.3,)]) == "0.01"
    assert hard.cell(held, [(0.0006,)]) == "0.0005"
    assert hard.cell(held, [(0.0,), (1.0,), (0.0006,)]) == "2/3"
    assert hard.cell(held, [(0.0,), (1e-4,)]) == "-"


@pytest.mark.parametrize("name", hard.SCENES)
def test_a_start_is_as_it_is_or_rounded_or_pushed_as_its_rods_allow(name):
    system = c.build_system(name)
    q = system["q0"]
    v = system["v0"]
    first, rounded, *_, pushed = hard.starts(system, 7)
    assert np.array_equal(first[0], v) and np.array_equal(first[1], system["m"])
    near = {"rtol": 2e-14, "atol": 0.0}
    assert np.allclose(rounded[0], v, **near) and np.allclose(rounded[1], system["m"], **near)
    share = pushed[1] / system["m"] - 1.0
    assert 0.05 < np.max(np.abs(share)) < 0.3
    free = hard.axes(system) > 0.0
    assert not pushed[0][:, ~free].any()  # hinges
    jac, _, gdot, _ = c.constraint_terms(system, q, pushed[0])
    assert np.allclose(gdot, 0.0, atol=1e-9 * (1.0 + np.max(np.abs(v))))
    scaled = np.sum(pushed[0] * v) / max(1e-9, np.sum(v * v)) * v
    has_one_motion = (
        np.sum(free) * len(q) - np.linalg.matrix_rank(jac) == 1
    )  # so a push can but scale it
    assert np.max(np.abs(pushed[0] - scaled)) > 0.05 or (has_one_motion and v.any())


def table_of_hard_cases():
    """{column: {scene: largest step in s, 0 if none holds all}} of the studies' README."""
    text = make.STUDIES.read_text(encoding="utf-8")
    _, block = text.split("studies hard_cases -->\n```text\n")
    _, integrators, methods, *rows = block.split("\n```")[0].splitlines()
    titles = zip(integrators.split(), methods.split(), strict=True)
    found = {title: {} for title in titles}
    for row in rows:
        scene, *cells = row.split()
        for title, cell in zip(found, cells, strict=True):
            known = re.fullmatch(r"0\.\d+", cell)
            found[title][scene] = float(cell) if known else 0.0
    return found


def test_what_is_said_of_the_hard_cases_follows_from_their_table():
    table = table_of_hard_cases()
    assert [*table] == [(x.short, x.method) for x in hard.COLUMNS]
    assert [*table["semi", "none"]] == hard.SCENES
    assert {*table["gauss", "baumgarte"].values()} == {max(hard.LADDER)}
    impulse = table["semi", "impulse"]
    assert min(impulse.values()) > 0.0
    for method in "none", "baumgarte", "soft":  # which solve once a step, too
        assert all(impulse[scene] >= step for scene, step in table["semi", method].items())


def test_in_space_a_start_is_pushed_along_all_axes():
    system = BOBS | {"q0": BOBS["q0"][:, [1, 2, 0]]}  # level, along z
    v, _ = hard.starts(system, 3)[2]
    assert np.min(np.abs(v[:, :2])) > 0.01 and np.allclose(v[:, 2], 0.0, atol=1e-12)


def test_a_step_that_is_compiled_once_runs_with_each_starts_masses_and_step():
    system = c.build_system("heavy_tip")
    v, m = hard.starts(system, 3)[2]
    run = hard.compiled_for(system, speed.SOLVERS["semi_implicit", "impulse"])
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


@pytest.mark.parametrize(
    ("name", "method"), [("ours, impulse", "impulse"), ("ours, soft (MuJoCo)", "soft")]
)
def test_our_own_rows_are_the_pages_methods_and_the_worst_of_a_run_is_told(name, method):
    system = c.build_system("triple", 5)
    run = c.run_method(system, method, "semi_implicit", DT, 600)
    gained = np.max(np.abs(run.energies - run.energies[0])) / (3.0 * 9.81 * 3.0)
    found = real.worst(system, real.engines(DT)[name], 600)
    assert found == pytest.approx([np.max(run.violations), gained], rel=1e-6)


W = 2.0 * np.pi * min(60.0, 0.25 / DT)  # rad/s
SOFT = DT * W * (4.0 + DT * W)
SHARE = 0.1**2 / (4.0 * np.pi**2)
SWEEPS = {  # bias rate in 1/s, mass scale and impulse scale, in the engines' own words
    "Box2D v3.1.1": (W / (4.0 + DT * W), SOFT / (1.0 + SOFT), 1.0 / (1.0 + SOFT)),
    "Jolt v5.5.0": (0.0, 1.0, 0.0),
    "Drake v1.56.0": (0.5 / DT, 1.0 / (1.0 + SHARE), SHARE / (1.0 + SHARE)),
}


@pytest.mark.parametrize("name", SWEEPS)
def test_an_engines_row_is_what_its_sweeps_end_at(name):
    """There a sweep changes no impulse: -mass (speed + bias) - impulse scale x impulse = 0."""
    system = real.random_chain(np.random.default_rng(2), 3, 0.03)
    method = real.engines(DT)[name].method
    q = system["q0"]
    v = system["v0"]
    m = system["m"]
    q_next, v_next = c.semi_implicit_step(q, v, m, method.make_force(system), DT)
    jac, g, _, _ = c.constraint_terms(system, q, v)
    size = c.rod_lengths(system, q)
    axes = jac / size[:, None]
    impulse = np.linalg.lstsq(axes.T, (m * (v_next - v - DT * c.GRAVITY)).ravel())[0]
    bias, mass, scale = SWEEPS[name]
    aim = axes @ v_next.ravel() + bias * g / size  # theirs is |d| - L, to first order the same
    effective = np.sum(axes**2 / np.repeat(m, 3), axis=1)  # 1/kg
    assert np.allclose(mass * aim / effective + scale * impulse, 0.0, atol=1e-9)
    if method.post_step:
        q_end, v_end = method.post_step(system, q, q_next, v_next, DT)
        ratio = c.constraint_violation(system, q_end) / c.constraint_violation(system, q_next)
        assert ratio == pytest.approx({"Box2D v3.1.1": 1.0, "Jolt v5.5.0": 0.64}[name], rel=0.03)
        assert np.allclose(jac @ v_end.ravel(), 0.0) == (name == "Jolt v5.5.0")
