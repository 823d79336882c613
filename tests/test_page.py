"""The page of a scene: its bits in node, and what its reader sees and does in Chromium."""

import json
import shutil
import subprocess
from functools import partial
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from conftest import SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints.pages import page
from curriculum.ch3_4_constraints.results import palette

USUAL = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02}
BITS = [("double", "rk4"), ("jansen_leg", "semi_implicit")]
FIVE = ["none", "baumgarte", "impulse", "soft", "project"]
TAKE_STEPS = """
const document = {documentElement: null}, getComputedStyle = () => null;
const matchMedia = () => ({addEventListener() {}});
const scene = %s;
%s
const found = scene.methods.map(method => {
  const motion = new Motion(scene, method, Motion.knobs(scene, %s));
  for (let k = 0; k < %d; k++) motion.step();
  return [method, Array.from(motion.state)];
});
console.log(JSON.stringify(found));
"""


def states(chapter, system, integrator, steps, **settings):
    """{method: (q, v)} after so many steps that node takes, with the page's knobs set so."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    scene = page.as_script(page.scene_of(chapter, system, integrator, USUAL, {}))
    script = TAKE_STEPS % (scene, page.page_file("parts.js"), json.dumps(settings), steps)
    done = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, timeout=60)
    return {x: np.reshape(state, (2, -1, 3)) for x, state in json.loads(done.stdout)}


@pytest.mark.parametrize(("name", "integrator"), BITS)
def test_steps_of_the_page_are_pythons_bits(name, integrator):
    system = c.build_system(name)
    found = states(c, system, integrator, 300)
    assert [*found] == [x for x in FIVE if x != "impulse" or integrator == "semi_implicit"]
    for method, state in found.items():
        run = c.run_method(system, method, integrator, 0.005, 300)
        assert np.array_equal(state, [run.q[-1], run.v[-1]]), method


@pytest.mark.parametrize("hand", [[1.0, -2.0, 0.0], [100.0, -2.0, 0.0]])
def test_sliders_and_a_hand_pull_each_method_and_the_readers_own_as_a_force_would(hand):
    system = c.build_system("triple")
    knobs = {"baumgarte": 40.0, "time_constant": 0.05}

    def methods(dt, baumgarte=20.0, time_constant=0.02):
        mine = c.Method(partial(c.make_force, w=0.5 / dt), "a spring for this step")
        return c.make_methods(dt, baumgarte, time_constant) | {"mine": mine}

    def pull(q, v):  # by a damped spring, not harder than three times all weights
        pull = 50.0 * (np.array(hand) - q[1] - 0.1 * v[1])
        pull = pull * np.minimum(1.0, 30.0 * np.sum(system["m"]) / np.sqrt(pull @ pull))
        return pull * np.array([[0.0], [1.0], [0.0]])

    def pulled(method, q, v):
        return method.make_force({**system, "load": pull(q, v)})(q, v)

    edited = SimpleNamespace(**vars(c) | {"make_methods": methods})
    of_a_hand = {"hand": hand[:2], "pulls": [0, 50, 0]}
    found = states(edited, system, "semi_implicit", 100, dt=0.01, **of_a_hand, **knobs)
    assert {*found} == {*methods(0.01)}
    for name, method in methods(0.01, **knobs).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        run = c.simulate(step, system, partial(pulled, method), 0.01, 100)
        assert found[name] == pytest.approx(np.array([run.q[-1], run.v[-1]]), abs=1e-7)


def test_what_a_page_cannot_hold_is_refused_in_a_sentence():
    def refused(system, force=c.external_force, integrator="semi_implicit"):
        with patch.object(c, "external_force", force), pytest.raises(page.NoPage) as why:
            page.scene_of(c, system, integrator, USUAL, {})
        return str(why.value)

    system = c.build_system("double")
    assert "more than 40 rods" in refused(c.build_system("chain", links=41))
    assert "gauss steps are too slow" in refused(system, integrator="gauss")
    assert "leaves the plane z = 0" in refused(system, lambda system, q, v: np.ones_like(q))
    assert "branches on a value" in refused(system, lambda system, q, v: q if q[0, 0] > 0 else -q)
    system["v0"][1, 2] = 1.0
    assert "in the plane z = 0 only" in refused(system)


@pytest.fixture(scope="module")
def pages(visit, tmp_path_factory):
    """pages(*flags, **context) -> the page of a run with these flags, once it has chosen a step."""
    path = tmp_path_factory.mktemp("page") / "play.html"

    def opened(*flags, edited=False, **context):
        args, system = c.parse_args(flags)
        path.write_text(page.play(c, args, system, edited), encoding="utf-8")
        shown = visit(path, **context)
        shown.wait_for_function("() => document.querySelector('#choice').textContent")
        return shown

    return opened


def judged(shown):
    """The rows of the verdict, as lists of words, once it has its last cell."""
    shown.wait_for_function("""() => document.querySelector("#choice").textContent
      && !document.querySelector("#verdict").textContent.includes("\\u2026")""")
    rows = [x.split("\t") for x in shown.locator("#verdict tbody").inner_text().splitlines()]
    return {row[0]: row[1:] for row in rows}


@pytest.fixture(scope="module")
def double(pages):
    return pages()


@pytest.fixture
def still(double):
    """The page of the double pendulum, as the run was, at rest."""
    click(double, "As it was")
    double.evaluate("clock.set(false); begin()")
    return double


def steps(shown, many):
    shown.evaluate(f"for (let k = 0; k < {many}; k++) step(); draw()")


def run(name, dt, many, **knobs):
    """That of the double pendulum."""
    with np.errstate(all="ignore"):
        return c.run_method(c.build_system("double"), name, "semi_implicit", dt, many, **knobs)


def two(x):
    """A number as pages print it: two digits."""
    return f"{float(f'{x:.2g}'):g}".replace("-", "−")


def millimetres(x):
    return "≈ 0" if x < 1e-9 else two(1000 * x)


def told(shown):
    """What the plot says of each method."""
    return shown.locator("#board canvas").get_attribute("aria-label").partition(":")[2]


DRAWN = """stage => {
  const marks = [], own = {
    lines: (each, color, width, dash = []) => each.forEach(at =>
      marks.push({kind: "line", at, color, width, dash, alpha: stage.pen.globalAlpha})),
    words: (text, at, color) => marks.push({kind: "words", at, color, text}),
  };
  Object.assign(stage, own);
  stage.draw();
  for (const name in own) delete stage[name];
  return marks;
}"""


def drawn(shown, stage, kind, color=None):
    """The lines or words, of a colour, that a stage draws: where, in metres."""
    marks = shown.evaluate(f"({DRAWN})({stage})")
    return [x for x in marks if x["kind"] == kind and color in (None, x["color"])]


@pytest.mark.parametrize(("size", "theme"), SCREENS)
def test_the_first_screen_is_tiles_that_fit_it_in_legible_words(pages, size, theme):
    shown = pages(edited=True, viewport=size, color_scheme=theme, device_scale_factor=2)
    boxes = [tile.bounding_box() for tile in shown.locator(".tile").all()]
    seen = sum(x["width"] * (min(size["height"], x["y"] + x["height"]) - x["y"]) for x in boxes)
    assert len(boxes) == 5 and seen >= 0.4 * size["width"] * size["height"]
    assert shown.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert 'name="viewport" content="width=device-width' in shown.content()
    names = ["ink", "quiet", "long", "short", *(f"m{k}" for k in range(len(palette.METHODS)))]
    for color in shown.evaluate("names => names.map(ink)", names):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    sizes = "all => all.map(x => [x.width / x.clientWidth, x.height / x.clientHeight])"
    sharp = shown.locator("canvas").evaluate_all(sizes)
    assert len(sharp) == 6 and np.ravel(sharp) == pytest.approx(2.0, abs=0.02)
    assert shown.locator("#time").inner_text() == "0.00 s", "it waits for who wants less motion"
    assert "moves without those edits" in shown.locator("header").inner_text()
    shown.emulate_media(color_scheme="dark" if theme == "light" else "light")
    shown.wait_for_function("x => ink('ink').includes(x)", arg=palette.INK[theme == "light"])


def test_it_opens_on_a_longer_step_only_if_no_method_is_lost_then_and_says_so(pages):
    triple, rk4 = pages("--system", "triple"), pages("--integrator", "rk4")
    for shown, facts in (
        (pages(), "semi_implicit, steps of 10 ms, twice the run’s."),
        (triple, "semi_implicit, steps of 5 ms, the run’s."),
        (rk4, "rk4, steps of 10 ms, twice the run’s. impulse is left out: it is made for"),
    ):
        assert shown.locator("#facts").inner_text().startswith(facts)
    assert "lost at 24.9 s" in str(judged(triple)), "in the run's step, too"
    colors = rk4.locator("figcaption b").evaluate_all("all => all.map(x => x.className)")
    assert colors == ["m0", "m1", "m3", "m4"], "each keeps its own"


def test_the_verdict_is_what_runs_of_30_s_say(still):
    operations = {}
    for name, (rods, energy, operations[name], breaks, _) in judged(still).items():
        found = run(name, 0.005, 6000)
        off = np.max(np.abs(found.energies - found.energies[0])) / (2 * 9.81 * 2)  # of m g L
        assert [rods, energy] == [millimetres(np.max(found.violations)), f"{two(100 * off)} %"]
        lost = [dt for dt in (0.01, 0.02, 0.04, 0.05) if run(name, dt, round(30 / dt)).lost]
        assert breaks == (f"{1000 * lost[0]:g} ms" if lost else "not up to 50 ms")
    assert int(operations["project"]) > 2 * int(operations["none"])
    assert "within 5 %: impulse. Best rods: project" in still.locator("#choice").inner_text()


def test_as_it_was_has_the_numbers_of_the_run_and_draws_its_pose(still):
    click(still, "True motion")
    steps(still, 400)
    fine = run("project", 0.005 / 20, 400 * 20).q[::20]
    for k, name in enumerate(FIVE):
        found = run(name, 0.005, 400)
        errors = c.rod_lengths(c.build_system("double"), found.q[-1]) - 1.0
        worst = errors[np.argmax(np.abs(errors))]
        words = f"{millimetres(abs(worst))} mm too {'long' if worst > 0 else 'short'}"
        expected = "rods are right" if name == "project" else words
        assert still.locator(".off").nth(k).inner_text() == expected
        away = np.max(np.linalg.norm(found.q - fine, axis=-1))
        assert f"{name} {millimetres(away)}" in told(still)
    tile, found = "copies[1].view", run("baumgarte", 0.005, 400)
    for color, places in ("ink", found.q[-1]), ("reference", fine[-1]):
        lines = [x["at"] for x in drawn(still, tile, "line", color)]
        rods = np.array([[np.zeros(3), places[0]], places])[..., :2]
        assert np.sort(lines, axis=1) == pytest.approx(np.sort(rods, axis=1))
    [trail] = drawn(still, tile, "line", "m1")
    assert np.array(trail["at"]) == pytest.approx(found.tip[-301:, :2]), "of 1.5 s"


@pytest.mark.parametrize("stretch", [0.2, -0.2])
def test_what_is_too_long_is_red_and_what_is_too_short_dashed_blue(still, stretch):
    color = "long" if stretch > 0 else "short"
    still.evaluate(f"copies[1].state.set([1 + {stretch}, 0, 0, 2 + {stretch}, 0, 0])")
    wrong = [x for x in drawn(still, "copies[1].view", "line") if x["color"] in ("long", "short")]
    assert [x["color"] for x in wrong] == [color], "of the first rod; the second is right"
    assert sorted(x for x, _ in wrong[0]["at"]) == pytest.approx(sorted([1, 1 + stretch]))
    assert bool(wrong[0]["dash"]) == (color == "short")
    still.evaluate("copies[1].rods = copies[1].errors; draw()")
    assert still.locator(".off").nth(1).inner_text() == f"200 mm too {color}"


def test_the_plot_draws_each_worst_rod_in_decades_and_names_it_where_its_line_ends(still):
    steps(still, 100)
    words = {x["text"]: x["at"] for x in drawn(still, "plot", "words")}
    assert [words[x][1] for x in ("1 m", "10 cm", "100 µm", "≤ 1 µm")] == [0, -1, -4, -6]
    worst = np.max(run("none", 0.005, 100).violations)
    curves = [x for x in drawn(still, "plot", "line") if x["width"] == 2]
    end = pytest.approx([0.5, np.log10(worst)])
    assert curves[0]["at"][-1] == words[f"none {millimetres(worst)}"] == end
    assert len({tuple(x["dash"]) for x in curves}) == 5, "told apart without colours"
    click(still, "Energy")
    high = still.evaluate("plot.axis.high")
    for zoomed in 20, 1:
        click(still, "Zoom")
        assert still.evaluate("plot.axis.high") == pytest.approx(high / zoomed)


def test_a_method_that_is_lost_says_when_and_why_and_what_helps(still):
    still.locator("#baumgarte input").fill("10")  # 320/s: beyond what 5 ms endure
    steps(still, 200)
    when = 0.005 * (len(run("baumgarte", 0.005, 200, baumgarte=320.0).q) - 1)
    lost = still.locator(".lost")
    assert [x.is_visible() for x in lost.all()] == [k == 1 for k in range(5)]
    words = f"lost at {when:.2f} s: its rods flew apart. Try a shorter step, or less stiffness."
    assert lost.nth(1).inner_text() == words and "baumgarte lost" in told(still)
    assert still.locator(".tile").nth(1).locator("[inert] .hand").count() == 2, "no longer pulled"
    still.evaluate("copies[4].state.set([1e4, 0, 0, 1e4, 0, 0], 6)")  # m/s
    steps(still, 1)
    assert "s: no way back onto the rods. Try a shorter step." in lost.nth(4).inner_text()
    click(still, "Again")
    assert not any(x.is_visible() for x in lost.all())


def test_time_passes_while_a_hand_pulls_and_what_it_adds_is_no_error(still):
    hand = still.locator(".tile").nth(3).locator(".hand").last
    click(still, "Energy")
    for key in "Escape", "Tab", "Shift":  # or by the mouse alone
        box, before = hand.bounding_box(), still.evaluate("run.time")
        still.mouse.move(box["x"] + 22, box["y"] + 22)
        still.mouse.down()
        still.mouse.move(box["x"] + 3000, box["y"])  # far away, but the hand's force is bounded
        still.wait_for_function("before => run.time > before + 0.1", arg=before)
        string = drawn(still, "copies[3].view", "line")[-1]
        assert string["dash"] and string["at"][1][0] - string["at"][0][0] > 10
        still.keyboard.press(key)
        still.mouse.up()
        assert not still.evaluate("held.copy || clock.going"), "it stands still again"
        assert not any(x.is_visible() for x in still.locator(".lost").all())
        assert still.locator(".off").nth(4).inner_text() == "rods are right"
        assert "%" not in told(still)


def test_any_bob_is_reached_by_keys_and_keys_of_the_browser_are_its_own(still):
    focused, hand = "document.activeElement", still.locator(".tile").first.locator(".hand").last
    assert still.locator("a, button, input").first.inner_text() == "Play"
    hand.focus()
    still.keyboard.press("PageDown")
    assert "none: pull bob 1 of 2" in still.evaluate(f"{focused}.ariaLabel")
    still.keyboard.press("Alt+ArrowRight")
    assert not still.evaluate("held.copy || clock.going"), "that is the browser's"
    still.keyboard.press("ArrowRight")
    still.wait_for_function("() => run.time > 0.1")
    still.keyboard.press("Escape")
    x, taken = still.evaluate("[copies[0].point(0)[0], run.taken]")
    assert x > run("none", 0.005, taken).q[-1, 0, 0]


def test_the_nearest_bob_is_pulled_and_fingers_have_room_to_scroll(pages):
    shown = pages("--system", "chain", "--links", "6")
    hands = shown.locator(".tile").first.locator(".hand")
    boxes = [hand.bounding_box() for hand in hands.all()]
    shown.mouse.move(boxes[2]["x"] + 22, boxes[2]["y"] + 22)
    shown.mouse.down()
    assert "pull bob 3 of 6" in shown.evaluate("document.activeElement.ariaLabel")
    styles = "all => all.map(getComputedStyle).map(x => x.pointerEvents + ' ' + x.touchAction)"
    touched = [x == "auto none" for x in hands.evaluate_all(styles)]
    places = np.array([[box["x"], box["y"]] for box in boxes])[touched]
    gaps = np.linalg.norm(places[:, None] - places, axis=-1) + 99 * np.eye(len(places))
    assert 1 < len(places) < 6 and np.min(gaps) >= 44


def test_sliders_set_exact_values_say_them_and_begin_again_if_they_must(pages):
    shown = pages("--dt", "0.0033", "--baumgarte", "17.3", "--time-constant", "0.0271")
    steps(shown, 1)
    shown.locator("#baumgarte input").fill("11")
    assert shown.evaluate("[knobs.baumgarte, run.taken]") == [320, 1]
    shown.locator("#dt input").fill("9")
    assert shown.evaluate("[knobs.dt, run.taken]") == [0.05, 0]
    softness = shown.locator("#time_constant output").inner_text()
    assert softness == "27.1 ms, taken as two steps: 100 ms"
    click(shown, "As it was")
    own = {"dt": 0.0033, "baumgarte": 17.3, "time_constant": 0.0271}
    assert shown.evaluate("knobs").items() >= own.items()
    words = shown.locator("#baumgarte output").inner_text()
    assert words == "17.3/s; step × stiffness = 0.06, breaks at 0.83"
    edge = 2.0 * (np.sqrt(2.0) - 1.0) / 0.0033  # 251/s: after ten ticks is 200, then 320
    place = (10 + (edge - 200) / 120) / 11
    mark = "x => [parseFloat(getComputedStyle(x, '::after').left), x.clientWidth]"
    left, wide = shown.locator("#baumgarte").evaluate(mark)
    assert left == pytest.approx(7 + (wide - 16) * place, abs=0.5)


def test_a_question_has_its_slider_beside_it_and_stands_where_it_is_true(still, pages):
    still.locator("#baumgarte input").fill("3")
    click(still, "How stiff may the spring be?")
    assert still.evaluate("[knobs.dt, knobs.baumgarte]") == [0.01, 20.0]
    assert still.locator("#asked label").get_attribute("id") == "baumgarte"
    assert still.locator("#questions").get_by_text("Why do").count() == 1
    spin = pages("--system", "spin", "--dt", "0.02")
    assert spin.locator("#questions").get_by_text("Why do").count() == 0, "one turns too far"
    with patch.object(c, "external_force", lambda s, q, v=None: s["m"] * c.GRAVITY - 0.5 * v):
        braked = pages("--dt", "0.02")
    assert braked.locator("#questions").get_by_text("energy").count() == 0
    assert braked.locator("#verdict td:nth-child(3)").all_inner_texts() == ["–"] * 5


def test_one_long_step_shows_what_a_rod_grows_by(still):
    click(still, "Why do these rods grow?")
    for many in 16, 17:
        for k, name in enumerate(FIVE):
            before, after = np.linalg.norm(run(name, 0.04, many).q[-2:, 0], axis=1)
            side = "longer" if after > before else "shorter"
            words = f"{millimetres(abs(after - before))} mm {side} by this step"
            expected = "rods are right" if name == "project" else words
            assert still.locator(".off").nth(k).inner_text() == expected
        assert drawn(still, "copies[0].view", "line", "long"), "none's rod has grown"
        click(still, "One step")
