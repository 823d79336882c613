"""Scenes: a mistake is named by field, index and what is allowed; what must break is refused."""

import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import UNIX

import constraints as c
from curriculum.ch3_4_constraints.page import play
from curriculum.ch3_4_constraints.rods import scenes, systems
from curriculum.ch3_4_constraints.rods.scenes import LARGEST, MOST_ENTRIES, parse_scene
from curriculum.ch3_4_constraints.rods.statics import refusal
from curriculum.ch3_4_constraints.rods.systems import check_system, is_flat, rod_parts
from curriculum.common.errors import Refused

GOOD = """{"anchors": [[0, 0, 0]],
 "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 2}, {"position": [2, 0, 0]}],
 "rods": [{"pair": [0, -1]}, {"pair": [1, 0], "length": 1.0000001}]}"""
POSITION, LOAD, PAIR = "particles[1].position", "particles[0].load", "rods[1].pair"
WRONG = [  # what stands there, what is put there, and what is named: a field, and what it is
    ("}]}", '}], "about": "\\ud800"}', "about", r'"\ud800"'),
    ("}]}", '}], "by": 1}', "a key of the file", '"by"'),
    ("}]}", '}], "rods": []}', "a key", '"rods"'),
    ("[2, 0, 0]}", "[2, 0, 0]}" + MOST_ENTRIES * ", {}", "particles", "1000 entries"),
    ("[2, 0,", 41 * "[" + "2" + 40 * "]" + ", 0,", POSITION, "[[[[[["),
    ("[2, 0,", "[NaN, 0,", POSITION, "[NaN, 0, 0]"),
    ("[2, 0,", '["2", 0,', POSITION, '["2", 0, 0]'),
    ('y": [0,', 'y": [true,', "particles[0].velocity", "[true, 0, 0]"),
    ('y": [0,', 'y": [1e-5,', "rods[0]", "at 1e-05 m/s"),
    ('y": [0,', 'y": [-1e-5,', "rods[0]", "at -1e-05 m/s"),
    (": 2}", ': 2, "load": [0, 1]}', LOAD, "[0, 1]"),
    (": 2}", ': 2, "load": [0, 1, Infinity]}', LOAD, "[0, 1, Infinity]"),
    (": 2}", ': 2, "load": [0, 1, 1e12]}', LOAD, "1000000000000.0"),
    (": 2}", ': 2, "load": 40}', LOAD, "40"),
    (": 2}", ': 2, "weight": 40}', "a key of particles[0]", '"weight"'),
    (": 2}", ": " + 40 * "[" + "2" + 40 * "]" + "}", "the shape of particles[0].mass", "[1, 1, 1"),
    (": 2}", ": 0}", "particles[0].mass", "is 0;"),
    ("[1, 0],", "[2, 0],", PAIR, "[2, 0]"),
    ("[1, 0],", "[1, 1],", PAIR, "[1, 1]"),
    ("[1, 0],", "[1, -2],", PAIR, "[1, -2]"),
    ("[1, 0],", "[0, -1],", PAIR, "rods[0] ties the same"),
    ("1.0000001", "1.00001", "rods[1].length", "must be 1 m"),
    (": [1, 0, 0]", ": [0, 0, 0]", "rods[0].pair", "two points apart"),
    ("[[0, 0, 0]]", "[]", "rods[0].pair", "(0 in all)"),
]


@pytest.mark.parametrize(("old", "new", "field", "value"), WRONG)
def test_a_wrong_value_in_a_file_is_named(old, new, field, value, tmp_path, refused):
    assert GOOD.count(old) == 1
    (tmp_path / "scene.json").write_text(GOOD.replace(old, new))
    said = refused("--system", tmp_path / "scene.json")
    assert field in said and value in said


LIMITS = [(scenes, "MOST_ENTRIES", 2), (scenes, "LARGEST", len(GOOD)), (systems, "FILLED", 5)]


@pytest.mark.parametrize(("module", "name", "size"), LIMITS)
def test_a_scene_that_is_just_as_large_as_may_be_is_taken(
    module, name, size, tmp_path, monkeypatch, refused
):
    (tmp_path / "scene.json").write_text(GOOD)
    monkeypatch.setattr(module, name, size)
    assert len(c.build_system(tmp_path / "scene.json")["q0"]) == 2
    monkeypatch.setattr(module, name, size - 1)
    refused("--system", tmp_path / "scene.json")


def test_a_scene_without_words_has_none(tmp_path):
    for about in ('"about": ""', '"about": "  "'):
        (tmp_path / "scene.json").write_text(GOOD.replace("}]}", "}], " + about + "}"))
        system = c.build_system(tmp_path / "scene.json")
        assert "about" not in system and play.about(system) == "2 bobs, 3 kg, on 2 m of rods"
    assert "about" in c.build_system("braced")


STAR = {"pairs": [(k, 0) for k in range(1, 101)], "lengths": np.ones(100)}
TYPED = {  # what is named of a typed system, and what is wrong in it
    "a system is": {"v0": None},
    "m[1] is 10000000000.0; must be at most 1e+12 times 1e-06 kg": {"m": [[1e-6], [1e10]]},
    "the number of rows of lengths is 3; must be 2": {"lengths": [1.0, 1.0, 1.0]},
    "the number of rows of load is 1; must be 2": {"load": [[0.0, 1.0, 0.0]]},
    "lengths[1] is 1.12; must be 1 m, to 10 %": {"lengths": [1.09, 1.12]},
    "lengths[0] is 0.88; must be 1 m, to 10 %": {"lengths": [0.88, 0.91]},
    "the shape of m[0] is []; must be (1,)": {"m": np.ones(2)},
    "load[1] is [0.0, NaN, 0.0]": {"load": [[0, 0, 0], [0.0, math.nan, 0.0]]},
    "pairs[0] is [-1, 0]": {"pairs": [(-1, 0), (1, 0)]},
    "v0[0] is [NaN, NaN, NaN]": {"v0": np.full((2, 3), np.nan)},
    "pairs[2] is [1, 0]; must be given once; rods[1] ties": {
        "pairs": [(0, -1), (1, 0), (1, 0)],
        "lengths": [1.0, 1.0, 1.0],
    },
    "pairs[0] is [0.0, -1]": {"pairs": [[0.0, -1], [1, 0]]},
    "the number of particles and rods is [2, 0]": {"pairs": np.zeros((0, 2), int)},
    "must be 10000 at most": c.build_system("chain", links=101) | STAR,
}


@pytest.mark.parametrize("sentence", TYPED)
def test_a_wrong_value_in_a_typed_system_is_named_with_what_is_allowed(sentence):
    system = c.build_system("double") | TYPED[sentence]
    system = {key: x for key, x in system.items() if x is not None}
    with pytest.raises(Refused, match=re.escape(sentence)):
        check_system(system, c.PIVOT)


def test_a_typed_system_becomes_arrays_of_float64_and_keeps_its_other_keys():
    double = c.build_system("double")
    lists = {key: np.asarray(x).tolist() for key, x in double.items()}
    clean = check_system(lists | {"wind": 3.0}, c.PIVOT)
    assert clean.pop("wind") == 3.0 and clean.pop("pairs") == double["pairs"]
    assert all(np.array_equal(x, double[key]) and x.dtype == float for key, x in clean.items())


def test_lengths_that_are_a_little_off_are_kept():
    rough = check_system(c.build_system("double") | {"lengths": [1.09, 0.92]}, c.PIVOT)
    assert rough["lengths"].tolist() == [1.09, 0.92]


def test_lengths_that_a_file_leaves_out_are_measured_and_loads_are_none(tmp_path):
    text = GOOD.replace("[2, 0, 0]", "[1.6, 0.8, 0]").replace(": 2}", ': 2, "load": [3, -4, 0.5]}')
    (tmp_path / "scene.json").write_text(text)
    system = c.build_system(tmp_path / "scene.json")
    assert system["lengths"].tolist() == [1.0, 1.0000001] and np.hypot(0.6, 0.8) == 1.0
    assert system["load"].tolist() == [[3.0, -4.0, 0.5], [0.0, 0.0, 0.0]]


def test_what_a_rod_has_too_much_or_lacks_is_at_its_moving_end():
    """Rods (0, -1) and (1, 0), on the second anchor and on a particle: 3 for 2 m, and 1 for 4."""
    anchors = [[9.0, 9.0, 9.0], [0.0, 0.0, 1.0]]
    system = {"pairs": [(0, -2), (1, 0)], "lengths": np.array([2.0, 4.0]), "anchors": anchors}
    q = np.array([[3.0, 0.0, 1.0], [3.0, -1.0, 1.0]])
    right, too_long, too_short = (part[1] for part in rod_parts(system, np.stack([0.0 * q + 1, q])))
    assert right.tolist() == [[[0, 0, 1], [2, 0, 1]], [[3, 0, 1], [3, -1, 1]]]
    assert too_long.tolist() == [[[2, 0, 1], [3, 0, 1]], [[3, -1, 1], [3, -1, 1]]]
    assert too_short.tolist() == [[[3, 0, 1], [3, 0, 1]], [[3, -1, 1], [3, -4, 1]]]


def test_a_system_is_flat_if_all_of_it_is_and_moves_in_one_plane():
    flat = c.build_system("windows")
    assert is_flat(flat)
    for key in ("q0", "v0", "anchors"):
        off = flat[key].copy()
        off[-1, 2] = 1e-9
        assert not is_flat(flat | {key: off})


TAUT = {  # a cable of two rods, straight from anchor to anchor
    "anchors": [[0, 0, 0], [2, 0, 0]],
    "particles": [{"position": [1, 0, 0]}],
    "rods": [{"pair": [0, -1]}, {"pair": [0, -2]}],
}
NO_SCENES = {  # what is said of files and names that are no scenes, or none that can move
    "open": "not JSON: ",
    "deep": "not JSON: ",
    "itself": "cannot be read: ",
    "huge": f"must be a plain file of at most {LARGEST / 1e6:g} MB",
    "pipe": "must be a plain file",
    "tripel": "no scene and no file; did you mean 'triple'?",
    "nosuch": "scenes are pendulum, double, triple, chain, ",
    "nul\0": "must be a name in characters that can be printed",
    "taut": "are taut: in this pose no finite tension can hold them; give the loop some",
}


@UNIX
def test_a_file_that_is_no_scene_is_told_what_it_is(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    Path("open").write_text("{")
    Path("deep").write_text("[" * 100_000)
    Path("itself").symlink_to("itself")
    Path("taut").write_text(json.dumps(TAUT))
    Path("huge").touch()
    os.truncate("huge", 10**12)  # a hole
    os.mkfifo("pipe")  # reading it would never end
    for name, sentence in NO_SCENES.items():
        assert sentence in refused("--system", name)


def test_an_error_of_the_program_is_not_told_as_one_of_the_scene(monkeypatch):
    monkeypatch.setattr(scenes, "refusal", lambda *_: math.sqrt(-1.0))
    with pytest.raises(ValueError, match="math domain error"):
        c.build_system("braced")


def test_a_file_goes_before_a_shipped_scene_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):  # editors mark their bytes
        Path("braced").write_text(GOOD, encoding)
        assert c.build_system("braced")["m"].tolist() == [[2.0], [1.0]]


LINE = [(1, 0), (2, 0)], [(0, -1), (1, 0), (1, -2)]
LEVEL = *LINE, [(0, 0), (3, 0)]
FLAT = *LINE, [(0, 0), (1, 0)]
BAR = [(3, 4), (6, 8)], [(0, -1), (1, 0), (1, -1)], [(0, 0)]
HELD = [(3, 4), (6, 8), (0.5, 3)], [*BAR[1], (2, -1), (2, 0), (2, 1)], [(0, 0)]
LEGS = [(1, 2)], [(0, -1), (0, -2), (0, -3)], [(0, 0), (1, 0.3), (3, 0)]
SAG = [(0, -1), (0, -2)], [(0, 0), (2, 0)]
WHIRL = [(0, 1), (1, 1)], [(0, -1), (0, -2), (1, 0)], [(0, 0), (0, 2)]
STARTS = {  # points, rods, anchors; speeds upward; loads in N; whether finite tensions hold it
    "a taut cable": (LEVEL, 0, 0, False),
    "one whose weights are lifted": (LEVEL, 0, [[0, 9.81, 0], [0, 9.81, 0]], True),
    "of which one is lifted": (LEVEL, 0, [[0, 9.81, 0], [0, 0, 0]], False),
    "lifted, and pulled along it": (LEVEL, 0, [[-50, 9.81, 0], [70, 9.81, 0]], True),
    "lifted, and pushed aside": (LEVEL, 0, [[0, 9.81, 0], [0, 9.81, 3]], False),
    "a four-bar folded flat": (FLAT, 0, 0, True),
    "a four-bar that unfolds": (FLAT, [1, 1], 0, True),
    "a four-bar that tears": (FLAT, [0.5, 1], 0, False),
    "three legs for two, at rest but for rounding": (LEGS, [1e-16], 0, True),
    "a weight on a line that sags": (([(1, -1e-5)], *SAG), 0, 0, True),
    "one whose sag no solve sees": (([(1, -1e-7)], *SAG), 0, 0, False),
    "a bob on a taut line, at which one pulls that turns": (WHIRL, [0, 2], 0, False),
    "one that is held against that": (WHIRL, [0, 2], [[-4, 0, 0], [0, 0, 0]], True),
    "a straight bar with a joint": (BAR, 0, 0, False),
    "one that a particle beside its line keeps straight": (HELD, 0, 0, True),
}


@pytest.mark.parametrize("name", STARTS)
def test_a_start_that_must_break_a_rod_is_refused_and_no_other(name):
    (points, pairs, anchors), speeds, load, holds = STARTS[name]
    scene = {
        "anchors": [[*at, 0] for at in anchors],
        "particles": [{"position": [*at, 0]} for at in points],
        "rods": [{"pair": [*pair]} for pair in pairs],
    }
    system = parse_scene(scene)
    system["v0"][:, 1] = speeds
    assert (refusal(system | {"load": load + 0.0 * system["v0"]}, c.GRAVITY) is None) == holds
    if not np.any(speeds):  # and nothing pulls
        assert refusal(system, 0.0 * c.GRAVITY) is None
