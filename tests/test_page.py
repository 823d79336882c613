"""The page that lives: its bits in node, and what its reader sees and does in Chromium."""

import itertools
import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints import pages, play, publish
from curriculum.ch3_4_constraints.run_checks import misfit
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.common import javascript
from curriculum.common.programs import Program, repeat
from curriculum.common.tape import Untraceable

import numpy as np
import pytest
from conftest import complaint, feel

DT = 0.005
USUAL = DT, (20.0, 0.02, 0.95)
NODE, HANDS = (Path(__file__).with_name(x) for x in ("run_page.cjs", "hands.js"))


def page(name, rule="semi_implicit", system=None):
    """The page of a scene, or of a `system` that is called so, as a run of this rule has it."""
    system = system or c.build_system(name)
    return play.page(c, name, system, rule, c.INTEGRATORS[rule], *USUAL)


def node(*words, lines=b""):
    """What node prints, in bytes."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    command = ["node", *map(str, words)]
    done = subprocess.run(command, input=lines, capture_output=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, b"")
    return done.stdout


def compared(folder, name, rule, steps):
    """{mode: (what node says, the Run of Python)}, once all their states are the same bits."""
    file, system = folder / "page.html", c.build_system(name)
    file.write_text(page(name, rule))
    modes = [mode for mode, hold in c.hold_table().items() if not misfit(hold, rule)]
    said = json.loads(node(NODE, file, steps, *modes))
    for mode in modes:
        run = _runs.run(system, rule, mode, DT, steps, range(steps + 1))
        count = len(run.q)
        expected = [x[..., :2].reshape(count, -1) for x in (run.q, run.v)]
        found = np.fromfile(f"{file}.{mode}").reshape(said[mode]["done"] + 1, -1)
        assert np.array_equal(found[:count], np.concatenate(expected, axis=1)), mode
        assert said[mode]["whole"], "a step that fails leaves the state as it was"
        said[mode] = said[mode], run
    return said


def test_every_exact_operation_is_written_as_python_has_it(tmp_path):
    def everything(x):
        a, b = x
        larger, smaller = np.maximum(a, b), np.minimum(a, b)
        known = np.where(-(-a - b), 1.0, 2.0)  # NaN is not 0
        chosen = np.where(a < b, a - (b - 3.0), -(a + b) * 0.1 / (a * (b / 7.0)))
        return (np.stack([larger, smaller, chosen, np.abs(a - b), np.sqrt(a * a + b), known]),)

    program, writer = Program(everything, np.zeros(2, bool)), javascript.Writer()
    name = writer.program(program, ["x"], {x: f"x[{k}]" for k, x in enumerate(program.inputs)})
    assert not program.inexact()
    lines = f"""{javascript.PRELUDE}{writer.source()}
    const values = [0.1, -0.7, 3, 1e300, Infinity, NaN];
    const made = values.flatMap((a) => values.flatMap((b) => {name}([a, b])));
    process.stdout.write(Buffer.from(Float64Array.from(made).buffer));"""
    pairs = itertools.product([0.1, -0.7, 3.0, 1e300, np.inf, np.nan], repeat=2)
    with np.errstate(all="ignore"):
        expected = np.concatenate([everything(np.array(pair))[0] for pair in pairs])
    found = np.frombuffer(node("-", lines=lines.encode()))
    assert np.array_equal(found, expected, equal_nan=True)


RUNS = [("double", "semi_implicit", 4000), ("heavy_tip", "semi_implicit", 4000)]
RUNS += [("jansen_leg", "semi_implicit", 100), ("windows", "semi_implicit", 400)]
RUNS += [("tight_cable", "semi_implicit", 20)]  # where a loop is taut
RUNS += [("double", rule, 100) for rule in ("rk4", "gauss")]


@pytest.mark.parametrize(("name", "rule", "steps"), RUNS)
def test_every_mode_makes_pythons_bits_halves_included(name, rule, steps, tmp_path):
    found = compared(tmp_path, name, rule, steps)
    assert "project" in found and ("impulse" in found) == (rule == "semi_implicit")
    for mode, (said, run) in found.items():
        assert (said["done"], said["halved"]) == (len(run.tip) - 1, run.halved), mode
        assert run.stopped is None or run.stopped.endswith(f"{said['done'] + 1}: {said['why']}")
        if (name, mode) == ("heavy_tip", "project"):
            assert run.halved > 0 and run.stopped  # or the test would not have seen either


def test_rows_and_forces_of_the_readers_own_are_in_the_page(monkeypatch, tmp_path):
    """Also of a row for a step's length: where its steps fail, halves keep the whole step's."""
    table = c.hold_table

    def longer(*given, **named):
        rows = table(*given, **named)
        mended = rows["impulse"]._replace(after=c.project)
        return rows | {"mine": c.Hold(1.0, 3.0, 5.0, 0.0), "mended": mended}

    monkeypatch.setattr(c, "hold_table", longer)
    _, run = compared(tmp_path, "pendulum", "semi_implicit", 400)["mine"]
    said, mended = compared(tmp_path, "heavy_tip", "semi_implicit", 800)["mended"]
    assert said["halved"] == mended.halved > 0 and mended.how.startswith("compiled")

    def drag(q, v):  # and a little, of a loop
        return -0.3 * v + repeat(lambda y: (0.5 * y, 1e3 * np.sum(y * y)), v, 60, "no end")

    feel(monkeypatch, drag)
    _, dragged = compared(tmp_path, "pendulum", "semi_implicit", 400)["mine"]
    assert dragged.energies[-1] < run.energies[-1] - 0.1
    monkeypatch.setattr(c, "external_force", lambda system, q: system["m"] * c.GRAVITY)
    compared(tmp_path, "pendulum", "semi_implicit", 9)  # one that takes no v is in it, too


def test_a_page_is_made_and_the_chapter_stays_as_it_is(monkeypatch):
    """Other threads may run it meanwhile."""
    usual = page("double")

    def own(system, q, v=None):
        return system["m"] * c.GRAVITY * (1.0 if c.external_force is own else 2.0)

    monkeypatch.setattr(c, "external_force", own)
    assert page("double") == usual


def test_a_page_that_cannot_be_made_is_not_there_and_told_of(monkeypatch, tmp_path, capsys):
    (tmp_path / publish.PAGE).write_text("old")
    forces = {"branches on a value": lambda q, v: q if q[0, 0] > 0.0 else -q}
    forces["asks for the time"] = lambda q, v: time.time() * v  # which is not to be frozen in
    table, called = c.hold_table, []

    def mending(*state):  # every other step
        called.append(1)
        return c.project(*state) if len(called) % 2 else state[2:4]

    def own(*given):
        return table(*given) | {"mine": c.Hold(1.0, 0.0, 0.0, 0.0, after=mending)}

    forces["does something else"] = lambda q, v: -v if q.dtype == float else q
    for why, force in forces.items():
        feel(monkeypatch, force)
        c.main(["--steps", "2", "--no-rerun", "--no-picture", "--out", str(tmp_path)])
        assert f"\n{publish.PAGE} left out: it {why}" in capsys.readouterr().out
        assert not (tmp_path / publish.PAGE).exists()
    feel(monkeypatch, lambda q, v: 0.0 * q)
    edits = ("hold_table", own, "changes"), ("applied_force", c.external_force, "has")
    for name, value, why in edits:
        with monkeypatch.context() as edited:
            edited.setattr(c, name, value)
            with pytest.raises(Untraceable, match=f"it {why}"):
                page("double")
    with pytest.raises(Untraceable, match="120 rods"):
        page("x", system=c.build_system("chain", links=121))
    monkeypatch.setattr(play, "LONGEST", 100)
    with pytest.raises(Untraceable, match=r"^\d{3} operations a step are too slow for a browser"):
        page("double")


def test_a_page_needs_nothing_else_and_is_the_same_each_time():
    for name, most in (("double", 60_000), ("jansen_leg", 300_000)):
        text = page(name)
        assert text == page(name) and len(text.encode()) <= most
        assert not re.search(r"https?:|\beval\b|new Function|\son\w+=|\bimport\b|src=", text)
        assert "default-src 'none'" in text and "unsafe" not in text
        assert re.search("<noscript>[^<]*allow JavaScript", text)


def test_pages_of_scenes_are_written_with_an_index(tmp_path, capsys):
    assert "'spim'; did you mean 'spin'?" in complaint(capsys, "spim", main=pages.main)
    line = complaint(capsys, "x", main=pages.main)
    assert "none is called 'x'; there are pendulum, double, " in line and "[]" not in line
    line = complaint(capsys, "spin", "--out", tmp_path, "double", main=pages.main)
    assert "unrecognized arguments: double; " in line
    pages.main(["pendulum", "spin", "--out", str(tmp_path)])
    index = (tmp_path / pages.INDEX).read_text()
    assert re.findall('href="(.*?)"', index) == ["pendulum.html", "spin.html"]
    assert all((tmp_path / name).exists() for name in ("pendulum.html", "spin.html"))


# ---- in a browser
@pytest.fixture(scope="module")
def visit(tmp_path_factory):
    """visit(scene, ...): its page, open in one of two tabs without a window; in the end they have
    complained of nothing. Only the tests turn the clock of one, so that a busy machine changes
    nothing; the other is for fingers, with the wall's."""
    programs = filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))
    program = next(programs, None)
    if program is None:
        pytest.skip("chromium is not installed")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    complaints, folder = [], tmp_path_factory.mktemp("pages")
    with api.sync_playwright() as playwright:
        flags = ["--no-sandbox", "--disable-gpu"]
        browser = playwright.chromium.launch(executable_path=program, args=flags)
        turned, touched = browser.new_page(), browser.new_page(has_touch=True)
        for tab in (turned, touched):
            tab.add_init_script(path=HANDS)
            tab.on("pageerror", lambda error: complaints.append(str(error)))
            tab.on("console", lambda message: complaints.append(message.text))
            tab.on("request", lambda asked: complaints.append(asked.url))
        turned.clock.install(time=0)
        turned.clock.pause_at(60_000)

        def visit(name, size=(1100, 820), text=None, wall=False, **media):
            tab, file = touched if wall else turned, folder / f"{name}.html"
            if text or not file.exists():
                file.write_text(text or page(name))
            tab.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
            usual = {"color_scheme": "light", "reduced_motion": "no-preference"}
            tab.emulate_media(**usual | media)
            tab.goto(file.as_uri())
            return tab

        yield visit
        browser.close()
    assert [x for x in complaints if not x.startswith("file:")] == []


SCREENS = [("double", "dark", (390, 844)), ("jansen_leg", "light", (1100, 820))]


@pytest.mark.parametrize(("name", "theme", "size"), SCREENS)
def test_a_page_fits_its_screen_and_runs_without_an_error(name, theme, size, visit):
    tab = visit(name, size, color_scheme=theme)
    for button in tab.query_selector_all("button"):
        if button.is_visible():
            button.dispatch_event("click")
            tab.clock.run_for(50)
    wide, tall = tab.evaluate("[document.body.scrollWidth, document.body.scrollHeight]")
    assert wide <= size[0] and tall <= size[1] + 40


def test_a_scene_may_be_called_like_a_blank_of_the_template(visit):
    odd, system = "<i>{{policy}} /* data */ {{name}}", c.build_system("pendulum")
    assert (
        visit("odd", text=page(odd, system=system)).inner_text("h1").startswith(f"{odd}: five ways")
    )


def test_the_longest_names_and_the_clock_stay_on_a_narrow_screen(monkeypatch, visit):
    table, name = c.hold_table, 9 * "long"
    monkeypatch.setattr(c, "hold_table", lambda *given: {name: table(*given)["none"]})
    system, step_fn = c.build_system("pendulum"), c.semi_implicit_step
    text = play.page(c, 2 * name, system, "semi_implicit", step_fn, *USUAL)
    tab = visit("long", (320, 640), text=text)
    assert tab.evaluate("document.documentElement.scrollWidth") == 320
    assert tab.evaluate("byId('clock').getBoundingClientRect().right") < 320
    assert tab.evaluate("[...document.querySelectorAll('b')].every((x) => x.offsetWidth < 100)")


def test_the_clock_is_the_walls(visit):
    tab = visit("double")
    for dt in (0.0025, 0.005, 0.01, 0.02):
        tab.evaluate("hands.pick", ["dt", dt])
        begun = tab.evaluate("performance.now()")
        tab.clock.run_for(1000)
        passed = (tab.evaluate("performance.now()") - begun) / 1000.0
        assert passed >= 0.95 and tab.evaluate("time") == pytest.approx(passed, rel=0.05)
        assert tab.evaluate("Math.abs(time - taken * knobs.dt)") == 0.0


def test_a_drag_moves_a_particle_in_every_tile_and_arrow_keys_pull_until_escape(visit):
    tab = visit("double")
    tab.clock.run_for(100)
    x, y = tab.evaluate("hands.spot", ["impulse", 1])
    tab.mouse.move(x, y)
    tab.mouse.down()
    target = tab.evaluate("hands.spot", ["impulse", -1])  # to the anchor
    tab.mouse.move(*target, steps=5)
    swing = tab.evaluate("copies[0].swing")
    tab.evaluate("hands.go", 600)
    assert tab.evaluate("copies[0].swing") == swing  # the hand's energy is no mode's error
    for mode in tab.evaluate("data.modes"):
        far = tab.evaluate("hands.reach", [mode, 1])
        assert far < 0.3, mode  # of rods of 1 m: held by the hand's spring
    assert target == tab.evaluate("hands.spot", ["impulse", -1])
    tab.mouse.up()
    assert tab.evaluate("[hand.particle, ...knobs.pull]") == [None, 0, 0]
    tab.focus("canvas.view")
    tab.keyboard.press("ArrowUp")
    assert tab.evaluate("[hand.particle, knobs.pull[1] > 0]") == [1, True]
    held = tab.evaluate("knobs.hand")
    tab.mouse.move(x, y)  # a mouse that passes by leads nothing
    assert tab.evaluate("knobs.hand") == held
    tab.press("input >> nth=0", "Escape")
    assert tab.evaluate("hand.particle") is None
    tab.press("canvas.view >> nth=0", "Alt+ArrowLeft")  # which turns back to another page
    assert tab.evaluate("hand.particle") is None
    tab.mouse.down(button="right")
    assert tab.evaluate("hand.particle") is None
    tab.mouse.up(button="right")


def test_what_questions_say_is_seen(visit):
    tab = visit("double")
    tab.click("text=Why does none grow?")
    tab.click("#one", click_count=6)
    assert tab.evaluate("copies[0].error / view.wide") > 0.01  # a pixel of a hundred
    tab.click("text=How soft is soft?")
    hang = "begin(), hands.copy('soft').state.set([0, -1, 0, -2, 0, 0, 0, 0]), hands.go(3000)"
    stretch = [tab.evaluate(f"knobs.T *= {x}, {hang}, hands.copy('soft').error") for x in (1, 2)]
    assert stretch[0] < 0.01 and stretch[1] / stretch[0] == pytest.approx(4.0, rel=0.1)
    tab.click("text=Half the step?")
    tab.evaluate("hands.go(300), globalThis.kept = before, null")
    tab.click("#again")
    assert tab.evaluate("before === kept")
    tab = visit("peaucellier")
    tab.click("text=Where is w's cliff?")
    for lost in (None, "flew apart at 1.10 s"):  # and a notch to the right
        tab.click("#again")
        tab.evaluate("hands.go", 2000)
        assert tab.evaluate("hands.copy('baumgarte').lost") == lost
        tab.press("input[aria-label^=w]", "ArrowRight")
    tab.press("input[aria-label^=w]", "ArrowRight")  # past theory's cliff, too
    tab.clock.run_for(500)
    assert lost in tab.inner_text("#tiles") and "0.85 of 0.828" in tab.inner_text("#knobs")
    asked = visit("gauss", text=page("double", "gauss")).inner_text("#questions")
    assert "cliff" not in asked and "grow" not in asked


def test_where_only_no_spring_at_all_holds_or_each_does_the_cliff_says_so(visit):
    """Of rods of 1 mm, in steps that are long for such."""
    system = c.build_system("double")
    system |= {key: 1e-3 * system[key] for key in ("q0", "lengths")}
    tab = visit("small", text=page("small", system=system))
    tab.click("text=Where is w's cliff?")
    said = tab.inner_text("#say")
    assert "here w = 0 (dt w = 0) holds for 10 s, w = 5 " in said and "Move w" in said
    tab = visit("upright")  # where nothing moves: there is no notch to the right of the last w
    tab.click("text=Where is w's cliff?")
    assert tab.inner_text("#say").endswith("here w = 396 (dt w = 1.98) holds for 10 s.")


def test_where_there_is_no_time_for_a_question_no_more_is_said_than_was_tried(visit):
    tab = visit("double")
    slow = "(ms) => { let now = 0; performance.now = () => (now += ms); }"  # each time it is asked
    tab.evaluate(slow, 1)
    tab.click("text=Where is w's cliff?")
    assert " holds for 2 s, " in tab.inner_text("#say")
    tab.evaluate(slow, 50)
    tab.click("text=Half the step?")
    assert tab.evaluate("taken") == 1  # and the page answers, before there is the next one
    tab.click("#again")
    tab.clock.run_for(500)
    assert tab.evaluate("before") is None
    tab.click("text=Half the step?")
    tab.clock.run_for(1000)
    assert tab.evaluate("before[0].errors.length * before[0].bin") > 0.9  # s, to be seen


def test_a_button_that_is_pressed_keeps_its_look_where_colours_are_forced(visit):
    tab = visit("double")
    tab.click("#slow")
    asked = "['slow', 'forces'].map((id) => getComputedStyle(byId(id)).forcedColorAdjust)"
    assert tab.evaluate(asked) == ["none", "auto"]


def test_a_question_that_is_asked_is_read_whole(visit):
    """On a phone the row of questions fades out to the right, over its last seventh."""
    tab = visit("double", (390, 844))
    for button in tab.query_selector_all("#questions button")[:-1]:
        button.click()
        box = button.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 390 * 0.86


@pytest.mark.parametrize("wide", [360, 701, 900])
def test_a_small_screen_shows_what_is_asked_for_and_no_number_wraps(wide, visit):
    tab = visit("double", (wide, 844))
    tab.click("text=What keeps energy?")
    assert tab.evaluate("byId('plots').children[1].clientWidth") > 0
    tab.click("text=What is near the truth?")
    tab.evaluate("hands.go", 400)
    tab.clock.run_for(500)
    assert tab.is_visible("dd.away") and 10 < tab.evaluate("hands.tallest()") < 20


def test_only_a_browser_that_is_late_for_seconds_is_said_to_be(visit):
    tab = visit("double")
    late = "(n) => { for (; n > 0; n--) advance((clock.last || 1) + 500); tell(); }"
    for frames, said in ((3, False), (6, True)):  # of which each drops 0.4 s
        tab.evaluate(late, frames)
        assert ("only 20 %" in tab.inner_text("#notes")) == said
    tab.evaluate("play(false), tell()")
    assert tab.inner_text("#notes") == ""
    tab.evaluate(late, 12)  # and after so many the truth is left out
    assert tab.inner_text("dd.away >> nth=0").startswith("≥ ")
    tab.evaluate("begin(), tell()")
    assert tab.inner_text("dd.away >> nth=0") == "–"


def test_a_new_step_is_a_new_run_beside_the_pale_one_before(visit):
    tab = visit("double")
    tab.evaluate("hands.go", 200)
    tab.evaluate("hands.pick", ["w", 40.0])  # goes on, with a tick in the plot
    tab.evaluate("hands.pick", ["w", 80.0])  # soon after: the tick moves on
    assert tab.evaluate("[time > 0.9, marks.length, before]") == [True, 1, None]
    assert tab.evaluate("marks[0][1]") == "w 80" and tab.is_hidden(".halved >> nth=0")
    tab.evaluate("hands.pick", ["dt", 0.0025])
    assert tab.evaluate("[time, marks.length, before.length]") == [0, 0, 5]
    tab.evaluate("hands.pick(['dt', 0.05]), hands.go(40), hands.pick(['dt', 0.005])")
    assert tab.evaluate("before[0].errors.length * before[0].bin") == pytest.approx(2.05)
    tab.evaluate("hands.pick(['dt', 0.0005]), hands.go(4000)")
    assert 290 < tab.evaluate("copies[0].trail.length") < 310  # soon drawn, by any step
    tab.click("text=As it was")
    assert tab.evaluate("knobs.dt === data.knobs.dt && knobs.w === data.knobs.w")


def test_a_swipe_beside_the_particles_scrolls_and_one_on_them_does_not(visit):
    tab = visit("double", (390, 600), wall=True)
    tab.click("#run")
    devtools = tab.context.new_cdp_session(tab)

    def touch(kind, *points):
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def swipe(x, y):
        touch("touchStart", {"x": x, "y": y})
        for up in (30, 60, 120):
            touch("touchMove", {"x": x, "y": y - up})
        held = tab.evaluate("hand.particle")
        touch("touchEnd")
        return held

    spots = [tab.evaluate("hands.spot", [mode, 1]) for mode in ("none", "impulse")]
    assert swipe(*spots[0]) == 1  # it goes with the finger
    fingers = [{"x": x, "y": y + 5 * k, "id": k} for k, (x, y) in enumerate(spots)]
    touch("touchStart", fingers[0])
    held = tab.evaluate("knobs.hand")
    touch("touchStart", *fingers)  # not with a second one
    assert tab.evaluate("knobs.hand") == held
    touch("touchEnd")
    tab.evaluate("new Promise(requestAnimationFrame)")
    assert tab.evaluate("scrollY") == 0
    box = tab.query_selector("canvas.view").bounding_box()
    assert swipe(box["x"] + 10, box["y"] + box["height"] - 5) is None
    tab.wait_for_function("scrollY > 50")


def test_60_frames_a_second(visit):
    assert (
        visit("jansen_leg", wall=True).evaluate("hands.frames", 205) < 205
    )  # 200 ms for 12 of them


def test_reduced_motion_is_paused_and_of_a_sine_bits_may_differ(visit, monkeypatch):
    feel(monkeypatch, lambda q, v: np.sin(q))
    tab = visit("sines", text=page("pendulum"), reduced_motion="reduce")
    tab.clock.run_for(500)
    assert tab.evaluate("time") == 0 and tab.inner_text("#run") == "start"
    tab.press("canvas.view >> nth=0", "ArrowUp")
    tab.clock.run_for(50)
    assert "start it" in tab.inner_text("#notes")
    tab.keyboard.press("Escape")
    tab.click("#one")
    assert tab.evaluate("taken") == 1
    tab.click("#run")
    tab.clock.run_for(500)
    assert "uses sin" in tab.inner_text("#notes")
    tab.click("text=As it was")
    assert "but for their last bits" in tab.inner_text("#say")


def test_a_force_that_comes_to_no_end_stops_what_it_moves_and_not_the_page(visit, monkeypatch):
    def drag(q, v):  # of slow particles alone
        return repeat(lambda y: (0.9 * y, 100.0 * np.sum(y * y)), -v, 20, "too fast")

    feel(monkeypatch, drag)
    tab = visit("drag", text=page("pendulum"))
    tab.click("#run")
    tab.click("#forces")
    for _ in range(18):
        tab.click("#one")
        tab.clock.run_for(50)  # in which it is drawn
    assert "too fast at 0.09 s" in tab.inner_text("#tiles")


def test_a_scene_that_is_not_flat_turns(visit):
    system = c.build_system("double") | {"v0": np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])}
    tab = visit("turned", text=page("turned", system=system))
    tab.clock.run_for(500)
    before = tab.evaluate("hands.spot", ["none", 1])
    tab.locator("input[aria-label^=turn]").fill("90")
    assert before != tab.evaluate("hands.spot", ["none", 1])
    assert tab.evaluate("place(copies[0].state, 1)[2]") != 0.0
