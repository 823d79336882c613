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


def changing(words, total, x, y, size, anchor="middle"):
    """Words at x, y that change in a loop of `total` s, evenly: [(text, colour), ...]. They are a
    column that moves behind a window of one line. Where nothing moves it shows the last."""
    line, wide = round(1.4 * size), 20 * size
    inset = {"middle": wide // 2, "end": wide}[anchor]
    rows = [
        element("tspan", text.translate(svg.ESCAPES), x=inset, y=size + line * k, fill=color)
        for k, (text, color) in enumerate(words)
    ]
    places = [f"0 {-line * k}" for k in range(len(words))]
    how = {"type": "translate", "calcMode": "discrete"}
    move = looped(total, "transform", places, "animateTransform", **how)
    style = {"font_size": size, "text_anchor": anchor, "transform": f"translate({places[-1]})"}
    window = {"x": round(x - inset, 1), "y": round(y - size, 1), "width": wide, "height": line}
    return element("svg", element("text", move, *rows, **style), **window)


def motion(found, rates=RATES):
    """The text of an SVG that moves: the modes of a Comparison side by side, at the pace of the
    simulated time, and beside them how far their rods are off. Equal runs are equal bytes; the
    first of `rates` is taken whose text has no more than BYTES, or else the last."""
    (rate, most), *slower = rates
    system, runs, dt = found.system, found.runs, found.dt
    low, high, bar = box(system, runs)
    lines, colors = pens(system["pairs"]), svg.mode_colors(runs)
    size = (high - low)[:2]
    across, wide, room = tiling(len(runs) + 1, SHEET, size, WORDS, NARROW)
    scale = min(wide / size[0], room / size[1])  # pixels a metre
    if scale * bar > BAR:
        bar /= 10.0
    width, tall = scale * size
    bottom = -(-(len(runs) + 1) // across) * (tall + WORDS)
    sheet = Drawing(SHEET[0], round(bottom) + 34, found.title)
    every = found.shown[min(1, len(found.shown) - 1)] or 1
    stride = every * max(1, round(1.0 / (rate * every * dt)))
    last = min(most / dt, max(run.kept[-1] for run in runs.values())) + 1e-9
    steps = np.arange(0, last, stride).astype(int)
    steps = steps[np.logical_and.accumulate(np.isin(steps, found.shown))]  # evenly spaced
    total = max(steps[-1], 1) * dt

    def place(points):
        return np.rint(FINE * scale * (points[..., :2] - [low[0], high[1]]) * [1, -1]).astype(int)

    def lines_through(q):
        return [place(nodes(q, system["anchors"]))[:, line] for line in lines]

    anchors = place(system["anchors"][::-1])
    still = [element("circle", cx=x, cy=y, r=5 * FINE, fill=svg.GREY) for x, y in anchors]
    known = np.flatnonzero(np.isin(found.shown[: len(found.motion)], steps))
    if len(known) > 1:
        seconds, q = found.shown[known] * dt, found.motion[known]
        dash = {"stroke": svg.GREY, "stroke_dasharray": f"{4 * FINE} {6 * FINE}"}
        still.append(moving(lines_through(q), seconds, total, stroke_width=4 * FINE, **dash))
    sheet.add("defs", element("g", *still, id="still"))
    for k, mode in enumerate(runs):
        there, q, _ = found.states(mode, steps)
        seconds, color = there * dt, colors[mode]
        ball = element("circle", r=1.3, fill=color)
        dots = element("marker", ball, id=f"dot{k}", viewBox="-2 -2 4 4", overflow="visible")
        style = dict.fromkeys(("marker_mid", "marker_end"), f"url(#dot{k})") | {"stroke": color}
        rods = moving(lines_through(q), seconds, total, stroke_width=4 * FINE, **style)
        parts = [dots, element("use", href="#still"), rods]
        for pieces, look in off(system, q, place):
            parts.append(moving(pieces, seconds, total, **look))
        left, top = wide * (k % across), (tall + WORDS) * (k // across)
        middle, at = left + wide / 2, {"y": round(top, 1), "height": round(tall, 1)}
        view = {"viewBox": f"0 0 {FINE * width:.0f} {FINE * tall:.0f}", "width": round(width, 1)}
        sheet.add("svg", *parts, x=round(middle - width / 2, 1), **at, **view)
        sheet.words(middle, top + tall + 22, mode, color, "middle", 22, "bold")
        words = figures(found, mode, total)
        sheet.parts.append(changing(words, total, middle, top + tall + 44, 19))
    left, top = wide * (len(runs) % across), (tall + WORDS) * (len(runs) // across)
    drift(sheet, found, colors, total, (left, top, left + wide, top + tall + WORDS))
    legend(sheet, bottom + 20, scale * bar, bar, len(known) > 1)
    ticks = np.arange(0.0, total - 1e-9, 1.0 / CLOCK)
    clock = [(f"{seconds:.1f} s", svg.INK) for seconds in ticks]
    sheet.parts.append(changing(clock, total, SHEET[0] - 16, bottom + 20, 19, "end"))
    text = sheet.text()
    if slower and len(text) > BYTES:
        return motion(found, slower)
    return text


def off(system, q, place):
    """Yield (traces, style) of what rods have too much, and of what they lack, at q (F, N, 3)."""
    _, marks, heads, error = rod_ends(system, q)
    marks, heads = place(marks), place(heads)
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


def figures(found, mode, total):
    """How far the worst rod of a mode is off, some times a second: [(text, colour), ...]."""
    run = found.runs[mode]
    words = []
    for seconds in np.arange(0.0, total - 1e-9, 1.0 / FIGURES):
        at = np.searchsorted(run.kept, seconds / found.dt - 1e-6)
        if at == len(run.kept):
            words.append((found.outcome(mode), svg.EXCESS))
            continue
        *_, errors = rod_ends(found.system, run.q[at : at + 1])
        worst = errors.flat[np.argmax(np.abs(errors))]
        if abs(worst) < LEAST:
            words.append((f"off {length(abs(worst))}", svg.INK))
        elif worst > 0.0:
            words.append((f"{length(worst)} too long", svg.EXCESS))
        else:
            words.append((f"{length(-worst)} too short", svg.MISSING))
    return words


def drift(sheet, found, colors, total, corners):
    """Draw the worst rod error of all modes against the time, and a line that moves with it."""
    left, top, right, bottom = corners
    inner = left + 52, top + 34, right - 86, bottom - 34
    worst = {m: run.violations[: round(total / found.dt) + 1] for m, run in found.runs.items()}
    ended = [np.max(x) for mode, x in worst.items() if not found.runs[mode].stopped]
    limits = 0.3 * LEAST, 3.0 * max([1e-2, *ended])
    curves = {}
    for mode, errors in worst.items():
        parts = np.array_split(errors, min(CURVE, len(errors)))
        seconds = np.linspace(0.0, (len(errors) - 1) * found.dt, len(parts))
        values = np.clip([np.max(part) for part in parts], LEAST, limits[1])
        curves[mode] = colors[mode], list(zip(seconds, values, strict=True))
    tall = len(DECADES) * 1.3 * SMALL < inner[3] - inner[1]
    y = "", limits, DECADES if tall else dict([*DECADES.items()][::2])
    x = "", (0.0, total), {0.0: "0", total: f"{total:.3g} s"}
    sheet.words(left + 16, top + 20, "the worst rod", size=SMALL + 2)
    svg.plot(sheet, inner, x, y, curves, SMALL)
    across = ["0", f"{inner[2] - inner[0]:.1f}"]
    sweep = looped(total, "transform", across, "animateTransform", type="translate")
    upright = f"M{inner[0]:.1f} {inner[1]:.1f}V{inner[3]:.1f}"
    sheet.add("path", sweep, d=upright, stroke=svg.INK, stroke_width=1)


def legend(sheet, y, width, bar, known):
    """Draw what lines mean, below the tiles: a scale, and a piece of each line with its name."""
    at = 16
    kinds = [(width, svg.GREY, 3, "none", f"{bar:g} m"), (24, svg.EXCESS, 7, "none", "too long")]
    kinds.append((24, svg.MISSING, 4, "3 2", "too short"))
    if known:
        kinds.append((30, svg.GREY, 4, "4 6", "the true motion"))
    for wide, color, thick, dash, words in kinds:
        style = {"stroke_width": thick, "stroke_dasharray": dash, "stroke_linecap": "butt"}
        sheet.add("path", d=f"M{at:.1f} {y - 6:.1f}h{wide:.1f}", stroke=color, **style)
        sheet.words(at + wide + 8, y, words, size=17)
        at += wide + 30 + 8.5 * len(words)
