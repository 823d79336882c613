"""Draws all pictures except those drawn by hand or by a study."""

import re
from functools import partial
from html import escape
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.mechanics.systems import m_g_L, rod_parts
from curriculum.ch3_4_constraints.pages import page
from curriculum.ch3_4_constraints.results import palette
from curriculum.ch3_4_constraints.results.table import length

FOLDER = Path(__file__).parent
DT = 0.005  # s
TIMES = {0.0: "0 s", 5.0: "5 s", 10.0: "10 s", 15.0: "15 s", 20.0: "20 s"}
MINUS = "\N{MINUS SIGN}"
EVERY = 32  # steps between two points of a curve
COLUMNS = 3  # of tiles
METHODS = {name: f"m{k}" for name, k in palette.places(c.make_methods(DT)).items()}  # and colours
run = partial(c.run_method, integrator="semi_implicit", dt=DT, steps=4000)
STYLE = f"""<style>{page.palette_css()}path {{ fill: none; stroke-linejoin: round }}
text {{ font: 30px system-ui, sans-serif }}</style>"""
MOVING = """<style>.still { display: none }
@media (prefers-reduced-motion: reduce), print {
.still { display: inline } .moves { display: none } }</style>"""
SYMBOLS = """<style>:root { --v: #0a7d46; --lambda: #b35200; }
@media screen and (prefers-color-scheme: dark) {
:root { --v: #1eb765; --lambda: #ed7705; } }</style>"""
MOVES = re.compile('<path class="moves".*?</path>\n')


def larger(width):
    """A style for a sheet so many units wide: on a phone, its words have 11 px or more."""
    return (
        f"<style>@media (max-width: 500px) {{ text {{ font-size: {width / 31:.0f}px }} }}</style>"
    )


def still(picture):
    """A picture, as text, that moves no more: it is as its motion ends."""
    return MOVES.sub("", picture.replace(MOVING, "")).replace(' class="still"', "")


class Sheet:
    """A drawing of the box from `low` to `high`, `width` by `height` units, two to a pixel."""

    def __init__(self, width, height, low, high):
        self.size = (width, height)
        self.low = low
        self.scale = np.divide(self.size, np.subtract(high, low))
        self.parts = [
            STYLE,
            larger(width),
            '<rect width="100%" height="100%" rx="12" fill="var(--paper)"/>',
        ]

    def at(self, point):
        x, y = (np.array(point)[:2] - self.low) * self.scale
        return f"{x:.0f} {self.size[1] - y:.0f}"

    def strokes(self, lines):
        return "".join(f"M{self.at(a)}L{self.at(b)}" for a, b in lines)

    def line(self, points, colour, width=6, dash=""):
        style = f"stroke-dasharray:{dash}" if dash else "stroke-linecap:round"
        self.path(["M" + "L".join(map(self.at, points))], colour, width, style)

    def arrow(self, start, end, colour):
        along = np.subtract(end, start)[:2]
        size = np.linalg.norm(along * self.scale)
        if size < 1.0:  # it cannot be seen, and has no direction
            return
        back = -min(22.0, size) / size * along
        aside = 0.5 * np.array([-back[1], back[0]])
        left = end[:2] + back + aside
        right = end[:2] + back - aside
        self.line([start, end, left, end, right], colour)

    def path(self, frames, colour, width, more="", dt=0.0):
        style = f"stroke:var(--{colour});stroke-width:{width};{more}".rstrip(";")
        if len(frames) == 1:
            self.parts.append(f'<path d="{frames[0]}" style="{style}"></path>')
            return
        if MOVING not in self.parts:
            self.parts.insert(0, MOVING)
        move = f'attributeName="d" values="{";".join(frames)}" dur="{len(frames) * dt:g}s"'
        move = f'<animate {move} repeatCount="indefinite"/>'
        self.parts.append(f'<path class="still" d="{frames[-1]}" style="{style}"></path>')
        self.parts.append(f'<path class="moves" d="{frames[0]}" style="{style}">{move}</path>')

    def words(self, point, words, colour="ink", anchor="middle", up=0, style=""):
        x, y = self.at(point).split()
        place = f'x="{x}" y="{int(y) - up}" text-anchor="{anchor}"'
        style = f"{style}fill:var(--{colour})"
        self.parts.append(f'<text {place} style="{style}">{escape(words)}</text>')

    def text(self, width=None):
        """The drawing as SVG, by default half as many pixels wide as it has units."""
        width = width or self.size[0] // 2
        box = 'viewBox="0 0 {} {}" width="{}"'.format(*self.size, width)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>'
        return "\n".join([head, *self.parts, "</svg>\n"])


def axes(height, x_ticks, y_ticks, upright=False):
    """A sheet with axes over ticks {place: words}; `upright`: lines rise from those below, too."""
    left, *_, right = x_ticks
    bottom, *_, top = y_ticks
    wide = right - left
    high = top - bottom
    low = (left - 0.16 * wide, bottom - 0.14 * high)
    end = (right + 0.07 * wide, top + 0.24 * high)
    sheet = Sheet(1200, height, low, end)
    for y, words in y_ticks.items():
        sheet.line([(left, y), (right, y)], "reference", 1)
        sheet.words((left - 0.01 * wide, y), words, "reference", "end", -10)
    for x, words in x_ticks.items():
        if upright:
            sheet.line([(x, bottom), (x, top)], "reference", 1)
        sheet.words((x, bottom), words, "reference", up=-40)
    return sheet


def chart(curves, x_ticks, y_ticks, y_name, covered=""):
    """Curves (name, colour, x, y) over axes; `covered` names those at 0 that cover each other."""
    left, *_, right = x_ticks
    bottom, *_, top = y_ticks
    sheet = axes(600, x_ticks, y_ticks)
    sheet.words((left, top), y_name, "reference", "start", 64)
    lengths = [len(words) + 2 for words, *_ in curves]
    for k, (words, colour, x, y) in enumerate(curves):
        sheet.line(zip(x, np.clip(y, bottom, top), strict=True), colour)
        share = (sum(lengths[:k]) + 0.5 * lengths[k]) / sum(lengths)  # long names have more room
        sheet.words((left + share * (right - left), top), words, colour, up=18)
    if covered:
        sheet.words((right, 0.0), covered, "ink", "end", 14)
    return sheet.text()


class Tiles:
    """So many tiles side by side on a sheet, each large enough for all points `seen` (..., 3)."""

    def __init__(self, seen, count):
        self.low = seen.min(axis=0) - 0.2
        self.high = seen.max(axis=0) + 0.2
        wide, tall, _ = self.high - self.low
        self.wide = wide
        self.tall = tall + 0.24 * wide  # with two lines of words
        rows = -(-count // COLUMNS)
        corner = self.low[:2] - [0.0, (rows - 1) * self.tall]
        end = corner + [COLUMNS * self.wide, rows * self.tall]
        self.sheet = Sheet(1500, round(500 * rows * self.tall / self.wide), corner, end)

    def shift(self, k):
        """How far tile k is from the first."""
        return np.array([k % COLUMNS * self.wide, -(k // COLUMNS) * self.tall, 0.0])

    def words(self, k, lines):
        """Lines of words and their colours, from the top of tile k on."""
        top = self.low + self.shift(k) + [0.5 * self.wide, self.tall, 0.0]
        for row, (words, colour) in enumerate(lines):
            self.sheet.words(top, words, colour, up=-50 * (row + 1))

    def gaps(self, k, places, line, dt):
        """A dashed line upright at x = `line`, and how far from it a particle is at its places."""
        shift = self.shift(k)
        ends = [(line + shift[0], y + shift[1]) for y in (self.low[1], self.high[1])]
        self.sheet.line(ends, "ink", 3, "4 12")
        gaps = []
        for place in places:
            beside = [line, place[1], 0.0]
            gaps.append(self.sheet.strokes([(place + shift, beside + shift)]))
        self.sheet.path(gaps, "long", 5, dt=dt)

    def rods(self, k, system, q, colour, dt):
        """The rods of a system in all states q (steps, N, 3), its particles and its anchors."""
        shift = self.shift(k)
        right, much, missing = rod_parts(system, q)
        for parts, *style in (
            (right, colour, 7, ""),
            (missing[:, :, [0, 0]], colour, 20, "stroke-linecap:round"),  # particles
            (much, "long", 12, ""),
            (missing, "short", 7, "stroke-dasharray:6"),
        ):
            data = [self.sheet.strokes(part + shift) for part in parts]
            self.sheet.path(data, *style, dt)
        for anchor in system["anchors"] + shift:
            self.sheet.line([anchor, anchor], "reference", 14)


def tiles(scene, begin, end, every=1, upright=None, methods=tuple(METHODS)):
    """The methods side by side, moving from `begin` to `end` in s, a frame every so many steps.

    `upright`: a particle that should keep its x, if there is one. A dashed line says where.
    """
    system = c.build_system(scene)
    frames = np.arange(begin / DT, end / DT + 1, every, dtype=int)
    runs = [run(system, method, steps=frames[-1]) for method in methods]
    places = [found.q[frames[frames < len(found.q)]].reshape(-1, 3) for found in runs]
    board = Tiles(np.vstack([system["anchors"], *places]), len(runs) + 1)
    for k, (method, found) in enumerate(zip(methods, runs, strict=True)):
        q = found.q[np.minimum(frames, len(found.q) - 1)]  # a run that is lost stays where it was
        if upright is not None:
            board.gaps(k, q[:, upright], system["q0"][upright, 0], every * DT)
        board.rods(k, system, q, METHODS[method], every * DT)
        off = f"rods off by {length(found.violations.max())}"
        board.words(k, [(method, METHODS[method]), (off, METHODS[method])])
    when = "to" if begin < end else "at"
    legend = [
        (f"{scene}, {when} {end:g} s", "ink"),
        ("red: too long", "long"),
        ("blue: too short", "short"),
    ]
    board.words(len(runs), legend)  # the last tile says what is seen
    return board.sheet.text()


def one_step(d, v, dt=0.2, baumgarte=2.0):
    """What each method makes of a bob at d (2,) in m with v (2,) in m/s, in one long step."""
    system = c.build_system("pendulum")
    system["q0"] = np.array([[*d, 0.0]])
    system["v0"] = np.array([[*v, 0.0]])
    sheet = Sheet(1200, 850, (-0.6, -1.6), (1.8, 0.1))
    sheet.parts.append(SYMBOLS)
    round_ = [(np.cos(x), np.sin(x)) for x in np.linspace(-np.pi, 0.0, 60)]
    sheet.line(round_, "reference", 3, "2 10")
    sheet.line([(0, 0), d], "reference", 6)
    sheet.arrow(d, np.add(d, dt * np.array(v)), "v")
    ends = {}
    for name, method in c.make_methods(dt, baumgarte).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        q, _ = step(system["q0"], system["v0"], system["m"], method.make_force(system), dt)
        ends[name] = q
    names = sorted(ends, key=lambda name: -ends[name][0, 1])  # from the top
    below = np.inf
    for name in names:
        x, y, _ = ends[name][0]
        below = min(below - 0.095, y)
        error = c.rod_lengths(system, ends[name])[0] - 1.0
        words = "right"
        if abs(error) > 1e-9:
            sign = "+" if error > 0.0 else MINUS
            words = sign + length(abs(error))
        sheet.line([(x, y), (x, y)], METHODS[name], 22)
        sheet.line([(x, y), (0.85, below)], METHODS[name], 2)
        sheet.words((0.87, below), f"{name} {words}", METHODS[name], "start", -10)
    plain = ends[next(iter(ends))][0]
    for name, method in c.make_methods(dt).items():
        if method.post_step:  # from where the step ended without it
            sheet.arrow(plain, ends[name][0], "lambda")
    sheet.line([(0, 0), (0, 0)], "reference", 16)
    sheet.line([d, d], "ink", 26)
    return sheet.text()


def two_methods(times, runs):
    """How rods drift under none, and do not under baumgarte; runs {method: Outcome}."""
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
        curves.append((name, METHODS[name], times, gain))
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


def chaos(times, double, tip):
    """How starts part whose last bob is thrown ever less; tip (steps + 1, 3) if it is not."""
    curves = []
    for digits, colour in ((3, "m0"), (6, "m1"), (9, "m2")):
        thrown = double | {"v0": np.array([[0.0, 0.0, 0.0], [0.0, 10.0**-digits, 0.0]])}
        apart = np.linalg.norm(run(thrown, "project").tip - tip, axis=1)[EVERY::EVERY]
        curves.append((f"1e-{digits} m/s apart", colour, times[1:], np.log10(apart)))
    ticks = {k: length(10.0**k) for k in (-12, -9, -6, -3, 0)} | {1: ""}
    return chart(curves, TIMES, ticks, "distance between the tips")


def drawn():
    """Yield (name, text) of each: those that are curves, then those that move."""
    double = c.build_system("double")
    times = np.arange(0, 4001, EVERY) * DT
    runs = {method: run(double, method) for method in METHODS}
    yield "two_methods", two_methods(times, runs)
    yield "energy", energies(times, runs, m_g_L(double, c.GRAVITY))
    yield "cliff", cliff()
    yield "chaos", chaos(times, double, runs["project"].tip)
    yield "one_step", one_step((0.0, -1.12), (2.0, -1.0))
    yield "flat_pose", tiles("peaucellier", 4.0, 4.0, upright=3)
    yield "double", tiles("double", 12.0, 20.0, 10)
    yield "triple", tiles("triple", 12.0, 20.0, 10)
    yield "peaucellier", tiles("peaucellier", 0.0, 6.0, 20, upright=3)
    yield "jansen_leg", tiles("jansen_leg", 0.0, 5.0, 20)
    yield "windows", tiles("windows", 0.0, 6.0, 40)
