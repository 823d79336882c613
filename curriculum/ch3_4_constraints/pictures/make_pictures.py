"""Make the pictures, but those drawn by hand and those of a study:
python -m curriculum.ch3_4_constraints.pictures.make_pictures"""

from functools import partial
from html import escape
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.mechanics.systems import rod_parts
from curriculum.ch3_4_constraints.pages import page
from curriculum.ch3_4_constraints.results.table import length

FOLDER = Path(__file__).parent
DT = 0.005  # s
TIMES = {0.0: "0 s", 5.0: "5 s", 10.0: "10 s", 15.0: "15 s", 20.0: "20 s"}
METHODS = {name: f"m{k}" for k, name in enumerate(c.make_methods(DT))}  # and their colours
run = partial(c.run_method, integrator="semi_implicit", dt=DT, steps=4000)
STYLE = f"""<style>{page.palette_css()}path {{ fill: none; stroke-linejoin: round }}
text {{ font: 30px system-ui, sans-serif }}</style>"""


class Sheet:
    """A drawing of the box from `low` to `high`, `width` by `height` units, two to a pixel."""

    def __init__(self, width, height, low, high):
        self.size, self.low = (width, height), low
        self.scale = np.divide(self.size, np.subtract(high, low))
        self.parts = [STYLE, '<rect width="100%" height="100%" rx="12" fill="var(--paper)"/>']

    def at(self, point):
        x, y = (np.array(point)[:2] - self.low) * self.scale
        return f"{x:.0f} {self.size[1] - y:.0f}"

    def line(self, points, colour, width=6, dash=""):
        style = f"stroke-dasharray:{dash}" if dash else "stroke-linecap:round"
        self.path(["M" + "L".join(map(self.at, points))], colour, width, style)

    def path(self, frames, colour, width, more="", dt=0.0):
        style = f"stroke:var(--{colour});stroke-width:{width};{more}".rstrip(";")
        move = f'attributeName="d" values="{";".join(frames)}" dur="{len(frames) * dt:g}s"'
        move = f'<animate {move} repeatCount="indefinite"/>' if len(frames) > 1 else ""
        self.parts.append(f'<path d="{frames[0]}" style="{style}">{move}</path>')

    def words(self, point, words, colour="ink", anchor="middle", up=0):
        x, y = self.at(point).split()
        place = f'x="{x}" y="{int(y) - up}" text-anchor="{anchor}"'
        self.parts.append(f'<text {place} style="fill:var(--{colour})">{escape(words)}</text>')

    def write(self, name):
        box = 'viewBox="0 0 {} {}" width="{}"'.format(*self.size, self.size[0] // 2)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>'
        text = "\n".join([head, *self.parts, "</svg>\n"])
        (FOLDER / f"{name}.svg").write_text(text, encoding="utf-8")


def axes(height, x_ticks, y_ticks, upright=False):
    """A sheet with axes over ticks {place: words}; `upright`: lines rise from those below, too."""
    (left, *_, right), (bottom, *_, top) = x_ticks, y_ticks
    wide, high = right - left, top - bottom
    low, end = (left - 0.16 * wide, bottom - 0.14 * high), (right + 0.07 * wide, top + 0.2 * high)
    sheet = Sheet(1200, height, low, end)
    for y, words in y_ticks.items():
        sheet.line([(left, y), (right, y)], "reference", 1)
        sheet.words((left - 0.01 * wide, y), words, "reference", "end", -10)
    for x, words in x_ticks.items():
        if upright:
            sheet.line([(x, bottom), (x, top)], "reference", 1)
        sheet.words((x, bottom), words, "reference", up=-40)
    return sheet


def chart(name, curves, x_ticks, y_ticks, y_name):
    """Curves (name, colour, x, y) over axes."""
    (left, *_, right), (bottom, *_, top) = x_ticks, y_ticks
    sheet = axes(600, x_ticks, y_ticks)
    sheet.words((left, top), y_name, "reference", "start", 64)
    for k, (words, colour, x, y) in enumerate(curves):
        sheet.line(zip(x, np.clip(y, bottom, top), strict=True), colour)
        place = left + (k + 0.5) / len(curves) * (right - left)
        sheet.words((place, top), words, colour, up=18)
    sheet.write(name)


def tiles(name, scene, begin, end, every=1):
    """The methods side by side, moving from `begin` to `end` in s, a frame every so many steps."""
    system, frames = c.build_system(scene), np.arange(begin / DT, end / DT + 1, every, dtype=int)
    runs = {method: run(system, method, steps=frames[-1]) for method in METHODS}
    seen = np.vstack([*system["anchors"], *(q for x in runs.values() for q in x.q[frames])])
    low, high = seen.min(axis=0) - 0.2, seen.max(axis=0) + 0.2
    wide, tall, _ = high - low + [0.0, 0.14 * (high - low)[0], 0.0]  # with a line of words
    corner = low[:2] - [0.0, tall]
    sheet = Sheet(1500, round(1000 * tall / wide), corner, corner + [3.0 * wide, 2.0 * tall])
    for k, (method, found) in enumerate(runs.items()):
        shift, colour = np.array([k % 3 * wide, -(k // 3) * tall, 0.0]), METHODS[method]
        right, much, missing = (part + shift for part in rod_parts(system, found.q[frames]))
        for parts, *style in (
            (right, colour, 7, ""),
            (missing[:, :, [0, 0]], colour, 20, "stroke-linecap:round"),  # particles
            (much, "long", 12, ""),
            (missing, "short", 7, "stroke-dasharray:6"),
        ):
            data = ["".join(f"M{sheet.at(a)}L{sheet.at(b)}" for a, b in part) for part in parts]
            sheet.path(data, *style, every * DT)
        for anchor in system["anchors"] + shift:
            sheet.line([anchor, anchor], "reference", 14)
        words = f"{method}: worst rod {length(found.violations.max())}"
        sheet.words(low + shift + [0.5 * wide, tall, 0.0], words, colour, up=-50)
    place = low + [2.5 * wide, 0.0, 0.0]
    sheet.words(place, f"{scene}, {'to' if begin < end else 'at'} {end:g} s", up=-50)
    sheet.words(place, "red: too much", "long", up=-90)
    sheet.words(place, "blue: missing", "short", up=-130)
    sheet.write(name)


def main():
    """Make them all: those that are curves, then those that move."""
    double, times = c.build_system("double"), np.arange(0, 4001, 32) * DT
    runs = {method: run(double, method) for method in METHODS}
    worst = {x: np.maximum(runs[x].violations[::32], 1e-13) for x in ("none", "baumgarte")}
    curves = [(x, METHODS[x], times, np.log10(errors)) for x, errors in worst.items()]
    ticks = {k: length(10.0**k) for k in range(-4, 1)}
    chart("two_methods", curves, TIMES, ticks, "worst rod error")
    gained = {x: (found.energies - found.energies[0])[::32] for x, found in runs.items()}
    curves = [(x, METHODS[x], times, gain / (2 * 9.81 * 2)) for x, gain in gained.items()]
    ticks = {x / 100: f"{x} %" for x in (-50, -25, 0, 25, 50)}
    chart("energy", curves, TIMES, ticks, "energy gained, of m g L")
    curves, hung = [], c.build_system("pendulum") | {"q0": np.array([[0.0, -1.001, 0.0]])}
    for z, colour in ((0.1, "m1"), (0.8, "m2"), (0.85, "long")):
        found = run(hung, "baumgarte", steps=40, baumgarte=z / DT)
        curves.append((f"dt w = {z}", colour, np.arange(41), -1.0 - found.tip[:, 1]))
    ticks = {x / 1000: f"{x} mm" for x in (-4, -2, 0, 2, 4)}
    chart("cliff", curves, {0: "0", 20: "20 steps", 40: "40 steps"}, ticks, "rod error")
    curves, tip = [], run(double, "project").tip
    for digits, colour in ((3, "m0"), (6, "m1"), (9, "m2")):
        thrown = double | {"v0": np.array([[0.0, 0.0, 0.0], [0.0, 10.0**-digits, 0.0]])}
        apart = np.linalg.norm(run(thrown, "project").tip - tip, axis=1)[32::32]
        curves.append((f"1e-{digits} m/s apart", colour, times[1:], np.log10(apart)))
    ticks = {k: length(10.0**k) for k in (-12, -9, -6, -3, 0)} | {1: ""}
    chart("chaos", curves, TIMES, ticks, "distance between the tips")
    tiles("tiles", "double", 20.0, 20.0)
    tiles("flat_pose", "peaucellier", 4.0, 4.0)
    tiles("double", "double", 12.0, 20.0, 10)
    tiles("triple", "triple", 12.0, 20.0, 10)
    tiles("peaucellier", "peaucellier", 0.0, 6.0, 20)
    tiles("jansen_leg", "jansen_leg", 0.0, 5.0, 20)
    tiles("windows", "windows", 0.0, 6.0, 40)


if __name__ == "__main__":
    main()
