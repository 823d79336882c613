"""Scenes are refused for a reason, and no others: a mistake is named, a start must be held."""

import contextlib
import json
import os
import re
from itertools import combinations, product
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.statics import refusal
from curriculum.ch3_4_constraints.studies._runs import SCENES, make_system, run
from curriculum.ch3_4_constraints.studies.hard_cases import METHODS
from curriculum.ch3_4_constraints.systems import MOST, SceneError, check_system
from curriculum.ch3_4_constraints.tables import UNHELD
from curriculum.common.elimination import has_loop

import numpy as np
import pytest
from conftest import MISTAKES, complaint

GOOD = MISTAKES["scenes"]["good"]
WRONG = [(at, x, *told) for at, values, *told in MISTAKES["scenes"]["wrong"] for x in values]
WRONG += [
    ("particles[0].velocity", f"[{10**400}, 0, 0]", "", "three finite numbers [x, y, z]"),
    ("anchors", json.dumps([[0, 0, 0]] * (MOST + 1)), "anchors is [[", f"0 to {MOST} entries"),
]
STAR = {"pairs": [(k, 0) for k in range(1, 700)], "lengths": np.ones(699)}
LEVEL = c.build_system("double") | {"q0": [[1.0, 0, 0], [2, 0, 0]]}
UNFIT = MISTAKES["scenes"]["unfit"] | {
    "q0 is [[[0.0, 0.0, 0.0]]]; must be a list or an array (N, 3)": {"q0": np.zeros((1, 1, 3))},
    "of particles and rods is [2, 0]": {"pairs": np.zeros((0, 2), int)},
    "q0 is null; must be a list or an array (N, 3), each row three": {"q0": None},
    "meet, is 489300; must be 10000 at most": c.build_system("chain", links=700) | STAR,
    "must be at most 1e+12 times 1e-06 kg": {"m": [[1e-6], [1e10]]},
    "keep can be gone through but once": {"keep": iter([1, 2])},
    "steps is np.uint8(255); must be an int": {"steps": np.uint8(255)},
    "this force does not fit rk4; take gauss": {"mode": c.Hold(1.0, 0.0, 0.0, 0.0, rule="gauss")},
    "hold is None; must be": {"mode": None},
    "softness of a Hold is -0.99; must be >= 0; it is (1 - p) / p": {
        "mode": c.hold_table(0.01, impedance=100.0)["soft"]
    },
    "softness of a Hold is nan; must be a finite": {"mode": c.Hold(1.0, 0.0, 0.0, np.nan)},
    "the damping of a Hold is '40'; must be a finite": {"mode": c.Hold(1.0, "40", 0.0, 0.0)},
    "the stiffness of a Hold is inf; must be a finite": {"mode": c.Hold(1.0, 0.0, np.inf, 0.0)},
    "the use_jdotv of a Hold is None; must be a finite": {"mode": c.Hold(None, 0.0, 0.0, 0.0)},
    "step_fn is {'q0': array([[0., 0., 0.], [0., 0., 0.]])}; must be": {
        "step_fn": {"q0": np.zeros((2, 3))}
    },
    "hold is 20j; must be": {"mode": 20j},
    "hold is (1, 2); must be": {"mode": (1, 2)},
}
CONTENTS = {"open": "{", "deep": "[" * 100000, "huge": ""}
CONTENTS["twice"] = '{"particles": [{"position": [1, 0, 0], "mass": 1, "mass": 5}]}'
NO_SCENES = [*MISTAKES["scenes"]["names"], ("x" * 5000, "cannot be read: ")]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where a short name is enough


def answer(capsys, name):
    """The one line that says why there is no scene of this name."""
    line = complaint(capsys, "--system", name)
    assert line.startswith("constraints.py: error: argument --system: ")
    assert repr(name) in line or len(name) > 60 and len(line) < 200
    return line


@pytest.mark.parametrize(("place", "value", "found", "allowed"), WRONG)
def test_a_mistake_in_a_file_is_named(place, value, found, allowed, capsys):
    at = document = {"file": json.loads(json.dumps(GOOD))}
    *keys, last = [int(k) if k.isdigit() else k for k in re.findall(r"\w+", f"file.{place}")]
    for key in keys:
        at = at[key]
    at[last] = "@"
    Path("scene.json").write_text(json.dumps(document["file"]).replace('"@"', value))
    said, right = answer(capsys, "scene.json").split("; must be ")
    assert (found or f": {place} is {json.dumps(json.loads(value))[:50]}") in said
    assert allowed in right


@pytest.mark.parametrize("sentence", UNFIT)
def test_what_cannot_be_run_is_named_before_it_begins(sentence):
    """A mistake in a typed system, or in what is asked of a run."""
    asked = {"mode": "none", "dt": 0.01, "steps": 9} | UNFIT[sentence]
    system = {key: asked.pop(key, usual) for key, usual in LEVEL.items()}
    system = {key: x for key, x in system.items() if not isinstance(x, str)}  # left out
    system, forced = asked.pop("system", system), asked.pop("forced", system)
    mode, rule = asked.pop("mode"), asked.pop("step_fn", c.rk4_step)
    with pytest.raises(ValueError, match=re.escape(sentence)) as told:
        force = asked.pop("force", None) or c.make_force(forced, mode)
        c.simulate(rule, system, force, **asked)
    assert "\n" not in str(told.value)


def test_a_clean_system_is_float64_and_keeps_other_keys_and_lacks_none():
    double = c.build_system("double")
    with pytest.raises(SceneError, match="must be a dict with q0, v0, m, anchors, pairs, lengths"):
        check_system({"q0": double["q0"]})
    short = {key: double[key].astype(np.float32) for key in ("q0", "v0", "m")}
    slack = {"pairs": np.array(double["pairs"]), "lengths": [1.0, 0.999]}  # wrong on purpose
    clean = check_system(double | short | slack | {"wind": 3.0})
    assert {clean[key].dtype for key in clean if key not in ("pairs", "wind")} == {np.dtype(float)}
    assert clean["pairs"] == [(0, -1), (1, 0)] and clean["wind"] == 3.0
    assert np.array_equal(clean["q0"], short["q0"]) and clean["lengths"][1] == 0.999
    off = {"q0": [[10.0, 0, 0], [20, 0, 0]], "lengths": [11.0, 9.0]}  # by 10 %, and no more
    assert np.array_equal(check_system(LEVEL | off)["lengths"], off["lengths"])


def test_a_file_or_a_name_that_is_no_scene(capsys):
    for name, content in CONTENTS.items():
        Path(name).write_text(content)
    Path("itself").symlink_to("itself")
    Path("bytes").write_bytes(b"\xff")
    os.truncate("huge", 10**12)  # a hole
    os.mkdir("folder")
    os.mkfifo("pipe")  # reading it would never end
    for name, sentence in NO_SCENES:
        assert sentence in answer(capsys, name)


def test_a_scene_is_named_by_text_or_a_path_and_a_file_here_goes_first(tmp_path):
    Path("mine.json").write_text(json.dumps(GOOD))
    assert len(c.build_system(tmp_path / "mine.json")["m"]) == 2
    with pytest.raises(SceneError, match="3 is neither the name of a scene nor a path"):
        c.build_system(3)
    shipped = [c.build_system(name)["q0"] for name in ("braced", str(SCENES / "braced.json"))]
    assert np.array_equal(*shipped)
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):  # editors mark their bytes
        Path("braced").write_text(json.dumps(GOOD), encoding)
        assert len(c.build_system("braced")["q0"]) == 2


def test_what_is_no_system_is_told_of_by_every_function_of_one():
    q, v = LEVEL["q0"], LEVEL["v0"]
    for asked in (
        lambda: c.make_force("double", "none")(q, v),
        lambda: c.tensions(q, LEVEL, v),
        lambda: c.energy(None, q, v),
    ):
        with pytest.raises(SceneError, match="a system is .*; must be a dict, as build_system"):
            asked()


def test_many_states_are_pointed_to_mapped_and_an_odd_order_is_refused():
    with pytest.raises(ValueError, match=r"must be \(\d, 3\), a row for each particle; mapped\(f"):
        c.rod_errors(LEVEL, np.array([LEVEL["q0"]] * 5))
    with pytest.raises(ValueError, match="order of a midpoint rule is 7; must be even, 2 to 16"):
        c.make_midpoint(7)


def test_a_chain_has_links_as_many_as_a_file_may_have():
    assert len(c.build_system("chain", links=MOST)["m"]) == MOST
    for links in (0, -1, 2.5, MOST + 1, True):
        said = json.dumps(links)
        with pytest.raises(SceneError, match=f"links is {said}; must be a whole number of rods"):
            c.build_system("chain", links=links)


def test_a_length_in_a_file_is_judged_by_its_rods_own():
    right = contextlib.nullcontext()
    wrong = pytest.raises(SceneError, match="how far apart its ends are")
    for size, (off, told) in product((1e-4, 1.0, 1e4), ((1e-7, right), (1e-5, wrong))):
        rods = [{"pair": [0, -1], "length": size * (1.0 + off)}]
        scene = {"anchors": [[0, 0, 0]], "particles": [{"position": [size, 0, 0]}], "rods": rods}
        Path("scene.json").write_text(json.dumps(scene))
        with told:
            assert c.build_system("scene.json")["lengths"] == [rods[0]["length"]]


def test_a_system_without_anchors_hangs_on_the_pivot_wherever_that_is(monkeypatch):
    monkeypatch.setattr(c, "PIVOT", np.array([[0.0, 1.0, 0.0]]))
    full = c.build_system("pendulum")
    bare = {key: full[key] for key in full if key != "anchors"}
    one, other = (c.simulate(c.rk4_step, x, c.make_force(x, "none"), 0.1, 9) for x in (full, bare))
    assert np.array_equal(one.tip, other.tip)
    with pytest.raises(ValueError, match="anchors are not those of the run"):
        elsewhere = full | {"anchors": [[0.0, 1.0, 1e-9]]}
        c.simulate(c.rk4_step, elsewhere, c.make_force(bare, "none"), 0.1, 9)


def test_a_system_whose_anchor_is_moved_leaves_the_pivot_of_others_where_it_is():
    usual, moved = c.build_system("double"), c.build_system("double")
    for key in ("q0", "anchors"):
        moved[key] += [0.0, 5.0, 0.0]
    other = c.build_system("double")
    assert all(np.array_equal(other[key], usual[key]) for key in usual)


def test_a_force_of_another_system_is_refused_whatever_differs():
    double = c.build_system("double")
    others = {"m": [[1.0], [2.0]], "lengths": [1.0, 1.01], "anchors": [[0.0, 0.01, 0.0]]}
    others["pairs"] = [(0, -1), (1, -1)]
    for key, other in others.items():
        force = c.make_force(double | {key: other}, "none")
        with pytest.raises(ValueError, match=f"another system: {key} are not those of the run"):
            c.simulate(c.rk4_step, double, force, 0.01, 1)
    typed = {key: np.asarray(double[key]).tolist() for key in ("m", "pairs", "lengths", "q0", "v0")}
    found = c.simulate(c.rk4_step, double, c.make_force(typed, "none"), 0.01, np.int64(1))
    assert found.stopped is None  # the same numbers, typed in another way, without the pivot


def test_shipped_scenes_start_on_their_rods_and_are_what_they_are_called(capsys, monkeypatch):
    assert "are taut: in this pose no finite tension" in answer(capsys, "taut_cable")
    monkeypatch.setattr(c, "GRAVITY", np.zeros(3))  # is known in one place
    systems = {path.stem: c.build_system(path.stem) for path in SCENES.glob("*.json")}
    for system in systems.values():
        assert has_loop(system["pairs"]) == (len(system["pairs"]) > len(system["m"]))
        assert c.constraint_violation(system, system["q0"]) < 1e-15
    braced, leg = systems["braced"], systems["jansen_leg"]
    jac = c.constraint_terms(braced, braced["q0"], braced["v0"])[0]
    assert (len(jac), np.linalg.matrix_rank(jac)) == (6, 5)  # of six rods five would do
    # cm, as the linkage demo of K. M. Moerman's toolbox GIBBON has them
    drawn = [(38, 22.8), (-8.7357, 40.5702), (17.0047, -35.4306), (-39.6678, -5.8717)]
    drawn += [(-19.4476, -39.6874), (30.3109, -82.5894)]
    assert np.abs(100 * (leg["q0"] - leg["anchors"][1])[:, :2] - drawn).max() < 1e-4


# --- which starts no finite tension can hold ---
STARTS = dict(MISTAKES["scenes"]["starts"])
for sag in (1e-2, 1e-4, 1e-6, 1e-9, 0.0):  # tensions of m g / (2 sag), until doubles see none
    ends = [(0, 0), (2.0 * np.sqrt(1.0 - sag * sag), 0)]
    weight = [(0.5 * ends[1][0], -sag)], [(0, -1), (0, -2)], ends, [0], sag > 1e-8
    STARTS[f"a weight on a line that sags by {sag:g}"] = weight
for wide in (2, 3):  # a level row of braced squares, hung by its corners, can sag; two cannot
    at, corners = list(product(range(3), range(wide))), list(product((0, 2), (0, wide - 1)))
    steps = {(j, i): tuple(np.subtract(at[j], at[i])) for i, j in combinations(range(len(at)), 2)}
    rods = [pair for pair, step in steps.items() if step in ((1, 0), (0, 1), (1, 1))]
    rods += [(at.index(corner), -1 - k) for k, corner in enumerate(corners)]
    q, ends = ([(x, y, z) for x, z in places] for y, places in ((0.0, at), (1.0, corners)))
    STARTS[f"plates, in rows: {wide - 1}"] = q, rods, ends, [0] * len(q), wide == 2


@pytest.mark.parametrize("name", STARTS)
def test_a_start_that_tears_is_refused_and_no_other(name):
    """Without gravity no loop does that is at rest; the loops are of the first two particles."""
    points, rods, anchors, speeds, ok = STARTS[name]
    points, anchors = ([(*at, 0.0)[:3] for at in places] for places in (points, anchors))
    upward = np.outer(speeds, [0.0, 1.0, 0.0])
    system = make_system(points, upward, np.ones(len(points)), rods, anchors=anchors)
    assert (refusal(system, c.GRAVITY) is None) == ok
    assert (refusal(system, 0.0 * c.GRAVITY) is None) == (ok or not any(speeds[:2]))


def test_nothing_but_rounding_could_move_what_is_in_balance_and_it_does_not():
    cable = c.build_system("tight_cable")  # 0.1 % longer than its span
    assert np.sum(cable["lengths"]) / cable["anchors"][1, 0] == pytest.approx(1.001, rel=1e-15)
    for method in METHODS:
        assert np.abs(run(c.build_system("upright"), *method, 0.005, 400).tip[:, 0]).max() < 1e-9
        if "soft" not in method:  # whose rods are longer under load
            assert np.ptp(run(cable, *method, 0.005, 100).tip, axis=0).max() < 1e-9


def found(tmp_path, scene, *flags):
    """The metrics of a short run of a scene, and the names of all that it writes."""
    Path("scene.json").write_text(json.dumps(scene))
    c.main(["--system", "scene.json", "--no-rerun", "--out", str(tmp_path / "out"), *flags])
    names = {path.name for path in (tmp_path / "out").iterdir()}
    return json.loads((tmp_path / "out/metrics.json").read_text()), names


def test_two_bobs_on_a_rod_that_hangs_on_nothing_have_all_their_files(tmp_path):
    bobs = [{"position": [0, 0, 0]}, {"position": [1, 0, 0], "velocity": [0, 1, 0]}]
    _, names = found(tmp_path, {"particles": bobs, "rods": [{"pair": [1, 0]}]}, "--steps", "20")
    assert names == {"metrics.json", "motion.svg", "play.html"}


def test_a_motion_that_tensions_do_not_make_is_no_truth(tmp_path, capsys):
    """The bob would circle at 3e4 rad/s; every rule would find the same other motion."""
    bob = {"position": [1, -1e-4, 0], "velocity": [0, 0, 3]}
    rods = [{"pair": [0, -1]}, {"pair": [0, -2]}]
    level = {"anchors": [[0, 0, 0], [2, 0, 0]], "particles": [bob], "rods": rods}
    metrics, _ = found(tmp_path, level, "--steps", "400", "--stabilization", "none")
    (row,) = metrics["results"].values()
    assert row["unheld"] > UNHELD and row["error"] is None
    assert "is not looked for: at the start no" in capsys.readouterr().out
