"""The recording, read back with Rerun's own reader; the moving picture; the drawings."""

import gc
import itertools
import re
from collections import defaultdict
from types import FunctionType, SimpleNamespace
from unittest import mock
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints import geometry, picture, publish, recording, svg
from curriculum.ch3_4_constraints.comparison import FRAME_RATE, FRAMES, Comparison, frames
from curriculum.ch3_4_constraints.pictures.make_pictures import FOLDER, PICTURES
from curriculum.ch3_4_constraints.studies._runs import energy_scale
from curriculum.ch3_4_constraints.tables import length
from curriculum.common import aim, ruler

import numpy as np
import pytest
from conftest import held, true_run
from rerun.chunk import RrdReader

SVG = "{http://www.w3.org/2000/svg}"
GROUND = f"#{bytes(recording.BACKGROUND).hex()}"
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
    """The Comparison that a run has found, and its files read again: `seen` {entity: {column:
    rows}}, `views` {origin: {property: rows}} and `drawn`, the picture's elements."""
    with mock.patch.object(recording, "record", wraps=recording.record) as noted:
        c.main([*flags, "--no-page", "--out", str(folder)])
    (comparison,) = noted.call_args.args
    reader = RrdReader(str(folder / publish.RECORDING))
    (store,), (blueprint,) = reader.recordings(), reader.blueprints()
    pages, views = chunks(reader, store=blueprint), {}
    for entity, page in pages.items():
        if "space_origin" in page:
            inside = [some for name, some in pages.items() if name.startswith(f"{entity}/")]
            view = {name: x[0] for some in (*inside, page) for name, x in some.items()}
            views[f"/{view['space_origin'][0]}"] = view
    what = {"seen": chunks(reader), "views": views, "id": store.recording_id, "pages": pages}
    what |= {"drawn": ElementTree.parse(folder / publish.PICTURE), "comparison": comparison}
    what["size"] = (folder / publish.RECORDING).stat().st_size
    return SimpleNamespace(**comparison._asdict(), **what)


def colors(entity):
    """Colours (K, 3) of all that an entity was."""
    return np.concatenate(entity["colors"])[:, None] >> [24, 16, 8] & 255


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The default run; a leg, whose rods pull and push; and rods that grow beside a lost mode."""
    folder = tmp_path_factory.mktemp("recorded")
    flags = {"default": "", "leg": "--system jansen_leg --dt 0.01 --steps 200"}
    flags["lost"] = "--dt 0.05 --steps 60 --baumgarte 40"
    return {name: made(folder / name, *words.split()) for name, words in flags.items()}


def test_a_curve_shows_what_its_title_says(recorded):
    leg, rods = recorded["leg"], "rods: +6 is 1 mm too long, -6 is 1 mm too short (9: 1 m)"
    titles = "pull of the first rod, N", rods, "energy error, share of m g L"
    for mode in leg.runs:
        _, q, v = leg.comparison.states(mode, leg.shown)
        errors = np.array([c.rod_errors(leg.system, state) for state in q])
        over, under = (np.log10(np.maximum(1e9 * x, 1.0)) for x in (errors.max(1), -errors.min(1)))
        joule = np.array([c.energy(leg.system, *state) for state in zip(q, v, strict=True)])
        gained = (joule - joule[0]) / energy_scale(leg.system)
        pull = leg.tensions[mode](q, v)[:, 0]
        curves = pull[:, None], np.stack([over, -under], axis=1), gained[:, None]
        for plot, title, curve in zip(("/pull", "/rods", "/energy"), titles, curves, strict=True):
            assert leg.views[plot]["display_name"] == [title]
            shown = np.array([*leg.seen[f"{plot}/{mode}"]["scalars"]])
            assert np.max(np.abs(shown - curve)[1:]) < 1e-6 * max(np.ptp(curve), 1e-3)


def test_particles_rods_trail_and_the_true_motion_are_where_they_were(recorded):
    leg = recorded["leg"]
    seen, anchors, lengths = leg.seen, leg.system["anchors"], leg.system["lengths"]
    assert np.allclose(seen["/anchors"]["positions"][0], anchors[::-1])
    (begin, end), (label,) = seen["/bar"]["strips"][0][0], seen["/bar"]["labels"][0]
    assert f"{np.subtract(end, begin)[0]:g} m" == label
    for mode in leg.runs:
        steps, q, _ = leg.comparison.states(mode, leg.shown)
        tile = f"/modes/{mode}"
        assert {"$origin/**", "bar", "truth"} < set(leg.views[tile]["query"])
        for entity in (f"{tile}/particles", f"{tile}/path", f"/pull/{mode}"):
            assert colors(seen[entity]).tolist() == [recording.rgb(svg.MODES[mode]).tolist()]
            assert np.allclose(seen[entity]["seconds"], 0.01 * steps, atol=1e-9)
        assert np.allclose(seen[f"{tile}/particles"]["positions"], q, atol=1e-6)
        assert np.allclose(seen[f"{tile}/path"]["positions"], q[:, -1:], atol=1e-6)
        for state, rods in zip(q, seen[f"{tile}/rods"]["strips"], strict=True):
            for rod, size, (i, j) in zip(rods, lengths, leg.system["pairs"], strict=True):
                d = state[i] - (begin := state[j] if j >= 0 else anchors[-1 - j])
                mark = begin + d * min(1.0, size / np.linalg.norm(d))
                assert np.allclose(rod, [begin, mark], atol=1e-6)
    *strips, last = seen["/truth"]["strips"]
    heads = np.array(strips)[:, 0, 1]
    assert np.allclose(heads, leg.motion[:, leg.system["pairs"][0][0]], atol=1e-6)
    # a frame of its own for each of the modes': a viewer would hold an old one
    known = 0.01 * leg.shown[: len(heads)]
    assert np.allclose(seen["/truth"]["seconds"][:-1], known) and not last


def test_the_true_motion_is_shown_as_long_as_it_is_known(recorded, monkeypatch):
    default = recorded["default"]
    assert len(default.motion) == len(default.shown)  # 20 s
    truth, _ = ruler.true_position(true_run("double"), default.shown[133] * 0.005)
    assert ruler.distance(default.motion[133], truth) < 1e-5
    chain, shown = true_run("chain"), frames(4000, 0.005, 10)
    sought = c.build_system("chain"), 0.005, shown, ruler.Truth(0)
    motion = ruler.true_motion(chain, *sought)
    assert 10.0 < 0.005 * shown[len(motion)] < 20.0  # s
    other = held("chain", "project")("gauss:12:1e-14", 0.0075, 1800, range(0, 1800, 2))
    apart = [ruler.distance(*pair) for pair in zip(motion, other.q, strict=False)]
    assert max(apart) < ruler.CLOSE
    monkeypatch.setattr(ruler, "HORIZON", 3.0)  # it is sought step by step, further and further
    assert np.array_equal(ruler.true_motion(chain, *sought), motion)


def test_a_rod_glows_where_it_pulls_and_where_it_pushes(recorded):
    leg = recorded["leg"]
    pulls = {m: leg.tensions[m](*leg.comparison.states(m, leg.shown)[1:]) for m in leg.runs}
    full = np.quantile(np.abs(np.concatenate([*pulls.values()])), 0.9)
    assert f"full glow = {full:.3g} newtons" in leg.seen["/panel"]["text"][0][0]
    grey, *ends = (recording.rgb(x).astype(int) for x in (svg.GREY, svg.PULL, svg.PUSH))
    for mode, newtons in pulls.items():
        glow = np.clip(newtons.ravel() / full, -1.0, 1.0)[:, None]
        expected = grey + abs(glow) * (np.where(glow > 0.0, *ends) - grey)
        assert np.all(np.abs(colors(leg.seen[f"/modes/{mode}/rods"]) - expected) <= 1.0)
        assert {-1.0, 1.0} < {*glow.flat}


def test_the_eye_sees_the_whole_scene_from_the_front(recorded):
    for some in recorded.values():
        view, alive = some.views["/modes/none"], (x for x in some.runs.values() if not x.stopped)
        q = np.concatenate([run.q for run in alive])
        eye, target = (np.array(view[name][0]) for name in ("position", "look_target"))
        assert np.allclose(target[:2], eye[:2]) and target[2] < eye[2]
        assert view["eye_up"] == [[0.0, 1.0, 0.0]]
        _, wide, tall = geometry.tiling(6, (840, 800), np.ptp(q.reshape(-1, 3), axis=0)[:2], 28)
        x, y, ahead = np.moveaxis((q - eye) * [1.0, 1.0, -1.0], -1, 0)
        share = np.max(np.abs([x * tall / wide, y]) / ahead) / recording.SLOPE  # of half a tile
        assert np.all(ahead > 0.0) and 0.5 < share < 1.0  # nothing is cut, nor far away


def test_a_lost_mode_leaves_the_picture_and_bends_no_axis(recorded):
    """Its tile says when it was lost."""
    lost = recorded["lost"]
    done, seen = lost.runs["baumgarte"], lost.seen
    alive = [mode for mode, run in lost.runs.items() if not run.stopped]
    assert "baumgarte" not in alive and "none" in alive
    words = f"lost at {0.05 * done.kept[-1]:.3g} s"
    assert np.allclose(seen["/modes/baumgarte"]["seconds"], 0.05 * (done.kept[-1] + 1))
    assert seen["/modes/baumgarte"]["is_recursive"] == [[True]]
    assert seen["/lost/baumgarte"]["labels"] == [[words]]
    assert "lost/baumgarte" in lost.views["/modes/baumgarte"]["query"]
    off = length(np.max(lost.runs["none"].violations))
    for mode, name in (("baumgarte", f"baumgarte, {words}"), ("none", f"none, off {off}")):
        assert lost.views[f"/modes/{mode}"]["display_name"] == [name]
    for folder in ("/pull", "/rods", "/energy"):
        view = lost.views[folder]
        shown = np.concatenate([np.ravel([*seen[f"{folder}/{m}"]["scalars"]]) for m in alive])
        (low, high), (time,) = view["range"][0], view["view_range"]
        assert low < np.quantile(shown, 0.02) and np.quantile(shown, 0.98) < high
        assert high - low < 1.2 * np.ptp(shown) and time["start"] == 0
        assert 3.5 < time["end"] / 1e9 < 5.0  # behind the end of 3 s there is the legend
    assert np.max([*seen["/energy/baumgarte"]["scalars"]]) > 100.0 * high


def test_what_a_rod_has_too_much_is_red_and_what_it_lacks_is_dashed_and_blue(tmp_path):
    """Of a rod of 1 m that is pulled to 1.5 m, and of one that is pushed to 0.5 m."""
    rods = {"anchors": np.zeros((1, 3)), "pairs": [(0, -1), (1, -1)], "lengths": np.ones(2)}
    q = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]] + 10 * [[[1.5, 0.0, 0.0], [0.0, 0.5, 0.0]]])
    found = compared(["none"], rods, q, np.arange(11), q)
    (path := tmp_path / "two.rrd").write_bytes(recording.record(found))
    seen = chunks(RrdReader(str(path)))
    excess, missing = (seen[f"/modes/none/{name}"] for name in ("excess", "missing"))
    assert not excess["strips"][0] and not missing["strips"][0]
    assert np.allclose(excess["strips"][-1], [[[1, 0, 0], [1.5, 0, 0]]])
    dashes = 0.5 + 0.5 * np.array([[0.0, 0.2], [0.4, 0.6], [0.8, 1.0]])
    assert np.allclose(np.array(missing["strips"][-1])[..., 1], dashes)
    assert colors(excess).tolist() == [recording.rgb(svg.EXCESS).tolist()]
    assert colors(missing).tolist() == [recording.rgb(svg.MISSING).tolist()]
    *_, path = ElementTree.fromstring(picture.motion(found)).findall(f"{SVG}svg/{SVG}path")
    assert path.get("stroke") == svg.MISSING and path.get("stroke-dasharray")


def test_a_recording_is_small_and_has_a_name_of_its_own_and_begins_where_modes_differ(recorded):
    default = recorded["default"]
    assert default.id != recorded["lost"].id  # or a viewer that opens both takes them for one
    assert default.size < 2_000_000
    (said,) = default.seen["/panel"]["text"][0]
    assert said.startswith("**double, semi_implicit, steps of 0.005 s**")
    assert default.seen["/__properties"]["name"] == [[default.comparison.title]]
    (loop,) = default.pages["/time_panel"]["time_selection"][0]
    assert [loop[at] / 1e9 for at in ("min", "max")] == [12.0, 20.0]


def clock(inset):
    """The words of a window in which words change."""
    return [words.text for words in inset.iter(f"{SVG}tspan")]


def test_the_picture_moves_as_the_run_did(recorded):
    default = recorded["default"]
    tiles = [tile for tile in default.drawn.findall(f"{SVG}svg") if tile.get("viewBox")]
    for mode, tile in zip(default.runs, tiles, strict=True):
        (path,) = [x for x in tile.findall(f"{SVG}path") if x.get("marker-end")]
        shapes = path.find(f"{SVG}animate").get("values").split(";")
        assert path.get("d") == shapes[-1]  # what is seen where nothing moves
        shapes = [re.findall(r"-?\d+", shape) for shape in shapes]
        corners = np.cumsum(np.reshape(shapes, (len(shapes), -1, 2)).astype(float), axis=1)
        seconds = float(path.find(f"{SVG}animate").get("dur")[:-1])
        assert seconds / (len(shapes) - 1) == pytest.approx(1 / 20, rel=0.15)
        moved = (corners[:, 1:] - corners[:, :1]) * [1, -1]
        _, q, _ = default.comparison.states(mode, 9 * np.arange(len(shapes)))
        metre = np.sum(moved * q[..., :2]) / np.sum(q[..., :2] ** 2)
        assert np.max(np.abs(moved - metre * q[..., :2])) < 2.0  # fifths of a pixel
        error = [c.rod_errors(default.system, state) for state in q]
        for color, worst in ((svg.EXCESS, np.max(error)), (svg.MISSING, -np.min(error))):
            drawn = [x for x in tile.findall(f"{SVG}path") if x.get("stroke") == color]
            assert bool(drawn) == (worst > picture.FINE / metre), mode  # a pixel
    lost = recorded["lost"]  # one mode disappears
    at, shown = lost.runs["baumgarte"].kept[-1], lost.runs["none"].kept[-1]
    *_, hidden = lost.drawn.findall(f"{SVG}svg//{SVG}animate[@attributeName='display']")
    assert 0 < at < shown and float(hidden.get("keyTimes")[2:]) == pytest.approx(at / shown, 0.02)


def test_the_picture_tells_the_time_and_how_far_rods_are_off_at_that_time(recorded):
    for some in (recorded["default"], recorded["lost"]):
        *figures, time = [x for x in some.drawn.findall(f"{SVG}svg") if not x.get("viewBox")]
        tick = float(time.find(f".//{SVG}animateTransform").get("dur")[:-1]) / len(clock(time))
        assert clock(time)[7] == "1.4 s" and tick == pytest.approx(0.2, rel=0.1)
        for (mode, done), inset in zip(some.runs.items(), figures, strict=True):
            for k, said in enumerate(clock(inset)):
                at = np.searchsorted(done.kept, 0.5 * k / some.dt - 1e-6)
                if at == len(done.kept):
                    assert done.stopped and said == some.comparison.outcome(mode)
                    continue
                errors = c.rod_errors(some.system, done.q[at])
                worst = errors[np.argmax(np.abs(errors))]
                words = f"{length(abs(worst))} too {'long' if worst > 0.0 else 'short'}"
                assert said in (words, "off < 1 pm") and (abs(worst) > 1e-12 or said != words)


def compared(mode_names, system, q, shown, motion):
    """A Comparison of made-up runs."""
    zero = np.zeros(len(q))
    done = SimpleNamespace(kept=shown, q=q, v=q, violations=zero, energies=zero, stopped=None)
    done.summary = lambda scale, truth: {}
    runs = dict.fromkeys(mode_names, done)
    args = SimpleNamespace(system="\udcff")  # a file's name may be no text
    pulls = dict.fromkeys(runs, lambda q, v: np.zeros((len(q), len(system["pairs"]))))
    plan = aim.Plan("rk4", 0.01, len(q) - 1, ruler.Truth(0))
    return Comparison(args, system, *plan, runs, 1.0, pulls, shown, motion)


def test_no_scene_makes_a_large_recording_or_picture():
    """Frames are sixty a second or every step, or fewer; and rods that turn at random are drawn as
    if they were the modes and the true motion."""
    assert list(frames(100, 0.05, 2)) == [*range(0, 101, 1)]
    assert len(frames(20_000, 0.001, 2)) == pytest.approx(20 * FRAME_RATE, 0.1)
    for particles, steps in itertools.product([1, 7, 1000, 99_999], [1, 999, 100_000, 3_000_001]):
        shown = frames(steps, 1.0, particles)
        assert shown[0] == 0 and np.all(np.diff(shown) > 0) and shown[-1] <= steps
        assert len(shown) <= max(6, min(FRAMES, 300_000 // particles))
    long = 0.005 * frames(400_000, 0.005, 2)  # s; at first and at last it is smooth
    assert np.all(np.diff(long[long < 19.0]) < 0.02) and np.all(np.diff(long[long > 1985.0]) < 0.02)
    for links, steps in ((1, 1000), (40, 1000), (900, 50)):
        angles = np.random.default_rng(0).normal(size=(steps + 1, links)).cumsum(axis=0)
        q = np.stack([np.sin(angles), np.cos(angles), 0.0 * angles], axis=-1).cumsum(axis=1)
        shown, system = np.arange(steps + 1), c.build_system("chain", links=links)
        found = compared(c.hold_table(), system, q, shown, q)
        assert len(picture.motion(found).encode()) <= picture.BYTES


def seen_by(eyes, hexes):
    """L*, a* and b* (CIE 1976) of colours, but for a constant, and how bright they are (0 to 1)."""
    coded = np.array([[*bytes.fromhex(x[1:])] for x in hexes]) / 255.0
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    share = np.clip(light @ np.transpose(eyes), 0, 1) @ np.transpose(TO_XYZ)
    share = share / np.sum(TO_XYZ, axis=1)
    root = np.where(share > (6 / 29) ** 3, np.cbrt(share), share / 3 / (6 / 29) ** 2 + 4 / 29)
    return root @ [[0, 500, 0], [116, -500, 200], [0, 0, -200]], light @ TO_XYZ[1]


WHITE, BLACK = svg.COLORS["paper"]
ON_WHITE = [x for name, x in svg.LIGHT.items() if name not in ("ink", "pale", "paper")]
ON_DARK = [svg.DARK[x] for x in ON_WHITE]
PLOTTED = [color[2] for color in svg.COLORS.values() if len(color) == 3]
PALETTES = {  # colours; those of them that are read, on these grounds; their contrast there (WCAG)
    "white": (ON_WHITE, ON_WHITE, [WHITE], 4.5),
    "dark": (ON_DARK, ON_DARK, [BLACK], 4.5),
    "recording": ([svg.RECORDED[x] for x in ON_WHITE], PLOTTED, [WHITE, GROUND], 3.0),
}


@pytest.mark.parametrize("name", PALETTES)
def test_colours_are_told_apart_by_all_and_can_be_read(name):
    """In each kind of colour blindness; modes, forces, and what rods have too much and lack."""
    colours, read, grounds, least = PALETTES[name]
    for eyes in BLIND:
        places, _ = seen_by(eyes, colours)
        assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(places, 2)) > 15.0
    bright, papers = (seen_by(np.eye(3), some)[1] + 0.05 for some in (read, grounds))
    for a, b in itertools.product(bright, papers):
        assert max(a, b) / min(a, b) > least


DRAWN = {name for name in PICTURES if isinstance(PICTURES[name], FunctionType)}


def test_a_drawing_is_what_its_script_makes_in_colours_of_the_palette_with_a_title():
    """Those that no script makes, too: a mode, a pull and an excess look the same in all."""
    palette = {*svg.LIGHT.values(), "none"}
    for path in FOLDER.glob("*.svg"):
        stored = path.read_text(encoding="utf-8")
        assert ElementTree.fromstring(stored).find(f"{SVG}title").text and svg.STYLE in stored
        colours = re.findall(r'(?:fill|stroke)="(.*?)"', stored)
        assert {*colours} <= palette, path.name
        if path.stem in DRAWN - {"cost"}:  # which is slow
            assert PICTURES[path.stem]() == stored, "make_pictures makes it again"
        if path.stem in PICTURES.keys() - DRAWN:
            said = ElementTree.fromstring(stored).findall(f"{SVG}text")
            legend = [x for x in said if x.get("font-size") == "17"]
            ends = [float(x.get("x")) + 8.5 * len(x.text) for x in legend]
            assert max(ends) < picture.SHEET[0] - 80, path.name  # the clock is there
            names = [x for x in said if x.get("font-size") == "13"]  # in the chart, and its axes
            lowest = max(float(x.get("y")) for x in names if x.get("font-weight") == "bold")
            assert lowest < max(float(x.get("y")) for x in names if x.text == "0"), path.name
            swept = re.search(r'values="0;(-?[\d.]+)"', stored)  # pixels
            assert float(swept[1]) > 100, f"the chart of {path.name} has room"
    gallery = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\((\w+)\.svg\)", gallery)) == PICTURES.keys() - DRAWN
    assert sum((FOLDER / f"{name}.svg").stat().st_size for name in PICTURES) < 1_500_000


def test_the_file_of_a_scene_may_be_called_anything(tmp_path, capfd):
    """A name that no picture can hold, and one that rerun renames, which it warns of."""
    for name in ("\x01.json", "Kette (2), 50%.json", "\u00e9.json"):
        scene = tmp_path / name
        scene.write_bytes((c.HERE / c.CHAPTER / "scenes/spin.json").read_bytes())
        flags = ["--system", str(scene), "--steps", "2", "--out", str(tmp_path)]
        c.main([*flags, "--rerun", "--no-page", "--stabilization", "none"])
        assert capfd.readouterr().err == ""
        title = ElementTree.parse(tmp_path / publish.PICTURE).find(f"{SVG}title").text
        assert scene.stem.replace("\x01", "?") in title


def test_ctrl_c_while_it_is_recorded_is_no_warning_of_reruns(tmp_path, capfd):
    interrupted = mock.patch.object(recording, "dashed", side_effect=KeyboardInterrupt)
    with interrupted, pytest.raises(KeyboardInterrupt):
        c.main(["--system", "pendulum", "--steps", "20", "--rerun", "--out", str(tmp_path)])
    gc.collect()  # of the stream, which warns as it goes
    assert capfd.readouterr().err == ""
