"""The pictures: what they draw and say is what the chapter's runs do."""

import re
import shlex
from itertools import combinations
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints import rods
from curriculum.ch3_4_constraints.site import drawing, gallery, pictures
from curriculum.common.errors import Refused
from curriculum.common.words import length

DT = 0.005  # s
NUMBER = re.compile(r"-?[\d.]+")


def parsed(picture):
    """A picture, or the parts of a sheet, as a tree."""
    text = picture if isinstance(picture, str) else f"<svg>{''.join(picture.parts)}</svg>"
    return ElementTree.fromstring(text.replace(' xmlns="http://www.w3.org/2000/svg"', ""))


def words(root):
    """{text: (x, y)} of a picture."""
    return {x.text: (float(x.get("x")), float(x.get("y"))) for x in root.iter("text")}


def lines(outline):
    """The lines of a path's d, a list of (points, 2), y up."""
    parts = [NUMBER.findall(line) for line in outline.split("M")[1:]]
    return [np.array(numbers, float).reshape(-1, 2) * [1, -1] for numbers in parts]


def drawn(root, colour, kind=None):
    """The lines of each path of a colour: of those of a class, if there is one."""
    style = f"stroke:var(--{colour});"
    paths = [x for x in root.iter("path") if x.get("style").startswith(style)]
    return [lines(x.get("d")) for x in paths if x.get("class") == kind]


def tiles(name, steps, methods=tuple(gallery.METHODS)):
    """A scene, its runs {method: Run}, and the tiles {method: Sheet} of their last states."""
    system = c.build_system(name)
    runs = {x: c.run_method(system, x, "semi_implicit", DT, steps) for x in methods}
    return system, runs, gallery.tiles(system, runs, np.arange(0, steps + 1, 50), np.arange(steps))


def test_a_tile_has_its_last_state_its_worst_rod_and_in_red_what_a_rod_has_too_much():
    system, runs, found = tiles("double", 4000)
    for method, run in runs.items():
        root = parsed(found[method])
        assert any(length(run.violations.max()) in said for said in words(root))
        ((shown,),) = drawn(root, gallery.METHODS[method], "still")
        places = np.array([c.PIVOT, run.q[-1, 0], run.q[-1, 1]])[:, :2]
        apart = np.diff(places, axis=0)
        seen = np.diff(shown, axis=0)
        scale = np.linalg.norm(seen) / np.linalg.norm(apart)
        assert np.allclose(seen, scale * apart, atol=1.5)
        if method == "none":
            (much,) = drawn(root, "long", "still")
            red = [np.linalg.norm(np.ptp(piece, axis=0)) for piece in much]
            errors = c.rod_lengths(system, run.q[-1]) - system["lengths"]
            assert np.allclose(red, scale * errors, atol=2.0) and np.max(red) > 10.0


@pytest.mark.parametrize("width", [500.0, 750.0])
@pytest.mark.parametrize("count", [1, 2, 5, 6, 8])
def test_however_many_methods_no_tile_covers_another_or_the_legend(width, count):
    sheets = {k: drawing.Sheet(width, 300.0, (0.0, 0.0), (1.0, 1.0)) for k in range(count)}
    root = parsed(gallery.board(sheets, ["about"]))
    wide, tall = map(float, root.get("viewBox").split()[2:])
    keys = "x", "y", "width", "height"
    boxes = [[float(x.get(key)) for key in keys] for x in root.findall("svg")]
    assert len(boxes) == count + 1 and "about" in words(root.findall("svg")[-1])
    for x, y, *size in boxes:
        assert size == [width, 300.0] and x + width <= wide and y + 300.0 <= tall
    for one, other in combinations(boxes, 2):
        assert abs(one[0] - other[0]) >= width or abs(one[1] - other[1]) >= 300.0


def test_peaucelliers_joint_has_its_dashed_line_and_a_red_gap_where_it_left_it():
    root = parsed(pictures.flat_pose())
    system = c.build_system("peaucellier")
    shown = [x for x in root.findall("svg") if drawn(x, "ink")]
    for tile, method in zip(shown, gallery.METHODS, strict=True):
        ((((foot, _), (top, _)),),) = drawn(tile, "ink")
        ((joint, end),) = drawn(tile, "long")[-1]
        run = c.run_method(system, method, "semi_implicit", DT, 800)
        assert foot == top == end[0] and joint[1] == end[1]
        off = run.q[-1, 3, 0] - system["q0"][3, 0]
        assert np.sign(round(off, 1)) == np.sign(round((joint[0] - end[0]) / 100.0, 1))
        assert (abs(joint[0] - end[0]) > 4.0) == (abs(off) > 0.05)


def test_lines_of_nodes_go_along_each_rod_once():
    pairs = [(0, -1), (1, 0), (2, 1), (2, -2), (3, 0)]
    assert gallery.trails_of(pairs) == [[-1, 0, 1, 2], [-2, 2], [0, 3]]


def test_each_scene_that_can_be_let_go_has_a_picture_that_it_fills_and_a_command():
    said = (pictures.FOLDER / "README.md").read_text(encoding="utf-8")
    commands = [shlex.split(line) for line in said.splitlines() if line.startswith("    python")]
    commands = {command[3]: command for command in commands}
    for name in [*gallery.CHAINS, *rods.SHIPPED]:
        try:
            system = c.build_system(name)
        except Refused:
            assert name not in said
            continue
        c.parse_args(commands[name][2:])
        assert " ".join(system.get("about", "").split()) in " ".join(said.split())
        path = pictures.FOLDER / f"{name}.svg"
        assert f"({path.name})" in said and path.stat().st_size < 150_000
        root = parsed(path.read_text(encoding="utf-8"))
        shown = zip(root.findall("svg"), gallery.METHODS.values(), strict=False)
        assert max(fills(tile, colour) for tile, colour in shown) > 0.7, name


def fills(tile, colour):
    """How much of its tile's width, or of the height for what moves, a method fills."""
    outlines = [x.get("values").replace(";", "") for x in tile.iter("animate")]
    points = np.concatenate([*lines("".join(outlines)), *drawn(tile, colour)[0]])
    x, y = np.ptp(points, axis=0)
    return max(x / float(tile.get("width")), y / gallery.HIGHEST)


def test_a_scene_that_is_added_is_in_the_gallery_and_moves_where_things_may(monkeypatch, tmp_path):
    own = tmp_path / "own.json"
    own.write_text(
        '{"about": "A bob that is mine.", "anchors": [[0, 0, 0]],'
        ' "particles": [{"position": [1, 0, 0]}], "rods": [{"pair": [0, -1]}]}'
    )
    monkeypatch.setitem(rods.SHIPPED, "own", own)
    assert "A bob that is mine." in gallery.text()
    picture = gallery.picture("own", gallery.scenes()["own"])
    moving = [x.get("values").split(";") for x in parsed(picture).iter("animate")]
    assert all(len({*frames}) > 50 for frames in moving)
    still = drawing.still(picture)
    assert "none }" not in still and "<animate" not in still
    ends = [x.get("d") for x in parsed(still).findall(".//path[@class='still']")]
    assert ends == [frames[-1] for frames in moving]


def test_what_is_fast_is_slowed_and_says_so():
    root = parsed(gallery.picture("spin", c.build_system("spin")))
    assert {x.get("dur") for x in root.iter("animate")} == {"6s"}
    assert {"0 to 1 s", "6 times slower"} <= {*words(root)}


def test_a_run_that_flies_off_makes_its_machine_no_smaller():
    _, runs, found = tiles("spin", 200)
    _, _, held = tiles("spin", 200, ["impulse", "project", "soft"])
    assert runs["baumgarte"].lost.partition(":")[0] in words(parsed(found["baumgarte"]))
    assert np.allclose(found["soft"].scale, held["soft"].scale, rtol=0.05)


def test_one_step_says_the_rods_error_after_it_with_its_sign():
    seen = words(parsed(pictures.one_step()))
    system = c.build_system("pendulum")
    q = np.array([[0.0, -1.12, 0.0]])
    v = np.array([[2.0, -1.0, 0.0]])
    for name, method in c.make_methods(0.2, baumgarte=2.0).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        end, _ = step(q, v, system["m"], method.make_force(system), 0.2)
        error = c.rod_lengths(system, end)[0] - 1.0
        sign = "+" if error > 0.0 else "\N{MINUS SIGN}"
        said = f"{sign}{length(abs(error))}" if abs(error) > 1e-9 else "right"
        assert f"{name} {said}" in seen


def test_an_arrow_is_drawn_of_each_method_that_moves_the_bob_after_its_step(monkeypatch):
    usual = c.make_methods
    own = {
        "moves": c.Method(c.make_force, "", lambda system, q_start, q, v, dt: (0.9 * q, v)),
        "slows": c.Method(c.make_force, "", lambda system, q_start, q, v, dt: (q, 0.9 * v)),
    }
    monkeypatch.setattr(c, "make_methods", lambda *args, **knobs: usual(*args, **knobs) | own)
    monkeypatch.setattr(pictures, "METHODS", dict.fromkeys(c.make_methods(), "m0"))
    text = pictures.one_step(tuple(c.make_methods()))
    moving = [name for name, method in usual().items() if method.post_step]
    arrows = drawn(parsed(text), "lambda")
    assert len(arrows) == len(moving) + 1 and "nan" not in text


def test_only_methods_that_stay_near_zero_are_named_there_and_a_curve_ends_where_its_run_is_lost():
    times = np.arange(0, 4001, pictures.EVERY) * 0.005
    ends = {"none": -0.3, "baumgarte": 0.3, "impulse": 0.019, "soft": -0.021, "project": -0.019}
    runs = {x: SimpleNamespace(energies=np.linspace(7, 7 + 2 * ends[x], 4001)) for x in ends}
    runs["none"].energies = runs["none"].energies[:2000]
    root = parsed(pictures.energies(times, runs, 2.0))
    assert {"impulse, project", "soft"} <= {*words(root)}
    ((lost,),) = drawn(root, "m0")
    ((whole,),) = drawn(root, "m1")
    assert np.ptp(lost[:, 0]) == pytest.approx(0.5 * np.ptp(whole[:, 0]), rel=0.02)


def test_curves_end_where_the_runs_end_and_names_keep_apart():
    x = np.linspace(0.0, 20.0, 5)
    curves = [(f"curve {k}", "m0", x, 0.1 * k * x) for k in range(5)]
    ticks = {0.0: "0", 1.0: "1", 2.0: "2"}
    root = parsed(drawing.chart(curves, pictures.TIMES, ticks, "up"))
    places = words(root)
    unit = places["1"][1] - places["2"][1]
    ends = np.array([line[-1, 1] for (line,) in drawn(root, "m0")])
    heights = (ends - ends[0]) / unit
    assert np.allclose(heights, [0.0, 2.0, 2.0, 2.0, 2.0], atol=0.01)  # cut off at the top
    names = [places[name][0] for name, *_ in curves]
    assert np.min(np.diff(names)) > 38 * 0.6 * len("curve 0")  # as large as on a phone
