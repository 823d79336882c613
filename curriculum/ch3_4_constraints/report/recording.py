"""A Rerun recording of a run: a view of each method, and plots of rods, energy and force."""

import zlib
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from curriculum.ch3_4_constraints.rods.systems import energy_scale, nodes, rod_parts
from curriculum.common import palette
from curriculum.common.words import in_digits, length

TIMELINE = "sim_time"  # in s
FRAME_RATE = 60  # states shown in a simulated second, if that is neither too FEW nor too MANY
FEW = 50  # states of a run that are shown, at least, if it has them
MANY = 3600  # states of a run that are shown, at most
POINTS = 300_000  # of particles, at most, in all states of a method
TRAIL = 1.0  # s of the last particle's path
FIELD_OF_VIEW = np.radians(55.0)  # from top to bottom, of Rerun's eye
WIDE = 1.5  # a view is at least so many times as wide as high, as the layout has it
MARGIN = 1.15  # around what is seen
FLOOR = 1e-12  # m: no smaller rod error is plotted
VIEWS = [  # what to look for in them, in Markdown
    "Each view is a method, and all start alike. When do their paths part?",
    "**Red** is what a rod has too much, **blue** what it lacks: in whose view?",
]


class Plot(NamedTuple):
    """A plot with a curve for each method."""

    title: str
    question: str  # what to look for, in Markdown
    legend: rrb.Corner2D  # where no curve is, as a rule: all begins small


def plots(rows, scale):
    """{entity: Plot} of what is known of one of these rows of the results.

    Where external_force takes or gives energy, what is gained is no error. `scale`: of energy, in
    J.
    """
    found = {
        "violation": Plot(
            "worst rod error, log10 of metres: -3 is 1 mm",
            "**Worst rod error**: which curves climb (drift), which stay level (corrected)?",
            rrb.Corner2D.RightBottom,
        )
    }
    share = f"share of {in_digits(scale, 3):g} J"
    title = f"energy error, {share}"
    question = "**Energy error**: who pays with energy for good rods?"
    if not all(row["conserves"] for row in rows):
        title = f"energy taken (below 0) or given, {share}"
        question = "**Energy taken or given**: external_force changes it. Do the methods agree?"
    if any(row["energy_rel_max"] is not None for row in rows):
        found["energy"] = Plot(title, question, rrb.Corner2D.LeftBottom)
    if any(row["tension_max"] is not None for row in rows):
        found["force"] = Plot(
            "largest force of a rod so far, N",
            "**Largest force so far**: when does it jump, and what do the rods do just then?",
            rrb.Corner2D.LeftTop,
        )
    return found


def rgb(colors):
    """[r, g, b] of a colour of the palette, as it is on dark."""
    _, on_dark = colors
    return [*bytes.fromhex(on_dark[1:])]


def record(asked, runs, results, metrics):
    """The bytes of a recording of runs {method: Run}.

    No wall clock is written, and its id is made of the metrics. The recordings of equal runs hold
    the same, as `rerun rrd compare` finds; a header of their files, and so their bytes, differ.
    Rerun frees no stream before Python ends (its issue 2116): each call leaves about 2 MB behind.
    """
    name = f"{asked.name}-{zlib.crc32(metrics.encode()):08x}"
    stream = rr.RecordingStream("constraints", recording_id=name, send_properties=False)
    memory = stream.memory_recording()  # on a full disk rerun's own writer may hang
    try:
        fill(stream, asked, runs, results)
    finally:  # after Ctrl-C, too, or rerun warns of what it drops
        content = memory.drain_as_bytes()
    return content


def guide(title, kinds):
    """A text: what to look at."""
    lines = VIEWS + [plot.question for plot in kinds.values()]
    steps = "\n".join(f"{k}. {line}" for k, line in enumerate(lines, 1))
    return rr.TextDocument(f"**{title}**\n\n{steps}\n", media_type=rr.MediaType.MARKDOWN)


def fill(stream, asked, runs, results):
    """Send runs {method: Run} to a stream of Rerun's, and how they are to be looked at."""
    system = asked.system
    scale = energy_scale(system, asked.chapter.gravity)
    kinds = plots(results.values(), scale)
    title = f"{asked.name}, {asked.integrator}, steps of {asked.dt:.4g} s"
    stream.send_recording_name(title)
    stream.log("guide", guide(title, kinds), static=True)
    places = palette.places(asked.chapter.make_methods(asked.dt, **asked.knobs))
    alive = [run for run in runs.values() if not run.stopped] or list(runs.values())
    seen = np.concatenate([nodes(run.q, system["anchors"]).reshape(-1, 3) for run in alive])
    ball = min(0.014 * np.max(np.ptp(seen, axis=0)), 0.3 * np.min(system["lengths"]))  # m
    anchors = rr.Points3D(system["anchors"], radii=0.8 * ball, colors=rgb(palette.REFERENCE))
    stream.log("anchors", anchors, static=True)
    values = {plot: [] for plot in kinds}
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
        style = rr.SeriesLines(colors=[color], names=[name])
        for plot, curve in curves_of(run, results[name], scale, shown).items():
            send(stream, f"{plot}/{key}", seconds, rr.Scalars.columns(scalars=curve), style)
            if run in alive:
                values[plot].extend(curve)
    stream.send_blueprint(blueprint(results, seen, values, kinds))


def curves_of(run, row, scale, shown):
    """{plot: its values (n,)} of a run at the steps that are shown, as far as they are known.

    `scale`: of energy, in J.
    """
    curves = {"violation": np.log10(np.maximum(run.violations[shown], FLOOR))}
    if row["energy_rel_max"] is not None:
        curves["energy"] = (run.energies[shown] - run.energies[0]) / scale
    if row["tension_max"] is not None:
        # Of each moment it would be a scribble: a swing has many peaks.
        curves["force"] = np.fmax.accumulate(run.pulls)[shown]
    return curves


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


def blueprint(results, seen, values, kinds):
    """The layout: a view of each method, of all points `seen` (..., 3); what to look at; and beside
    them the plots of these kinds, whose axes fit the `values`."""
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
    beside = []
    for entity, plot in kinds.items():
        least, most = np.quantile(values[entity] or [0.0], (0.002, 0.998))  # a spike may be cut
        room = 0.05 * (most - least) or 1.0
        view = rrb.TimeSeriesView(
            name=plot.title,
            origin=entity,
            axis_y=rrb.ScalarAxis(range=(least - room, most + room)),
            plot_legend=rrb.PlotLegend(plot.legend),
            background=ground,
        )
        beside.append(view)
    panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing")
    sides = rrb.Grid(*views, grid_columns=2), rrb.Vertical(*beside)
    return rrb.Blueprint(rrb.Horizontal(*sides, column_shares=[3, 2]), panel, collapse_panels=True)
