"""A Rerun recording of a comparison: a tile a mode, and plots of the pull, the rods, the energy."""

import re
import zlib
from typing import NamedTuple

from curriculum.ch3_4_constraints import svg
from curriculum.ch3_4_constraints.geometry import box, rod_ends, tiling

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

if [int(part) for part in rr.__version__.split(".")[:2]] < [0, 38]:  # as pyproject.toml has it
    raise ImportError(f"rerun {rr.__version__} is too old: pip install -e '.'")
TIMELINE, BACKGROUND = "sim_time", [16, 16, 20]  # seconds; dark
WINDOW, TITLE = (840, 800), 28  # pixels that tiles share, as most open it; a tile's title
SLOPE, MARGIN = 0.52, 1.12  # Rerun's eye sees so much up per metre ahead; room around
LABEL = [255, 255, 255]  # its ground is dark in the light theme, too
LOOP = 8.0  # s at the end that are played again and again: there the modes differ
LEGEND = 0.35  # room for the legend, as a share of the time shown
FLOOR = 1e-9  # m: a rod error of less is drawn as 0
PLOTS = {  # titles
    "pull": "pull of the first rod, N",
    "rods": "rods: +6 is 1 mm too long, -6 is 1 mm too short (9: 1 m)",
    "energy": "energy error, share of m g L",
}
GUIDE = """**{title}**

**Rods** glow orange where they pull, violet where they push; full glow = {full:.3g} newtons.
**Red** is what a rod has too much, **dashed blue** what it lacks. **Curves** are coloured like the
particles. **Thin and grey**, as long as it is known: the true motion.

**The last {loop:.3g} s**, where the modes differ most, are played again and again. Whose rods are
too long, whose too short? Whose energy left zero, and which way?
"""


def rgb(color):
    """[r, g, b] of a colour of svg, as a recording has it."""
    return np.array([*bytes.fromhex(svg.RECORDED[color][1:])])


def lines(begins, ends, shown, thickness, color=None, **colors):
    """A style, and rows of lines between points (F, C, 3), of those that are `shown` (F, C)."""
    strips = np.stack([begins, ends], axis=2)[shown]
    style = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(thickness), colors=color)
    rows = rr.LineStrips3D.columns(strips=strips, **colors)
    return style, rows.partition(np.sum(shown, axis=1))


def dashed(begins, ends, shown, color):
    """The same with three dashes for each line."""
    way = ends - begins
    begins, ends = (
        np.concatenate([begins + share * way for share in shares], axis=1)
        for shares in ((0.0, 0.4, 0.8), (0.2, 0.6, 1.0))
    )
    return lines(begins, ends, np.tile(shown, 3), 3.0, color)


def draw(system, q, pulls, full, color, ball):
    """{entity: (style, rows)} of a mode at q (F, N, 3): rods, particles, the path.

    `pulls` (F, C) in N: rods glow most at `full`; `color`: of all else; `ball`: a radius in m.
    """
    tails, marks, heads, error = rod_ends(system, q)
    ends = np.where(error[..., None] > 0.0, marks, heads)
    share = np.clip(np.abs(pulls) / full, 0.0, 1.0)[..., None]
    goal, grey = np.where(pulls[..., None] > 0.0, rgb(svg.PULL), rgb(svg.PUSH)), rgb(svg.GREY)
    glow = (grey + share * (goal - grey)).astype(np.uint8)
    particles = rr.Points3D.columns(positions=q.reshape(-1, 3))
    particles = particles.partition([q.shape[1]] * len(q))
    path, thin = rr.Points3D.columns(positions=q[:, -1]), rr.Radius.ui_points(1.5)
    return {  # what is within a particle is hidden by it, and need not be there
        "rods": lines(tails, ends, np.full(error.shape, True), 3.0, colors=glow.reshape(-1, 3)),
        "excess": lines(marks, heads, error > ball, 4.0, rgb(svg.EXCESS)),
        "missing": dashed(heads, marks, error < -ball, rgb(svg.MISSING)),
        "particles": (rr.Points3D.from_fields(radii=ball, colors=color), particles),
        "path": (rr.Points3D.from_fields(radii=thin, colors=color), path),
    }


def record(comparison):
    """The bytes of a recording of a Comparison.

    Axes fit the modes that survive, and one that is lost leaves the picture. The id is made of what
    was found, and no wall clock is written: equal runs are equal recordings, and no others are.
    """
    checksum = zlib.crc32(repr((comparison.dt, comparison.rows)).encode())
    settings = {"recording_id": f"{comparison.scene}-{checksum:08x}", "send_properties": False}
    plain = re.sub("[^A-Za-z0-9 _-]", "-", comparison.scene)[:100]  # or rerun warns: it renames it
    recording = rr.RecordingStream(f"constraints: {plain}", **settings)
    memory = recording.memory_recording()  # on a full disk rerun's own writer may wait for ever
    try:
        fill(recording, comparison)
    finally:  # after Ctrl-C, too, or rerun warns of what it drops
        content = memory.drain_as_bytes()
    return content


def fill(recording, comparison):
    """Send a Comparison, and how it is to be looked at, to a stream of Rerun's."""
    system, runs = comparison.system, comparison.runs
    tracks = {mode: tracked(comparison, mode) for mode in runs}
    alive = [tracks[mode] for mode, run in runs.items() if not run.stopped] or [*tracks.values()]
    lively = {plot: np.concatenate([track.curves[plot] for track in alive]) for plot in PLOTS}
    full = np.quantile(np.abs(np.concatenate([x.pulls.ravel() for x in alive])), 0.9) or 1.0
    end = max(track.seconds[-1] for track in tracks.values())
    low, high, bar = box(system, runs)
    ball = min(0.014 * np.max(high - low), 0.3 * float(np.min(system["lengths"])))
    layout = blueprint(comparison, end, low, high, lively)
    recording.send_blueprint(layout, make_active=True, make_default=True)  # else a server loses it
    recording.send_recording_name(comparison.title)
    text = GUIDE.format(title=comparison.title, full=full, loop=min(LOOP, end))
    begin = low + [0.03 * (high - low)[0], 0.0, 0.0]
    line = [begin, begin + [bar, 0.0, 0.0]]
    still = {
        "panel": rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN),
        "/": rr.ViewCoordinates.RIGHT_HAND_Y_UP,
        "anchors": rr.Points3D(system["anchors"][::-1], radii=0.8 * ball, colors=rgb(svg.GREY)),
        "bar": rr.LineStrips3D([line], labels=f"{bar:g} m", colors=[LABEL]),
    }
    for entity, shape in still.items():
        send(recording, entity, shape)
    if len(comparison.motion):
        send(recording, "truth", *true_motion(comparison))
    for (mode, track), color in zip(tracks.items(), svg.mode_colors(runs).values(), strict=True):
        drawn = draw(system, track.q, track.pulls, full, rgb(color), ball)
        for part in of_mode(comparison, mode, track, drawn, rgb(color), (low + high) / 2):
            send(recording, *part)


def of_mode(comparison, mode, track, drawn, color, middle):
    """Yield (entity, style, columns, seconds) of a mode: what is `drawn` of it, {entity: (style,
    rows)}, what is said in the `middle` (3,) once it is lost, and its curves."""
    key = rr.escape_entity_path_part(mode)
    for entity, (style, rows) in drawn.items():
        yield f"modes/{key}/{entity}", style, rows, track.seconds
    if comparison.runs[mode].stopped:
        after = track.seconds[-1:] + comparison.dt
        words = {"labels": [comparison.outcome(mode)], "colors": [LABEL], "radii": [0.0]}
        yield f"modes/{key}", None, rr.Clear.columns(is_recursive=[True]), after
        yield f"lost/{key}", None, rr.Points3D.columns(positions=[middle], **words), after
    for plot, curve in track.curves.items():
        many = curve.shape[1]
        style = rr.SeriesLines(colors=[color] * many, names=[mode] * many)
        values = rr.Scalars.columns(scalars=curve.ravel()).partition([many] * len(curve))
        yield f"{plot}/{key}", style, values, track.seconds


def send(recording, entity, style, columns=None, seconds=None):
    """Send what stays of an entity, if anything does, and its columns at `seconds` (F,)."""
    if style:
        recording.log(entity, style, static=True)
        recording.flush()  # columns take another way and must not overtake
    if columns is not None:
        time = np.round(1e9 * seconds).astype("timedelta64[ns]")
        recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=time)], columns)


class Track(NamedTuple):
    """What is shown of a mode, at F states."""

    seconds: np.ndarray  # (F,)
    q: np.ndarray  # (F, N, 3) m
    pulls: np.ndarray  # (F, C) N
    curves: dict  # by plot: (F, n), of as many curves


def tracked(comparison, mode):
    """The Track of a mode."""
    run = comparison.runs[mode]
    steps, q, v = comparison.states(mode, [*comparison.shown, run.kept[-1]])
    pulls = comparison.tensions[mode](q, v)
    *_, errors = rod_ends(comparison.system, q)
    worst = np.stack([np.max(errors, axis=1), -np.min(errors, axis=1)], axis=1)
    rods = np.log10(np.maximum(worst / FLOOR, 1.0)) * [1.0, -1.0]
    energy = (run.energies[steps, None] - run.energies[0]) / comparison.scale
    curves = {"pull": pulls[:, :1], "rods": rods, "energy": energy}
    return Track(steps * comparison.dt, q, pulls, curves)


def true_motion(comparison):
    """The style and the rows of lines of the true motion, which vanish when it is lost, and the
    seconds (F,) of the rows."""
    q = np.append(comparison.motion, comparison.motion[-1:], axis=0)
    known = comparison.shown[: len(comparison.motion)]
    seconds = comparison.dt * np.append(known, known[-1] + 1)
    tails, _, heads, _ = rod_ends(comparison.system, q)
    shown = np.broadcast_to(seconds[:, None] < seconds[-1], heads.shape[:2])
    return *lines(tails, heads, shown, 1.0, rgb(svg.GREY)), seconds


def blueprint(comparison, end, low, high, lively):
    """The layout: tiles, a mode each, that show what is between the corners `low` and `high`, and
    what to look at; beside them plots, whose axes fit `lively` {plot: values}. `end`: in s."""
    begin, now = (rrb.TimeRangeBoundary.cursor_relative(seconds=s) for s in (-1.0, 0.0))
    trail = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=begin, end=now)])
    # one legend will do, and it has room behind the end
    whole = (rrb.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, (1.0 + LEGEND) * end))
    time = rrb.TimeAxis(view_range=rrb.TimeRange(*whole))
    size, middle = high - low, 0.5 * (low + high)
    across, wide, tall = tiling(len(comparison.runs) + 1, WINDOW, size, TITLE)
    reach = 0.5 * MARGIN * max(size[0] * tall / wide, size[1], size[2])
    eye = middle + [0.0, 0.0, 0.5 * size[2] + reach / SLOPE]
    eye = rrb.EyeControls3D(position=eye, look_target=middle, eye_up=[0.0, 1.0, 0.0])
    seen = {"eye_controls": eye, "line_grid": False, "background": BACKGROUND}
    left, right = [], []
    for mode in comparison.runs:
        key = rr.escape_entity_path_part(mode)
        name = f"{mode}, {comparison.outcome(mode)}"
        shared = ["$origin/**", "anchors", "bar", "truth", f"lost/{key}"]
        trails = {f"modes/{key}/path": trail}
        where = {"origin": f"modes/{key}", "contents": shared, "overrides": trails}
        left.append(rrb.Spatial3DView(name=name, **where, **seen))
    left.append(rrb.TextDocumentView(name="what to look at", origin="panel"))
    for plot, values in lively.items():
        part = (0.005, 0.995) if plot == "pull" else (0.0, 1.0)  # a spike of force may be cut off
        least, most = np.quantile(values, part).tolist()
        room = 0.05 * (most - least) + 1e-12
        legend = rrb.PlotLegend(rrb.Corner2D.RightTop, visible=plot == "energy")
        y = rrb.ScalarAxis(range=(least - room, most + room))
        axes = {"axis_x": time, "axis_y": y, "plot_legend": legend}
        right.append(rrb.TimeSeriesView(name=PLOTS[plot], origin=plot, **axes))
    last = [round(1e9 * seconds) for seconds in (max(0.0, end - LOOP), end)]
    loop = {"loop_mode": "selection", "time_selection": rrb.components.AbsoluteTimeRange(*last)}
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing", **loop)
    both = rrb.Grid(*left, grid_columns=across), rrb.Vertical(*right)
    return rrb.Blueprint(rrb.Horizontal(*both, column_shares=[3, 2]), panel, collapse_panels=True)
