"""The pictures: what they draw and say is what the chapter's runs do."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints.pictures import make_pictures
from curriculum.ch3_4_constraints.results import palette, table

SVG = "{http://www.w3.org/2000/svg}"
DT = 0.005  # s


def words(root):
    """{text: (x, y)} of a picture."""
    found = [(x.text, (float(x.get("x")), float(x.get("y")))) for x in root.iter(f"{SVG}text")]
    return dict(found)


def pieces(path):
    """The lines of a path, (lines, 2, 2), y up."""
    data = path.get("d").replace("M", " ").replace("L", " ").split()
    return np.array(data, float).reshape(-1, 2, 2) * [1, -1]


def drawn(root, colour, kind=None):
    """The paths of a colour: those of a class, if there is one."""
    style = f"stroke:var(--{colour});"
    paths = [x for x in root.iter(f"{SVG}path") if x.get("style").startswith(style)]
    return [x for x in paths if x.get("class") == kind]


def test_tiles_draw_the_last_state_of_each_method_and_its_worst_rod():
    root = ElementTree.fromstring(make_pictures.tiles("double", 1.0, 3.0, 10))
    system = c.build_system("double")
    for k, method in enumerate(c.make_methods(DT)):
        run = c.run_method(system, method, "semi_implicit", DT, 600)
        assert f"rods off by {table.length(run.violations.max())}" in words(root)
        rods, _ = drawn(root, f"m{k % len(palette.METHODS)}", "still")
        first, second = pieces(rods)
        d = np.array([run.q[-1][0], run.q[-1][1] - run.q[-1][0]])[:, :2]
        d = d / np.maximum(1.0, np.linalg.norm(d, axis=1))[:, None]  # too much of a rod is red
        shown = np.array([first[1] - first[0], second[1] - second[0]])
        scale = np.linalg.norm(shown) / np.linalg.norm(d)
        assert np.allclose(shown, scale * d, atol=1.5)


def test_red_is_what_a_rod_has_too_much():
    root = ElementTree.fromstring(make_pictures.tiles("double", 20.0, 20.0, methods=["none"]))
    run = c.run_method(c.build_system("double"), "none", "semi_implicit", DT, 4000)
    (much,) = drawn(root, "long")
    rods, _ = drawn(root, "m0")
    right = np.linalg.norm(np.diff(pieces(rods), axis=1), axis=-1)  # of 1 m each
    ratios = np.linalg.norm(np.diff(pieces(much), axis=1), axis=-1) / right
    errors = c.rod_lengths(c.build_system("double"), run.q[-1]) - 1.0
    assert np.allclose(ratios.ravel(), errors, atol=0.02)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 6, 8])
def test_however_many_methods_no_tile_covers_another_or_the_legend(count):
    methods = [*c.make_methods(DT), *c.make_methods(DT)][:count]
    root = ElementTree.fromstring(make_pictures.tiles("double", 0.5, 0.5, methods=methods))
    wide, tall = map(float, root.get("viewBox").split()[2:])
    places = [(float(x.get("x")), float(x.get("y"))) for x in root.iter(f"{SVG}text")]
    assert {*methods} <= {x.text for x in root.iter(f"{SVG}text")}
    assert len(set(places)) == len(places)
    for x, y in places:
        assert 0.0 < x < wide and 0.0 < y < tall


def test_peaucelliers_joint_has_its_dashed_line_and_a_red_gap_where_it_left_it():
    root = ElementTree.fromstring(make_pictures.tiles("peaucellier", 4.0, 4.0, upright=3))
    system = c.build_system("peaucellier")
    dashed = [x for x in drawn(root, "ink") if "dasharray" in x.get("style")]
    gaps = [x for x in drawn(root, "long") if "width:5" in x.get("style")]
    for line, gap, method in zip(dashed, gaps, c.make_methods(DT), strict=True):
        ((foot, top),) = pieces(line)
        ((joint, end),) = pieces(gap)
        run = c.run_method(system, method, "semi_implicit", DT, 800)
        assert foot[0] == top[0] == end[0] and joint[1] == end[1]
        off = run.q[-1, 3, 0] - system["q0"][3, 0]
        assert np.sign(round(off, 1)) == np.sign(round((joint[0] - end[0]) / 100.0, 1))
        assert (abs(joint[0] - end[0]) > 4.0) == (abs(off) > 0.05)


def test_one_step_says_the_rods_error_after_it_with_its_sign():
    seen = words(ElementTree.fromstring(make_pictures.one_step((0.0, -1.12), (2.0, -1.0))))
    system = c.build_system("pendulum")
    q = np.array([[0.0, -1.12, 0.0]])
    v = np.array([[2.0, -1.0, 0.0]])
    for name, method in c.make_methods(0.2, baumgarte=2.0).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        end, _ = step(q, v, system["m"], method.make_force(system), 0.2)
        error = c.rod_lengths(system, end)[0] - 1.0
        sign = "+" if error > 0.0 else "\N{MINUS SIGN}"
        said = f"{sign}{table.length(abs(error))}" if abs(error) > 1e-9 else "right"
        assert f"{name} {said}" in seen


def test_an_arrow_is_drawn_of_each_method_that_moves_the_bob_after_its_step(monkeypatch):
    usual = c.make_methods
    own = {
        "moves": c.Method(c.make_force, "", lambda system, q_start, q, v, dt: (0.9 * q, v)),
        "slows": c.Method(c.make_force, "", lambda system, q_start, q, v, dt: (q, 0.9 * v)),
    }
    monkeypatch.setattr(c, "make_methods", lambda *args: usual(*args) | own)
    monkeypatch.setattr(make_pictures, "METHODS", dict.fromkeys(c.make_methods(), "m0"))
    text = make_pictures.one_step((0.0, -1.12), (2.0, -1.0))
    moving = [name for name, method in usual().items() if method.post_step]
    arrows = drawn(ElementTree.fromstring(text), "lambda")
    assert len(arrows) == len(moving) + 1 and "nan" not in text


def test_curves_end_where_the_runs_end_and_names_keep_apart():
    x = np.linspace(0.0, 20.0, 5)
    curves = [(f"curve {k}", "m0", x, 0.1 * k * x) for k in range(5)]
    ticks = {0.0: "0", 1.0: "1", 2.0: "2"}
    root = ElementTree.fromstring(make_pictures.chart(curves, make_pictures.TIMES, ticks, "up"))
    places = words(root)
    unit = places["1"][1] - places["2"][1]
    ends = [np.array(re.findall(r"[\d.]+", x.get("d")), float)[-1] for x in drawn(root, "m0")]
    heights = (ends[0] - np.array(ends)) / unit
    assert np.allclose(heights, [0.0, 2.0, 2.0, 2.0, 2.0], atol=0.01)  # cut off at the top
    names = [places[name][0] for name, *_ in curves]
    assert np.min(np.diff(names)) > 38 * 0.6 * len("curve 0")  # as large as on a phone
