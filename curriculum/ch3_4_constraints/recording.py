"""A Rerun recording of a comparison: a tile a mode, and plots of the pull, the rods, the energy."""

import zlib
from pathlib import Path

from curriculum.ch3_4_constraints.statics import nodes
from curriculum.ch3_4_constraints.svg import EXCESS, GREY, MODES, PULL, PUSH
from curriculum.ch3_4_constraints.tables import length

import numpy as np

FRAME_RATE, MAX_RECORDED = 60.0, 300_000  # states a simulated second; positions shown, at most
TIMELINE, BACKGROUND = "sim_time", [16, 16, 20]  # seconds; dark
WINDOW, TITLE = (840, 800), 28  # pixels that tiles share, as most open it; a tile's title
SLOPE, MARGIN = 0.52, 1.12  # Rerun's eye sees so much up per metre ahead; room around
LABEL = [255, 255, 255]  # its ground is dark in the light theme, too
FLOOR = 1e-9  # m: a rod error of less is drawn as this
FORCES, ENERGY = "pull of the first rod, N", "energy error, share of m g L"
RODS = "worst rod, powers of ten of a metre (-3: 1 mm)"
GUIDE = """**{title}**

**Rods** glow brown where they pull, violet where they push; full glow = {full:.3g} newtons. **Red**
is what a rod has too much: drift. **Curves** are coloured like the particles. **Thin and grey**, as
long as it is known: the true motion.

**Go to the end.** Whose rods are longer? Whose energy left zero, and which way?
"""


def frames(steps, dt, particles):
    """The steps to keep for the picture and the recording; a run keeps more, to be judged by."""
    most = max(1, MAX_RECORDED // particles - 2)
    return range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt)), -(-(steps + 1) // most)))


def title(args, used):
    """What was run, in words."""
    return f"{scene_name(args)}, {args.integrator}, steps of {used['dt']:.4g} s"


def scene_name(args):
    """The system's name, without what is no text: a file may be called anything."""
    return Path(args.system).stem.encode(errors="replace").decode()


def outcome(run, dt):
    """What became of a mode, in a few words."""
    if run.stopped:
        return f"lost at {run.kept[-1] * dt:.3g} s"
    return f"off {length(np.max(run.violations))}"


def rod_ends(system, q):
    """Tails, marks and heads of rods, (F, C, 3) each, at q (F, N, 3): tails are at the partners,
    heads at the particles, and marks where a rod that is too long should end."""
    heads, tails = np.moveaxis(nodes(q, system["anchors"])[:, system["pairs"]], 2, 0)
    size = np.maximum(np.linalg.norm(heads - tails, axis=-1, keepdims=True), 1e-300)
    share = np.minimum(1.0, np.reshape(system["lengths"], (-1, 1)) / size)
    return tails, tails + share * (heads - tails), heads


def box(system, runs):
    """Two corners (3,) around the modes whose rods keep to half their length, or else around the
    best; and a length to compare with, one metre if that fits."""
    worst = {m: np.inf if run.stopped else np.max(run.violations) for m, run in runs.items()}
    good = [mode for mode in runs if worst[mode] < 0.5 * np.max(system["lengths"])]
    good = good or [min(worst, key=worst.get)]
    shown = np.concatenate([nodes(runs[mode].q, system["anchors"]) for mode in good])
    low, high = np.min(shown, axis=(0, 1)), np.max(shown, axis=(0, 1))
    size = np.max(high - low)
    return low - 0.06 * size, high + 0.06 * size, min(1.0, 10.0 ** np.floor(np.log10(size)))


def columns(count, shape, size, words):
    """How many of `count` tiles go side by side in a sheet of `shape` (width, height), to show
    things of `size` (x, y) at their largest, above `words`, in pixels; and their room (x, y)."""
    layouts = [(k, shape[0] / k, shape[1] / -(-count // k) - words) for k in range(1, count + 1)]
    return max(layouts, key=lambda layout: min(layout[1] / size[0], layout[2] / size[1]))


def rgb(color, share=1.0):
    """[r, g, b] of a "#rrggbb", or what is `share` (...,) on the way to it from grey: (..., 3)."""
    goal, grey = (np.array([*bytes.fromhex(x[1:])]) for x in (color, GREY))
    return (grey + np.asarray(share)[..., None] * (goal - grey)).astype(np.uint8)


def lines(begins, ends, shown, thickness, color=None, **colors):
    """A style, and rows of lines between points (F, C, 3), of those that are `shown` (F, C)."""
    import rerun as rr  # here: a run without a recording never pays for it

    strips = np.stack([begins, ends], axis=2)[shown]
    style = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(thickness), colors=color)
    rows = rr.LineStrips3D.columns(strips=strips, **colors)
    return style, rows.partition(np.sum(shown, axis=1))


def draw(system, run, pulls, full, color, ball):
    """{entity: (style, rows)} of a mode: rods, particles, the path.

    `pulls` (F, C): newtons of the rods, which glow most at `full`; `color`: of all else; `ball`:
    the radius of a particle.
    """
    import rerun as rr

    tails, marks, heads = rod_ends(system, run.q)
    long = np.linalg.norm(heads - marks, axis=-1) > ball  # else the particle hides it
    share = np.clip(np.abs(pulls) / full, 0.0, 1.0)
    glow = np.where(pulls[..., None] > 0.0, rgb(PULL, share), rgb(PUSH, share))
    particles = rr.Points3D.columns(positions=run.q.reshape(-1, 3))
    particles = particles.partition([run.q.shape[1]] * len(run.q))
    path, thin = rr.Points3D.columns(positions=run.q[:, -1]), rr.Radius.ui_points(1.5)
    return {
        "rods": lines(tails, marks, np.ones_like(long), 3.0, colors=glow.reshape(-1, 3)),
        "excess": lines(marks, heads, long, 4.0, rgb(EXCESS)),
        "particles": (rr.Points3D.from_fields(radii=ball, colors=color), particles),
        "path": (rr.Points3D.from_fields(radii=thin, colors=color), path),
    }


def record(args, used, system, runs, rows, scale, pulls, ghost):
    """The bytes of a recording: kept states of `runs` {mode: Run}, beside `rows` {mode: summary}.

    `args.system` and `args.integrator` name them; `used["dt"]` in s; `pulls` {mode: (F, C)}:
    newtons of the rods in the F kept states; `scale`: the unit of energy errors in J; `ghost`: the
    true motion as long as it is known, (seconds (T,), positions (T, N, 3)), or nothing. Axes fit
    the modes that survive, and one that is lost leaves the picture. The id is made of what was
    found, and no wall clock is written: the same run is the same recording, another run another.
    """
    import rerun as rr

    dt, name = used["dt"], scene_name(args)
    alive = [mode for mode, run in runs.items() if not run.stopped] or list(runs)
    full = np.quantile(np.abs(np.concatenate([pulls[mode].ravel() for mode in alive])), 0.9) or 1.0
    low, high, bar = box(system, runs)
    ball = min(0.018 * np.max(high - low), 0.3 * float(np.min(system["lengths"])))
    curves = {
        FORCES: {mode: pulls[mode][:, 0] for mode in runs},
        RODS: {m: np.log10(np.maximum(run.violations[run.kept], FLOOR)) for m, run in runs.items()},
        ENERGY: {m: (run.energies[run.kept] - run.energies[0]) / scale for m, run in runs.items()},
    }
    lively = {plot: np.concatenate([curve[m] for m in alive]) for plot, curve in curves.items()}
    found = zlib.crc32(repr((dt, rows)).encode())
    settings = {"recording_id": f"{name}-{found:08x}", "send_properties": False}
    recording = rr.RecordingStream(f"constraints: {name}", **settings)
    memory = recording.memory_recording()  # on a full disk rerun's own writer may wait for ever
    layout = blueprint(runs, dt, low, high, lively)
    recording.send_blueprint(layout, make_active=True, make_default=True)  # else a server loses it

    def send(entity, style, columns=None, seconds=None):
        """Send what stays of an entity, if anything does, and its columns at `seconds` (F,)."""
        if style:
            recording.log(entity, style, static=True)
            recording.flush()  # columns take another way and must not overtake
        if columns is not None:
            time = np.round(1e9 * seconds).astype("timedelta64[ns]")
            recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=time)], columns)

    text, anchors = GUIDE.format(title=title(args, used), full=full), system["anchors"][::-1]
    begin = low + [0.03 * (high - low)[0], 0.0, 0.0]
    line = [begin, begin + [bar, 0.0, 0.0]]
    send("panel", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
    send("scene", rr.ViewCoordinates.RIGHT_HAND_Y_UP)
    send("scene/anchors", rr.Points3D(anchors, radii=0.8 * ball, colors=rgb(GREY)))
    send("scene/bar", rr.LineStrips3D([line], labels=f"{bar:g} m", colors=[LABEL]))
    if ghost:
        seconds, q = np.append(ghost[0], ghost[0][-1] + dt), np.append(ghost[1], ghost[1][-1:], 0)
        tails, _, heads = rod_ends(system, q)
        shown = np.broadcast_to(seconds[:, None] < seconds[-1], heads.shape[:2])  # and then nothing
        send("scene/truth", *lines(tails, heads, shown, 1.0, rgb(GREY)), seconds)
    for k, (mode, run) in enumerate(runs.items()):
        key, color, seconds = f"{k + 1}_{mode}", rgb(MODES[mode]), run.kept * dt  # sorted by key
        for entity, drawn in draw(system, run, pulls[mode], full, color, ball).items():
            send(f"scene/{key}/{entity}", *drawn, seconds)
        if run.stopped:
            words = {"labels": [outcome(run, dt)], "colors": [LABEL], "radii": [0.0]}
            said = rr.Points3D.columns(positions=[(low + high) / 2], **words)
            send(f"scene/{key}", None, rr.Clear.columns(is_recursive=[True]), seconds[-1:] + dt)
            send(f"scene/lost_{key}", None, said, seconds[-1:] + dt)
        for plot, curve in enumerate(curves.values()):
            style = rr.SeriesLines(colors=color, names=mode)
            send(f"curves/{plot}/{key}", style, rr.Scalars.columns(scalars=curve[mode]), seconds)
    return memory.drain_as_bytes()


def blueprint(runs, dt, low, high, lively):
    """The layout: tiles, a mode each, that show what is between the corners `low` and `high`, and
    what to look at; beside them plots, whose axes fit `lively` {title: values}."""
    import rerun.blueprint as rrb

    begin, now = (rrb.TimeRangeBoundary.cursor_relative(seconds=s) for s in (-1.0, 0.0))
    trail = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=begin, end=now)])
    end = max(run.kept[-1] for run in runs.values()) * dt
    whole = (rrb.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, 1.04 * end))
    time = rrb.TimeAxis(view_range=rrb.TimeRange(*whole))
    size, middle = high - low, 0.5 * (low + high)
    across, wide, tall = columns(len(runs) + 1, WINDOW, size, TITLE)
    reach = 0.5 * MARGIN * max(size[0] * tall / wide, size[1], size[2])
    eye = middle + [0.0, 0.0, 0.5 * size[2] + reach / SLOPE]
    eye = rrb.EyeControls3D(position=eye, look_target=middle, eye_up=[0.0, 1.0, 0.0])
    seen = {"eye_controls": eye, "line_grid": False, "background": BACKGROUND}
    shared = ["$origin/**", "scene/anchors", "scene/bar", "scene/truth"]
    left, right = [], []
    for k, (mode, run) in enumerate(runs.items()):
        key, name = f"{k + 1}_{mode}", f"{mode}, {outcome(run, dt)}"
        seen |= {"origin": f"scene/{key}", "contents": [*shared, f"scene/lost_{key}"]}
        seen["overrides"] = {f"scene/{key}/path": trail}
        left.append(rrb.Spatial3DView(name=name, **seen))
    left.append(rrb.TextDocumentView(name="what to look at", origin="panel"))
    for plot, (name, values) in enumerate(lively.items()):
        part = (0.005, 0.995) if name == FORCES else (0.0, 1.0)  # a spike of force may be cut off
        least, most = np.quantile(values, part).tolist()
        room = 0.05 * (most - least) + 1e-12
        if name == RODS:
            most = max(most, np.floor(most + room))  # a power of ten whose label needs room, too
        # one legend will do: at first energy is right, and leaves room there
        legend = rrb.PlotLegend(rrb.Corner2D.LeftBottom, visible=name == ENERGY)
        y = rrb.ScalarAxis(range=(least - room, most + room))
        axes = {"axis_x": time, "axis_y": y, "plot_legend": legend}
        right.append(rrb.TimeSeriesView(name=name, origin=f"curves/{plot}", **axes))
    play = {"state": "collapsed", "play_state": "playing", "loop_mode": "all"}
    both = rrb.Grid(*left, grid_columns=across), rrb.Vertical(*right)
    panel = rrb.TimePanel(timeline=TIMELINE, **play)
    return rrb.Blueprint(rrb.Horizontal(*both, column_shares=[3, 2]), panel, collapse_panels=True)
