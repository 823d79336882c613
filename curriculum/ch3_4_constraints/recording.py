"""A Rerun recording of a comparison: a view a mode from the front, and over time the pull, the rods
and the energy."""

import zlib
from pathlib import Path


import numpy as np

FRAME_RATE, MAX_RECORDED = (
    60.0,
    300_000,
)  # frames a simulated second; positions of all frames of a mode, at most
TIMELINE, BACKGROUND = "sim_time", [16, 16, 20]  # seconds; dark
COLORS = {
    "none": [235, 100, 50],
    "baumgarte": [20, 175, 120],
    "impulse": [80, 180, 235],
    "soft": [200, 215, 60],
}
COLORS["project"] = [215, 125, 175]
GREY, YELLOW, BLUE, WHITE = [110, 110, 115], [255, 190, 40], [60, 150, 255], [255, 255, 255]
SLOPE, SHAPE, MARGIN = (
    0.52,
    0.7,
    1.12,
)  # Rerun's eye sees so much up per metre ahead; a tile's width per height; room
ROUNDING = 1e-16  # m: a rod error of less is drawn as this
PULL, RODS, ENERGY = (
    "pull of the first rod, N",
    "rod error, log10 of m (-3: a millimetre)",
    "energy error, share of m g L",
)
GUIDE = """
Worst rod, worst energy, and how far from the true motion at {when}.

**Rods** glow yellow where they pull, blue where they push. **White** is what a rod has too much: drift.
**Curves** are coloured like the particles.{lost}

**Go to the end.** Whose rods are longer? Whose energy left zero, and which way?
"""
LOST = " A **lost** mode is drawn no more."


def frames(steps, dt, particles):
    """The steps to record: with the two states that every run keeps, no more than MAX_RECORDED
    positions allow."""
    most = max(1, MAX_RECORDED // particles - 2)
    return range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt)), -(-(steps + 1) // most)))


def rod_ends(pairs, q, anchors):
    """Where rods begin, at their partner or anchor, and end, at their particle: (F, C, 3) each, of
    q (F, N, 3)."""
    i, j = np.transpose(pairs)
    ends = np.concatenate([q, np.broadcast_to(anchors[::-1], (len(q), *anchors.shape))], axis=1)
    return ends[:, j], q[:, i]


def glow(pulls, full):
    """Colours (F * C, 3) of rods that pull with `pulls` (F, C) newtons: grey at none, yellow or
    blue from `full` on."""
    share, grey = np.clip(np.abs(pulls) / full, 0.0, 1.0)[..., None], np.array(GREY)
    return (
        (grey + share * (np.where(pulls[..., None] > 0.0, YELLOW, BLUE) - grey))
        .astype(np.uint8)
        .reshape(-1, 3)
    )


def look_at(points):
    """Where the eye stands and what it looks at, for all points (P, 3) to be in a tile; and half
    that tile's height."""
    low, high = points.min(axis=0), points.max(axis=0)
    half, middle = 0.5 * (high - low), 0.5 * (low + high)
    reach = MARGIN * max(half[0] / SHAPE, half[1], half[2])
    return middle + [0.0, 0.0, half[2] + reach / SLOPE], middle, reach


def panel(runs, rows, title, when):
    """What to look at, in Markdown."""
    cells = [("mode", "rods, m", "energy", f"at {when}, m"), ("---",) * 4]
    for mode, run in runs.items():
        numbers = (np.max(run.violations), rows[mode]["energy_rel_max"], rows[mode]["error"])
        cells.append((mode, *("-" if x is None else f"{x:.2g}" for x in numbers)))
    lost = LOST if any(run.stopped for run in runs.values()) else ""
    table = "\n".join(f"| {' | '.join(row)} |" for row in cells)
    return f"**{title}**\n\n{table}\n{GUIDE.format(when=when, lost=lost)}"


def span(curves):
    """The least and the largest value of some curves, and a little room."""
    values = np.concatenate(curves)
    low, high = float(values.min()), float(values.max())
    room = 0.05 * (high - low) + 1e-12
    return low - room, high + room


def draw(run, ends, lengths, colors, color, ball):
    """({entity: its style}, {entity: columns, a row a frame}) of a mode: rods from and to `ends`,
    particles, the path.

    `colors`: of the rods, frame by frame; `color`: of all else; `ball`: the radius of a particle in
    m.
    """
    import rerun as rr

    tails, heads = ends
    d, length = heads - tails, lengths[:, None]
    size = np.sqrt(np.sum(d * d, axis=-1, keepdims=True))
    marks = tails + d * np.minimum(1.0, length / size)  # where the rods should end
    long = (size - length)[..., 0] > ball  # else the particle hides it
    rods = rr.LineStrips3D.columns(
        strips=np.stack([tails, marks], axis=2).reshape(-1, 2, 3), colors=colors
    )
    excess = rr.LineStrips3D.columns(strips=np.stack([marks, heads], axis=2)[long])
    particles, (count, many) = rr.Points3D.columns(positions=run.q.reshape(-1, 3)), run.q.shape[:2]
    thick, thin = rr.Radius.ui_points(3.0), rr.Radius.ui_points(1.5)
    style = {
        "rods": rr.LineStrips3D.from_fields(radii=thick),
        "excess": rr.LineStrips3D.from_fields(radii=thick, colors=WHITE),
        "particles": rr.Points3D.from_fields(radii=ball, colors=color),
        "path": rr.Points3D.from_fields(radii=thin, colors=color),
    }
    return style, {
        "rods": rods.partition([len(lengths)] * count),
        "excess": excess.partition(long.sum(axis=1)),
        "particles": particles.partition([many] * count),
        "path": rr.Points3D.columns(positions=run.q[:, -1]),
    }


def pulls(tensions, system, runs, holds):
    """{mode: (F, C)}: tensions(system, q, v, hold) of the states (F, N, 3) that `runs` kept, each
    state by itself."""
    return {
        mode: each(lambda q, v, hold=holds[mode]: tensions(system, q, v, hold), run.q, run.v)
        for mode, run in runs.items()
    }


def record(path, args, used, system, runs, rows, fall, pulls):
    """Write `path`: the kept states of `runs` {mode: Run}, beside `rows` {mode: summary}.

    `args.system` and `args.integrator` name them; `used["dt"]` and `used["error_at"]` in s;
    `pulls()` {mode: (F, C)}:
    newtons of the rods in the F kept states; `fall`: the unit of energy errors in J. Axes fit the
    modes that survive, and one that is lost leaves the picture. The id is made of what was found,
    and no wall clock is written: the same run is the same recording, and another run another one.
    """
    import rerun as rr  # here: a run without a recording never pays for it

    name, dt, pulls = Path(args.system).stem, used["dt"], pulls()
    alive = [mode for mode, run in runs.items() if not run.stopped] or list(runs)
    lengths, anchors = (
        np.asarray(x, dtype=float)
        for x in (system["lengths"], system.get("anchors", [np.zeros(3)]))
    )
    full = (
        float(np.quantile(np.abs(np.concatenate([pulls[mode].ravel() for mode in alive])), 0.9))
        or 1.0
    )
    eye, target, reach = look_at(
        np.concatenate([runs[mode].q.reshape(-1, 3) for mode in alive] + [anchors])
    )
    ball = min(0.025 * reach, 0.3 * float(np.min(lengths)))
    curves = {
        PULL: {mode: pulls[mode][:, 0] for mode in runs},
        RODS: {
            mode: np.log10(np.maximum(run.violations[run.kept], ROUNDING))
            for mode, run in runs.items()
        },
        ENERGY: {
            mode: (run.energies[run.kept] - run.energies[0]) / fall for mode, run in runs.items()
        },
    }
    end = max(run.kept[-1] for run in runs.values()) * dt
    title = f"{name}, {args.integrator}, steps of {dt:.4g} s"
    text = panel(runs, rows, title, f"{used['error_at']:.3g} s")
    still = {
        "scene": rr.ViewCoordinates.RIGHT_HAND_Y_UP,
        "scene/anchors": rr.Points3D(anchors, radii=0.8 * ball, colors=GREY),
        "panel": rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN),
    }
    moving = []  # (entity, seconds (F,), columns)
    for k, (mode, run) in enumerate(runs.items()):
        key, color, seconds = (
            f"{k + 1}_{mode}",
            COLORS.get(mode, GREY),
            run.kept * dt,
        )  # the viewer sorts by key
        ends = rod_ends(system["pairs"], run.q, anchors)
        style, columns = draw(run, ends, lengths, glow(pulls[mode], full), color, ball)
        still |= {f"scene/{key}/{entity}": what for entity, what in style.items()}
        moving += [(f"scene/{key}/{entity}", seconds, what) for entity, what in columns.items()]
        if run.stopped:
            moving.append(
                (f"scene/{key}", seconds[-1:] + dt, rr.Clear.columns(is_recursive=[True]))
            )
        for plot, curve in enumerate(curves.values()):
            still[f"curves/{plot}/{key}"] = rr.SeriesLines(colors=color, names=mode)
            moving.append(
                (f"curves/{plot}/{key}", seconds, rr.Scalars.columns(scalars=curve[mode]))
            )

    unique = f"{name}-{zlib.crc32(repr((dt, rows)).encode()):08x}"
    at_once = rr.ChunkBatcherConfig(
        flush_num_rows=1
    )  # what is logged goes to the file as it comes, not in a heap
    recording = rr.RecordingStream(
        f"constraints: {name}", recording_id=unique, send_properties=False, batcher_config=at_once
    )
    ranges = {title: span([curve[mode] for mode in alive]) for title, curve in curves.items()}
    memory = (
        recording.memory_recording()
    )  # written at the end, by us: on a full disk rerun's own writer may wait forever
    layout = blueprint(runs, dt, end, eye, target, ranges)
    recording.send_blueprint(layout, make_active=False, make_default=True)
    for entity, what in still.items():
        recording.log(entity, what, static=True)
    recording.flush()  # columns take another way and must not overtake
    for entity, seconds, columns in moving:
        time = np.round(1e9 * seconds).astype("timedelta64[ns]")
        recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=time)], columns)
    recording.flush()
    Path(path).write_bytes(memory.drain_as_bytes())
    recording.disconnect()


def blueprint(runs, dt, end, eye, target, ranges):
    """The layout: tiles seen from `eye`, a mode each, and what to look at; beside them plots,
    `ranges` {title: y}."""
    import rerun.blueprint as rrb

    begin, now = (rrb.TimeRangeBoundary.cursor_relative(seconds=s) for s in (-1.0, 0.0))
    trail = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=begin, end=now)])
    whole = (rrb.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, 1.04 * end))
    time = rrb.TimeAxis(view_range=rrb.TimeRange(*whole))
    tiles = []
    for k, (mode, run) in enumerate(runs.items()):
        scene, lost = f"scene/{k + 1}_{mode}", f"lost at {run.kept[-1] * dt:.3g} s"
        tiles.append(
            rrb.Spatial3DView(
                name=f"{mode}, {lost if run.stopped else f'off {np.max(run.violations):.2g} m'}",
                origin=scene,
                contents=["$origin/**", "scene/anchors"],
                eye_controls=rrb.EyeControls3D(
                    position=eye, look_target=target, eye_up=[0.0, 1.0, 0.0]
                ),
                line_grid=False,
                background=BACKGROUND,
                overrides={f"{scene}/path": trail},
            )
        )
    plots = []
    for plot, (title, reach) in enumerate(ranges.items()):
        plots.append(
            rrb.TimeSeriesView(
                name=title,
                origin=f"curves/{plot}",
                axis_x=time,
                axis_y=rrb.ScalarAxis(range=reach),
                plot_legend=rrb.PlotLegend(
                    rrb.Corner2D.LeftBottom, visible=title == RODS
                ),  # over rounding errors
            )
        )
    tiles.append(rrb.TextDocumentView(name="what to look at", origin="panel"))
    left, right = rrb.Grid(*tiles, grid_columns=3 if len(runs) > 1 else 1), rrb.Vertical(*plots)
    play = rrb.TimePanel(
        timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"
    )
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]), play, collapse_panels=True
    )
