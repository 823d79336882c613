"""The gallery: each scene under all methods side by side, in motion, and what it is in words."""

from textwrap import fill
from typing import NamedTuple

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints import rods
from curriculum.ch3_4_constraints.page.scene import MAX_RODS
from curriculum.ch3_4_constraints.rods.systems import differences, is_flat, nodes, rod_parts
from curriculum.ch3_4_constraints.site.drawing import Sheet
from curriculum.common import palette
from curriculum.common.words import length

DT = 0.005  # s, of all runs
SECONDS = 6.0  # so long a scene is shown,
TURNS = 60.0  # but at most until a rod that goes on as it starts has turned by so many rad
EVERY = 10  # steps from one frame to the next, at least
FINER = 3  # times as often the last particle's way is drawn
LARGEST = 100_000  # bytes of a picture, about; there are fewer frames if need be
FEWEST = 24  # frames: with fewer it is the last one, and stands still
WIDTH = 1500  # units of a sheet, two to a pixel
HIGHEST = 560  # units of what moves in a tile, from top to bottom
HEAD = 120  # units: two lines of words above it
EDGE = 30  # units around it
FLAT = 0.4  # as high as wide, or less: two tiles side by side, and not three
LOST = 0.25  # of all rods: a run whose rods are off by more may leave its tile
VISIBLE = 3.0  # units: a shorter piece is not drawn
THIN = 4.0  # units: no rod is thinner
STILL = 1.0  # unit: what moves by less stands still
COLUMNS = 100  # of a text
UPRIGHT = {"peaucellier": 3}  # particles that should keep their x
METHODS = {name: f"m{k}" for name, k in palette.places(c.make_methods(DT)).items()}  # and colours
CHAINS = {  # what is shown of them: from when to when in s, and in words
    "double": (12.0, 20.0, "Let go level: the last 8 of 20 seconds."),
    "triple": (12.0, 20.0, "The same with one more rod. No two methods end alike."),
}


class Film(NamedTuple):
    """What is shown of a scene."""

    begin: float  # s
    end: float  # s
    every: int = EVERY  # steps from one frame to the next
    slower: int = 1  # so many times slower than it is


def scenes():
    """{name: system} of what is in the gallery: two chains, and all scenes."""
    return {name: c.build_system(name) for name in [*CHAINS, *rods.SHIPPED]}


def film(name, system):
    """What is shown of a scene; of what turns fast it is less, and slower."""
    if name in CHAINS:
        begin, end, _ = CHAINS[name]
        return Film(begin, end)
    fixed = np.zeros_like(system["anchors"])
    apart = differences(system["v0"], fixed, system["pairs"])
    rate = np.max(np.linalg.norm(apart, axis=1) / system["lengths"])  # rad/s
    slower = max(1, round(SECONDS * rate / TURNS))
    return Film(0.0, SECONDS / slower, max(1, EVERY // slower), slower)


def trails(pairs):
    """The rods of `pairs` as lines of nodes: [[0, -1], [2, 1, 0]] is three rods."""
    left = [tuple(map(int, pair)) for pair in pairs]
    lines = []
    while left:
        ends = [end for pair in left for end in pair]
        odd = [end for end in ends if ends.count(end) % 2]
        line = [(odd or ends)[0]]  # a line that begins where it must
        while rod := next((pair for pair in left if line[-1] in pair), None):
            left.remove(rod)
            line.append(sum(rod) - line[-1])
        lines.append(line)
    return lines


def polyline(points):
    """Points (n, 2) of whole units as SVG's path: a place, and moves from one to the next."""
    moves = np.diff(points, axis=0).ravel()
    numbers = "".join(f" {x}" if x >= 0 else f"{x}" for x in moves)
    return "M{} {}l{}".format(*points[0], numbers.lstrip())


class Tiles:
    """Tiles side by side on a sheet, each large enough for the points `seen` (..., 3), in m."""

    def __init__(self, seen, count, shortest):
        low = np.min(seen, axis=0)[:2]
        wide, tall = np.maximum(np.max(seen, axis=0)[:2] - low, 0.5 * shortest)
        self.columns = 2 if tall < FLAT * wide else 3
        self.width = WIDTH / self.columns
        self.scale = min((self.width - 2 * EDGE) / wide, HIGHEST / tall)  # units a metre
        self.middle = low + 0.5 * np.array([wide, tall])
        self.height = tall * self.scale + HEAD + 2 * EDGE
        self.rows = -(-count // self.columns)
        self.ball = min(12.0, 0.35 * shortest * self.scale)  # units: the radius of a particle
        total = self.rows * self.height
        self.sheet = Sheet(WIDTH, round(total), (0.0, 0.0), (WIDTH, total))
        self.marks = set()

    def corner(self, k):
        """The upper left corner of tile k on the sheet, in units from its upper left corner."""
        row, column = divmod(k, self.columns)
        return np.array([column * self.width, row * self.height])

    def at(self, k, q):
        """Places q (..., 3), in m, in tile k: (..., 2) in whole units, y down."""
        middle = [0.5 * self.width, HEAD + 0.5 * (self.height - HEAD)]
        places = (np.asarray(q)[..., :2] - self.middle) * self.scale * [1.0, -1.0]
        return np.round(self.corner(k) + middle + places).astype(int)

    def words(self, k, lines, top=0.0):
        """Lines of words and their colours, from so many units below the top of tile k on."""
        x, y = self.corner(k) + [0.5 * self.width, top]
        for row, (words, colour) in enumerate(lines):
            place = (x, self.sheet.size[1] - y - 46 * (row + 1))
            self.sheet.words(place, words, colour)

    def line(self, points, style):
        """A line through points of whole units (n, 2) that stands still."""
        self.sheet.parts.append(f'<path d="{polyline(points)}" style="{style}"></path>')

    def marked(self, colour):
        """A style whose lines have a disc of that colour at each of their points."""
        if colour not in self.marks:
            self.marks.add(colour)
            size = f'r="{self.ball:.3g}" fill="var(--{colour})"'
            kind = 'markerUnits="userSpaceOnUse" overflow="visible"'
            self.sheet.parts.append(f'<marker id="{colour}" {kind}><circle {size}/></marker>')
        return f"marker:url(#{colour})"

    def cut(self, k, places):
        """A style that cuts off what leaves tile k, if one of its places (..., 2) does."""
        corner = self.corner(k)
        inside = (places >= corner) & (places <= corner + [self.width, self.height])
        if np.all(inside):
            return ""
        box = 'x="{:.0f}" y="{:.0f}" width="{:.0f}" height="{:.0f}"'
        box = box.format(*corner, self.width, self.height)
        self.sheet.parts.append(f'<clipPath id="t{k}"><rect {box}/></clipPath>')
        return f"clip-path:url(#t{k})"

    def rods(self, k, system, q, way, colour, dt):
        """The rods of a system in all states q (steps, N, 3), and the last particle's `way` (n, 3).

        What does not move, is drawn once.
        """
        points = self.at(k, nodes(q, system["anchors"]))
        if np.max(np.ptp(points, axis=0)) <= STILL:
            q = q[-1:]
            points = points[-1:]
        cut = self.cut(k, points)
        if len(q) > 1:
            faint = f"stroke:var(--{colour});stroke-width:3;stroke-opacity:0.3"
            self.line(self.at(k, way), f"{faint};{cut}".rstrip(";"))
        lines = trails(system["pairs"])
        width = min(9.0, max(THIN, 0.75 * self.ball))
        shown = ["".join(polyline(state[line]) for line in lines) for state in points]
        self.sheet.path(shown, colour, f"{width:.3g}", f"{self.marked(colour)};{cut}", dt)
        _, much, missing = rod_parts(system, q)
        self.pieces(k, much, "long", f"{1.6 * width:.3g}", cut, dt)
        self.pieces(k, missing, "short", f"{width:.3g}", f"stroke-dasharray:6;{cut}", dt)
        for anchor in self.at(k, system["anchors"]):
            dot = f"stroke:var(--reference);stroke-width:{1.4 * self.ball:.3g}"
            self.line(np.array([anchor, anchor]), f"{dot};stroke-linecap:round")

    def pieces(self, k, parts, colour, width, more, dt):
        """Pieces of rods (steps, C, 2, 3), of those rods only whose piece can be seen some time."""
        places = self.at(k, parts)
        size = np.linalg.norm(places[:, :, 1] - places[:, :, 0], axis=-1)
        seen = np.max(size, axis=0) > VISIBLE
        if np.any(seen):
            shown = ["".join(map(polyline, state)) for state in places[:, seen]]
            self.sheet.path(shown, colour, width, more, dt)

    def gaps(self, k, places, x, dt):
        """An upright dashed line at x m, and how far from it a particle is at places (steps, 3)."""
        points = self.at(k, places)
        ((foot, _),) = self.at(k, [[x, 0.0, 0.0]])
        _, top = self.corner(k) + [0.0, HEAD]
        line = np.array([[foot, round(top)], [foot, round(top + self.height - HEAD - EDGE)]])
        self.line(line, "stroke:var(--ink);stroke-width:3;stroke-dasharray:4 12")
        gaps = [polyline(np.array([point, [foot, point[1]]])) for point in points]
        self.sheet.path(gaps, "long", 5, dt=dt)


def tiles(name, system, film, methods=tuple(METHODS)):
    """A scene's picture: the methods side by side, and what is seen in the last tile."""
    first, last = round(film.begin / DT), round(film.end / DT)
    frames = np.arange(first, last + 1, film.every)
    runs = [c.run_method(system, x, "semi_implicit", DT, last) for x in methods]
    whole = np.sum(system["lengths"])
    held = [run for run in runs if not run.lost and run.violations.max() < LOST * whole] or runs
    places = [run.q[frames[frames < len(run.q)]].reshape(-1, 3) for run in held]
    seen = np.vstack([system["anchors"], *places])
    board = Tiles(seen, len(runs) + 1, np.min(system["lengths"]))
    dt = film.every * DT * film.slower
    for k, (method, run) in enumerate(zip(methods, runs, strict=True)):
        q = run.q[np.minimum(frames, len(run.q) - 1)]  # a run that is lost stays where it was
        if name in UPRIGHT:
            board.gaps(k, q[:, UPRIGHT[name]], system["q0"][UPRIGHT[name], 0], dt)
        way = run.tip[first : frames[-1] + 1 : max(1, film.every // FINER)]
        board.rods(k, system, q, way, METHODS[method], dt)
        ends = run.lost.partition(":")[0] if run.lost else length(run.violations.max())
        off = ends if run.lost else f"rods off by {ends}"
        board.words(k, [(method, METHODS[method]), (off, METHODS[method])])
    board.words(len(runs), legend(name, film), top=0.5 * max(0.0, board.height - 300.0))
    return board.sheet.text()


def legend(name, film):
    """Lines of words, and their colours: what is seen."""
    when = f"{film.begin:g} to {film.end:g} s" if film.begin < film.end else f"at {film.end:g} s"
    lines = [(name, "ink"), (when, "ink")]
    if film.slower > 1:
        lines.append((f"{film.slower} times slower", "ink"))
    return [*lines, ("red: too long", "long"), ("blue: too short", "short")]


def picture(name, system):
    """A scene's picture, in motion if that fits."""
    wanted = film(name, system)
    while True:
        drawn = tiles(name, system, wanted)
        fewer = len(drawn) / LARGEST
        if fewer <= 1.0:
            return drawn
        wanted = wanted._replace(every=int(np.ceil(1.05 * fewer * wanted.every)))
        if (wanted.end - wanted.begin) / DT / wanted.every < FEWEST:
            return tiles(name, system, wanted._replace(begin=wanted.end))


def text():
    """The gallery in Markdown: of each scene its own words, its picture, and its command."""
    parts = []
    for name, system in scenes().items():
        words = CHAINS[name][-1] if name in CHAINS else system.get("about", "")
        command = f"python constraints.py --system {name}"
        if is_flat(system) and len(system["pairs"]) <= MAX_RODS:
            command += " --within 1mm"
        said = fill(f"**{name}**: {words}", COLUMNS, break_long_words=False)
        parts.append(f"{said}\n\n![{name} under each method]({name}.svg)\n\n    {command}\n")
    return "\n".join(parts)


def drawn():
    """Yield (name, text) of each picture."""
    for name, system in scenes().items():
        yield name, picture(name, system)
