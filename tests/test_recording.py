"""The recording, read back with Rerun's own reader; the moving picture; the drawings."""

import inspect
import itertools
import re
import subprocess
import sys
from collections import defaultdict
from types import FunctionType, SimpleNamespace
from unittest import mock
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints import picture, publish, recording, svg, tables
from curriculum.ch3_4_constraints.pictures.make_pictures import FOLDER, PICTURES
from curriculum.ch3_4_constraints.studies._runs import energy_scale

import numpy as np
import pytest
from rerun.chunk import RrdReader

SVG = "{http://www.w3.org/2000/svg}"
BLIND = [  # G. Machado, M. Oliveira, L. Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009) 1291
    np.eye(3),
    [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],  # protanopia
    [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],  # deuteranopia
    [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],  # tritanopia
]
TO_XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]


def chunks(reader, **store):
    """{entity: {column: rows}} of a recording or, with `store`, of its blueprint."""
    found = defaultdict(dict)
    for chunk in reader.stream(**store).to_chunks():
        batch = chunk.to_record_batch()
        for name, rows in zip(batch.schema.names, batch.columns, strict=True):
            if name == recording.TIMELINE:
                found[chunk.entity_path]["seconds"] = rows.to_numpy() / np.timedelta64(1, "s")
            elif ":" in name:
                found[chunk.entity_path][name.rpartition(":")[2]] = rows.to_pylist()
    return found


def made(folder, *flags):
    """What a run was recorded of, and its files read again: `found` {entity: {column: rows}},
    `views` {origin: {property: rows}} and `drawn`, the picture's elements."""
    record, views = recording.record, {}
    with mock.patch.object(publish, "record", wraps=record) as noted:
        c.main([*flags, "--out", str(folder)])
    what = inspect.signature(record).bind(*noted.call_args.args).arguments
    reader = RrdReader(str(folder / publish.RECORDING))
    (store,), (blueprint,) = reader.recordings(), reader.blueprints()
    pages = chunks(reader, store=blueprint)
    for entity, page in pages.items():
        if "space_origin" in page:
            inside = [some for name, some in pages.items() if name.startswith(f"{entity}/")]
            view = {name: x[0] for some in (*inside, page) for name, x in some.items()}
            views[f"/{view['space_origin'][0]}"] = view
    what |= {"found": chunks(reader), "views": views, "id": store.recording_id}
    what |= {"drawn": ElementTree.parse(folder / publish.PICTURE), "path": reader.path}
    return SimpleNamespace(**what)


def colors(entity):
    """Colours (K, 3) of all that an entity was."""
    return np.concatenate(entity["colors"])[:, None] >> [24, 16, 8] & 255


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The default run; a leg, whose rods pull and push; and rods that grow beside a lost mode."""
    flags = {"default": "", "leg": "--system jansen_leg --dt 0.01 --steps 200"}
    flags["lost"] = "--dt 0.05 --steps 60 --baumgarte 40"
    return {x: made(tmp_path_factory.mktemp(x), *flags[x].split()) for x in flags}


def test_a_curve_shows_what_its_title_says(recorded):
    leg = recorded["leg"]
    titles = ["pull of the first rod, N", "worst rod, powers of ten of a metre (-3: 1 mm)"]
    titles.append("energy error, share of m g L")
    assert titles == [leg.views[f"/curves/{plot}"]["display_name"][0] for plot in range(3)]
    for k, (mode, done) in enumerate(leg.runs.items()):
        worst = np.maximum(c.constraint_violation(leg.system, done.q), 1e-9)
        joule = c.energy(leg.system, done.q, done.v)
        gained = (joule - joule[0]) / energy_scale(leg.system)
        for plot, curve in enumerate((leg.pulls[mode][:, 0], np.log10(worst), gained)):
            shown = np.ravel(leg.found[f"/curves/{plot}/{k + 1}_{mode}"]["scalars"])
            assert np.max(np.abs(shown - curve)[1:]) < 1e-6 * max(np.ptp(curve), 1e-3)


def test_particles_rods_trail_and_the_true_motion_are_where_they_were(recorded):
    leg = recorded["leg"]
    found, anchors, lengths = leg.found, leg.system["anchors"], leg.system["lengths"]
    assert np.allclose(found["/scene/anchors"]["positions"][0], anchors[::-1])
    (begin, end), (label,) = found["/scene/bar"]["strips"][0][0], found["/scene/bar"]["labels"][0]
    assert f"{np.subtract(end, begin)[0]:g} m" == label
    for k, (mode, done) in enumerate(leg.runs.items()):
        seen, curve = f"/scene/{k + 1}_{mode}", f"/curves/0/{k + 1}_{mode}"
        assert {"$origin/**", "scene/bar", "scene/truth"} < set(leg.views[seen]["query"])
        for entity in (f"{seen}/particles", f"{seen}/path", curve):
            assert colors(found[entity]).tolist() == [recording.rgb(svg.MODES[mode]).tolist()]
            assert np.allclose(found[entity]["seconds"], 0.01 * done.kept, atol=1e-9)
        assert np.allclose(found[f"{seen}/particles"]["positions"], done.q, atol=1e-6)
        assert np.allclose(found[f"{seen}/path"]["positions"], done.q[:, -1:], atol=1e-6)
        for q, rods in zip(done.q, found[f"{seen}/rods"]["strips"], strict=True):
            for rod, length, (i, j) in zip(rods, lengths, leg.system["pairs"], strict=True):
                d = q[i] - (begin := q[j] if j >= 0 else anchors[-1 - j])
                mark = begin + d * min(1.0, length / np.linalg.norm(d))
                assert np.allclose(rod, [begin, mark], atol=1e-6)
    *strips, last = found["/scene/truth"]["strips"]
    heads = np.array(strips)[:, 0, 1]
    assert np.allclose(heads, leg.ghost[1][:, leg.system["pairs"][0][0]], atol=1e-6)
    assert np.allclose(found["/scene/truth"]["seconds"][:-1], leg.ghost[0]) and not last


def test_a_rod_glows_where_it_pulls_and_where_it_pushes(recorded):
    leg = recorded["leg"]
    full = np.quantile(np.abs(np.concatenate(list(leg.pulls.values()))), 0.9)
    assert f"full glow = {full:.3g} newtons" in leg.found["/panel"]["text"][0][0]
    for k, mode in enumerate(leg.runs):
        shown, share = colors(leg.found[f"/scene/{k + 1}_{mode}/rods"]), leg.pulls[mode].ravel()
        glow = np.clip(share / full, -1.0, 1.0)[:, None]
        grey, *ends = (recording.rgb(x).astype(int) for x in (svg.GREY, svg.PULL, svg.PUSH))
        expected = grey + abs(glow) * (np.where(glow > 0.0, *ends) - grey)
        assert np.all(np.abs(shown - expected) <= 1.0) and {-1.0, 1.0} < {*glow.flat}


def test_the_eye_sees_the_whole_scene_from_the_front(recorded):
    for some in recorded.values():
        view, alive = some.views["/scene/1_none"], (x for x in some.runs.values() if not x.stopped)
        q = np.concatenate([run.q for run in alive])
        eye, target = (np.array(view[name][0]) for name in ("position", "look_target"))
        assert np.allclose(target[:2], eye[:2]) and target[2] < eye[2]
        assert view["eye_up"] == [[0.0, 1.0, 0.0]]
        _, wide, tall = recording.columns(6, (840, 800), np.ptp(q.reshape(-1, 3), axis=0)[:2], 28)
        x, y, ahead = np.moveaxis((q - eye) * [1.0, 1.0, -1.0], -1, 0)
        share = np.max(np.abs([x * tall / wide, y]) / ahead) / recording.SLOPE  # of half a tile
        assert np.all(ahead > 0.0) and 0.5 < share < 1.0  # nothing is cut, nor far away


def test_a_lost_mode_leaves_the_picture_and_bends_no_axis(recorded):
    """Its tile says when it was lost; and what a rod of another has too much is red."""
    lost, gone = recorded["lost"], "2_baumgarte"
    done, none, found = lost.runs["baumgarte"], lost.runs["none"], lost.found
    alive = [f"{k + 1}_{m}" for k, (m, run) in enumerate(lost.runs.items()) if not run.stopped]
    assert gone not in alive and "1_none" in alive
    words = f"lost at {0.05 * done.kept[-1]:.3g} s"
    assert np.allclose(found[f"/scene/{gone}"]["seconds"], 0.05 * (done.kept[-1] + 1))
    assert found[f"/scene/{gone}"]["is_recursive"] == [[True]]
    assert found[f"/scene/lost_{gone}"]["labels"] == [[words]]
    assert f"scene/lost_{gone}" in lost.views[f"/scene/{gone}"]["query"]
    off = tables.length(np.max(none.violations))
    for key, name in ((gone, f"baumgarte, {words}"), ("1_none", f"none, off {off}")):
        assert lost.views[f"/scene/{key}"]["display_name"] == [name]
    for plot in range(3):
        curves, view = f"/curves/{plot}", lost.views[f"/curves/{plot}"]
        shown = np.concatenate([found[f"{curves}/{key}"]["scalars"] for key in alive])
        (low, high), (time,) = view["range"][0], view["view_range"]
        assert low < np.quantile(shown, 0.02) and np.quantile(shown, 0.98) < high
        assert high - low < 1.2 * np.ptp(shown) and time["start"] == 0
        if plot == 1:  # the topmost label would be cut in half
            assert high - np.floor(high) > 0.04 * (high - low)
        assert 3.0 < time["end"] / 1e9 < 3.3
    assert np.max(found[f"/curves/2/{gone}"]["scalars"]) > 100.0 * high
    strips, excess = found["/scene/1_none/excess"]["strips"], recording.rgb(svg.EXCESS)
    assert colors(found["/scene/1_none/excess"]).tolist() == [excess.tolist()]
    assert not strips[0]  # at the start no rod is too long, at the end both are
    marks, heads = np.moveaxis(np.array(strips[-1]), 1, 0)
    assert np.allclose(heads, none.q[-1], atol=1e-5)
    assert np.allclose(np.linalg.norm(heads - marks, axis=1), c.rod_errors(lost.system, none.q[-1]))


def test_the_recording_is_small_and_sound_and_a_server_keeps_its_layout(recorded):
    default, command = recorded["default"], [sys.executable, "-m", "rerun", "rrd"]
    assert default.id != recorded["lost"].id  # or a viewer that opens both takes them for one
    assert default.path.stat().st_size < 2_000_000
    subprocess.run([*command, "verify", default.path], check=True, capture_output=True)
    text = subprocess.check_output([*command, "print", recorded["lost"].path], text=True)
    # else a viewer in a browser makes up its own
    assert re.search("BlueprintActivation.*make_active: true, make_default: true", text)
    (said,) = default.found["/panel"]["text"][0]
    assert said.startswith("**double, semi_implicit, steps of 0.005 s**")


def test_the_picture_moves_as_the_run_did(recorded):
    default = recorded["default"]
    for done, tile in zip(default.runs.values(), default.drawn.findall(f"{SVG}svg"), strict=True):
        rods = tile.find(f"{SVG}path/{SVG}animate")
        shapes = [re.findall(r"-?\d+", shape) for shape in rods.get("values").split(";")]
        corners = np.cumsum(np.reshape(shapes, (len(shapes), -1, 2)).astype(float), axis=1)
        assert float(rods.get("dur")[:-1]) / (len(shapes) - 1) == pytest.approx(1 / 20, rel=0.15)
        moved = (corners[:, 1:] - corners[:, :1]) * [1, -1]
        where = done.q[np.isin(done.kept, 9 * np.arange(len(shapes)))][..., :2]
        metre = np.sum(moved * where) / np.sum(where * where)
        assert np.max(np.abs(moved - metre * where)) < 2.0  # tenths of a pixel
        red = [x for x in tile.findall(f"{SVG}path") if x.get("stroke") == svg.EXCESS]
        assert bool(red) == (np.max(done.violations) > 0.025)  # a pixel
    hidden = default.drawn.find(f"{SVG}defs//{SVG}animate[@attributeName='display']")
    assert float(hidden.get("keyTimes")[2:]) == pytest.approx(default.ghost[0][-1] / 20.0, abs=0.01)
    lost = recorded["lost"]  # one mode disappears, and its words say when
    at, shown = lost.runs["baumgarte"].kept[-1], lost.runs["none"].kept[-1]
    *_, hidden = lost.drawn.findall(f"{SVG}svg//{SVG}animate[@attributeName='display']")
    assert 0 < at < shown and float(hidden.get("keyTimes")[2:]) == pytest.approx(at / shown, 0.02)
    assert f"lost at {0.05 * at:.3g} s" in [words.text for words in lost.drawn.iter(f"{SVG}text")]


def test_no_scene_makes_a_large_recording_or_picture():
    """Frames are sixty a second or every step, or fewer; and rods that turn at random are drawn as
    if they were the modes and the true motion."""
    assert list(recording.frames(100, 0.05, 2)) == list(range(101))
    assert len(recording.frames(20_000, 0.001, 2)) == pytest.approx(20 * recording.FRAME_RATE, 0.1)
    for particles, steps in itertools.product([1, 7, 1000, 99_999], [1, 999, 100_000, 3_000_001]):
        kept = {*recording.frames(steps, 1.0, particles), steps // 3, steps}  # a run keeps two more
        assert 0 in kept and len(kept) * particles <= recording.MAX_RECORDED
    # the name of a file may be no text, which no picture could hold
    args, seconds = SimpleNamespace(system="\udcff", integrator="rk4"), 0.01 * np.arange(1001)
    for links, steps in ((1, 1000), (11, 1000), (900, 50)):
        angles = np.random.default_rng(0).normal(size=(steps + 1, links)).cumsum(axis=0)
        q = np.stack([np.sin(angles), np.cos(angles), 0.0 * angles], axis=-1).cumsum(axis=1)
        what = {"kept": np.arange(steps + 1), "q": q, "violations": [0.0], "stopped": None}
        runs = dict.fromkeys(c.hold_table(), SimpleNamespace(**what))
        scene = args, {"dt": 0.01}, c.build_system("chain", links=links), runs
        shown, ghost = recording.frames(steps, 0.01, links), (seconds[: steps + 1], q)
        assert len(picture.motion(*scene, shown, ghost).encode()) <= picture.BYTES


@pytest.mark.parametrize("eyes", BLIND)
def test_modes_and_forces_have_colours_that_all_can_tell_apart(eyes):
    palette = *svg.MODES.values(), svg.PULL, svg.PUSH
    coded = np.array([*map(recording.rgb, palette), recording.BACKGROUND]) / 255.0
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    share = np.clip(light[:-1] @ np.transpose(eyes), 0, 1) @ np.transpose(TO_XYZ)
    root = np.cbrt(share / np.sum(TO_XYZ, axis=1))
    lab = root @ [[0, 500, 0], [116, -500, 200], [0, 0, -200]]  # CIE 1976, of what is not dark
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(lab, 2)) > 10.0
    # contrast of at least 3, as in WCAG, on white and on the viewer's ground, and so on black
    *bright, ground = light @ TO_XYZ[1] + 0.05
    assert 1.05 / max(bright) > 3.0 and min(bright) / ground > 3.0


DRAWN = {name for name in PICTURES if isinstance(PICTURES[name], FunctionType)}


def test_a_drawing_is_what_its_script_makes_and_has_a_title_and_the_colours_of_the_palette():
    """Those that no script makes, too: a mode, a pull and an excess look the same in all."""
    palette = {*svg.MODES.values(), svg.PULL, svg.PUSH, svg.EXCESS, svg.INK, svg.GREY, svg.PALE}
    for path in FOLDER.glob("*.svg"):
        stored = path.read_text(encoding="utf-8")
        assert ElementTree.fromstring(stored).find(f"{SVG}title").text and svg.STYLE in stored
        colours = re.findall(r'(?:fill|stroke)="(.*?)"', stored)
        assert {*colours} <= {*palette, "none", "var(--paper)"}, path.name
        if path.name in DRAWN - {"cost.svg"}:  # which is slow
            assert PICTURES[path.name]() == stored, "make_pictures makes it again"


def test_the_gallery_shows_each_scene():
    gallery = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\((\w+\.svg)\)", gallery)) == PICTURES.keys() - DRAWN
    assert sum((FOLDER / name).stat().st_size for name in PICTURES) < 1_500_000
