"""The moving picture of a run: an animated SVG, which plays wherever an image is shown."""

from curriculum.ch3_4_constraints.recording import box, columns, outcome, rod_ends, title
from curriculum.ch3_4_constraints.statics import nodes
from curriculum.ch3_4_constraints.svg import EXCESS, GREY, INK, MODES, Drawing, element

import numpy as np

RATES = (20.0, 20.0), (10.0, 20.0), (10.0, 10.0), (10.0, 5.0), (10.0, 2.5), (10.0, 1.0)
BYTES, ENDS = 145_000, 150  # the first of RATES (frames a second, s) that fits; ends of rods drawn
SHEET, WORDS, FINE = (760, 600), 60, 10  # pixels, of the tiles; words in a tile; units a pixel


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


def moving(traces, seconds, total, **style):
    """A path in a loop of `total` s: lines through `traces` [(F, S, 2)], of whole numbers, at
    `seconds` (F,), which are evenly spaced; hidden from the last of them on."""
    steps = [np.diff(trace, axis=1, prepend=0).reshape(len(trace), -1) for trace in traces]
    form = "".join("M%d %dl" + " ".join(["%d %d"] * (trace.shape[1] - 1)) for trace in traces)
    shapes = [form % tuple(row) for row in np.concatenate(steps, axis=1).tolist()]
    loop, times, hide = {"dur": f"{total:g}s", "repeatCount": "indefinite"}, {}, ""
    if 0.0 < seconds[-1] < total - 1e-9:
        shapes.append(shapes[-1])
        times = {"keyTimes": ";".join([*(f"{x:.4g}" for x in seconds / total), "1"])}
        once = {"calcMode": "discrete", "keyTimes": f"0;{seconds[-1] / total:.4g}"}
        hide = element("animate", attributeName="display", values="inline;none", **once, **loop)
    values = ";".join(shapes).replace(" -", "-")
    shape = element("animate", attributeName="d", values=values, **times, **loop)
    return element("path", shape, hide, fill="none", **style)


def motion(args, used, system, runs, keep, ghost, rates=RATES):
    """The text of an SVG that moves: `runs` {mode: Run} side by side, of whose kept states those
    of the steps `keep`, a range, are shown at the pace of the simulated time.

    `args`, `used`, `ghost`: as recording.record takes them; of `ghost` 20 evenly spaced frames a
    second will do. The first of `rates` is taken whose text has no more than BYTES, or else the
    last. Equal runs are equal bytes.
    """
    (rate, most), *slower = rates
    (low, high, bar), dt, lines = box(system, runs), used["dt"], pens(system["pairs"])
    size = (high - low)[:2]
    across, wide, room = columns(len(runs), SHEET, size, WORDS)
    scale = min(wide / size[0], room / size[1])  # pixels a metre
    width, tall = scale * size
    bottom = -(-len(runs) // across) * (tall + WORDS)
    sheet = Drawing(SHEET[0], round(bottom) + 34, title(args, used))
    stride = keep.step * max(1, round(1.0 / (rate * keep.step * dt)))
    last = min(most / dt + 1e-9, max(run.kept[-1] for run in runs.values()))
    total = max(1, int(last / stride)) * stride * dt

    def place(points):
        return np.rint(FINE * scale * (points[..., :2] - [low[0], high[1]]) * [1, -1]).astype(int)

    def lines_through(q):
        return [place(nodes(q, system["anchors"]))[:, line] for line in lines]

    anchors = place(system["anchors"][::-1])
    still = [element("circle", cx=x, cy=y, r=5 * FINE, fill=GREY) for x, y in anchors]
    if ghost:
        seconds, q = (x[ghost[0] < total + 1e-9] for x in ghost)
        dash = {"stroke": GREY, "stroke_dasharray": f"{4 * FINE} {6 * FINE}"}
        still.append(moving(lines_through(q), seconds, total, stroke_width=4 * FINE, **dash))
    sheet.add("defs", element("g", *still, id="still"))
    for k, (mode, run) in enumerate(runs.items()):
        left, top, color = wide * (k % across), (tall + WORDS) * (k // across), MODES[mode]
        shown = (run.kept % stride == 0) & (run.kept * dt < total + 1e-9)
        seconds, q = run.kept[shown] * dt, run.q[shown]
        _, marks, heads = map(place, rod_ends(system, q))
        far = np.flatnonzero(np.max(np.abs(heads - marks), axis=(0, 2)) > FINE)[:ENDS]
        ball = element("circle", r=1.3, fill=color)
        dots = element("marker", ball, id=mode, viewBox="-2 -2 4 4", overflow="visible")
        style = dict.fromkeys(("marker_mid", "marker_end"), f"url(#{mode})") | {"stroke": color}
        rods = moving(lines_through(q), seconds, total, stroke_width=4 * FINE, **style)
        parts = [dots, element("use", href="#still"), rods]
        if len(far):
            excess = [np.stack([marks[:, rod], heads[:, rod]], axis=1) for rod in far]
            style = {"stroke": EXCESS, "stroke_width": 7 * FINE, "stroke_linecap": "butt"}
            parts.append(moving(excess, seconds, total, **style))
        view = {"viewBox": f"0 0 {FINE * width:.0f} {FINE * tall:.0f}", "width": round(width, 1)}
        middle, at = left + wide / 2, {"y": round(top, 1), "height": round(tall, 1)}
        sheet.add("svg", *parts, x=round(middle - width / 2, 1), **at, **view)
        said = EXCESS if run.stopped else INK
        sheet.words(middle, top + tall + 22, mode, color, "middle", 22, "bold")
        sheet.words(middle, top + tall + 44, outcome(run, dt), said, "middle", 19)
    sheet.line([(16, bottom + 14), (16 + scale * bar, bottom + 14)], GREY, 3)
    legend = f"{bar:g} m; red: what a rod has too much" + "; dashed: the true motion" * bool(ghost)
    sheet.words(26 + scale * bar, bottom + 20, legend, size=17)
    text = sheet.text()
    if slower and len(text) > BYTES:
        return motion(args, used, system, runs, keep, ghost, slower)
    return text
