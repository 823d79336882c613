"""The recording, read back with Rerun's own reader: what is in it, in which colours, seen from
where; the pictures."""

import itertools
import json
import re
import subprocess
import sys
from collections import defaultdict
from types import SimpleNamespace
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints.pictures.make_pictures import FOLDER, PICTURES
from curriculum.ch3_4_constraints.recording import (
    FRAME_RATE,
    MAX_RECORDED,
    TIMELINE,
    frames,
    record,
)
from curriculum.ch3_4_constraints.studies._runs import energy_scale, run, scene
from curriculum.common import files
from curriculum.common.ruler import Truth

import numpy as np
import pytest
from rerun.chunk import RrdReader

STEEP = np.tan(np.radians(55.0 / 2.0))  # what Rerun's eye sees up and down, per metre ahead
WIDE = 0.7 * STEEP  # and to the sides, in one of six tiles of a window of 1400 x 900


def chunks(reader, **store):
    """{entity: {column: array of Arrow's}} of a recording or, with `store`, of its blueprint."""
    found = defaultdict(dict)
    for chunk in reader.stream(**store).to_chunks():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if ":" in name or name == TIMELINE]
        found[chunk.entity_path] |= {name.rpartition(":")[2]: batch.column(name) for name in names}
    return found


class Recording:
    """What a file holds: its entities, its views {origin: properties}, and what it is called."""

    def __init__(self, path):
        reader = RrdReader(str(path))
        (self.store,), (blueprint,) = reader.recordings(), reader.blueprints()
        self.entities, pages, self.views = chunks(reader), chunks(reader, store=blueprint), {}
        for entity, page in pages.items():
            if "space_origin" in page:
                inside = [values for name, values in pages.items() if name.startswith(f"{entity}/")]
                view = {
                    name: values[name][0].as_py() for values in (*inside, page) for name in values
                }
                self.views[f"/{view['space_origin'][0]}"] = view

    def rows(self, entity, column):
        """A list of what an entity had at each frame, or for ever."""
        return self.entities[entity][column].to_pylist()

    def numbers(self, entity, column):
        """The same as an array."""
        return np.array(self.rows(entity, column), dtype=float)

    def seconds(self, entity):
        """When its frames are."""
        return self.entities[entity][TIMELINE].to_numpy() / np.timedelta64(1, "s")


def rerun(*words):
    return subprocess.run(
        [sys.executable, "-m", "rerun", *map(str, words)], capture_output=True, text=True
    )


def write(path, system, holds, dt, steps, keep=None):
    """Record runs of a system, {mode: Hold}; returns them, and the pulls of their rods."""
    keep = frames(steps, dt, len(system["q0"])) if keep is None else keep
    runs = {
        mode: run(system, "semi_implicit", hold, dt, steps, keep) for mode, hold in holds.items()
    }
    pulls = {mode: c.tensions(system, done.q, done.v, holds[mode]) for mode, done in runs.items()}
    unit = energy_scale(system)
    rows = {mode: done.summary(unit, Truth(0)) for mode, done in runs.items()}
    args, used = (
        SimpleNamespace(system="some", integrator="semi_implicit"),
        {"dt": dt, "error_at": 0.0},
    )
    record(path, args, used, system, runs, rows, unit, lambda: pulls)
    return SimpleNamespace(system=system, dt=dt, runs=runs, pulls=pulls, recording=Recording(path))


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    """The folder that the default run writes."""
    folder = tmp_path_factory.mktemp("default")
    c.main(["--out", str(folder)])
    return folder


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """The leg, with two anchors and rods that pull and push."""
    holds = c.hold_table(0.01)
    holds = {mode: holds[mode] for mode in ("none", "soft")}
    return write(tmp_path_factory.mktemp("leg") / "leg.rrd", scene("jansen_leg"), holds, 0.01, 200)


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """A double pendulum: the rods of one mode grow, and the other blows up."""
    holds = {"none": c.as_hold(0.0), "baumgarte": c.as_hold(40.0)}
    return write(
        tmp_path_factory.mktemp("lost") / "lost.rrd", c.build_system("double"), holds, 0.05, 60
    )


def test_a_rod_pulls_three_m_g_cos(tmp_path):
    mass, length = (
        2.0,
        1.5,
    )  # released level: m v^2 / L is 2 m g cos of the angle, and the weight's share another
    content = {"anchors": [[0, 0, 0]], "particles": [{"position": [length, 0, 0], "mass": mass}]}
    file = tmp_path / "level.json"
    file.write_text(json.dumps(content | {"rods": [{"pair": [0, -1]}]}), encoding="utf-8")
    words = [
        "--system",
        file,
        "--integrator",
        "gauss",
        "--stabilization",
        "none",
        "--steps",
        300,
        "--out",
        tmp_path,
    ]
    c.main([str(word) for word in words])
    found = Recording(tmp_path / "constraints.rrd")
    cos = -found.numbers("/scene/1_none/particles", "positions")[:, 0, 1] / length
    pull = found.numbers("/curves/0/1_none", "scalars")[:, 0]
    assert len(cos) > 80 and cos.min() < 0.01 and cos.max() > 0.99
    assert (
        np.max(np.abs(pull - 3.0 * mass * 9.81 * cos)) < 1e-4
    )  # positions are recorded in single precision


def test_a_curve_shows_what_its_title_says(leg):
    titles = {origin: view["display_name"][0] for origin, view in leg.recording.views.items()}
    m, g = leg.system["m"][:, 0], 9.81
    for k, (mode, done) in enumerate(leg.runs.items()):
        ends = np.concatenate(
            [done.q, np.tile(leg.system["anchors"][::-1], (len(done.q), 1, 1))], axis=1
        )
        lengths = [np.linalg.norm(ends[:, i] - ends[:, j], axis=1) for i, j in leg.system["pairs"]]
        worst = np.max(np.abs(np.transpose(lengths) - leg.system["lengths"]), axis=1)
        joule = np.sum(0.5 * m * np.sum(done.v**2, axis=2) + m * g * done.q[:, :, 1], axis=1)
        expected = {
            "pull of the first rod, N": leg.pulls[mode][:, 0],
            "rod error, log10 of m (-3: a millimetre)": np.log10(np.maximum(worst, 1e-16)),
            "energy error, share of m g L": (joule - joule[0]) / energy_scale(leg.system),
        }
        for plot in range(3):
            shown = leg.recording.numbers(f"/curves/{plot}/{k + 1}_{mode}", "scalars")[:, 0]
            curve = expected.pop(titles[f"/curves/{plot}"])
            assert np.max(np.abs(shown - curve)[1:]) < 1e-6 * np.ptp(
                curve
            )  # at the start all is rounding


def test_particles_rods_anchors_and_trail_are_where_they_were(leg):
    pairs, lengths, anchors = leg.system["pairs"], leg.system["lengths"], leg.system["anchors"]
    assert np.allclose(leg.recording.numbers("/scene/anchors", "positions")[0], anchors)
    for k, (mode, done) in enumerate(leg.runs.items()):
        seen = f"/scene/{k + 1}_{mode}"
        view = leg.recording.views[seen]
        assert view["query"] == ["$origin/**", "scene/anchors"]
        assert view["ranges"] == [
            {"timeline": TIMELINE, "range": {"start": -1_000_000_000, "end": 0}}
        ]  # the trail's
        assert np.allclose(
            leg.recording.numbers(f"{seen}/particles", "positions"), done.q, atol=1e-6
        )
        assert np.allclose(
            leg.recording.numbers(f"{seen}/path", "positions")[:, 0], done.q[:, -1], atol=1e-6
        )
        for entity in ("rods", "excess", "particles", "path"):
            assert np.allclose(
                leg.recording.seconds(f"{seen}/{entity}"), leg.dt * done.kept, atol=1e-9
            )
        for q, rods in list(zip(done.q, leg.recording.rows(f"{seen}/rods", "strips"), strict=True))[
            ::10
        ]:
            for (i, j), length, (tail, mark) in zip(pairs, lengths, np.array(rods), strict=True):
                d = q[i] - (begin := q[j] if j >= 0 else anchors[-1 - j])
                assert np.allclose(tail, begin, atol=1e-6)
                assert np.allclose(
                    mark, begin + d * min(1.0, length / np.linalg.norm(d)), atol=1e-6
                )


def test_what_a_rod_has_too_much_is_white(lost):
    strips = lost.recording.rows("/scene/1_none/excess", "strips")
    assert lost.recording.rows("/scene/1_none/excess", "colors") == [[0xFFFFFFFF]]
    assert not strips[0]  # at the start no rod is too long, at the end both are
    marks, heads = np.moveaxis(np.array(strips[-1]), 1, 0)
    q = lost.runs["none"].q[-1]
    assert np.allclose(heads, q, atol=1e-5)
    too_much = np.linalg.norm(q - [np.zeros(3), q[0]], axis=1) - 1.0
    assert np.allclose(np.linalg.norm(heads - marks, axis=1), too_much, atol=1e-5)


def test_a_rod_is_yellow_where_it_pulls_and_blue_where_it_pushes(leg):
    strong = np.quantile(np.abs(np.concatenate(list(leg.pulls.values()))), 0.9)
    for k, mode in enumerate(leg.runs):
        colors, share = (
            leg.recording.rows(f"/scene/{k + 1}_{mode}/rods", "colors"),
            leg.pulls[mode] / strong,
        )
        red, blue = ((np.array(colors) >> shift & 255).astype(int) for shift in (24, 8))
        assert np.all((red > blue + 100)[share > 0.6]) and np.any(share > 0.6)
        assert np.all((blue > red + 100)[share < -0.6]) and np.any(share < -0.6)
        assert np.all(
            (np.abs(red - blue) < 20)[np.abs(share) < 0.05]
        )  # grey, and all shades between
        assert len(np.unique(red)) > 50


def test_every_mode_has_one_colour_and_no_other_mode_has_it(default):
    found, colors = Recording(default / "constraints.rrd"), defaultdict(set)
    for entity in found.entities:
        if re.search("/(particles|path)$|^/curves", entity):
            (mode,) = re.findall(r"/\d_([a-z]+)", entity)
            colors[mode].add(found.rows(entity, "colors")[0][0])
            assert not entity.startswith("/curves") or found.rows(entity, "names") == [[mode]]
    assert colors.keys() == c.hold_table().keys()
    assert all(len(its) == 1 for its in colors.values()) and len(
        set.union(*colors.values())
    ) == len(colors)


def test_the_eye_sees_the_whole_scene_from_the_front(leg, lost):
    for made, seen in ((leg, "1_none"), (leg, "2_soft"), (lost, "1_none"), (lost, "2_baumgarte")):
        view = made.recording.views[f"/scene/{seen}"]
        eye, target = (np.array(view[name][0]) for name in ("position", "look_target"))
        assert (
            np.allclose(target[:2], eye[:2])
            and target[2] < eye[2]
            and view["eye_up"] == [[0.0, 1.0, 0.0]]
        )
        x, y, ahead = np.moveaxis((made.runs["none"].q - eye) * [1.0, 1.0, -1.0], -1, 0)
        share = np.max(np.abs([x / WIDE, y / STEEP]) / ahead)
        assert (
            np.all(ahead > 0.0) and 0.5 < share < 1.0
        )  # of half a tile: nothing is cut, nor far away


def test_a_lost_mode_leaves_the_picture_and_its_title_says_when(lost):
    done, found = lost.runs["baumgarte"], lost.recording
    assert done.stopped and not lost.runs["none"].stopped
    assert np.allclose(found.seconds("/scene/2_baumgarte"), lost.dt * (done.kept[-1] + 1))
    assert (
        found.rows("/scene/2_baumgarte", "is_recursive") == [[True]]
        and "/scene/1_none" not in found.entities
    )
    titles = [
        found.views[f"/scene/{seen}"]["display_name"][0] for seen in ("1_none", "2_baumgarte")
    ]
    off = np.max(lost.runs["none"].violations)
    assert titles == [
        f"none, off {off:.2g} m",
        f"baumgarte, lost at {lost.dt * done.kept[-1]:.3g} s",
    ]
    assert "**lost**" in found.rows("/panel", "text")[0][0]


def test_no_axis_bends_to_a_lost_mode(lost):
    for plot in range(3):
        view, curve = (
            lost.recording.views[f"/curves/{plot}"],
            lost.recording.numbers(f"/curves/{plot}/1_none", "scalars"),
        )
        (low, high), (time,) = view["range"][0], view["view_range"]
        assert low < curve.min() and curve.max() < high and high - low < 1.2 * np.ptp(curve)
        assert time["start"] == 0 and 3.0 < time["end"] / 1e9 < 3.3
    assert lost.recording.numbers("/curves/2/2_baumgarte", "scalars").max() > 100.0 * high


def test_frames_are_sixty_a_second_or_every_step(default):
    assert list(frames(100, 0.05, 2)) == list(range(101))
    assert len(frames(20_000, 0.001, 2)) == pytest.approx(20.0 * FRAME_RATE, rel=0.1)
    seconds = Recording(default / "constraints.rrd").seconds("/curves/0/5_project")
    assert len(seconds) == pytest.approx(20.0 * FRAME_RATE, rel=0.15)
    assert seconds[0] == 0.0 and seconds[-1] == 20.0 and np.max(np.diff(seconds)) < 1.2 / FRAME_RATE


def test_no_more_positions_are_recorded_than_the_cap():
    for particles, steps in itertools.product(
        [1, 2, 7, 49, 1000, 33_333, 99_999], [1, 999, 100_000, 3_000_001]
    ):
        kept = {*frames(steps, 1.0, particles), steps // 3, steps}  # two a run keeps for itself
        assert 0 in kept and len(kept) * particles <= MAX_RECORDED


def test_the_default_recording_is_small_and_sound(default):
    path = default / "constraints.rrd"
    assert path.stat().st_size < 2_000_000
    done = rerun("rrd", "verify", path)
    assert done.returncode == 0, done.stderr


def test_the_recording_names_its_scene_and_shows_the_numbers_beside_it(default):
    found, rows = (
        Recording(default / "constraints.rrd"),
        json.loads((default / "metrics.json").read_text())["results"],
    )
    (text,) = found.rows("/panel", "text")[0]
    assert all(
        "double" in name for name in (found.store.application_id, found.store.recording_id, text)
    )
    assert text.startswith("**double, semi_implicit, steps of 0.005 s**") and "at 2 s, m" in text
    for mode, row in rows.items():
        numbers = [f"{row[name]:.2g}" for name in ("max_violation", "energy_rel_max", "error")]
        assert f"| {' | '.join([mode, *numbers])} |" in text


def test_equal_runs_are_equal_recordings(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    for path in (one, two):
        write(
            path,
            c.build_system("pendulum"),
            {"none": c.as_hold(0.0)},
            0.0005,
            200_000,
            range(0, 200_001, 2),
        )
    assert rerun("rrd", "compare", one, two).returncode == 0


def test_other_runs_are_other_recordings(tmp_path):
    one, two = tmp_path / "one", tmp_path / "two"
    for path, seed in ((one, 0), (two, 1)):
        write(path, c.build_system("pendulum", seed), {"none": c.as_hold(0.0)}, 0.01, 10)
    assert rerun("rrd", "compare", one, two).returncode != 0
    names = {Recording(path).store.recording_id for path in (one, two)}
    assert len(names) == 2  # else a viewer that opens both would take them for one


def test_what_stands_still_comes_first_and_modes_come_in_their_order(default):
    parts = [
        (part.is_static, part.entity_path)
        for part in RrdReader(str(default / "constraints.rrd")).stream()
    ]
    still, moving = (
        [entity for static, entity in parts if static is kind] for kind in (True, False)
    )
    assert [static for static, _ in parts] == [True] * len(still) + [False] * len(moving)
    assert {entity.split("/")[1] for entity in still + moving} == {
        "scene",
        "curves",
        "panel",
    }  # and no wall clock
    for entities in (still, moving):
        modes = [found[0] for entity in entities if (found := re.findall(r"\d_[a-z]+", entity))]
        assert modes == sorted(modes) and len(set(modes)) == 5


def test_no_recording_is_left_beside_the_numbers_of_another_run(tmp_path, capsys):
    words = ["--steps", "20", "--out", str(tmp_path)]
    c.main(words)
    assert (tmp_path / "constraints.rrd").exists()
    c.main([*words, "--seed", "1", "--no-rerun"])
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]
    assert "look" not in capsys.readouterr().out.rpartition("wrote")[2]


@pytest.mark.parametrize(
    ("platform", "window", "browser"),
    [
        ("linux", None, True),
        ("linux", "DISPLAY", False),
        ("linux", "WAYLAND_DISPLAY", False),
        ("darwin", None, False),
    ],
)
def test_without_a_window_the_recording_opens_in_a_browser(
    platform, window, browser, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(files, "sys", SimpleNamespace(platform=platform))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    if window:
        monkeypatch.setenv(window, ":0")
    c.main(["--steps", "1", "--stabilization", "none", "--out", str(tmp_path)])
    command = f"python -m rerun {'--serve-web ' * browser}{tmp_path / 'constraints.rrd'}"
    assert capsys.readouterr().out.endswith(f"\nlook: {command}\n")


@pytest.mark.parametrize("name", ["forces.svg", "drift.svg"])  # cost.svg takes ten seconds
def test_a_drawing_is_what_its_script_makes(name):
    stored = (FOLDER / name).read_text(encoding="utf-8")
    assert PICTURES[name]() == stored, (
        "make it again: python -m curriculum.ch3_4_constraints.pictures.make_pictures"
    )
    words = {
        text.text
        for text in ElementTree.fromstring(stored).iter("{http://www.w3.org/2000/svg}text")
    }
    assert words >= ({"29.43 N", "25.49 N"} if name == "forces.svg" else set(c.hold_table()))


def test_every_picture_is_there_and_light():
    assert all(0 < (FOLDER / name).stat().st_size < 300_000 for name in PICTURES)
    assert {
        path.name for path in FOLDER.iterdir() if path.suffix in (".svg", ".png")
    } == PICTURES.keys()
