"""The recording, read back with Rerun's own reader: what is in it, in which colours, seen from
where; and the drawings."""

import itertools
import re
import subprocess
import sys
from collections import defaultdict
from types import FunctionType, SimpleNamespace
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints import recording, svg, tables
from curriculum.ch3_4_constraints.pictures.make_pictures import FOLDER, PICTURES
from curriculum.ch3_4_constraints.studies._runs import energy_scale, run, scene
from curriculum.common.ruler import Truth

import numpy as np
import pytest
from rerun.chunk import RrdReader


def chunks(reader, **store):
    """{entity: {column: array of Arrow's}} of a recording or, with `store`, of its blueprint."""
    found = defaultdict(dict)
    for chunk in reader.stream(**store).to_chunks():
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if ":" in name or name == recording.TIMELINE]
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
                inside = [some for name, some in pages.items() if name.startswith(f"{entity}/")]
                view = {name: x[0].as_py() for some in (*inside, page) for name, x in some.items()}
                self.views[f"/{view['space_origin'][0]}"] = view
        self.titles = {origin: view["display_name"][0] for origin, view in self.views.items()}

    def rows(self, entity, column):
        """A list of what an entity had at each frame, or for ever."""
        return self.entities[entity][column].to_pylist()

    def numbers(self, entity, column):
        """The same as an array."""
        return np.array(self.rows(entity, column), dtype=float)

    def colors(self, entity):
        """Colours (K, 3) of all that an entity was."""
        packed = np.concatenate(self.rows(entity, "colors"))
        return np.stack([packed >> shift & 255 for shift in (24, 16, 8)], axis=1).astype(int)

    def seconds(self, entity):
        """When its frames are."""
        return self.entities[entity][recording.TIMELINE].to_numpy() / np.timedelta64(1, "s")


def made(path, system, holds, dt, steps, keep=None, seen=0.0):
    """Record runs of `holds` {mode: hold}; the first one is the ghost, `seen` s long."""
    keep = recording.frames(steps, dt, len(system["q0"])) if keep is None else keep
    runs = {m: run(system, "semi_implicit", hold, dt, steps, keep) for m, hold in holds.items()}
    pulls = {m: c.tensions(system, done.q, done.v, holds[m]) for m, done in runs.items()}
    unit, args = energy_scale(system), SimpleNamespace(system="some", integrator="semi_implicit")
    rows, (first, *_) = {m: done.summary(unit, Truth(0)) for m, done in runs.items()}, runs.values()
    known = first.kept * dt <= seen
    ghost = (first.kept[known] * dt, first.q[known]) if seen else None
    recording.record(path, args, {"dt": dt}, system, runs, rows, unit, pulls, ghost)
    found = Recording(path)
    return SimpleNamespace(path=path, system=system, dt=dt, runs=runs, pulls=pulls, found=found)


@pytest.fixture(scope="module")
def default(tmp_path_factory):
    """The five modes of the default run."""
    path = tmp_path_factory.mktemp("default") / "constraints.rrd"
    return made(path, c.build_system("double"), c.hold_table(), 0.005, 4000)


@pytest.fixture(scope="module")
def leg(tmp_path_factory):
    """The leg, with two anchors and rods that pull and push; the truth is known for a second."""
    holds, path = c.hold_table(0.01), tmp_path_factory.mktemp("leg") / "leg.rrd"
    holds = {mode: holds[mode] for mode in ("none", "soft")}
    return made(path, scene("jansen_leg"), holds, 0.01, 200, seen=1.0)


@pytest.fixture(scope="module")
def lost(tmp_path_factory):
    """A double pendulum: the rods of one mode grow, and the other blows up."""
    holds, path = {"none": 0.0, "baumgarte": 40.0}, tmp_path_factory.mktemp("lost") / "lost.rrd"
    holds = {mode: c.as_hold(w) for mode, w in holds.items()}
    return made(path, c.build_system("double"), holds, 0.05, 60)


def test_a_curve_shows_what_its_title_says(leg):
    m, anchors = leg.system["m"][:, 0], leg.system["anchors"]
    for k, (mode, done) in enumerate(leg.runs.items()):
        ends = np.concatenate([done.q, np.tile(anchors[::-1], (len(done.q), 1, 1))], axis=1)
        lengths = [np.linalg.norm(ends[:, i] - ends[:, j], axis=1) for i, j in leg.system["pairs"]]
        worst = np.max(np.abs(np.transpose(lengths) - leg.system["lengths"]), axis=1)
        joule = np.sum(0.5 * m * np.sum(done.v**2, axis=2) + m * 9.81 * done.q[:, :, 1], axis=1)
        expected = {
            "pull of the first rod, N": leg.pulls[mode][:, 0],
            "worst rod, powers of ten of a metre (-3: 1 mm)": np.log10(np.maximum(worst, 1e-9)),
            "energy error, share of m g L": (joule - joule[0]) / energy_scale(leg.system),
        }
        for plot in range(3):
            shown = leg.found.numbers(f"/curves/{plot}/{k + 1}_{mode}", "scalars")[:, 0]
            curve = expected.pop(leg.found.titles[f"/curves/{plot}"])
            off = np.abs(shown - curve)[1:]  # at first, all is rounding
            assert np.max(off) < 1e-6 * np.ptp(curve)


def test_particles_rods_trail_and_the_true_motion_are_where_they_were(leg):
    found, anchors = leg.found, leg.system["anchors"]
    assert np.allclose(found.numbers("/scene/anchors", "positions")[0], anchors[::-1])
    (bar,) = found.numbers("/scene/bar", "strips")[0]
    assert f"{np.linalg.norm(bar[1] - bar[0]):g} m" == found.rows("/scene/bar", "labels")[0][0]
    for k, (mode, done) in enumerate(leg.runs.items()):
        seen, curve = f"/scene/{k + 1}_{mode}", f"/curves/0/{k + 1}_{mode}"
        assert {"$origin/**", "scene/bar", "scene/truth"} < set(found.views[seen]["query"])
        for entity in (f"{seen}/particles", f"{seen}/path", curve):
            assert found.colors(entity).tolist() == [recording.rgb(svg.MODES[mode]).tolist()]
            assert np.allclose(found.seconds(entity), leg.dt * done.kept, atol=1e-9)
        shown = [found.numbers(f"{seen}/{name}", "positions") for name in ("particles", "path")]
        assert np.allclose(shown[0], done.q, atol=1e-6)
        assert np.allclose(shown[1], done.q[:, -1:], atol=1e-6)
        for q, rods in zip(done.q, found.rows(f"{seen}/rods", "strips"), strict=True):
            for rod, (i, j) in enumerate(leg.system["pairs"]):
                d = q[i] - (begin := q[j] if j >= 0 else anchors[-1 - j])
                mark = begin + d * min(1.0, leg.system["lengths"][rod] / np.linalg.norm(d))
                assert np.allclose(rods[rod], [begin, mark], atol=1e-6)
    *strips, last = found.rows("/scene/truth", "strips")
    heads, (first, _) = np.array([rods[0][1] for rods in strips]), leg.system["pairs"][0]
    assert np.allclose(heads, leg.runs["none"].q[: len(heads), first], atol=1e-6)
    assert found.seconds("/scene/truth")[-2] == pytest.approx(1.0, abs=0.03) and not last


def test_a_rod_glows_where_it_pulls_and_where_it_pushes(leg):
    full = np.quantile(np.abs(np.concatenate(list(leg.pulls.values()))), 0.9)
    assert f"full glow = {full:.3g} newtons" in leg.found.rows("/panel", "text")[0][0]
    for k, mode in enumerate(leg.runs):
        colors = leg.found.colors(f"/scene/{k + 1}_{mode}/rods")
        share = leg.pulls[mode].ravel() / full
        for color, part in ((svg.PULL, share > 1.0), (svg.PUSH, share < -1.0)):
            assert np.any(part) and np.all(colors[part] == recording.rgb(color))
        weak = np.abs(share) < 0.01
        assert np.all(np.abs(colors[weak] - recording.rgb(svg.GREY).astype(int)) <= 2)
        assert len(np.unique(colors[:, 2])) > 50  # and all shades between


@pytest.mark.parametrize("name", ["leg", "lost"])
def test_the_eye_sees_the_whole_scene_from_the_front(name, request):
    some = request.getfixturevalue(name)
    view, q = some.found.views["/scene/1_none"], some.runs["none"].q
    eye, target = (np.array(view[name][0]) for name in ("position", "look_target"))
    assert np.allclose(target[:2], eye[:2]) and target[2] < eye[2]
    assert view["eye_up"] == [[0.0, 1.0, 0.0]]
    _, wide, tall = recording.columns(3, (840, 800), np.ptp(q.reshape(-1, 3), axis=0)[:2], 28)
    x, y, ahead = np.moveaxis((q - eye) * [1.0, 1.0, -1.0], -1, 0)
    share = np.max(np.abs([x * tall / wide, y]) / ahead) / recording.SLOPE  # of half a tile
    assert np.all(ahead > 0.0) and 0.5 < share < 1.0  # nothing is cut, nor far away


def test_a_lost_mode_leaves_the_picture_and_bends_no_axis(lost):
    """Its tile says when it was lost; and what a rod of the other has too much is red."""
    done, none, found = lost.runs["baumgarte"], lost.runs["none"], lost.found
    when = lost.dt * done.kept[-1]
    assert done.stopped and not none.stopped
    assert np.allclose(found.seconds("/scene/2_baumgarte"), when + lost.dt)
    assert found.rows("/scene/2_baumgarte", "is_recursive") == [[True]]
    assert found.rows("/scene/lost_2_baumgarte", "labels") == [[f"lost at {when:.3g} s"]]
    assert "scene/lost_2_baumgarte" in found.views["/scene/2_baumgarte"]["query"]
    off = f"none, off {tables.length(np.max(none.violations))}"
    assert {off, f"baumgarte, lost at {when:.3g} s"} < set(found.titles.values())
    for plot in range(3):
        view = found.views[f"/curves/{plot}"]
        curve = found.numbers(f"/curves/{plot}/1_none", "scalars")
        (low, high), (time,) = view["range"][0], view["view_range"]
        assert low < np.quantile(curve, 0.02) and np.quantile(curve, 0.98) < high
        assert high - low < 1.2 * np.ptp(curve) and time["start"] == 0
        assert 3.0 < time["end"] / 1e9 < 3.3
    assert found.numbers("/curves/2/2_baumgarte", "scalars").max() > 100.0 * high
    strips, excess = found.rows("/scene/1_none/excess", "strips"), recording.rgb(svg.EXCESS)
    assert found.colors("/scene/1_none/excess").tolist() == [excess.tolist()]
    assert not strips[0]  # at the start no rod is too long, at the end both are
    marks, heads = np.moveaxis(np.array(strips[-1]), 1, 0)
    assert np.allclose(heads, none.q[-1], atol=1e-5)
    too_much = np.linalg.norm(none.q[-1] - [np.zeros(3), none.q[-1, 0]], axis=1) - 1.0
    assert np.allclose(np.linalg.norm(heads - marks, axis=1), too_much, atol=1e-5)


def test_frames_are_sixty_a_second_or_every_step_and_have_a_cap():
    assert list(recording.frames(100, 0.05, 2)) == list(range(101))
    assert len(recording.frames(20_000, 0.001, 2)) == pytest.approx(20 * recording.FRAME_RATE, 0.1)
    for particles, steps in itertools.product([1, 7, 1000, 99_999], [1, 999, 100_000, 3_000_001]):
        kept = {*recording.frames(steps, 1.0, particles), steps // 3, steps}  # a run keeps two more
        assert 0 in kept and len(kept) * particles <= recording.MAX_RECORDED


def test_the_recording_is_small_and_sound_and_a_server_keeps_its_layout(default, lost):
    assert default.path.stat().st_size < 2_000_000
    command = [sys.executable, "-m", "rerun", "rrd"]
    subprocess.run([*command, "verify", default.path], check=True, capture_output=True)
    text = subprocess.check_output([*command, "print", lost.path], text=True)
    # else a viewer in a browser makes up its own
    assert re.search("BlueprintActivation.*make_active: true, make_default: true", text)
    (said,) = default.found.rows("/panel", "text")[0]
    assert said.startswith("**some, semi_implicit, steps of 0.005 s**")


def test_other_runs_are_other_recordings(tmp_path):
    """Else a viewer that opens both would take them for one. Of equal ones: test_same_bytes."""
    starts, hold = (c.build_system("pendulum", seed) for seed in (0, 1)), {"none": c.as_hold(0.0)}
    both = [made(tmp_path / "x.rrd", start, hold, 0.01, 10).found for start in starts]
    assert both[0].store.recording_id != both[1].store.recording_id


DRAWN = {name for name in PICTURES if isinstance(PICTURES[name], FunctionType)}


@pytest.mark.parametrize("name", sorted(DRAWN - {"cost.svg", "recording.png"}))  # which are slow
def test_a_drawing_is_what_its_script_makes(name):
    stored = (FOLDER / name).read_text(encoding="utf-8")
    assert PICTURES[name]() == stored, "make_pictures makes it again"
    assert ElementTree.fromstring(stored).find("{http://www.w3.org/2000/svg}title").text


def test_the_gallery_shows_each_scene():
    gallery = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\((\w+\.svg)\)", gallery)) == PICTURES.keys() - DRAWN
    assert sum((FOLDER / name).stat().st_size for name in PICTURES) < 1_500_000
