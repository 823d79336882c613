"""The page of a scene: its bits, its words beside Python's, and what Chromium shows."""

import contextlib
import io
import json
import re
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RECORD, SCREENS, click, contrast, drag, drawn, draws, near, places

import constraints as c
from curriculum.ch3_4_constraints.page import answer as answers
from curriculum.ch3_4_constraints.page import play, scene
from curriculum.ch3_4_constraints.rods.advice import advice, command
from curriculum.ch3_4_constraints.rods.schemes import scheme_of
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.common import palette, words

KNOBS = {"baumgarte": 20.0, "time_constant": 0.02}
METHODS = list(c.make_methods())
BOARD = -1  # the last canvas: the plot
LEVER = {  # of centimetres, with masses that are not 1
    "about": "A lever of two centimetres. It swings.",
    "particles": [
        {"position": [0.014, -0.012, 0.0], "mass": 0.03},
        {"position": [0.046, -0.01, 0.0], "mass": 0.2},
    ],
    "anchors": [[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]],
    "rods": [{"pair": [0, -1]}, {"pair": [1, -2]}, {"pair": [1, 0]}],
}
TAKE_STEPS = """() => {
  const scene = %s;
  return Object.keys(scene.method_of).map(name => {
    const motion = new Motion(scene, name, Motion.knobs(scene, %s));
    for (let k = 0; k < 100; k++) motion.step();
    return [name, Array.from(motion.state), [motion.energy, ...motion.errors]];
  });
}"""


def states(shown, system, others=(), **settings):
    """{scheme: (q, v), [energy, *errors]} after 100 steps of 2 ms, as a page takes them.

    `settings` of knobs and hand are other than those the page begins with.
    """
    knobs = {"dt": 0.002, **KNOBS}
    made = scene.scene_of(c.this_chapter(), system, "semi_implicit", knobs, others=others)
    found = shown.evaluate(TAKE_STEPS % (scene.as_script(made), json.dumps(settings)))
    return {x: (np.reshape(state, (2, -1, 3)), told) for x, state, told in found}


@pytest.fixture(scope="module")
def lever(tmp_path_factory):
    """The file of LEVER."""
    path = tmp_path_factory.mktemp("scene") / "lever.json"
    path.write_text(json.dumps(LEVER))
    return str(path)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """written(*flags): what a run prints and writes, and what its page was made of."""
    page = play.page

    def run(*flags):
        given = []
        folder = tmp_path_factory.mktemp("page")
        printed = io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
            patch.setattr(play, "page", lambda *args: given.append(args) or page(*args))
            c.main([*flags, "--no-rerun", f"--out={folder}"])
        found = dict(zip(["asked", "results", "truth", "answer"], *given, strict=True))
        path = folder / "play.html"
        text = path.read_text("utf-8")
        return SimpleNamespace(path=path, text=text, printed=printed.getvalue(), **found)

    return run


@pytest.fixture(scope="module")
def small(written, lever):
    """The lever's page, with an answer."""
    return written("--system", lever, "--dt", "0.002", "--steps", "200", "--within", "0.5mm")


@pytest.fixture(scope="module")
def lever_page(visit, small):
    page = visit(small.path)
    page.evaluate(RECORD)
    return page


@pytest.fixture
def shown(lever_page):
    """The lever's page as the run was, at rest."""
    click(lever_page, "As it was")
    lever_page.evaluate("clock.set(false); run.begin()")
    return lever_page


def steps(shown, many):
    shown.evaluate(f"for (let k = 0; k < {many}; k++) run.step(); drawing.draw()")


def own(page, name, many, dt=0.002, **knobs):
    """A Run of a page's system, as Python takes it."""
    with np.errstate(all="ignore"):
        return c.run_method(page.asked.system, name, "semi_implicit", dt, many, **knobs)


def told(shown):
    """What the plot says of each copy."""
    return shown.locator("#board canvas").get_attribute("aria-label").partition(":")[2]


def cells(text, start):
    """[[name, *cells]] of the table that follows `start` in the text of a page."""
    body = re.search("<tbody>(.*?)</table>", text[text.index(start) :], re.S)[1]
    rows = [re.split("<t[hd][^>]*>", row)[1:] for row in body.split("<tr>")[1:]]
    return [[unescape(cell).strip() for cell in row] for row in rows]


# --- its bits ---


@pytest.mark.parametrize("name", ["double", "jansen_leg", "spin", "lever"])
def test_steps_of_each_scheme_are_pythons_bits(name, lever, lever_page):
    system = c.build_system(lever if name == "lever" else name)
    pairs = [("semi_implicit", x) for x in METHODS]
    others = [("rk4", "project"), ("euler", "none")]
    schemes = [scheme_of(c.this_chapter(), *pair, KNOBS) for pair in others]
    found = states(lever_page, system, schemes)
    assert [*found] == METHODS + [str(scheme) for scheme in schemes]
    for (integrator, method), (state, told) in zip(pairs + others, found.values(), strict=True):
        run = c.run_method(system, method, integrator, 0.002, 100)
        assert np.array_equal(state, [run.q[-1], run.v[-1]]), method
        energy = run.energies[-1] / energy_scale(system, c.GRAVITY)
        errors = c.rod_lengths(system, run.q[-1]) - system["lengths"]
        near(told, [energy, *errors], 1e-12)


@pytest.mark.parametrize("hand", [[0.02, -0.03, 0.0], [100.0, -2.0, 0.0]])
def test_sliders_and_a_hand_pull_each_method_as_a_force_would(hand, lever, lever_page, monkeypatch):
    system = c.build_system(lever)
    knobs = {"baumgarte": 40.0, "time_constant": 0.05}

    force = c.external_force

    def pulled(system, q, v):  # by a damped spring, not harder than three times all weights
        pull = 5.0 * (np.array(hand) - q[1] - 0.1 * v[1])
        pull = pull * np.minimum(1.0, 30.0 * np.sum(system["m"]) / np.sqrt(pull @ pull))
        return force(system, q, v) + pull * np.array([[0.0], [1.0]])

    found = states(lever_page, system, hand=hand[:2], pulls=[0, 5], **knobs)
    monkeypatch.setattr(c, "external_force", pulled)
    for name, (state, _) in found.items():
        with np.errstate(all="ignore"):
            run = c.run_method(system, name, "semi_implicit", 0.002, 100, **knobs)
        near(state, [run.q[-1], run.v[-1]], 1e-7)


def test_what_a_page_cannot_hold_is_refused():
    up = c.Method(lambda system: lambda q, v: np.ones_like(q), "no rods")
    lifted = c.this_chapter()._replace(make_methods=lambda **knobs: {"up": up})
    thrown = c.build_system("double")
    thrown["v0"][1, 2] = 1.0
    for chapter, system, why in [
        (c.this_chapter(), c.build_system("chain", links=41), "more than 40 rods"),
        (c.this_chapter(), thrown, "in the plane z = 0 only"),
        (lifted, c.build_system("double"), "leaves the plane z = 0"),
    ]:
        with pytest.raises(scene.NoPage, match=why):
            scene.scene_of(chapter, system, "semi_implicit", {"dt": 0.005})


def test_a_page_holds_as_many_rods_as_may_be(monkeypatch):
    monkeypatch.setattr(scene, "MAX_RODS", 2)
    found = scene.scene_of(c.this_chapter(), c.build_system("double"), "rk4", {"dt": 0.005})
    assert len(found["pairs"]) == 2


def test_lengths_and_shares_are_written_as_python_writes_them(lever_page):
    numbers = [x * 10.0**k for x in (1.0, 1.25, 3.14159, 9.949, 9.96) for k in range(-14, 3)]
    found = lever_page.evaluate("all => all.map(x => [metric(x), perCent(x)])", numbers)
    assert found == [[words.length(x), words.per_cent(x)] for x in numbers]


# --- what Python writes ---


def test_a_page_says_what_its_scene_is():
    double = c.build_system("double")
    assert play.about({"about": "A leg of wood. It walks."}) == "A leg of wood"
    assert play.about({**double, "about": " . "}) == "2 bobs, 2 kg, on 2 m of rods"
    loaded = double | {"load": np.array([[0.0, 3.0, 4.0], [0.0, -20.0, 0.0]])}
    assert play.about(loaded).endswith("under loads of 25 N")


def test_terminal_metrics_and_page_say_the_same_of_a_run(written):
    run = written("--baumgarte", "400", "--dt", "0.004", "--steps", "2500")
    printed = [re.split(" {2,}", x) for x in run.printed.splitlines()]
    for name, *found in cells(run.text, 'id="found"'):
        [[_, *line]] = [x for x in printed if x[0] == name]
        if name == "baumgarte":
            assert found == [run.results[name]["stopped"]] == line
            continue
        work = words.amount(run.results[name]["operations"])
        assert found == [*line[:3], line[4], work]


def test_the_answer_stands_on_the_page_with_its_command_and_no_time_of_this_machine(small):
    said = advice(small.asked, small.answer)
    found = [row for row in cells(small.text, 'id="ladder"') if len(row) > 1]
    for line, row in zip(said.lines + said.alone, found, strict=True):
        work = words.amount(1e-3 * line.rung.operations, 2)
        assert row == [line.name.strip(), *line.cells[:-1], work]
    assert command(small.asked, small.answer) in unescape(small.text)
    rows = [row._replace(pace=2.0 * row.pace) for row in small.answer.rows]
    slower = small.answer._replace(rows=rows)
    assert play.page(small.asked, small.results, small.truth, slower) == small.text


def test_a_row_that_is_lost_says_so_in_one_cell(small):
    first = small.answer.rows[0]
    twice = first.twice._replace(lost="at 0.3 s: diverged")
    answer = small.answer._replace(rows=[first._replace(twice=twice)])
    text = answers.of_the_answer(small.asked, answer, {"colors": {}})["answer"]
    wide = len(advice(small.asked, answer).heads)
    assert f'<td colspan="{wide}">at 0.3 s: diverged' in text
    assert [len(row) for row in cells(text, "ladder")] == [1 + wide, 2, 1, 1 + wide]


def test_without_an_answer_stands_the_command_that_finds_one(written):
    page = written("--integrator", "rk4", "--steps", "9")
    assert "--integrator rk4 --steps 9 --no-rerun --within 1mm</code>" in page.text
    assert "ladder" not in re.findall('id="(.*?)"', page.text)
    assert "impulse is left out: it is made for semi_implicit." in page.text
    unlike = {"none": {"unlike": "its loop changes m"}}
    assert "its loop changes m." in play.facts(page.asked, unlike, {"made_for": {}})[1]


# --- what a browser shows ---


@pytest.mark.parametrize(("size", "theme"), SCREENS)
def test_a_screen_is_sharp_and_legible_and_no_control_shifts_the_tiles(small, visit, size, theme):
    shown = visit(small.path, viewport=size, color_scheme=theme, device_scale_factor=2)
    assert shown.locator("#time").inner_text() == "0.00 s", "it waits for who wants less motion"
    names = ["ink", "quiet", "long", "short", *(f"m{k}" for k in range(len(palette.METHODS)))]
    colors = {color.strip() for color in shown.evaluate("names => names.map(ink)", names)}
    assert len(colors) == len(names)
    assert min(contrast(x, palette.PAPER[theme == "dark"]) for x in colors) >= 4.5
    sizes = "all => all.map(x => [x.width / x.clientWidth, x.height / x.clientHeight])"
    sharp = shown.locator("canvas:visible").evaluate_all(sizes)
    near(sharp, np.full((6, 2), 2.0), 0.02)
    place = """() => {
      clock.set(false);
      const top = byId("tiles").getBoundingClientRect().top + scrollY;
      return [top, document.documentElement.scrollWidth];
    }"""
    before = shown.evaluate(place)
    assert before[1] == size["width"]
    buttons = shown.locator("#questions button, #ladder button, #views button, #controls button")
    assert buttons.count() == 5 + 7 + 3 + 2
    for button in buttons.all():
        button.click()
        assert shown.evaluate(place) == before
    shown.emulate_media(color_scheme="dark" if theme == "light" else "light")
    shown.wait_for_function("x => ink('ink').includes(x)", arg=palette.INK[theme == "light"])


def test_on_paper_it_is_light_and_without_what_only_a_screen_can_do(small, visit):
    shown = visit(small.path, color_scheme="dark")
    shown.emulate_media(media="print", color_scheme="dark")
    shown.wait_for_function("x => ink('ink') === x", arg=palette.INK[0])
    assert shown.locator("button:not(#ladder *):visible, input:visible").count() == 0
    assert shown.locator(":is(#says, #found tbody, #ladder, #title):visible").count() == 4


def test_as_it_was_has_the_numbers_of_the_run(shown, small):
    assert "from true motion" in shown.locator(".now").first.inner_text()
    steps(shown, 200)
    system = small.asked.system
    runs = {name: own(small, name, 200) for name in METHODS}
    for k, (name, run) in enumerate(runs.items()):
        off = max(c.rod_lengths(system, run.q[-1]) - system["lengths"], key=abs)
        rods = f"{words.length(abs(off))} too {'long' if off > 0 else 'short'}"
        now = shown.locator(".now").nth(k).inner_text().splitlines()
        away = f"{words.length(small.results[name]['error'])} from true motion"
        assert now == ["rods are right" if name == "project" else rods, away]
        assert f"{name} {words.length(np.max(run.violations))}" in told(shown)
    for k in range(len(METHODS)):
        near(places(shown, "line", "reference", k)[2], small.truth.q[[1, 0]], 1e-4)
    click(shown, "Energy")
    for k, (name, run) in enumerate(runs.items()):
        gains = (run.energies - run.energies[0]) / energy_scale(system, c.GRAVITY)
        most = max(gains, key=abs)
        assert f"{name} {'+' if most > 0 else '−'}{words.per_cent(abs(most))}" in told(shown)
        curve = drawn(shown, "line", f"m{k}", BOARD)[0].at
        now = np.rint(curve[:, 0] / 0.002).astype(int)
        near(curve[:, 1], gains[now], 1e-9)
    ticks = {x.text: x.at[1] for x in drawn(shown, "words", "quiet", BOARD) if "%" in x.text}
    assert [*ticks] == ["+10 %", "+5 %", "0 %", "−5 %", "−10 %"], "above soft's 6.9 %"
    near([*ticks.values()], [0.1, 0.05, 0.0, -0.05, -0.1], 0.005)
    assert shown.evaluate("[0, 0.03, 0.3].map(roundUp)") == [0.01, 0.05, 0.5]
    draws(shown, "line", "m1", [runs["baumgarte"].tip[1:]], 1)


@pytest.mark.parametrize("name", ["lever", "jansen_leg"])
def test_a_touch_on_a_row_plays_the_answer_as_it_was_found(name, small, written, visit):
    leg = ("--system", name, "--steps", "400", "--within", "1cm")
    page = small if name == "lever" else written(*leg)
    assert len(page.text) < 600_000
    shown = visit(page.path)
    rungs = [rung for rung, _ in answers.rungs(page.answer)]
    shown.evaluate(RECORD)
    row = shown.locator("#ladder button").nth(1)
    row.click()
    shown.wait_for_function("() => run.time > 0.1")
    shown.evaluate("clock.set(false); run.begin()")
    steps(shown, round(page.answer.seconds / shown.evaluate("run.tick")))
    tiles = shown.locator(".tile:visible")
    assert tiles.nth(1).get_attribute("class") == "tile marked"
    thick = [x.color for x in drawn(shown, "line", None, BOARD) if x.width == 4]
    assert thick == [f"m{METHODS.index(rungs[1].scheme.method)}"]
    assert shown.locator("#board").bounding_box()["width"] > 500.0, "in one column it is crowded"
    for rung, tile in zip(rungs, tiles.all_inner_texts(), strict=True):
        assert tile.startswith(f"{rung.scheme} in steps of {words.milliseconds(rung.dt)}")
        assert f"places {words.length(rung.places)} off" in tile
        assert f" {words.milliseconds(rung.dt)} " in told(shown)
        if rung.span == page.answer.seconds and rung.scheme.method != "project":
            assert f"{words.length(rung.rods)} too " in tile
    assert shown.locator("input:enabled").count() == 0
    row.click()
    assert tiles.count() == len(METHODS) and shown.locator("input:enabled").count() == 3


def test_a_row_is_played_for_as_long_as_it_was_tried(shown, small):
    shown.locator("#ladder button").first.click()
    tick, time = shown.evaluate("""() => {
      performance.now = () => 0; // no frame is too long
      run.begin();
      clock.set(true);
      clock.advance(0.09);
      delete performance.now;
      return [run.tick, run.time];
    }""")
    near(time, 0.09, 1.01 * tick)
    shown.evaluate("for (let k = 0; clock.going && k < 1000; k++) run.step()")
    assert shown.evaluate("run.time") == 0.4
    more = """() => {
      clock.set(true);
      for (let k = 0; clock.going && k < 300; k++) run.step();
      clock.set(false);
      return run.time;
    }"""
    assert shown.evaluate(more) > 0.6, "who wants to sees more"
    places = f"places {words.length(small.answer.verdict.rung.places)} off"
    assert places in shown.locator(".tile.marked").inner_text()
    for gesture, says in [
        ("hand.drag(run.copies[0], 0, [0, 0]); hand.letGo()", "from true motion"),
        ("run.begin()", places),
    ]:
        shown.evaluate(f"clock.set(false); {gesture}")
        steps(shown, 400)
        assert says in shown.locator(".tile.marked").inner_text()


def test_what_is_not_known_of_the_true_motion_is_not_said(shown):
    steps(shown, 9)
    doubt = shown.evaluate("truth.doubt = 0.05 * extent")
    steps(shown, 1)
    says = f"{words.length(doubt)} from true motion"
    assert shown.locator(".now").nth(2).inner_text().endswith(says)
    shown.evaluate("truth.doubt = 0.2 * extent")
    steps(shown, 1)
    assert "true motion" not in "".join(shown.locator(".now").all_inner_texts())
    draws(shown, "line", "reference", [])


def test_a_method_that_is_lost_says_when_and_why(shown, small):
    shown.locator("#baumgarte input").fill("10")  # 320/s
    shown.locator("#dt input").fill("5")
    steps(shown, 200)
    dt = shown.evaluate("knobs.dt")
    lost = own(small, "baumgarte", 200, dt, baumgarte=320.0).lost
    texts = shown.locator(".lost:visible").all_inner_texts()
    assert texts[1] == f"{lost}. Try a shorter step." and "baumgarte lost" in told(shown)
    assert shown.locator(".tile:visible [inert] .hand").count() == 2 * sum(map(bool, texts))
    shown.evaluate("run.begin(); run.copies[4].state.set([1e4, 0, 0, 1e4, 0, 0], 6)")  # m/s
    steps(shown, 1)
    texts = shown.locator(".lost:visible").all_inner_texts()
    assert texts == [""] * 4 + ["lost at 0 s: no way back onto the rods. Try a shorter step."]
    shown.locator("#ladder button").first.click()
    shown.evaluate(
        "hand.drag(run.copies[1], 0, [0, 0]); run.copies[0].lost = 'so'; clock.set(false)"
    )
    assert shown.locator(".lost:visible").first.inner_text().endswith(": so."), (
        "it has its own step"
    )


@pytest.mark.parametrize(("stretch", "color"), [(0.2, "long"), (-0.2, "short")])
def test_what_is_too_long_is_red_and_what_is_too_short_dashed_blue(shown, stretch, color):
    right = np.array(LEVER["particles"][0]["position"])
    draws(shown, "line", color, [], 1)  # as it starts, all rods are right
    at = (1.0 + stretch) * right
    shown.evaluate("at => { run.copies[1].state.set(at); drawing.draw(); }", at.tolist())
    first = drawn(shown, "line", color, 1)[0]
    near(first.at, [right, at])
    assert bool(first.dash) == (color == "short")
    near(places(shown, "line", "ink", 1)[0], [0.0 * at, min(right, at, key=np.linalg.norm)])


def test_what_is_rounding_is_measured_by_the_shortest_rod(shown):
    for off, says, look in [
        (1e-12, "rods are right", ""),
        (1e-10, "100 pm too long", ""),
        (1e-7, "100 nm too long", "long"),
    ]:
        shown.evaluate(f"run.copies[1].off = {off}; drawing.draw()")
        tile = shown.locator(".now b").nth(1)
        assert [tile.inner_text(), tile.get_attribute("class")] == [says, look]


def test_the_plot_has_a_decade_a_tick_down_to_a_millionth_of_the_rods(shown, small):
    steps(shown, 100)
    marks = {mark.text: mark for mark in drawn(shown, "words", None, BOARD)}
    heights = [marks[tick].at[1] for tick in ("10 cm", "1 mm", "≤ 100 nm")]
    near(heights, [-1.0, -3.0, -7.0], 0.08)
    worst = np.max(own(small, "none", 100).violations)
    assert f"none {words.length(worst)}" in marks
    for color, end in ("m0", np.log10(worst)), ("m4", -7.0):
        near(drawn(shown, "line", color, BOARD)[0].at[-1, :2], [0.2, end])
    kept = """copy => {
      for (copy.time = 0.22; copy.time < 30; copy.time += 0.04) copy.note("rods", 0);
      return [0, -1].map(k => copy.curves.rods.at(k)[0]);
    }"""
    first, last = shown.evaluate(f"({kept})(run.copies[1])")
    assert last > 29.9 and 20.0 < last - first < 23.0
    shown.evaluate("run.copies[0].curves.rods.push([30, 1e9]); board.draw()")
    *_, stub = drawn(shown, "line", "m0", BOARD)
    near(stub.at[0, :2], [30.0, shown.evaluate("board.plot.box[3]")])
    assert any(x.text.endswith("▲") for x in drawn(shown, "words", "m0", BOARD))


@pytest.mark.parametrize(("now", "left", "right"), [(0.2, 0, 5), (8, 0, 10), (30, 10, 30)])
def test_a_plot_rules_a_line_through_each_tick_and_names_its_seconds(shown, now, left, right):
    shown.evaluate("s => { run.copies[0].curves.rods = [[s, 1e-3]]; board.draw(); }", now)
    ruled = [[[left, k], [right, k]] for k in range(-1, -8, -1)]
    draws(shown, "line", "pale", ruled, BOARD)
    named = {x.text: x.at[0] for x in drawn(shown, "words", "quiet", BOARD) if x.text[-1] == "s"}
    apart = (right - left) // 5
    seconds = [s for s in range(right + 1) if s >= left and s % apart == 0]
    assert [*named] == [f"{s} s" for s in seconds]
    near([*named.values()], seconds, 0.03 * apart)


def test_each_of_eight_methods_has_a_look_of_its_own_and_drag_is_no_error(written, visit):
    make = c.make_methods
    force = c.external_force

    def more(*knobs, **named):
        rows = make(*knobs, **named)
        return rows | dict.fromkeys(["sixth", "seventh", "eighth", "ninth"], rows["none"])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(c, "make_methods", more)
        patch.setattr(c, "external_force", lambda system, q, v: force(system, q, v) - 0.5 * v)
        shown = visit(written("--steps", "99").path)
    looks = shown.evaluate("run.copies.map(({color, dash}) => [color, `${dash}`])")
    assert [len({*x}) for x in zip(*looks[:8], strict=True)] == [8, 8]
    assert looks[8] == looks[0], "from there on they begin again"
    click(shown, "Energy")
    assert shown.locator("#title").inner_text() == "Energy change"
    assert shown.evaluate("truth.known"), "by project, wherever it stands"
    assert "energy change" in shown.locator("#found thead").inner_text()
    assert shown.locator("#questions").get_by_text("energy").count() == 0


def test_time_passes_while_a_hand_pulls_and_what_it_adds_is_no_error(shown):
    hand = shown.locator(".tile").nth(3).locator(".hand").last
    click(shown, "Energy")
    for key in "Escape", "Tab", "Shift":  # or by the mouse alone
        before = shown.evaluate("run.time")
        let_go = drag(hand, 3000, 0)  # far away, but its force is bounded
        shown.wait_for_function("before => run.time > before + 0.1", arg=before)
        shown.keyboard.press(key)
        let_go()
        assert not shown.evaluate("hand.copy || clock.going"), "it stands still again"
        assert not any(shown.locator(".lost:visible").all_inner_texts())
        assert "%" not in told(shown)
        assert shown.locator("#time").inner_text() == shown.evaluate("`${run.time.toFixed(2)} s`")
    gain = """() => {
      run.begin();
      const energy = run.copies[4].energy;
      hand.drag(run.copies[4], 1, [0.06, 1]);
      for (let k = 0; k < 50; k++) run.step();
      hand.letGo();
      return run.copies[4].energy - energy;
    }"""
    assert shown.evaluate(gain) > 0.1
    steps(shown, 4)  # from where it was let go, its energy changes by no more
    assert shown.evaluate("Math.abs(run.copies[4].worst.energy)") < 0.05
    click(shown, "Play")
    shown.evaluate("hand.drag(run.copies[0], 0, [0, 0]); hand.letGo()")
    assert shown.evaluate("clock.going"), "as it did before"


def test_a_bob_that_is_taken_at_its_edge_goes_as_far_as_the_mouse(shown):
    shown.evaluate("() => { clock.advance = () => {}; }")  # the bob stays where it is
    bob = shown.locator(".tile").nth(3).locator(".hand").last
    x, y, scale = shown.evaluate("[...run.copies[3].point(1), run.copies[3].view.scale[0]]")
    for up, aside in (0, -12), (50, -12):  # pixels: it does not jump to the mouse
        drag(bob, 0, -up, (aside, 0))()
        near(shown.evaluate("knobs.hand"), [x, y + up / scale], 1.0 / scale)
    let_go = drag(bob, 0, 0, (0, -42))
    assert not shown.evaluate("hand.copy"), "too far from any"
    let_go()
    shown.evaluate("delete clock.advance")


def test_a_hand_is_a_spring_for_the_mass_it_holds_in_steps_that_bear_it(shown):
    pull = "k => { hand.drag(run.copies[0], k, [0, 0]); return knobs.pulls.slice(); }"
    for k, particle in enumerate(LEVER["particles"]):
        near(shown.evaluate(pull, k)[k], 225.0 * particle["mass"])
        shown.evaluate("hand.letGo()")
    assert shown.evaluate("knobs.pulls") == [0, 0]
    shown.evaluate("run.copies[2].dt = () => 0.1")
    near(shown.evaluate(pull, 1)[1], 100.0 * 0.2)
    shown.evaluate("hand.letGo(); run.copies[2].dt = () => knobs.dt")


def test_steps_longer_than_a_frame_are_taken_when_they_are_due(written, visit):
    shown = visit(written("--system", "pendulum", "--dt", "0.4", "--steps", "9").path)
    frames = "clock.going = true; for (let k = 0; k < 60; k++) clock.advance(1 / 60);"
    assert shown.evaluate(frames + "[run.taken, clock.late]") == [2, False]
    box = shown.evaluate("home")
    near(box, [-1.0, -1.0, 1.0, 0.0], 1e-3)  # as far as it truly swings
    widen = """([side, off]) => {
      run.begin();
      const at = [0, -0.5];
      at[side % 2] = home[side] + (side > 1 ? off : -off);
      run.copies[0].state.set(at);
      run.widen();
      return run.box.map((x, k) => Math.abs(x - home[k]));
    }"""
    for side in range(4):  # left, bottom, right, top: within half of its 2 m it is still shown
        for off, more in (0.9, 0.9), (1.1, 0.0):
            near(shown.evaluate(widen, [side, off]), more * np.eye(4)[side])


def test_a_processor_that_is_too_slow_shows_slow_motion_and_does_not_race(shown):
    slow = """elapsed => {
      clock.going = true;
      clock.advance(elapsed);
      drawing.told = 0;
      drawing.draw();
      const known = [clock.owed < 0.002, run.time < 0.11, byId("time").textContent.slice(6)];
      clock.set(false);
      return known;
    }"""
    assert shown.evaluate(slow, 1000) == [True, True, ", in slow motion"]
    assert "slow" not in shown.locator("#time").inner_text()
    shown.evaluate("""() => {
      clock.step = () => { for (const t = performance.now(); performance.now() < t + 11;); };
    }""")
    assert shown.evaluate(slow, 0.09) == [True, True, ", in slow motion"]
    shown.evaluate("() => { clock.step = () => run.step(); }")


def test_any_bob_is_reached_by_keys_and_keys_of_the_browser_are_its_own(shown):
    assert shown.locator("a, button, input").first.inner_text() == "Play"
    shown.locator(".tile").first.locator(".hand").last.focus()
    for key, bob in [("PageDown", 1), ("PageDown", 2), ("PageUp", 1)]:
        shown.keyboard.press(key)
        assert f"none: pull bob {bob} of 2" in shown.evaluate("document.activeElement.ariaLabel")
    shown.keyboard.press("Alt+ArrowRight")
    assert not shown.evaluate("hand.copy || clock.going"), "that is the browser's"
    top = shown.evaluate("scrollY")
    shown.keyboard.press("ArrowDown")
    shown.wait_for_function("() => run.time > 0.1")
    assert shown.evaluate("scrollY") == top, "and this one is the hand's"
    shown.keyboard.press("Escape")
    assert not shown.evaluate("hand.copy || clock.going"), "it is let go"


def test_a_finger_takes_the_nearest_bob_and_scrolls_where_none_is_near(written, visit):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
    shown = visit(written("--system", "windows", "--steps", "9").path, **phone)
    assert 2.0 * shown.evaluate("run.copies[0].view.scale[0]") > 54.0, "it fills its tiles"
    boxes = [hand.bounding_box() for hand in shown.locator(".tile").first.locator(".hand").all()]
    for k, box in enumerate(boxes):
        shown.touchscreen.tap(box["x"] + 22, box["y"] + 22)
        assert f"pull bob {k + 1} of 11" in shown.evaluate("document.activeElement.ariaLabel")
    above = boxes[0]["x"] + 22, min(box["y"] for box in boxes) - 15
    assert shown.evaluate("at => document.elementFromPoint(...at).className", above) != "hand"


def test_sliders_set_exact_values_say_them_and_begin_again_if_they_must(written, visit):
    knobs = "--dt", "0.0033", "--baumgarte", "17.3", "--time-constant", "0.0271"
    shown = visit(written("--steps", "9", *knobs).path)
    steps(shown, 1)
    shown.locator("#baumgarte input").fill("11")
    assert shown.evaluate("[knobs.baumgarte, run.taken]") == [320, 1]
    shown.locator("#dt input").fill("7")
    assert shown.evaluate("[knobs.dt, run.taken]") == [0.02, 0]
    assert shown.locator("#dt output").inner_text() == "20 ms, 6.06 times the run\u2019s"
    said = shown.locator("#time_constant output").inner_text()
    assert said == "27.1 ms, taken as two steps: 40 ms"
    click(shown, "How stiff a spring?")
    said = shown.locator("#asked #baumgarte output").inner_text()
    assert said == "17.3/s × 3.3 ms = 0.06, breaks at 0.83"
    edge = 2.0 * (np.sqrt(2.0) - 1.0) / 0.0033  # 251/s: after ten ticks is 200, then 320
    breaks = "parseFloat(byId('baumgarte').style.getPropertyValue('--breaks'))"
    near(shown.evaluate(breaks), (10 + (edge - 200) / 120) / 11)
    shown.locator("#dt input").fill("0")
    assert np.isnan(shown.evaluate(breaks)), "nothing breaks on this slider"


def test_half_the_step_is_compared_at_the_same_time(shown, small):
    click(shown, "What does half the step buy?")
    shown.evaluate("clock.set(false); run.begin()")
    steps(shown, 100)
    thin = [x for x in drawn(shown, "line", None, BOARD) if x.width < 0.9]
    for name, line in zip(METHODS, thin, strict=True):
        each = [np.max(own(small, name, many, 0.2 / many).violations) for many in (100, 200)]
        assert f"{name} {', '.join(map(words.length, each))}" in told(shown)
        near(line.at[-1, 1], np.log10(max(1e-7, each[1])))
    lifted = """() => {
      run.begin();
      hand.drag(run.copies[4], 1, [0.06, 1]);
      for (let k = 0; k < 50; k++) run.step();
      hand.letGo();
      for (let k = 0; k < 4; k++) run.step();
      return Math.abs(run.halves[4].worst.energy);
    }"""
    assert shown.evaluate(lifted) < 0.05, "what a hand adds is no error of theirs, either"
    click(shown, "As it was")
    assert "µm, " not in told(shown)
