"""The moving picture of a run: an animated SVG, which plays wherever an image is shown."""

from curriculum.ch3_4_constraints import svg
from curriculum.ch3_4_constraints.geometry import box, rod_ends, tiling
from curriculum.ch3_4_constraints.statics import nodes
from curriculum.ch3_4_constraints.svg import Drawing, element
from curriculum.ch3_4_constraints.tables import length

import numpy as np

# (frames a second, the longest time in s): the first of these that fits is taken
RATES = (20.0, 20.0), (10.0, 20.0), (10.0, 10.0), (10.0, 5.0), (10.0, 2.5), (10.0, 1.0)
BYTES = 145_000  # of a picture, at most
ENDS = 150  # of rods that are drawn, at most
SHEET = 760, 600  # pixels, of all tiles
WORDS = 60  # pixels, of the words in a tile
NARROW = 240  # pixels: less has no room for the chart
FINE = 5  # units in a pixel
CLOCK = 5  # times a second the time is told
FIGURES = 2  # times a second it is told how far rods are off
LEAST = 1e-12  # m: below this a rod is right
CURVE = 60  # points of a curve
BAR = 120  # pixels that the legend's length has, at most
DECADES = {1.0: "1 m", 1e-3: "1 mm", 1e-6: "1 um", 1e-9: "1 nm", 1e-12: "1 pm"}
SMALL = 13  # pixels, of words in the chart
TOLD = 19  # pixels, of words that change


def pens(pairs):
    """Rods as lines to draw without lifting the pen, lists of particles and anchors; if there are
    too many, each takes larger steps, or some are left out."""
    lines = []
    for i, j in pairs:
        if not lines or lines[-1][-1] != j:
            lines.append([j])
        lines[-1].append(i)
    every = -(-sum(map(len, lines)) // ENDS)
    lines = [[*line[:-1:every], line[-1]] for line in lines]
    return lines[:: -(-sum(map(len, lines)) // ENDS)]


def looped(total, what, values, name="animate", **how):
    """An element that has an attribute run through `values` in a loop of `total` s."""
    loop = {"dur": f"{total:g}s", "repeatCount": "indefinite"}
    return element(name, attributeName=what, values=";".join(values), **how, **loop)


def moving(traces, seconds, total, **style):
    """A path in a loop of `total` s: lines through `traces` [(F, S, 2)], of whole numbers, at
    `seconds` (F,), which are evenly spaced; hidden from the last of them on. Where nothing moves,
    in a thumbnail or on paper, it is as it is at the last."""
    steps = [np.diff(trace, axis=1, prepend=0).reshape(len(trace), -1) for trace in traces]
    form = "".join("M%d %dl" + " ".join(["%d %d"] * (trace.shape[1] - 1)) for trace in traces)
    rows = np.concatenate(steps, axis=1).tolist()
    shapes = [(form % tuple(row)).replace(" -", "-") for row in rows]
    last, times, hide = shapes[-1], {}, ""
    if 0.0 < seconds[-1] < total - 1e-9:
        shapes.append(last)
        times = {"keyTimes": ";".join([*(f"{x:.4g}" for x in seconds / total), "1"])}
        once = {"calcMode": "discrete", "keyTimes": f"0;{seconds[-1] / total:.4g}"}
        hide = looped(total, "display", ["inline", "none"], **once)
    return element("path", looped(total, "d", shapes, **times), hide, d=last, fill="none", **style)


def changing(words, total, x, y, anchor="middle"):
    """Words at x, y that change in a loop of `total` s, evenly: [(text, colour), ...]. They are a
    column that moves behind a window of one line. Where nothing moves it shows the last."""
    line, wide = round(1.4 * TOLD), 20 * TOLD
    inset = {"middle": wide // 2, "end": wide}[anchor]
    rows = [
        element("tspan", text.translate(svg.ESCAPES), x=inset, y=TOLD + line * k, fill=color)
        for k, (text, color) in enumerate(words)
    ]
    places = [f"0 {-line * k}" for k in range(len(words))]
    how = {"type": "translate", "calcMode": "discrete"}
    move = looped(total, "transform", places, "animateTransform", **how)
    style = {"font_size": TOLD, "text_anchor": anchor, "transform": f"translate({places[-1]})"}
    window = {"x": round(x - inset, 1), "y": round(y - TOLD, 1), "width": wide, "height": line}
    return element("svg", element("text", move, *rows, **style), **window)


def motion(comparison):
    """The text of an SVG that moves: the modes of a Comparison side by side, at the pace of the
    simulated time, and beside them how far their rods are off. Equal runs are equal bytes; the
    first of RATES is taken whose text has no more than BYTES, or else the last."""
    for rate, longest in RATES:
        text = Picture(comparison, rate, longest).text()
        if len(text) <= BYTES:
            break
    return text


def even_steps(comparison, rate, longest):
    """Steps that are shown and evenly spaced, `rate` a second, of at most the `longest` time."""
    shown, dt = comparison.shown, comparison.dt
    every = shown[min(1, len(shown) - 1)] or 1
    stride = every * max(1, round(1.0 / (rate * every * dt)))
    last = min(longest / dt, max(run.kept[-1] for run in comparison.runs.values())) + 1e-9
    steps = np.arange(0, last, stride).astype(int)
    return steps[np.logical_and.accumulate(np.isin(steps, shown))]


class Picture:
    """A sheet of tiles, a mode of a Comparison each, and one for the chart: a loop of `total` s.

    A tile is `wide` pixels, its scene `width` by `tall`, and below it are words. `scale`: pixels a
    metre; in a tile they are counted in units of 1 / FINE, from where `top_left` (x, y) in m is.
    """

    def __init__(self, comparison, rate, longest):
        self.comparison, self.system, self.runs = comparison, comparison.system, comparison.runs
        self.colors, self.lines = svg.mode_colors(self.runs), pens(self.system["pairs"])
        self.steps = even_steps(comparison, rate, longest)
        self.total = max(self.steps[-1], 1) * comparison.dt
        low, high, bar = box(self.system, self.runs)
        self.top_left, size, count = [low[0], high[1]], (high - low)[:2], len(self.runs) + 1
        self.across, self.wide, room = tiling(count, SHEET, size, WORDS, NARROW)
        self.scale = min(self.wide / size[0], room / size[1])
        self.bar = bar / 10.0 if self.scale * bar > BAR else bar  # m
        self.width, self.tall = self.scale * size
        self.bottom = -(-count // self.across) * (self.tall + WORDS)
        shown = comparison.shown[: len(comparison.motion)]
        known = np.flatnonzero(np.isin(shown, self.steps))
        self.known = known if len(known) > 1 else known[:0]  # frames of the true motion

    def text(self):
        """The file."""
        sheet = Drawing(SHEET[0], round(self.bottom) + 34, self.comparison.title)
        sheet.add("defs", element("g", *self.still(), id="still"))
        for k, mode in enumerate(self.runs):
            self.tile(sheet, k, mode)
        left, top = self.tile_corner(len(self.runs))
        self.drift(sheet, (left, top, left + self.wide, top + self.tall + WORDS))
        self.legend(sheet, self.bottom + 20)
        ticks = np.arange(0.0, self.total - 1e-9, 1.0 / CLOCK)
        clock = [(f"{seconds:.1f} s", svg.INK) for seconds in ticks]
        sheet.parts.append(changing(clock, self.total, SHEET[0] - 16, self.bottom + 20, "end"))
        return sheet.text()

    def tile_corner(self, k):
        """The left and the upper end of tile k, in pixels."""
        return self.wide * (k % self.across), (self.tall + WORDS) * (k // self.across)

    def place(self, points):
        """Points (..., 3) in m, in units of a tile: (..., 2), y down."""
        moved = (points[..., :2] - self.top_left) * [1, -1]
        return np.rint(FINE * self.scale * moved).astype(int)

    def rods(self, q, seconds, **style):
        """The rods at q (F, N, 3), as lines that move."""
        ends = self.place(nodes(q, self.system["anchors"]))
        traces = [ends[:, line] for line in self.lines]
        return moving(traces, seconds, self.total, stroke_width=4 * FINE, **style)

    def still(self):
        """Elements that are the same in all tiles: the anchors and, if known, the true motion."""
        anchors = self.place(self.system["anchors"][::-1])
        dots = [element("circle", cx=x, cy=y, r=5 * FINE, fill=svg.GREY) for x, y in anchors]
        if not len(self.known):
            return dots
        comparison, known = self.comparison, self.known
        dash = {"stroke": svg.GREY, "stroke_dasharray": f"{4 * FINE} {6 * FINE}"}
        seconds = comparison.shown[known] * comparison.dt
        return [*dots, self.rods(comparison.motion[known], seconds, **dash)]

    def tile(self, sheet, k, mode):
        """Draw a mode: rods and particles, what rods have too much or lack, and words below."""
        steps, q, _ = self.comparison.states(mode, self.steps)
        seconds, color = steps * self.comparison.dt, self.colors[mode]
        ball = element("circle", r=1.3, fill=color)
        dots = element("marker", ball, id=f"dot{k}", viewBox="-2 -2 4 4", overflow="visible")
        style = dict.fromkeys(("marker_mid", "marker_end"), f"url(#dot{k})") | {"stroke": color}
        parts = [dots, element("use", href="#still"), self.rods(q, seconds, **style)]
        parts += [moving(pieces, seconds, self.total, **look) for pieces, look in self.off(q)]
        left, top = self.tile_corner(k)
        middle, bottom = left + self.wide / 2, top + self.tall
        place = {"x": round(middle - self.width / 2, 1), "y": round(top, 1)}
        view = f"0 0 {FINE * self.width:.0f} {FINE * self.tall:.0f}"
        view = {"height": round(self.tall, 1), "viewBox": view, "width": round(self.width, 1)}
        sheet.add("svg", *parts, **place, **view)
        sheet.words(middle, bottom + 22, mode, color, "middle", 22, "bold")
        sheet.parts.append(changing(self.figures(mode), self.total, middle, bottom + 44))

    def off(self, q):
        """Yield (traces, style) of what rods have too much and what they lack, at q (F, N, 3)."""
        _, marks, heads, error = rod_ends(self.system, q)
        marks, heads = self.place(marks), self.place(heads)
        far = np.max(np.abs(heads - marks), axis=-1) > FINE  # a pixel
        too_long = {"stroke": svg.EXCESS, "stroke_width": 7 * FINE}
        too_short = {"stroke": svg.MISSING, "stroke_width": 4 * FINE}
        too_short["stroke_dasharray"] = f"{3 * FINE} {2 * FINE}"
        for style, wrong in ((too_long, error > 0.0), (too_short, error < 0.0)):
            rods = np.flatnonzero(np.any(far & wrong, axis=0))[:ENDS]
            ends = np.where(wrong[..., None], heads, marks)  # nothing, while it is not so
            traces = [np.stack([marks[:, rod], ends[:, rod]], axis=1) for rod in rods]
            if traces:
                yield traces, style | {"stroke_linecap": "butt"}

    def figures(self, mode):
        """How far the worst rod of a mode is off, some times a second: [(text, colour), ...]."""
        run, words = self.runs[mode], []
        for seconds in np.arange(0.0, self.total - 1e-9, 1.0 / FIGURES):
            at = np.searchsorted(run.kept, seconds / self.comparison.dt - 1e-6)
            if at == len(run.kept):
                words.append((self.comparison.outcome(mode), svg.EXCESS))
                continue
            *_, errors = rod_ends(self.system, run.q[at : at + 1])
            worst = errors.flat[np.argmax(np.abs(errors))]
            if abs(worst) < LEAST:
                words.append((f"off {length(abs(worst))}", svg.INK))
            elif worst > 0.0:
                words.append((f"{length(worst)} too long", svg.EXCESS))
            else:
                words.append((f"{length(-worst)} too short", svg.MISSING))
        return words

    def drift(self, sheet, corners):
        """Draw the worst rod error of all modes against time, and a line that moves with it."""
        left, top, right, bottom = corners
        inner = left + 52, top + 34, right - 86, bottom - 34
        dt, last = self.comparison.dt, round(self.total / self.comparison.dt)
        worst = {mode: run.violations[: last + 1] for mode, run in self.runs.items()}
        ended = [np.max(x) for mode, x in worst.items() if not self.runs[mode].stopped]
        limits = 0.3 * LEAST, 3.0 * max([1e-2, *ended])
        curves = {}
        for mode, errors in worst.items():
            parts = np.array_split(errors, min(CURVE, len(errors)))
            seconds = np.linspace(0.0, (len(errors) - 1) * dt, len(parts))
            values = np.clip([np.max(part) for part in parts], LEAST, limits[1])
            curves[mode] = self.colors[mode], list(zip(seconds, values, strict=True))
        tall = len(DECADES) * 1.3 * SMALL < inner[3] - inner[1]
        y = "", limits, DECADES if tall else dict([*DECADES.items()][::2])
        x = "", (0.0, self.total), {0.0: "0", self.total: f"{self.total:.3g} s"}
        sheet.words(left + 16, top + 20, "the worst rod", size=SMALL + 2)
        svg.plot(sheet, inner, x, y, curves, SMALL)
        across = ["0", f"{inner[2] - inner[0]:.1f}"]
        sweep = looped(self.total, "transform", across, "animateTransform", type="translate")
        upright = f"M{inner[0]:.1f} {inner[1]:.1f}V{inner[3]:.1f}"
        sheet.add("path", sweep, d=upright, stroke=svg.INK, stroke_width=1)

    def legend(self, sheet, y):
        """Draw what lines mean, below the tiles: a scale, a piece of each line with its name."""
        at, metres = 16, f"{self.bar:g} m"
        kinds = [(self.scale * self.bar, svg.GREY, 3, "none", metres)]
        kinds += [(24, svg.EXCESS, 7, "none", "too long"), (24, svg.MISSING, 4, "3 2", "too short")]
        if len(self.known):
            kinds.append((30, svg.GREY, 4, "4 6", "the true motion"))
        for wide, color, thick, dash, words in kinds:
            style = {"stroke_width": thick, "stroke_dasharray": dash, "stroke_linecap": "butt"}
            sheet.add("path", d=f"M{at:.1f} {y - 6:.1f}h{wide:.1f}", stroke=color, **style)
            sheet.words(at + wide + 8, y, words, size=17)
            at += wide + 30 + 8.5 * len(words)
