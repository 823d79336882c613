"""The moving picture: what moves, where and when, how large it is; who can tell its colours."""

import re
from itertools import combinations
from types import SimpleNamespace
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints import svg
from curriculum.ch3_4_constraints.picture import BYTES, write_motion
from curriculum.ch3_4_constraints.recording import frames, rgb
from curriculum.ch3_4_constraints.studies._runs import run

import numpy as np
import pytest

SVG = "{http://www.w3.org/2000/svg}"
BLIND = [  # G. Machado, M. Oliveira, L. Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009) 1291
    np.eye(3),
    [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],  # protanopia
    [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],  # deuteranopia
    [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],  # tritanopia
]
TO_XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]


def drawn(path, system, dt, steps, modes, seen=None):
    """The runs of a picture written to `path`, and its elements; the last mode is the ghost for
    `seen` s."""
    keep = frames(steps, dt, len(system["q0"]))
    runs = {mode: run(system, "semi_implicit", mode, dt, steps, keep) for mode in modes}
    args, last = SimpleNamespace(system="some", integrator="semi_implicit"), runs[modes[-1]]
    known = last.kept * dt <= (seen or 0.0)
    ghost = (last.kept[known] * dt, last.q[known]) if seen else None
    write_motion(path, args, {"dt": dt}, system, runs, keep, ghost)
    return runs, ElementTree.parse(path).getroot()


def test_the_picture_moves_as_the_run_did(tmp_path):
    files = tmp_path / "one.svg", tmp_path / "two.svg"
    setting = c.build_system("double"), 0.005, 4000, list(c.hold_table()), 8.0
    (runs, root), _ = (drawn(file, *setting) for file in files)
    assert files[0].read_bytes() == files[1].read_bytes() and files[0].stat().st_size < 150_000
    for done, tile in zip(runs.values(), root.findall(f"{SVG}svg"), strict=True):
        rods = tile.find(f"{SVG}path/{SVG}animate")
        shapes = [re.findall(r"-?\d+", shape) for shape in rods.get("values").split(";")]
        corners = np.cumsum(np.reshape(shapes, (len(shapes), -1, 2)).astype(float), axis=1)
        assert float(rods.get("dur")[:-1]) / (len(shapes) - 1) == pytest.approx(1 / 20, rel=0.15)
        moved = (corners[:, 1:] - corners[:, :1]) * [1, -1]
        where = done.q[np.isin(done.kept, 9 * np.arange(len(shapes)))][..., :2]
        metre = np.sum(moved * where) / np.sum(where * where)
        assert np.max(np.abs(moved - metre * where)) < 2.0  # tenths of a pixel
        red = [x for x in tile.findall(f"{SVG}path") if x.get("stroke") == svg.EXCESS]
        assert bool(red) == (np.max(done.violations) > 0.025)  # a pixel
    hidden = root.find(f"{SVG}defs//{SVG}animate[@attributeName='display']")
    assert float(hidden.get("keyTimes")[2:]) == pytest.approx(8.0 / 20.0, abs=0.01)


def test_a_lost_mode_disappears_and_its_words_say_when(tmp_path):
    setting = c.build_system("double"), 0.045, 200, ["none", "baumgarte"]
    runs, root = drawn(tmp_path / "lost.svg", *setting)
    at, shown = runs["baumgarte"].kept[-1], runs["none"].kept[-1]
    (hidden,) = root.findall(f".//{SVG}animate[@attributeName='display']")[-1:]
    assert 0 < at < shown and float(hidden.get("keyTimes")[2:]) == pytest.approx(at / shown, 0.02)
    assert f"lost at {0.045 * at:.3g} s" in [words.text for words in root.iter(f"{SVG}text")]


@pytest.mark.parametrize("links", [1, 11, 900])
def test_no_scene_makes_a_large_picture(links, tmp_path):
    system, steps = c.build_system("chain", links=links), 50 if links > 50 else 1000
    drawn(tmp_path / "motion.svg", system, 0.01, steps, ["none", "project"])
    assert (tmp_path / "motion.svg").stat().st_size <= BYTES


@pytest.mark.parametrize("eyes", BLIND)
def test_modes_and_forces_have_colours_that_all_can_tell_apart(eyes):
    coded = np.array([rgb(x) for x in (*svg.MODES.values(), svg.PULL, svg.PUSH)]) / 255.0
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    share = np.clip(light @ np.transpose(eyes), 0, 1) @ np.transpose(TO_XYZ)
    root = np.cbrt(share / np.sum(TO_XYZ, axis=1))
    lab = root @ [[0, 500, 0], [116, -500, 200], [0, 0, -200]]  # CIE 1976, of what is not dark
    assert min(np.linalg.norm(a - b) for a, b in combinations(lab, 2)) > 10.0
    bright = light @ TO_XYZ[1] + 0.05  # contrast of at least 3 on white and on black, as in WCAG
    assert np.all(1.05 / bright > 3.0) and np.all(bright / 0.05 > 3.0)
