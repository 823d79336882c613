"""The pictures: what they draw and say is what the chapter's runs do."""

import re
import shlex
from itertools import pairwise
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints import rods
from curriculum.ch3_4_constraints.site import drawing, gallery, pictures
from curriculum.common.errors import Refused
from curriculum.common.words import length

SVG = "{http://www.w3.org/2000/svg}"
NUMBER = re.compile(r"-?[\d.]+")


def words(root):
    """{text: (x, y)} of a picture."""
    found = [(x.text, (float(x.get("x")), float(x.get("y")))) for x in root.iter(f"{SVG}text")]
    return dict(found)


def lines(path):
    """The lines of a path, a list of (points, 2), y up."""
    found = []
    for line in path.get("d").split("M")[1:]:
        points = np.array([float(x) for x in NUMBER.findall(line)]).reshape(-1, 2) * [1, -1]
        found.append(np.cumsum(points, axis=0) if "l" in line else points)
    return found


def drawn(root, colour, kind=None):
    """The paths of a colour: those of a class, if there is one."""
    style = f"stroke:var(--{colour});"
    paths = [x for x in root.iter(f"{SVG}path") if x.get("style").startswith(style)]
    return [x for x in paths if x.get("class") == kind]


def tiles(name, begin, end, every=10, methods=tuple(gallery.METHODS)):
    """The tiles of a scene, from `begin` to `end` s."""
    film = gallery.Film(begin, end, every)
    return ElementTree.fromstring(gallery.tiles(name, c.build_system(name), film, methods))


def test_tiles_draw_the_last_state_of_each_method_and_its_worst_rod():
    root = tiles("double", 1.0, 3.0)
    system = c.build_system("double")
    for method, colour in gallery.METHODS.items():
        run = c.run_method(system, method, "semi_implicit", 0.005, 600)
        assert any(length(run.violations.max()) in said for said in words(root))
        (path,) = drawn(root, colour, "still")
        (shown,) = lines(path)
        places = np.array([c.PIVOT, run.q[-1, 0], run.q[-1, 1]])[:, :2]
        apart = np.diff(places, axis=0)
        seen = np.diff(shown, axis=0)
        scale = np.linalg.norm(seen) / np.linalg.norm(apart)
        assert np.allclose(seen, scale * apart, atol=1.5)


def test_red_is_what_a_rod_has_too_much():
    root = tiles("double", 20.0, 20.0, methods=["none"])
    run = c.run_method(c.build_system("double"), "none", "semi_implicit", 0.005, 4000)
    (much,) = drawn(root, "long")
    (path,) = drawn(root, "m0")
    (shown,) = lines(path)
    whole = np.linalg.norm(np.diff(shown, axis=0), axis=1)
    red = [np.linalg.norm(np.ptp(piece, axis=0)) for piece in lines(much)]
    errors = c.rod_lengths(c.build_system("double"), run.q[-1]) - 1.0
    assert np.allclose(red / (whole - red), errors, atol=0.02)


@pytest.mark.parametrize("name", ["double", "cable"])
@pytest.mark.parametrize("count", [1, 2, 5, 6, 8])
def test_however_many_methods_no_tile_covers_another_or_the_legend(name, count):
    methods = [*gallery.METHODS, *gallery.METHODS][:count]
    root = tiles(name, 0.5, 0.5, methods=methods)
    wide, tall = map(float, root.get("viewBox").split()[2:])
    places = [(float(x.get("x")), float(x.get("y"))) for x in root.iter(f"{SVG}text")]
    assert {*methods} <= {x.text for x in root.iter(f"{SVG}text")}
    assert len(set(places)) == len(places)
    for x, y in places:
        assert 0.0 < x < wide and 0.0 < y < tall


def test_peaucelliers_joint_has_its_dashed_line_and_a_red_gap_where_it_left_it():
    root = tiles("peaucellier", 4.0, 4.0)
    system = c.build_system("peaucellier")
    dashed = [x for x in drawn(root, "ink") if "dasharray" in x.get("style")]
    gaps = [x for x in drawn(root, "long") if "width:5" in x.get("style")]
    for line, gap, method in zip(dashed, gaps, gallery.METHODS, strict=True):
        (((foot, _), (top, _)),) = lines(line)
        ((joint, end),) = lines(gap)
        run = c.run_method(system, method, "semi_implicit", 0.005, 800)
        assert foot == top == end[0] and joint[1] == end[1]
        off = run.q[-1, 3, 0] - system["q0"][3, 0]
        assert np.sign(round(off, 1)) == np.sign(round((joint[0] - end[0]) / 100.0, 1))
        assert (abs(joint[0] - end[0]) > 4.0) == (abs(off) > 0.05)


def test_lines_of_nodes_go_along_each_rod_once():
    every = [system["pairs"] for system in gallery.scenes().values()]
    every.append([*every[-1], (5, 0), (3, 1), (7, -2), (6, 4)])
    for pairs in every:
        found = [{*ends} for line in gallery.trails(pairs) for ends in pairwise(line)]
        assert sorted(map(sorted, found)) == sorted(map(sorted, pairs))


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
        root = ElementTree.fromstring(path.read_text(encoding="utf-8"))
        wide = float(root.get("viewBox").split()[2])
        most = max(fills(root, colour, wide) for colour in gallery.METHODS.values())
        assert most > 0.7, name


def fills(root, colour, wide):
    """How much of a third of the width, or of the height for what moves, a method fills."""
    moved = [*drawn(root, colour, "moves"), *drawn(root, colour)]
    points = []
    for path in moved:
        points += lines(path)
        for animation in path:
            frames = animation.get("values").split(";")
            points += [x for frame in frames for x in lines({"d": frame})]
    x, y = np.ptp(np.concatenate(points), axis=0)
    return max(3.0 * x / wide, y / gallery.HIGHEST)


def test_a_scene_that_is_added_is_in_the_gallery(monkeypatch, tmp_path):
    own = tmp_path / "own.json"
    own.write_text(
        '{"about": "A bob that is mine.", "anchors": [[0, 0, 0]],'
        ' "particles": [{"position": [1, 0, 0]}], "rods": [{"pair": [0, -1]}]}'
    )
    monkeypatch.setitem(rods.SHIPPED, "own", own)
    assert "A bob that is mine." in gallery.text()
    assert "own" in gallery.scenes()
    picture = gallery.picture("own", c.build_system("own"))
    assert "<animate" in picture and "<animate" not in drawing.still(picture)


def test_what_stands_still_is_drawn_once_and_what_is_fast_is_slowed():
    upright = c.build_system("upright")
    assert "<animate" not in gallery.picture("upright", upright)
    system = c.build_system("spin")
    spin = gallery.film("spin", system)
    assert spin.end * spin.slower == pytest.approx(gallery.SECONDS)
    fastest = np.max(np.linalg.norm(np.diff(system["v0"], axis=0, prepend=0.0), axis=1))
    turned = spin.end * fastest / np.min(system["lengths"])  # rad
    assert turned == pytest.approx(gallery.TURNS, rel=0.2)


def test_a_run_that_flies_off_makes_its_machine_no_smaller_and_leaves_no_tile():
    root = tiles("spin", 0.0, 1.0, every=2)
    held = tiles("spin", 0.0, 1.0, every=2, methods=["impulse", "project", "soft"])
    sizes = [np.ptp(lines(drawn(x, "m2", "still")[0])[0], axis=0) for x in (root, held)]
    assert np.allclose(*sizes, rtol=0.05)
    boxes = {f"url(#{x.get('id')})" for x in root.iter(f"{SVG}clipPath")}
    (lost,) = drawn(root, "m1", "moves")
    assert lost.get("style").partition("clip-path:")[2] in boxes


def test_one_step_says_the_rods_error_after_it_with_its_sign():
    seen = words(ElementTree.fromstring(pictures.one_step((0.0, -1.12), (2.0, -1.0))))
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
    monkeypatch.setattr(c, "make_methods", lambda *args: usual(*args) | own)
    monkeypatch.setattr(pictures, "METHODS", dict.fromkeys(c.make_methods(), "m0"))
    text = pictures.one_step((0.0, -1.12), (2.0, -1.0), tuple(c.make_methods()))
    moving = [name for name, method in usual().items() if method.post_step]
    arrows = drawn(ElementTree.fromstring(text), "lambda")
    assert len(arrows) == len(moving) + 1 and "nan" not in text


def test_only_methods_that_stay_near_zero_are_named_there_and_a_curve_ends_where_its_run_is_lost():
    times = np.arange(0, 4001, pictures.EVERY) * 0.005
    ends = {"none": -0.3, "baumgarte": 0.3, "impulse": 0.019, "soft": -0.021, "project": -0.019}
    runs = {x: SimpleNamespace(energies=np.linspace(7, 7 + 2 * ends[x], 4001)) for x in ends}
    runs["none"].energies = runs["none"].energies[:2000]
    root = ElementTree.fromstring(pictures.energies(times, runs, 2.0))
    assert {"impulse, project", "soft"} <= {*words(root)}
    (path,) = drawn(root, "m0")
    (lost,) = lines(path)
    (whole,) = lines(drawn(root, "m1")[0])
    assert np.ptp(lost[:, 0]) == pytest.approx(0.5 * np.ptp(whole[:, 0]), rel=0.02)


def test_curves_end_where_the_runs_end_and_names_keep_apart():
    x = np.linspace(0.0, 20.0, 5)
    curves = [(f"curve {k}", "m0", x, 0.1 * k * x) for k in range(5)]
    ticks = {0.0: "0", 1.0: "1", 2.0: "2"}
    root = ElementTree.fromstring(drawing.chart(curves, pictures.TIMES, ticks, "up"))
    places = words(root)
    unit = places["1"][1] - places["2"][1]
    ends = [np.array(NUMBER.findall(x.get("d")), float)[-1] for x in drawn(root, "m0")]
    heights = (ends[0] - np.array(ends)) / unit
    assert np.allclose(heights, [0.0, 2.0, 2.0, 2.0, 2.0], atol=0.01)  # cut off at the top
    names = [places[name][0] for name, *_ in curves]
    assert np.min(np.diff(names)) > 38 * 0.6 * len("curve 0")  # as large as on a phone
