"""The moving picture of a run: an animated SVG, which plays wherever an image is shown."""

from pathlib import Path

from curriculum.ch3_4_constraints.svg import EXCESS, GREY, INK, MODES, PALE, Drawing, element
from curriculum.ch3_4_constraints.tables import length

import numpy as np

FRAME_RATE, MAX_KEPT = 60.0, 300_000  # states a second to keep; positions of a mode, at most
RATES = (20.0, 20.0), (10.0, 20.0), (10.0, 10.0), (10.0, 5.0), (10.0, 2.5), (10.0, 1.0)
BYTES, ENDS = 145_000, 150  # the first of RATES (frames a second, s) that fits; ends of rods drawn
WIDTH, HEIGHT, WORDS, FINE = 760, 560, 52, 10  # pixels: sheet, words in a tile; units a pixel


def frames(steps, dt, particles):
    """The steps to keep for the picture and the recording; every run itself keeps two more."""
    most = max(1, MAX_KEPT // particles - 2)
    return range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt)), -(-(steps + 1) // most)))


def title(args, used):
    """What was run, in words."""
    return f"{Path(args.system).stem}, {args.integrator}, steps of {used['dt']:.4g} s"


def verdict(run, dt):
    """What became of a mode, in a few words."""
    if run.stopped:
        return f"lost at {run.kept[-1] * dt:.3g} s"
    return f"off {length(np.max(run.violations))}"


def nodes(system, q):
    """Particles and then anchors, the first one last, (F, N + K, 3), at q (F, N, 3): `pairs` are
    indices into them."""
    anchors = np.reshape(system.get("anchors", np.zeros(3)), (-1, 3))
    return np.concatenate([q, np.broadcast_to(anchors[::-1], (len(q), *anchors.shape))], axis=1)


def rod_ends(system, q):
    """Tails, marks and heads of rods, (F, C, 3) each, at q (F, N, 3): tails are at the partners,
    heads at the particles, and marks where a rod that is too long should end."""
    q = nodes(system, q)
    i, j = np.transpose(system["pairs"])
    tails, heads = q[:, j], q[:, i]
    size = np.maximum(np.linalg.norm(heads - tails, axis=-1, keepdims=True), 1e-300)
    share = np.minimum(1.0, np.reshape(system["lengths"], (-1, 1)) / size)
    return tails, tails + share * (heads - tails), heads


def box(system, runs):
    """The corners (2, 3) of what is to be seen: of all modes whose rods keep to half their length,
    or else of the best one."""
    worst = {mode: np.inf if run.stopped else np.max(run.violations) for mode, run in runs.items()}
    good = [mode for mode in runs if worst[mode] < 0.5 * np.max(system["lengths"])]
    points = [runs[mode].q.reshape(-1, 3) for mode in good or [min(worst, key=worst.get)]]
    points = np.concatenate([*points, np.reshape(system.get("anchors", np.zeros(3)), (-1, 3))])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.05 * np.max(high - low)
    return np.array([low - room, high + room])


def columns(count, width, height, size):
    """In how many columns `count` tiles show something of `size` (x, y) at its largest."""
    def scale(across):
        return min(width / across / size[0], height / -(-count // across) / size[1])
    return max(range(count, 0, -1), key=scale)


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
    if seconds[-1] < total - 1e-9:
        shapes.append(shapes[-1])
        times = {"keyTimes": ";".join([*(f"{x:.4g}" for x in seconds / total), "1"])}
        once = {"calcMode": "discrete", "keyTimes": f"0;{seconds[-1] / total:.4g}"}
        hide = element("animate", attributeName="display", values="inline;none", **once, **loop)
    values = ";".join(shapes).replace(" -", "-")
    return element(
        "path", element("animate", attributeName="d", values=values, **times, **loop), hide, **style
    )


def write_motion(path, args, used, system, runs, keep, ghost=None):
    """Write `path`, an SVG that moves: `runs` {mode: Run} side by side, of whose kept states those
    of the steps `keep`, a range, are shown at the pace of the simulated time.

    `ghost`: the true motion as long as it is known, (seconds (F,), positions (F, N, 3)), or None.
    `args` and `used` name what was run. A file is bounded by BYTES, nearly: the first of RATES
    that fits is taken. Equal runs are equal bytes.
    """
    for rate, most in RATES:
        text = draw(args, used, system, runs, keep, ghost, rate, most)
        if len(text) <= BYTES:
            break
    Path(path).write_text(text, encoding="utf-8")


def draw(args, used, system, runs, keep, ghost, rate, most):
    """The text of the picture, of `rate` frames a second and the first `most` s."""
    (low, high), dt = box(system, runs), used["dt"]
    size, lines = (high - low)[:2], pens(system["pairs"])
    across = columns(len(runs), WIDTH, HEIGHT, size)
    down, wide = -(-len(runs) // across), WIDTH / across
    scale = min(wide / size[0], (HEIGHT / down - WORDS) / size[1])  # pixels a metre
    tall, fine = scale * size[1], FINE * scale
    sheet = Drawing(WIDTH, round(down * (tall + WORDS)) + 40, title(args, used))
    stride = keep.step * max(1, round(1.0 / (rate * keep.step * dt)))
    total = max(min(most, max(run.kept[-1] for run in runs.values()) * dt), dt)
    pen = {"fill": "none", "stroke_width": 3 * FINE}

    def place(points):
        return np.rint(fine * (points[..., :2] - [low[0], high[1]]) * [1, -1]).astype(int)

    def traces(q):
        q = place(nodes(system, q))
        return [q[:, line] for line in lines]

    if ghost:
        seconds, q = (x[ghost[0] < total + 1e-9] for x in ghost)
        dash = {"stroke": GREY, "stroke_dasharray": f"{4 * FINE} {5 * FINE}", "id": "true"}
        sheet.add("defs", moving(traces(q), seconds, total, **dash, **pen))
    for k, (mode, run) in enumerate(runs.items()):
        x, y, color = wide * (k % across), (tall + WORDS) * (k // across), MODES[mode]
        shown = (run.kept % stride == 0) & (run.kept * dt < total + 1e-9)
        seconds, (_, marks, heads) = run.kept[shown] * dt, map(place, rod_ends(system, run.q[shown]))
        ball = element("circle", r=1.3, fill=color)
        dots = {"id": mode, "viewBox": "-2 -2 4 4", "overflow": "visible"}
        parts = [element("marker", ball, **dots), *([element("use", href="#true")] if ghost else [])]
        style = {name: f"url(#{mode})" for name in ("marker_mid", "marker_end")}
        parts += [moving(traces(run.q[shown]), seconds, total, stroke=color, **style, **pen)]
        far = np.max(np.abs(heads - marks), axis=(0, 2)) > FINE
        excess = [np.stack([marks[:, k], heads[:, k]], axis=1) for k in np.flatnonzero(far)[:ENDS]]
        if excess:
            style = {"stroke": EXCESS, "stroke_width": 6 * FINE, "stroke_linecap": "butt"}
            parts += [moving(excess, seconds, total, **style)]
        parts += [element("circle", cx=x, cy=y, r=4 * FINE, fill=GREY) for x, y in place(nodes(system, run.q[:1])[0, len(run.q[0]) :])]
        view = {"viewBox": f"0 0 {FINE * wide:.0f} {FINE * tall:.0f}", "width": wide, "height": tall}
        sheet.add("svg", *parts, x=f"{x:.1f}", y=f"{y:.1f}", **view)
        middle, said = x + wide / 2, EXCESS if run.stopped else INK
        sheet.words(middle, y + tall + 20, mode, color, "middle", 19, "bold")
        sheet.words(middle, y + tall + 40, verdict(run, dt), said, "middle", 16)
    return sheet.text()
