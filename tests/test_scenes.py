"""Scenes: a mistake is named by field, index and what is allowed; what must break is refused."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import BARE

import constraints as c
from curriculum.ch3_4_constraints.scene_files import LARGEST, MOST, parse_scene
from curriculum.ch3_4_constraints.statics import refusal
from curriculum.ch3_4_constraints.systems import SceneError, check_system

GOOD = """{"anchors": [[0, 0, 0]],
 "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 2}, {"position": [2, 0, 0]}],
 "rods": [{"pair": [0, -1]}, {"pair": [1, 0], "length": 1.0000001}]}"""
ENDS = "; must be a particle 0..1, and then another or the anchor -1"

WRONG = [  # what stands there, what is put there, and what is said of it
    ("}]}", '}], "by": 1}', 'the file has a key "by"; must be an object with no keys but about, a'),
    ("[2, 0, 0]}", "[2, 0, 0]}" + MOST * ", {}", "; must be a list of 1 to 1000 entries"),
    ("[2, 0,", "[NaN, 0,", "particles[1].position is [NaN, 0, 0]; must be three finite numbers"),
    ('y": [0,', 'y": [true,', "particles[0].velocity is [true, 0, 0]; must be three finite"),
    ('y": [0,', 'y": [1e-5,', "stretch rods[0] at 1e-05 m/s; must be 0, for a rod can only turn"),
    (": 2}", ": 0}", "particles[0].mass is 0; must be a finite number of kilograms > 0"),
    ("[1, 0],", "[2, 0],", "rods[1].pair is [2, 0]" + ENDS),
    ("[1, 0],", "[0, -1],", "rods[1].pair is [0, -1]; must be given once; rods[0] ties the same"),
    ("1.0000001", "1.00001", "must be 1 m, to 0.0001 %; that is how far apart its ends are"),
    (": [1, 0, 0]", ": [0, 0, 0]", "rods[0].pair is [0, -1]; must be two points apart"),
    ("[[0, 0, 0]]", "[]", "rods[0].pair is [0, -1]; must be a particle 0..1, and then another;"),
]


@pytest.mark.parametrize(("there", "wrong", "sentence"), WRONG)
def test_a_wrong_value_in_a_file_is_named_with_what_is_allowed(
    there, wrong, sentence, tmp_path, refused
):
    assert GOOD.count(there) == 1
    (tmp_path / "scene.json").write_text(GOOD.replace(there, wrong))
    assert sentence in refused("--system", tmp_path / "scene.json")


STAR = {"pairs": [(k, 0) for k in range(1, 101)], "lengths": np.ones(100)}
TYPED = {  # what is said of a typed system, and what is wrong in it
    "must be a dict with q0, v0, m, anchors, pairs, lengths": {"v0": None},
    "must be at most 1e+12 times 1e-06 kg": {"m": [[1e-6], [1e10]]},
    "the shape of lengths is [3]; must be (2,)": {"lengths": [1.0, 1.0, 1.0]},
    "lengths[1] is 1.5; must be 1 m, to 10 %; that is how far": {"lengths": [1.0, 1.5]},
    "pairs[0] is [0.0, -1]; must be two whole": {"pairs": [[0.0, -1], [1, 0]]},
    "the number of particles and rods is [2, 0]": {"pairs": np.zeros((0, 2), int)},
    "entries of A, two for rods that meet, is": c.build_system("chain", links=101) | STAR,
}


@pytest.mark.parametrize("sentence", TYPED)
def test_a_wrong_value_in_a_typed_system_is_named_with_what_is_allowed(sentence):
    system = c.build_system("double") | TYPED[sentence]
    system = {key: x for key, x in system.items() if x is not None}
    with pytest.raises(SceneError, match=re.escape(sentence)):
        check_system(system, c.PIVOT)


def test_a_typed_system_becomes_arrays_of_float64_and_keeps_its_other_keys():
    double = c.build_system("double")
    typed = {key: np.asarray(x).tolist() for key, x in double.items() if key != "anchors"}
    clean = check_system(typed | {"wind": 3.0}, c.PIVOT)
    assert clean.pop("wind") == 3.0 and clean.pop("pairs") == double["pairs"]
    for key, x in clean.items():
        assert np.array_equal(x, double[key]) and x.dtype == float


NO_SCENES = {  # what is said of files and names that are no scenes, or none that can move
    "open": "not JSON: ",
    "deep": "not JSON: ",
    "twice": '"mass" is given twice in one object: 1 and 5',
    "itself": "cannot be read: ",
    "huge": f"must be a plain file of at most {LARGEST / 1e6:g} MB",
    "pipe": "must be a plain file",
    "tripel": "no scene and no file; did you mean 'triple'?",
    "nosuch": "scenes are pendulum, double, triple, chain, braced, ",
    "nul\0": "no scene and no file",
    "taut_cable": "are taut: in this pose no finite tension can hold them; give the loop some",
}


def test_a_file_that_is_no_scene_is_told_what_it_is(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    Path("open").write_text("{")
    Path("deep").write_text("[" * 100_000)
    Path("twice").write_text('{"particles": [{"position": [1, 0, 0], "mass": 1, "mass": 5}]}')
    Path("itself").symlink_to("itself")
    Path("huge").touch()
    os.truncate("huge", 10**12)  # a hole
    os.mkfifo("pipe")  # reading it would never end
    for name, sentence in NO_SCENES.items():
        assert sentence in refused("--system", name)


def test_a_file_goes_before_a_shipped_scene_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):  # editors mark their bytes
        Path("braced").write_text(GOOD, encoding)
        assert len(c.build_system("braced")["m"]) == 2


LINE = [(1, 0), (2, 0)], [(0, -1), (1, 0), (1, -2)]
LEGS = [(1, 2)], [(0, -1), (0, -2), (0, -3)], [(0, 0), (1, 0.3), (3, 0)]
SAG = [(0, -1), (0, -2)], [(0, 0), (2, 0)], [0]
STARTS = {  # points, rods, anchors, speeds upward, and whether finite tensions hold it
    "a taut cable": (*LINE, [(0, 0), (3, 0)], [0, 0], False),
    "a four-bar folded flat": (*LINE, [(0, 0), (1, 0)], [0, 0], True),
    "a four-bar that unfolds": (*LINE, [(0, 0), (1, 0)], [1, 1], True),
    "a four-bar that tears": (*LINE, [(0, 0), (1, 0)], [0.5, 1], False),
    "three legs for two, at rest but for rounding": (*LEGS, [1e-16], True),
    "a weight on a line that sags": ([(1, -1e-5)], *SAG, True),
    "one whose sag no solve sees": ([(1, -1e-7)], *SAG, False),
}


def flat_system(points, rods, anchors, speeds):
    """A system in the plane, particles of 1 kg with speeds upward."""
    points, anchors = ([[*at, 0] for at in places] for places in (points, anchors))
    particles = [{"position": at} for at in points]
    scene = {"anchors": anchors, "particles": particles, "rods": [{"pair": [*x]} for x in rods]}
    return parse_scene(scene) | {"v0": np.outer(speeds, [0.0, 1.0, 0.0])}


@pytest.mark.parametrize("name", STARTS)
def test_a_start_that_must_break_a_rod_is_refused_and_no_other(name):
    *start, holds = STARTS[name]
    system = flat_system(*start)
    assert (refusal(system, c.GRAVITY) is None) == holds
    if not system["v0"].any():  # and nothing pulls
        assert refusal(system, 0.0 * c.GRAVITY) is None


BAR = [(3, 4), (6, 8)], [(0, -1), (1, 0), (1, -1)], [(0, 0)]
SLIDE = [(0, 1), (1, 1), (2, 1)], [(0, -1), (1, 0), (2, 1), (2, 0), (1, -2)], [(0, 0), (1, 0)]


@pytest.mark.parametrize(("start", "bar"), [(BAR, [-1, 0, 1]), (SLIDE, [0, 1, 2])])
def test_a_straight_bar_with_a_joint_needs_a_particle_beside_its_line_and_then_runs(start, bar):
    points, rods, anchors = start
    why = refusal(flat_system(*start, [0] * len(points)), c.GRAVITY)
    assert "straight bar with a joint between its ends" in why and "beside their line" in why
    rods = rods + [(len(points), i) for i in bar]
    braced = flat_system([*points, (0.5, 3)], rods, anchors, [0] * (len(points) + 1))
    assert refusal(braced, c.GRAVITY) is None


def test_none_that_breaks_at_a_flat_pose_is_told_that_its_rods_had_left(tmp_path, capsys):
    """Four-bar windows fall through flat poses, where rods that are off by a micrometre break."""
    flags = ["--system=windows", "--integrator=rk4", "--dt=0.002", "--stabilization=none"]
    c.main([*flags, "--steps=2000", *BARE, f"--out={tmp_path}"])
    said = " ".join(capsys.readouterr().out.split())
    assert "; rods had left the constraint by " in said and "long" not in said


LONG = [(1e-3, 5e-3, True), (1e-3, 5e-4, False), (1.0, 0.05, True)]


@pytest.mark.parametrize(("m", "dt", "long"), LONG)
def test_a_step_is_long_beside_the_swing_of_the_shortest_rod(m, dt, long, tmp_path, capsys):
    scene = {"anchors": [[0, 0, 0]], "rods": [{"pair": [0, -1]}, {"pair": [1, 0]}]}
    scene["particles"] = [{"position": [m, 0, 0]}, {"position": [2.0 * m, 0, 0]}]
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene))
    c.main([f"--system={path}", f"--dt={dt}", "--steps=40", *BARE, f"--out={tmp_path / 'out'}"])
    said = capsys.readouterr().out
    assert ("is long: it is " in said) == long and "no reference" not in said
