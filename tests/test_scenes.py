"""Scene files: the chapter's hard scenes run or are refused for a reason, and every mistake is
named in one line."""

import json
import os
import re
import subprocess
import sys
from contextlib import nullcontext

import constraints as c
from curriculum.ch3_4_constraints.scene_files import SceneError, check_start, parse_scene
from curriculum.ch3_4_constraints.scenes.make_scenes import MADE, SCENES, scene, text
from curriculum.ch3_4_constraints.studies._runs import drift, run
from curriculum.common.graph import has_loop

import numpy as np
import pytest

CHAINS = {"long_chain", "heavy_tip", "light_tip", "spin", "upright"}
GOOD = {
    "anchors": [[0, 0, 0]],
    "particles": [
        {"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 1},
        {"position": [2, 0, 0]},
    ],
    "rods": [{"pair": [0, -1]}, {"pair": [1, 0], "length": 1}],
}
POINT, END = (
    "three finite numbers [x, y, z]",
    "a particle 0..1, tied to another or to an anchor -1..-1",
)
MISTAKES = [  # a place in GOOD, JSON to put there, what must be there
    ("particles", ["[]", "null"], "a list of 1 to "),
    ("particles/0", ["7"], "an object with position, velocity, mass"),
    (
        "particles/1/position",
        ["[2, 0]", "[NaN, 0, 0]", "[1e999, 0, 0]", f"[1{'0' * 400}, 0, 0]", "null"],
        POINT,
    ),
    ("particles/0/velocity", ["[0, -Infinity, 0]", "[0, true, 0]"], POINT),
    ("particles/0/mass", ["0", "-1", "true", "1e-320", '"1"'], "a finite number of kilograms > 0"),
    ("anchors", ["{}", "7"], "a list of points [x, y, z]"),
    ("anchors/0", ["[0, 0]"], POINT),
    ("rods", ["[]", "null", '{"pair": [0, -1]}'], "a list of 1 to "),
    ("rods/1/pair", ["[1]", "[1, 0.0]", "[true, 0]", "null"], "two whole numbers [i, j]"),
    ("rods/1/pair", ["[2, 0]", "[1, 2]", "[1, -2]", "[-1, 1]", "[1, 1]"], END),
    ("rods/1/pair", ["[0, -1]"], "given once; rods[0] ties the same two"),
    ("rods/1/length", ["0", "-1", "null"], "a finite number of metres > 0"),
    ("rods/1/length", ["1.01"], "the distance of its ends in the positions, 1 m"),
]
ANSWERED = [
    (place, value, None, allowed) for place, values, allowed in MISTAKES for value in values
] + [
    (
        "",
        "[1]",
        "the file is [1]",
        "an object with particles, rods and anchors",
    ),  # answered in words of their own
    (
        "by",
        '"me"',
        'the file is ["anchors", "by", "particles", "rods"]',
        "an object with no keys but about, anchors",
    ),
    (
        "rods/1/spring",
        "1",
        'rods[1] is ["length", "pair", "spring"]',
        "an object with no keys but pair, length",
    ),
    (
        "anchors",
        "[]",
        "rods[0].pair is [0, -1]",
        "a particle 0..1, tied to another; there are no anchors",
    ),
    ("rods/0/pair", "[0, 1]", "rods[1].pair is [1, 0]", "given once; rods[0] ties the same two"),
    (
        "particles/0/position/0",
        "0",
        "rods[0].pair is [0, -1]",
        "two points apart: a rod of length zero",
    ),
    (
        "particles/0/velocity/0",
        "0.5",
        "rods[0] is stretched at 0.5 m/s",
        "0: velocities keep every length",
    ),
]
LINE, LOOP, UP = [(1, 0), (2, 0)], [(0, -1), (1, 0), (1, -2)], {"velocity": [0, 1, 0]}
STARTS = [  # points, rods, anchors and speeds as for `scene`; whether finite tensions can hold them
    (LINE, LOOP, [(0, 0), (3, 0)], [UP], False),  # a taut cable, plucked,
    (
        [*LINE, (4, 0)],
        [*LOOP, (2, -3)],
        [(0, 0), (3, 0), (5, 0)],
        [{}, {}, UP],
        False,
    ),  # or beside a pendulum
    (LINE, LOOP, [(0, 0), (1, 0)], [], True),  # a four-bar folded flat, at rest,
    (LINE, LOOP, [(0, 0), (1, 0)], [UP, UP], True),  # unfolding,
    (LINE, LOOP, [(0, 0), (1, 0)], [{"velocity": [0, 0.5, 0]}, UP], False),  # and torn
    (
        [(1, 2)],
        [(0, -1), (0, -2), (0, -3)],
        [(0, 0), (1, 0.3), (3, -0.1)],
        [],
        True,
    ),  # a tripod with a leg too many
]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Scenes and results stand in a folder of their own, where a short name is enough."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def answer(capsys, name):
    """The one line with which the program, given a bad scene, ends with status 2 before it has
    written anything."""
    with pytest.raises(SystemExit) as stop:
        c.main(["--system", name, "--out", "out"])
    out, err = capsys.readouterr()
    assert stop.value.code == 2 and out == "" and err.count("\n") == 1 and not os.path.exists("out")
    assert err.startswith("constraints.py: error: argument --system: ") and (
        repr(name) in err or len(name) > 60
    )
    return err


@pytest.mark.parametrize(("place", "value", "found", "allowed"), ANSWERED)
def test_a_mistake_is_named(place, value, found, allowed, here, capsys):
    at = document = {"": json.loads(json.dumps(GOOD))}
    keys = [int(key) if key.isdigit() else key for key in f"/{place}".rstrip("/").split("/")]
    for key in keys[:-1]:
        at = at[key]
    at[keys[-1]] = "@"
    (here / "scene.json").write_text(json.dumps(document[""]).replace('"@"', value))
    line, field = answer(capsys, "scene.json"), re.sub("/([0-9])", r"[\1]", place).replace("/", ".")
    assert (
        found or f": {field} is {json.dumps(json.loads(value))[:50]}"
    ) in line and f"; must be {allowed}" in line


def test_a_file_that_is_no_scene(here, capsys):
    path = here / "scene.json"
    for content in (b"{", b"\xff", b"[" * 100000):
        path.write_bytes(content)
        assert "is not JSON: " in answer(capsys, "scene.json")
    command = [sys.executable, c.__file__, "--system", str(path), "--out", str(here / "out")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1) and not (
        here / "out"
    ).exists()


def test_a_key_that_stands_twice_is_refused_by_name(here, capsys):
    (here / "scene.json").write_text('{"particles": [], "particles": []}')
    assert 'the key "particles" stands twice' in answer(capsys, "scene.json")


def test_a_name_that_is_no_scene(here, capsys):
    assert "is no scene and no file; did you mean 'triple'?" in answer(capsys, "tripel")
    assert "is no scene and no file; scenes are pendulum, double, triple, chain, " in answer(
        capsys, ""
    )
    assert len(answer(capsys, "x" * 5000)) < 200
    (here / "folder").mkdir()
    assert "must be a plain file" in answer(capsys, "folder")
    if hasattr(os, "mkfifo"):
        os.mkfifo("pipe")  # reading it would never end
        assert "must be a plain file" in answer(capsys, "pipe")


def test_a_shipped_scene_has_a_name_and_a_file_here_goes_first(here):
    assert np.array_equal(
        c.build_system("braced")["q0"], c.build_system(str(SCENES / "braced.json"))["q0"]
    )
    (here / "braced").write_text(json.dumps(GOOD))
    assert len(c.build_system("braced")["q0"]) == 2


@pytest.mark.parametrize(("points", "rods", "anchors", "more", "ok"), STARTS)
def test_a_start_that_tears_is_refused(points, rods, anchors, more, ok):
    with (
        nullcontext()
        if ok
        else pytest.raises(SceneError, match="taut: in this pose no finite tension can hold them")
    ):
        check_start(parse_scene(json.loads(text(scene("", points, rods, anchors, more)))))


def test_stored_scenes_are_those_that_make_scenes_makes():
    assert {path.stem: path.read_text() for path in SCENES.glob("*.json")} == {
        k: text(v) for k, v in MADE.items()
    }


@pytest.mark.parametrize("name", sorted(MADE))
def test_a_hard_scene_runs_or_is_refused(name, capsys):
    if name == "taut_cable":
        assert "are taut: in this pose no finite tension" in answer(capsys, name)
        return
    system = c.build_system(name)
    assert has_loop(tuple(system["pairs"])) == (name not in CHAINS)
    assert c.constraint_violation(system, system["q0"]) < 1e-15
    dt, energy = (0.01, 1e-6) if name in ("jansen_leg", "fourbar_coupler") else (0.001, 1e-3)
    found = run(system, "rk4", "project", dt, 1000, range(1001))
    assert not found.stopped and found.violations.max() < 1e-10 and drift(system, found) < energy
    if (
        name == "fourbar_coupler"
    ):  # Roberts' point goes from pivot to pivot, 0.4 m, and stays level to 0.5 mm
        assert np.ptp(found.q[:, 2, 0]) > 0.399 and np.ptp(found.q[:, 2, 1]) < 0.0005
    if (
        name == "jansen_leg"
    ):  # cm from its fixed pivot, as the linkage demo of K. M. Moerman's toolbox GIBBON has them
        drawn = [
            (38, 22.8),
            (-8.7357, 40.5702),
            (17.0047, -35.4306),
            (-39.6678, -5.8717),
            (-19.4476, -39.6874),
        ]
        assert (
            np.abs(
                100 * (system["q0"] - system["anchors"][1])[:, :2] - [*drawn, (30.3109, -82.5894)]
            ).max()
            < 1e-4
        )
    if name == "braced":  # six rods, of which five would do
        jac = c.constraint_terms(system, system["q0"], system["v0"])[0]
        assert len(jac) == 6 and np.linalg.matrix_rank(jac) == 5
