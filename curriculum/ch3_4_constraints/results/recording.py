"""A Rerun recording of a run: a view of each method, and plots of rods, energy and tension."""

import zlib
from functools import partial
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from curriculum.ch3_4_constraints.mechanics.systems import m_g_L, nodes, rod_parts
from curriculum.ch3_4_constraints.results import palette
from curriculum.ch3_4_constraints.results.table import length
from curriculum.common.tracing import vmap

TIMELINE = "sim_time"  # in s
FRAME_RATE = 60  # states shown in a simulated second,
FEW = 50  # but at least so many, if there are,
MANY = 3600  # and at most so many
POINTS = 300_000  # of particles, at most, in all states of a method
TRAIL = 1.0  # s of the last particle's path
FIELD_OF_VIEW = np.radians(55.0)  # from top to bottom, of Rerun's eye
WIDE = 1.5  # a view is at least so many times as wide as high, as the layout has it
MARGIN = 1.15  # around what is seen
FLOOR = 1e-12  # m: no smaller rod error is plotted
TITLES = {
    "violation": "worst rod error, log10 of metres: -3 is 1 mm",
    "energy": "energy error, share of m g L",
    "tension": "tension of the first rod, N: below 0 it pushes",
}
LEGENDS = {  # where no curve is, as a rule: errors grow, and pulls peak late
    "violation": rrb.Corner2D.RightBottom,
    "energy": rrb.Corner2D.LeftBottom,
    "tension": rrb.Corner2D.LeftTop,
}
GUIDE = """**{title}**

1. Each view is a method, and all start alike. When do their paths part?
2. **Red** is what a rod has too much, **blue** what it lacks: in whose view?
3. **Worst rod error**: which curves climb (drift), which stay level (something corrects them)?
4. **Energy error**: who pays with energy for good rods?
5. **Tension**: where does it peak, and which methods blow up there with longer steps (`--dt`)?
"""


def rgb(colors):
    """[r, g, b] of a colour of the palette, as it is on dark."""
    _, on_dark = colors
    return [*bytes.fromhex(on_dark[1:])]


def record(args, system, runs, results, metrics, chapter):
    """The bytes of a recording of runs {method: Outcome}.

    No wall clock is written, and its id is made of the metrics. The recordings of equal runs hold
    the same, as `rerun rrd compare` finds; a header of their files, and so their bytes, differ.
    Rerun frees no stream before Python ends (its issue 2116): each call leaves about 2 MB behind.
    """
    scene = Path(args.system).stem
    name = f"{scene}-{zlib.crc32(metrics.encode()):08x}"
    stream = rr.RecordingStream("constraints", recording_id=name, send_properties=False)
    memory = stream.memory_recording()  # on a full disk rerun's own writer may hang
    try:
        title = f"{scene}, {args.integrator}, steps of {args.dt:.4g} s"
        stream.send_recording_name(title)
        guide = rr.TextDocument(GUIDE.format(title=title), media_type=rr.MediaType.MARKDOWN)
        stream.log("guide", guide, static=True)
        fill(stream, args, system, runs, results, chapter)
    finally:  # after Ctrl-C, too, or rerun warns of what it drops
        content = memory.drain_as_bytes()
    return content


def fill(stream, args, system, runs, results, chapter):
    """Send runs to a stream of Rerun's, and how they are to be looked at."""
    methods = chapter.make_methods(args.dt, **args.knobs)
    places = palette.places(methods)
    scale = m_g_L(system, chapter.GRAVITY)
    alive = [run for run in runs.values() if not run.stopped] or list(runs.values())
    seen = np.concatenate([nodes(run.q, system["anchors"]).reshape(-1, 3) for run in alive])
    ball = min(0.014 * np.max(np.ptp(seen, axis=0)), 0.3 * np.min(system["lengths"]))  # m
    anchors = rr.Points3D(system["anchors"], radii=0.8 * ball, colors=rgb(palette.REFERENCE))
    stream.log("anchors", anchors, static=True)
    values = {plot: [] for plot in TITLES}
    for name, run in runs.items():
        color = rgb(palette.METHODS[places[name]])
        key = rr.escape_entity_path_part(name)
        shown = frames(run)
        seconds = shown * run.dt
        for entity, style, rows in drawn(system, run, shown, color, ball):
            send(stream, f"methods/{key}/{entity}", seconds, rows, style)
        if run.stopped:
            clear = rr.Clear.columns(is_recursive=[True])
            send(stream, f"methods/{key}", seconds[-1:] + run.dt, clear)
        pull = partial(chapter.tensions, system, force=methods[name].make_force(system))
        curves = {
            "violation": np.log10(np.maximum(run.violations[shown], FLOOR)),
            "energy": (run.energies[shown] - run.energies[0]) / scale,
            "tension": vmap(pull)(run.q[shown], run.v[shown])[:, 0],
        }
        style = rr.SeriesLines(colors=[color], names=[name])
        for plot, curve in curves.items():
            send(stream, f"{plot}/{key}", seconds, rr.Scalars.columns(scalars=curve), style)
            if run in alive:
                values[plot].extend(curve)
    stream.send_blueprint(blueprint(results, seen, values))


def send(stream, entity, seconds, rows, style=None):
    """Send rows, one for each of the seconds, and the style of all."""
    if style:
        stream.log(entity, style, static=True)
        stream.flush()  # in this order, whatever the threads do: equal runs, equal recordings
    time = np.round(1e9 * seconds).astype("timedelta64[ns]")
    stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=time)], rows)


def frames(run):
    """The steps of a run that are shown."""
    steps = len(run.tip) - 1
    particles = run.q.shape[1]
    every = min(round(1.0 / (FRAME_RATE * run.dt)), steps // FEW)
    every = max(1, every, -(-steps // min(MANY, POINTS // particles)))
    return np.append(np.arange(0, steps, every), steps)


def drawn(system, run, shown, color, ball):
    """Yield (entity, style, rows) of particles, of the last one's path, and of rods: as far as they
    are right, and what they have too much or lack. `ball`: a particle's radius in m."""
    q = run.q[shown]
    particles = rr.Points3D.columns(positions=q.reshape(-1, 3)).partition([q.shape[1]] * len(q))
    yield "particles", rr.Points3D.from_fields(radii=ball, colors=color), particles
    path = rr.Points3D.columns(positions=q[:, -1])
    yield "path", rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.0), colors=color), path
    entities = "rods", "too_long", "too_short"
    shades = color, rgb(palette.TOO_LONG), rgb(palette.TOO_SHORT)
    for entity, shade, part in zip(entities, shades, rod_parts(system, q), strict=True):
        size = np.linalg.norm(part[:, :, 1] - part[:, :, 0], axis=-1)
        visible = size > (0.0 if entity == "rods" else ball)
        style = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(2.0), colors=shade)
        strips = rr.LineStrips3D.columns(strips=part[visible])
        yield entity, style, strips.partition(np.sum(visible, axis=1))


def eye_for(seen):
    """An eye that has all points `seen` (..., 3) before it."""
    size = np.ptp(seen, axis=0)
    middle = np.min(seen, axis=0) + 0.5 * size
    height = MARGIN * max(size[1], size[0] / WIDE)
    away = [0.0, 0.0, 0.5 * size[2] + 0.5 * height / np.tan(0.5 * FIELD_OF_VIEW)]
    return rrb.EyeControls3D(position=middle + away, look_target=middle, eye_up=[0.0, 1.0, 0.0])


def blueprint(results, seen, values):
    """The layout: a view of each method, of all points `seen` (..., 3); what to look at; and beside
    them the plots, whose axes fit the `values`."""
    eye = eye_for(seen)
    begin = rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL)
    now = rrb.TimeRangeBoundary.cursor_relative(seconds=0.0)
    trail = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=begin, end=now)])
    dark = rgb(palette.PAPER)
    ground = rrb.archetypes.PlotBackground(color=dark)
    views = []
    for name, row in results.items():
        key = rr.escape_entity_path_part(name)
        ends = row["stopped"] or f"rods off by {length(row['max_violation'])}"
        view = rrb.Spatial3DView(
            name=f"{name}: {ends}",
            origin=f"methods/{key}",
            contents=["$origin/**", "/anchors"],
            overrides={f"methods/{key}/path": trail},
            eye_controls=eye,
            line_grid=False,
            background=dark,
        )
        views.append(view)
    views.append(rrb.TextDocumentView(name="what to look at", origin="guide"))
    plots = []
    for plot, title in TITLES.items():
        least, most = np.quantile(values[plot], (0.002, 0.998))  # a spike may be cut off
        room = 0.05 * (most - least) or 1.0
        view = rrb.TimeSeriesView(
            name=title,
            origin=plot,
            axis_y=rrb.ScalarAxis(range=(least - room, most + room)),
            plot_legend=rrb.PlotLegend(LEGENDS[plot]),
            background=ground,
        )
        plots.append(view)
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing")
    sides = rrb.Grid(*views, grid_columns=2), rrb.Vertical(*plots)
    return rrb.Blueprint(rrb.Horizontal(*sides, column_shares=[3, 2]), panel, collapse_panels=True)
