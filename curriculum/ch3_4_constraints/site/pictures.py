"""Draws the pictures of the chapter, except those drawn by hand."""

from functools import partial
from itertools import cycle
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.ch3_4_constraints.site import gallery
from curriculum.ch3_4_constraints.site.drawing import Sheet, chart
from curriculum.ch3_4_constraints.site.gallery import DT, METHODS
from curriculum.common import exact
from curriculum.common.words import length

FOLDER = Path(__file__).parents[1] / "pictures"
TIMES = {0.0: "0 s", 5.0: "5 s", 10.0: "10 s", 15.0: "15 s", 20.0: "20 s"}
MINUS = "\N{MINUS SIGN}"
EVERY = 32  # steps between two points of a curve
run = partial(c.run_method, integrator="semi_implicit", dt=DT, steps=4000)
SYMBOLS = """<style>:root { --v: #0a7d46; --lambda: #b35200; }
@media screen and (prefers-color-scheme: dark) {
:root { --v: #1eb765; --lambda: #ed7705; } }</style>"""


def circle(sheet, begin=0.0, end=2.0 * np.pi):
    """Where a bob on a rod of 1 m may be, from one angle in rad to another: dotted."""
    angles = np.linspace(begin, end, 60)
    sheet.line(np.transpose([np.cos(angles), np.sin(angles)]), "reference", 3, "2 10")


def one_step(methods=tuple(METHODS)):
    """What some methods make of a bob that is off its circle, and thrown, in one long step."""
    dt = 0.2  # s
    d = np.array([[0.0, -1.12, 0.0]])
    v = np.array([[2.0, -1.0, 0.0]])
    system = c.build_system("pendulum")
    held = c.make_methods(dt, baumgarte=2.0)
    ends = {}
    for name in methods:
        step = c.stabilized(c.semi_implicit_step, system, held[name])
        q, _ = step(d, v, system["m"], held[name].make_force(system), dt)
        ends[name] = q[0]
    sheet = Sheet(1200, 850, (-0.6, -1.6), (1.8, 0.1))
    sheet.parts.append(SYMBOLS)
    circle(sheet, -np.pi, 0.0)
    sheet.line([(0, 0), d[0]], "reference", 6)
    sheet.arrow(d[0], d[0] + dt * v[0], "v")
    below = np.inf
    for name, end in sorted(ends.items(), key=lambda each: -each[1][1]):  # from the top
        below = min(below - 0.095, end[1])
        sheet.dot(end, METHODS[name], 22)
        sheet.line([end, (0.85, below)], METHODS[name], 2)
        words = f"{name} {in_words(np.linalg.norm(end) - 1.0)}"
        sheet.words((0.87, below), words, METHODS[name], "start", -10)
    for name, end in ends.items():
        if held[name].post_step:  # from where the step ended without it
            sheet.arrow(ends[methods[0]], end, "lambda")
    sheet.dot((0, 0), "reference", 16)
    sheet.dot(d[0], "ink", 26)
    return sheet.text()


def in_words(error):
    """By how much a rod is too long, in m, with its sign."""
    if abs(error) < 1e-9:
        return "right"
    return ("+" if error > 0.0 else MINUS) + length(abs(error))


def two_methods(times, runs):
    """How rods drift under none, and do not under baumgarte; runs {method: Run}."""
    curves = []
    for name in "none", "baumgarte":
        errors = np.maximum(runs[name].violations[::EVERY], 1e-13)
        curves.append((name, METHODS[name], times, np.log10(errors)))
    ticks = {k: length(10.0**k) for k in range(-4, 1)}
    return chart(curves, TIMES, ticks, "worst rod error")


def energies(times, runs, scale):
    """How much energy each method gains, in parts of a `scale` in J."""
    curves = []
    at_zero = []
    for name, found in runs.items():
        gain = (found.energies - found.energies[0])[::EVERY] / scale
        curves.append((name, METHODS[name], times[: len(gain)], gain))  # a run may be lost
        if np.max(np.abs(gain)) < 0.02:
            at_zero.append(name)
    ticks = {x / 100: f"{x} %" for x in (-50, -25, 0, 25, 50)}
    return chart(curves, TIMES, ticks, "energy gained, of m g L", ", ".join(at_zero))


def cliff():
    """What becomes of a rod that is too long, at three values of dt w."""
    hung = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.001, 0.0]])}
    curves = []
    for z, colour in ((0.1, "m1"), (0.8, "m2"), (0.85, "long")):
        found = run(hung, "baumgarte", steps=40, baumgarte=z / DT)
        curves.append((f"dt w = {z}", colour, np.arange(41), -1.0 - found.tip[:, 1]))
    ticks = {x / 1000: f"{x} mm" for x in (-4, -2, 0, 2, 4)}
    return chart(curves, {0: "0", 20: "20 steps", 40: "40 steps"}, ticks, "rod error")


DASHES = "9 9", "28 10", ""  # of integrators
NAMED = (-1.0, 0.0), (1.0, 1.0), (-1.0, 1.0)  # the way in which their names stand


def spring():
    """Velocity over place of 1 kg on a spring of 1 N/m, under each integrator, in long steps."""
    sheet = Sheet(1000, 900, (-2.6, -2.3), (2.4, 2.2))
    circle(sheet)
    styles = cycle(zip(DASHES, NAMED, strict=True))
    for (name, integrator), (dash, way) in zip(c.INTEGRATORS.items(), styles, strict=False):
        q, v = np.array([[1.0]]), np.array([[0.0]])
        states = [(1.0, 0.0)]
        for _ in range(32):
            q, v = integrator(q, v, np.ones((1, 1)), lambda q, v: -q, 0.4)
            states.append((q.item(), v.item()))
            if np.linalg.norm(states[-1]) > 2.0:
                break
        sheet.line(states, "ink", 4, dash)
        place = max(states, key=partial(np.dot, way))
        sheet.words(place, name, "ink", "start" if way[0] > 0.0 else "end", 20)
    sheet.words((0.0, -2.2), "to the right: place; up: velocity", "reference")
    return sheet.text()


def pump():
    """A pendulum under baumgarte: its path, with its rod's error twenty times as large."""
    found = run(c.build_system("pendulum"), "baumgarte", steps=500)
    d = found.q[:, 0, :2]
    size = np.linalg.norm(d, axis=1)[:, None]
    seen = d / size * (1.0 + 20.0 * (size - 1.0))
    sheet = Sheet(1000, 600, (-1.4, -1.35), (1.4, 0.33))
    circle(sheet, np.pi)
    sheet.line(seen[::4], METHODS["baumgarte"], 5)
    sheet.dot((0, 0), "reference", 16)
    sheet.words((0.0, -0.6), "short while it is fast", "ink")
    sheet.words((0.0, 0.2), "longer where it turns", "ink")
    return sheet.text()


def chaos(times, double, tip):
    """How starts part that are turned ever less; tip (steps + 1, 3) of the one that is not."""
    curves = []
    for digits, colour in ((3, "m0"), (6, "m1"), (9, "m2")):
        cos, sin = exact.cos(10.0**-digits), exact.sin(10.0**-digits)
        turned = double["q0"] @ [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]
        apart = np.linalg.norm(run(double | {"q0": turned}, "baumgarte").tip - tip, axis=1)
        curves.append((f"1e-{digits} rad apart", colour, times[1:], np.log10(apart[EVERY::EVERY])))
    ticks = {k: length(10.0**k) for k in (-12, -9, -6, -3, 0)} | {1: ""}
    return chart(curves, TIMES, ticks, "distance between the tips")


def flat_pose():
    """Peaucellier's linkage under each method beyond its flat pose, and where it should be."""
    system = c.build_system("peaucellier")
    steps = np.array([800])  # 4 s
    runs = {method: run(system, method, steps=800) for method in METHODS}
    tiles = gallery.tiles(system, runs, steps, steps)
    right = system["q0"][-1, 0]  # m: x of its last joint, which should stay so
    for method, tile in tiles.items():
        x, y, _ = runs[method].tip[-1]
        tile.line([(right, -3.0), (right, 2.4)], "ink", 3, "4 12")
        tile.line([(x, y), (right, y)], "long", 5)
    return gallery.board(tiles, ["peaucellier", "at 4 s"])


def drawn():
    """Yield (name, text) of each: those of the chapter, then those of the gallery."""
    double = c.build_system("double")
    times = np.arange(0, 4001, EVERY) * DT
    runs = {method: run(double, method) for method in METHODS}
    yield "two_methods", two_methods(times, runs)
    yield "energy", energies(times, runs, energy_scale(double, c.GRAVITY))
    yield "spring", spring()
    yield "pump", pump()
    yield "cliff", cliff()
    for method in "baumgarte", "impulse", "project":
        yield f"step_{method}", one_step(("none", method))
    yield "chaos", chaos(times, double, runs["baumgarte"].tip)
    yield "one_step", one_step()
    yield "flat_pose", flat_pose()
    yield from gallery.drawn()
