"""The page of a scene: its bits in node, and what its reader sees and does in Chromium."""

import json
import re
import shutil
import subprocess
from unittest.mock import patch

import numpy as np
import pytest
from conftest import SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints import page, palette, table

USUAL = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02, "impedance": 0.95}
FIVE = ["none", "baumgarte", "impulse", "soft", "project"]
INKS = [light for light, _ in palette.METHODS]
TAKE_STEPS = """
const document = {documentElement: null}, getComputedStyle = () => null;
const scene = %s;
%s
const found = scene.methods.map(method => {
  const motion = new Motion(scene, method, Motion.knobs(scene, %s));
  for (let k = 0; k < %d; k++) motion.step();
  return [method, Array.from(motion.state)];
});
console.log(JSON.stringify(found));
"""


def states(system, integrator, steps, **settings):
    """{method: (q, v)} after so many steps that node takes, with the page's knobs set so."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    scene = page.scene_script(c, system, integrator, USUAL, {})
    script = TAKE_STEPS % (scene, page.page_file("parts.js"), json.dumps(settings), steps)
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, timeout=60)
    return {x: np.reshape(state, (2, -1, 3)) for x, state in json.loads(done.stdout)}


@pytest.mark.parametrize("name", ["double", "jansen_leg"])
@pytest.mark.parametrize("integrator", ["semi_implicit", "rk4"])
def test_steps_of_the_page_are_pythons_bits(name, integrator):
    system = c.build_system(name)
    found = states(system, integrator, 500)
    assert [*found] == [x for x in FIVE if x != "impulse" or integrator == "semi_implicit"]
    for method, state in found.items():
        run = c.run_method(system, method, integrator, 0.005, 500)
        assert np.array_equal(state, [run.q[-1], run.v[-1]]), method


def test_sliders_a_hand_and_a_row_of_the_readers_own_are_the_chapters_to_the_bit():
    system, rows, own = c.build_system("triple"), c.stabilizations, c.external_force
    knobs = {"baumgarte": 40.0, "time_constant": 0.05}
    hand, stiffness = np.array([1.0, -2.0, 0.0]), np.array([[0.0], [50.0], [0.0]])

    def more(dt, *knobs, **named):
        return rows(dt, *knobs, **named) | {"mine": c.Stabilization(stiffness=0.5 / dt)}

    def pulled(system, q, v=None):  # by a damped spring
        return own(system, q, v) + stiffness * (hand - q - 0.1 * v)

    with patch.object(c, "stabilizations", more):
        touched = {"dt": 0.01, "mass": 3, "hand": [1, -2], "pulls": [0, 50, 0]}
        found = states(system, "semi_implicit", 100, **touched, **knobs)
        system["m"][-1] *= 3.0
        with patch.object(c, "external_force", pulled):
            for method in [*FIVE, "mine"]:
                run = c.run_method(system, method, "semi_implicit", 0.01, 100, **knobs)
                assert np.array_equal(found[method], [run.q[-1], run.v[-1]]), method


def test_what_a_page_cannot_hold_is_refused_in_a_sentence():
    def refused(system, force=c.external_force, integrator="semi_implicit"):
        with patch.object(c, "external_force", force), pytest.raises(page.NoPage) as why:
            page.scene_script(c, system, integrator, USUAL, {})
        return str(why.value)

    system = c.build_system("double")
    assert "more than 40 rods" in refused(c.build_system("chain", links=41))
    assert "gauss steps are too slow" in refused(system, integrator="gauss")
    assert "leaves the plane z = 0" in refused(system, lambda system, q, v: np.ones_like(q))
    assert "branches on a value" in refused(system, lambda system, q, v: q if q[0, 0] > 0 else -q)
    system["v0"][1, 2] = 1.0
    assert "in the plane z = 0 only" in refused(system)


@pytest.fixture
def pages(visit, tmp_path):
    """pages(*flags, **context) -> the page of a run with these flags."""

    def opened(*flags, **context):
        args, system = c.parse_args(["--out", "outputs/test", *flags])
        path = tmp_path / "play.html"
        path.write_text(page.play(c, args, system), encoding="utf-8")
        return visit(path, **context)

    return opened


@pytest.fixture
def still(pages):
    """The page of the double pendulum, at rest."""
    return pages()


DRAWN = """() => {
  const marks = [];
  let path;
  const {pen} = STAGE;
  const mark = (kind, at, color, more) => marks.push({kind, at, color, ...more});
  Object.assign(pen, {
    beginPath: () => { path = []; },
    lineTo: (...at) => path.push(at),
    arc: (x, y) => path.push([x, y]),
    stroke: () => mark("line", path, pen.strokeStyle,
      {alpha: pen.globalAlpha, width: pen.lineWidth, dashed: pen.getLineDash().length > 0}),
    fill: () => mark("disc", path[0], pen.fillStyle),
    fillRect: (...at) => mark("bar", at, pen.fillStyle),
    fillText: (text, ...at) => mark("words", at, pen.fillStyle, {text}),
  });
  STAGE.draw();
  return marks;
}"""


def drawn(shown, stage, kind, color=None):
    """The lines, discs, bars or words, of a colour, that a stage draws."""
    shown.wait_for_function(f"{stage}.width > 0")  # it knows its size
    marks = shown.evaluate(DRAWN.replace("STAGE", stage))
    return [x for x in marks if x["kind"] == kind and color in (None, x["color"])]


def pixels(shown, points):
    """Where points of a scene are in the tile of baumgarte: its box is as large as fits."""
    size, box = shown.evaluate("[[copies[1].view.width, copies[1].view.height], run.box]")
    low, high = np.reshape(box, (2, 2))
    scale = np.min(np.subtract(size, 12) / (high - low))  # 6 pixels are left free around it
    places = np.array(size) / 2 + scale * (np.array(points)[..., :2] - (low + high) / 2) * [1, -1]
    return pytest.approx(places, abs=0.5)


@pytest.mark.parametrize(("size", "theme"), SCREENS)
def test_the_first_screen_is_tiles_that_fit_it_in_legible_words(pages, size, theme):
    shown = pages("--system", "jansen_leg", viewport=size, color_scheme=theme)
    boxes = [tile.bounding_box() for tile in shown.locator(".tile").all()]
    seen = sum(x["width"] * (min(size["height"], x["y"] + x["height"]) - x["y"]) for x in boxes)
    assert len(boxes) == 5 and seen >= 0.5 * size["width"] * size["height"]
    assert shown.evaluate("document.documentElement.scrollWidth") <= size["width"]
    names = ["ink", "quiet", "long", "short", *(f"m{k}" for k in range(len(INKS)))]
    for color in shown.evaluate("names => names.map(ink)", names):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    link = shown.get_by_text("The chapter").get_attribute("href")
    assert link == "../../curriculum/ch3_4_constraints/chapter.html"
    assert "default-src 'none'" in shown.content() and "<noscript>" in shown.content()
    assert shown.evaluate("run.time") == 0, "it waits for a reader who wants less motion"


def test_it_opens_on_rods_that_grow_visibly_within_two_seconds(pages):
    moving = pages(reduced_motion="no-preference")
    moving.wait_for_function("() => run.time > 1.5", polling=20)
    none, *others = moving.evaluate("copies.map(x => largest(x.rods) * x.view.scale[0])")  # pixels
    assert none > 5 and max(others) < 0.7 * none
    assert moving.evaluate("knobs.dt") == 0.02
    assert pages("--baumgarte", "30").evaluate("knobs.dt") == 0.01, "half of what it endures"


def test_as_it_was_has_the_numbers_of_the_run_and_draws_its_pose(still):
    click(still, "As it was")
    still.evaluate("clock.set(false); begin(); for (let k = 0; k < 200; k++) step(); draw()")
    system, copies = c.build_system("double"), still.evaluate("copies.map(({worst}) => worst)")
    fine = c.run_method(system, "project", "semi_implicit", 0.005 / 20, 200 * 20).q[::20]
    words = still.evaluate("curves().map(({words}) => words)")
    runs = [c.run_method(system, name, "semi_implicit", 0.005, 200) for name in FIVE]
    for name, run, copy, shown in zip(FIVE, runs, copies, words, strict=True):
        assert copy["rods"] == np.max(run.violations[1:])
        change = (run.energies - run.energies[0]) / (2 * 9.81 * 2)  # of m g L
        assert copy["energy"] == pytest.approx(change[np.argmax(np.abs(change))], rel=1e-9)
        away = np.max(np.linalg.norm(run.q - fine, axis=-1))
        assert copy["motion"] == pytest.approx(away, rel=1e-6)
        assert shown == f"{name} {table.length(copy['rods']).replace('um', 'µm')}"
    tile, anchor, places = "copies[1].view", np.zeros(3), runs[1].q[-1]
    rods = [x["at"] for x in drawn(still, tile, "line", palette.INK[0])]
    assert rods == pixels(still, [[anchor, places[0]], places])
    assert drawn(still, tile, "line", INKS[1])[0]["at"] == pixels(still, runs[1].tip[1:])
    assert [x["at"] for x in drawn(still, tile, "disc", INKS[1])] == pixels(still, places)
    true = drawn(still, tile, "line", palette.REFERENCE[0])
    assert [x["at"][::-1] for x in true] == pixels(still, [[anchor, fine[-1, 0]], fine[-1]])
    for doubt, share in (0.05, [0.5, 0.5]), (0.2, []):  # of its size: chaos decides
        still.evaluate(f"truth.doubt = {doubt} * run.size; truth.step()")
        fading = drawn(still, tile, "line", palette.REFERENCE[0])
        assert [x["alpha"] / true[0]["alpha"] for x in fading] == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize("stretch", [0.2, -0.2])
def test_what_is_too_long_is_red_and_what_is_too_short_dashed_blue(still, stretch):
    (red, _), (blue, _) = palette.TOO_LONG, palette.TOO_SHORT
    color, other, word = (red, blue, "long") if stretch > 0 else (blue, red, "short")
    tile, ends = "copies[1].view", sorted([1, 1 + stretch])
    still.evaluate(f"copies[1].state.set([1 + {stretch}, 0, 0, 2 + {stretch}, 0, 0])")
    [wrong] = drawn(still, tile, "line", color)  # of the first rod; the second one is right
    assert sorted(wrong["at"]) == pixels(still, [[x, 0] for x in ends])
    assert wrong["dashed"] == (stretch < 0) and not drawn(still, tile, "line", other)
    [right, _] = drawn(still, tile, "line", palette.INK[0])
    assert right["at"] == pixels(still, [[0, 0], [ends[0], 0]])
    still.evaluate(f"copies[1].rods = [{stretch / 20}, -1e-4]; draw()")
    first, second = drawn(still, "copies[1].gauge", "bar")
    (x, high, wide, tall), (_, low, narrow, _) = first["at"], second["at"]
    assert [first["color"], second["color"]] == [color, blue]
    decade = still.evaluate("copies[1].gauge.width - 2") / 12  # from 1 um in the middle to 1 m
    assert [x, wide, narrow] == pytest.approx(
        [1 + 6 * decade, np.sign(stretch) * 4 * decade, -2 * decade]
    )
    assert 0 <= high < high + tall <= low <= 34 - tall, "one below the other"
    assert still.locator(".off").nth(1).inner_text() == f"1 cm too {word}"


def test_the_plot_draws_each_worst_rod_in_decades_and_names_it_at_its_end(still):
    for steps in 0, 50:  # at first all are at the bottom
        still.evaluate(f"for (let k = 0; k < {steps}; k++) step()")
        words = {x["text"]: x["at"] for x in drawn(still, "plot", "words")}
        names = sorted((y, x, text) for text, (x, y) in words.items() if text.split()[0] in FIVE)
        gaps = np.diff([0, *(y for y, _, _ in names), words["0 s"][1]])
        assert len(gaps) == 6 and min(gaps[1:-1]) >= 15 and min(gaps) > 0, "none covers another"
        assert steps or names[0][0] > words["1 µm"][1]
    times, worst = np.transpose(still.evaluate("copies[0].curves.rods"))
    (left, bottom), (_, top), (right, _) = (words[x] for x in ("0 s", "1 m", "5 s"))
    high = words["1 pm"][1] + np.log10(worst / 1e-12) / 12 * (top - words["1 pm"][1])
    curve = np.transpose([left + times / 5 * (right - left), high])
    assert drawn(still, "plot", "line", INKS[0])[0]["at"] == pytest.approx(curve)
    name = still.evaluate("curves()[0].words")
    assert names[0] == (pytest.approx(high[-1]), pytest.approx(right + 8), name)
    for time, first, each in (1, 0, 1), (7, 0, 2), (30, 12, 4):
        still.evaluate(f"run.time = {time}; copies[0].note('rods', 0.1)")
        shown = [x["text"] for x in drawn(still, "plot", "words") if x["text"].endswith(" s")]
        assert shown == [f"{s} s" for s in range(first, max(time, 5 * each) + 1, each)]


def test_a_method_that_is_lost_says_when_and_why_and_can_start_again(still):
    still.evaluate("knobs.baumgarte = 200; begin(); while (!copies[1].lost) step(); draw()")
    lost, when = still.locator(".lost"), still.evaluate("run.time")
    assert lost.nth(1).locator("p").inner_text() == f"lost at {when:.2f} s: its rods flew apart"
    inert = still.evaluate("copies.map(({view}) => view.element.inert)")  # no hand can pull it
    assert [x.is_visible() for x in lost.all()] == inert == [k == 1 for k in range(5)]
    assert still.evaluate("step(); curves()[1].words") == "baumgarte lost"
    lost.nth(1).get_by_role("button", name="Start it again").click()
    assert not lost.nth(1).is_visible() and still.evaluate("run.time") > when
    assert still.evaluate("copies[1].state.join() === scene.start.join()")
    still.evaluate("scene.posts.project = () => { throw new Error('no way back') }; step(); draw()")
    assert lost.nth(4).locator("p").inner_text().endswith("s: no way back")
    assert still.evaluate("copies[1].curves.motion.length") == 0, "it began too late for that"
    assert still.evaluate("copies[2].state[3] = run.home[2] + 0.1; draw(); run.box[2]") == (
        still.evaluate("run.home[2] + 0.1")
    ), "tiles show a bit more where a bob goes"
    click(still, "Again")
    assert still.evaluate("[run.time, copies.filter(({lost}) => lost).length]") == [0, 0]


def hold(shown, right, down):
    """Drag the last bob of soft by so many pixels and hold it; where the mouse is in its scene."""
    button = shown.locator(".tile").nth(3).locator(".hand").last
    button.hover()
    shown.mouse.down()
    box = button.bounding_box()
    x, y = box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 + down
    shown.mouse.move(x, y, steps=3)
    return shown.evaluate(f"copies[3].view.metres({{clientX: {x}, clientY: {y}}})")


def test_a_drag_while_it_stands_still_poses_every_copy_on_right_rods(still):
    still.evaluate("for (let k = 0; k < 30; k++) step(); draw()")
    there = hold(still, -40, -30)
    assert still.evaluate("copies[0].point(1)") == pytest.approx(there, abs=0.01)
    still.mouse.up()
    for after in "", "drag(copies[0], 0, [0, 0]); letGo()":  # onto its anchor
        still.evaluate(after)
        poses = np.reshape(still.evaluate("copies.map(({state}) => [...state])"), (5, 2, 2, 3))
        assert np.all(poses == poses[0]) and not poses[0, 1].any()
        assert c.constraint_violation(c.build_system("double"), poses[0, 0]) < 1e-12
        assert after or poses[0, 0, 1, :2] == pytest.approx(there, abs=0.05)
    still.evaluate("scene.posts.project = () => { throw new Error('no way back') }; null")
    back = still.evaluate("drag(copies[0], 0, [3, 0]); letGo(); [...copies[0].state]")
    assert back == [*poses[0].flat], "where it was, if it finds no way"


def test_the_nearest_of_bobs_whose_hands_overlap_is_pulled(pages):
    shown = pages("--system", "chain", "--links", "12")
    for k, hand in enumerate(shown.locator(".tile").first.locator(".hand").all()):
        box = hand.bounding_box()
        shown.mouse.move(box["x"] + 22, box["y"] + 22)
        shown.mouse.down()
        assert shown.evaluate("held.particle") == k
        shown.mouse.up()


@pytest.mark.parametrize("end", ["up", "Escape", "Tab"])
def test_a_hand_pulls_all_that_moves_until_it_ends_and_adds_no_error_of_energy(still, end):
    still.evaluate("clock.ask = () => {}; clock.set(true); knobs.mass = 3")  # without frames
    there = hold(still, 20, 20)
    assert still.evaluate("knobs.pulls") == [0, 15 * 15 * 3]
    assert still.evaluate("knobs.hand") == pytest.approx(there, abs=0.01)
    string = drawn(still, "copies[1].view", "line")[-1]
    assert string["dashed"] and string["at"][1] == pixels(still, there)
    still.keyboard.press("ArrowDown")
    assert still.evaluate("knobs.hand[1]") < there[1] - 0.01
    still.evaluate("for (let k = 0; k < 20; k++) step()")
    assert still.evaluate("copies.map(({worst}) => worst.energy)") == [0] * 5
    if end == "up":
        still.mouse.up()
    else:
        still.keyboard.press(end)
    assert still.evaluate("knobs.pulls") == [0, 0]
    assert still.evaluate("drag(copies[0], 0, [0, -1]); [...knobs.pulls]") == [15 * 15, 0]
    still.evaluate("letGo()")
    still.evaluate("step()")
    assert all(0 < abs(x) < 0.02 for x in still.evaluate("copies.map(({worst}) => worst.energy)"))


def test_sliders_set_exact_values_say_them_and_begin_again_if_they_must(pages):
    own = {"dt": 0.0033, "baumgarte": 17.3, "time_constant": 0.0271, "mass": 1}
    shown = pages("--dt", "0.0033", "--baumgarte", "17.3", "--time-constant", "0.0271")
    for key, value in own.items():
        slider, ticks = shown.locator(f"#{key} input"), shown.evaluate(f"ticks('{key}')")
        assert value in ticks and ticks == sorted(ticks)
        for k in 0, 3, len(ticks) - 1:
            shown.evaluate("step()")
            slider.fill(str(k))
            assert shown.evaluate(f"knobs.{key}") == ticks[k]
            words = slider.get_attribute("aria-valuetext")
            number = float(re.findall(r"\d[\d.]*", words)[0]) / (1000 if "ms" in words else 1)
            assert number == pytest.approx(ticks[k], rel=5e-3)
            assert (shown.evaluate("run.taken") == 0) == (key in ("dt", "mass"))
    assert (ticks[0], ticks[-1]) == (0.01, 100), "of the mass"
    click(shown, "As it was")
    assert shown.evaluate("sliders.map(({key}) => knobs[key])") == [*own.values()]
    words = shown.locator("#baumgarte output").inner_text()
    assert words == "17.3/s; step × stiffness = 0.06, breaks at 0.83"


QUESTIONS = {  # the control, the plot's view and the knobs of each
    "Why do these rods grow?": ("one", "rods", {}),
    "What does half the step buy?": ("dt", "rods", {"dt": 0.01, "time_constant": 0.05}),
    "How stiff may the spring be?": ("baumgarte", "rods", {"baumgarte": 40}),
    "Which keeps its energy?": ("energy", "energy", {}),
    "How soft is soft?": ("time_constant", "rods", {"time_constant": 0.1}),
    "Which is nearest the true motion?": ("motion", "motion", {}),
    "As it was": ("dt", "rods", {"dt": 0.005}),
}


def test_each_question_sets_knobs_a_view_and_a_control_and_says_what_to_look_at(pages):
    still, said = pages(), set()
    assert still.locator("#questions button").all_inner_texts() == [*QUESTIONS]
    for name, (control, view, knobs) in QUESTIONS.items():
        still.evaluate("knobs.mass = 3")
        click(still, name)
        for marked, expected in (".control", control), ("#board [aria-pressed=true]", view):
            assert still.locator(marked).get_attribute("id") == expected
        usual = {"dt": 0.02, "baumgarte": 20, "time_constant": 0.02, "mass": 1}
        assert still.evaluate("({...knobs})").items() >= (usual | knobs).items()
        assert still.evaluate("clock.going") == (control != "one")
        assert control == "one" or still.evaluate("run.time") < 0.5  # s: it begins, unless paused
        said.add(still.locator("#say").inner_text())
        if control == "one":  # each step adds to the rods of none, in full swing
            before = still.evaluate("[run.time, ...copies[0].rods]")
            click(still, "One step")
            after = still.evaluate("[run.time, ...copies[0].rods]")
            assert np.all(np.subtract(after, before) > 0) and before[0] >= 0.6
        if "half" in name:
            dashes = [x["dashed"] for x in drawn(still, "plot", "line") if x["width"] > 1]
            assert dashes == [True] * 5 + [False] * 5
    assert len(said) == len(QUESTIONS)
    flat = pages("--system", "peaucellier")
    click(flat, "Which way through the flat pose?")
    assert flat.evaluate("run.view") == "motion"
    assert pages("--system", "spin").get_by_role("button", name="Why do").count() == 0
    assert "NaN" not in "".join([*said, flat.locator("body").inner_text()])


def test_time_passes_as_the_clock_says_and_never_races(still):
    def passed(*frames, took=0):  # in s, with frames at these ms, when steps took so many
        return still.evaluate(f"""() => {{
          let now = 0;
          performance.now = () => now;
          clock.step = () => {{ step(); now += {took}; }};
          begin();
          clock.set(true);
          {list(frames)}.forEach(x => clock.frame(x));
          clock.going = false;
          return run.time;
        }}""")

    assert passed(1000, 1050, 1090) == pytest.approx(0.08), "what is owed is kept"
    assert passed(1000, 61_000) == pytest.approx(0.1, abs=0.021), "after a hidden tab"
    click(still, "Slow")
    assert passed(*range(1000, 3001, 100)) == pytest.approx(0.2, abs=0.021)
    click(still, "Slow")
    assert passed(*range(0, 1001, 100), took=11) == pytest.approx(10 * 0.02), "one a frame"
