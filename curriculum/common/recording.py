"""A Rerun recording of a chapter: movers seen from the front on the left, their curves over time on the right."""

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from curriculum.common.files import write_whole

TIMELINE = "sim_time"  # seconds
PALETTE = [("red", [230, 60, 50]), ("green", [70, 180, 90]), ("blue", [80, 140, 240]), ("orange", [240, 160, 40])]
PALETTE += [("violet", [190, 110, 230]), ("grey", [150, 150, 150])]


def record(path, name, movers, anchors):
    """Write `path`, whole or not at all, from whole columns, a few calls a mover.

    `movers`: {name: (index into PALETTE, seconds (F,), points (F, N, 3), segments (F, C, 2, 3), {title of
    a curve: (F,)})}; the last point leaves a path of a second. `anchors` (K, 3) stand still. Seen in the x-y plane,
    y up, all of the motion. Ids are fixed, no wall-clock timeline is written: the same run is the same recording.
    """
    points = np.concatenate([mover[2].reshape(-1, 3) for mover in movers.values()])
    low, high = np.quantile(points, (0.01, 0.99), axis=0)  # one that flies away shall not shrink the others to a dot
    low, high = np.minimum(low, anchors.min(axis=0)), np.maximum(high, anchors.max(axis=0))
    middle, reach = 0.5 * (low + high), 0.55 * float(np.max(high - low))
    begin, end = (rrb.TimeRangeBoundary.cursor_relative(seconds=s) for s in (-1.0, 0.0))
    last_second = rrb.VisibleTimeRanges([rrb.VisibleTimeRange(TIMELINE, start=begin, end=end)])
    front = middle + np.array([0.0, 0.0, 2.2 * reach])
    scene = rrb.Spatial3DView(
        name=", ".join(f"{PALETTE[color][0]}: {key}" for key, (color, *_) in movers.items()),
        origin="scene",
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=front, look_target=middle, eye_up=[0.0, 1.0, 0.0]),
        line_grid=False,
        background=[16, 16, 20],
        overrides={f"scene/{key}/path": last_second for key in movers},
    )
    titles = list(next(iter(movers.values()))[-1])
    plots = [rrb.TimeSeriesView(name=title, origin=f"curves/{k}") for k, title in enumerate(titles)]
    blueprint = rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(*plots), column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"),
        collapse_panels=True,
    )

    def write(temporary):
        recording = rr.RecordingStream(name, recording_id=name, send_properties=False)
        recording.save(temporary, default_blueprint=blueprint)
        recording.log("scene", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
        recording.log("scene/anchors", rr.Points3D(anchors, radii=0.02 * reach, colors=[150, 150, 150]), static=True)
        for key, (index, seconds, points, segments, curves) in movers.items():
            color = PALETTE[index][1]
            frames, count = segments.shape[:2]
            line, dot, ball = (
                kind.from_fields(radii=size * reach, colors=color)
                for kind, size in ((rr.LineStrips3D, 0.006), (rr.Points3D, 0.006), (rr.Points3D, 0.025))
            )
            strips = rr.LineStrips3D.columns(strips=segments.reshape(-1, 2, 3)).partition([count] * frames)
            balls = rr.Points3D.columns(positions=points.reshape(-1, 3)).partition([points.shape[1]] * frames)
            entities = {
                f"scene/{key}/rods": (line, strips),
                f"scene/{key}/particles": (ball, balls),
                f"scene/{key}/path": (dot, rr.Points3D.columns(positions=points[:, -1])),
            }
            for k, title in enumerate(titles):
                curve = rr.Scalars.columns(scalars=curves[title])
                entities[f"curves/{k}/{key}"] = (rr.SeriesLines(colors=color), curve)
            for entity, (style, columns) in entities.items():
                recording.log(entity, style, static=True)
                recording.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=seconds)], columns)
        recording.flush()
        recording.disconnect()

    write_whole(path, write)
