"""The chapter as a page: what is built, and in Chromium what its reader touches and sees."""

import re
from html import unescape

import numpy as np
import pytest
from conftest import ROOT, SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints import make
from curriculum.ch3_4_constraints.mechanics.stability import stability_limit
from curriculum.ch3_4_constraints.results import palette, table

builder = "curriculum.ch3_4_constraints.pages.chapter"
chapter = pytest.importorskip(builder, reason="to make it: pip install -e '.[site]'")
FIGURES = ["double", "question", "tangent", "solve", "drift", "cliff", "one_step", "flat_pose"]
FIGURES += ["chaos"]
SLIDER = "[type=range]"
DT = 0.005  # s: the step of all figures at first, but for drift's and one_step's
SOURCE = ROOT / "constraints.py"


def test_the_pages_links_work_from_anywhere_and_what_moves_a_reader_can_stop():
    text = make.PAGE.read_text(encoding="utf-8")
    assert "animate" not in text
    for link in re.findall(r'href="(?!https:)([^"]+)"', text):
        assert link.startswith("#"), link
        assert f'id="{link[1:]}"' in text, link


def test_what_is_folded_is_the_files_and_a_fold_shows_its_key_lines():
    text = re.sub("<summary>.*?</summary>", "", chapter.page(), flags=re.S)
    listings = re.findall('<div class="code python".*?>(.*?)</div>', text, re.S)
    seen = [unescape(re.sub("<.*?>", "", listing)) for listing in listings]
    regions = re.findall(r"# --- region: \w+ ---\n(.*?)# --- endregion", SOURCE.read_text(), re.S)
    for region in regions:
        assert region.strip() in [listing.strip() for listing in seen]
    for name, keys in chapter.KEYS.items():
        (found,) = re.findall(
            rf"^(?:def|class) {name}\b.*?(?=^\S)", SOURCE.read_text(), re.S | re.M
        )
        summary = chapter.folded(found, "python").partition("</summary>")[0]
        assert ("\n    ..." in summary) == ("more lines" in summary)
        for key in keys:
            assert key in unescape(re.sub("<.*?>", "", summary)), (name, key)


@pytest.mark.parametrize("name", ["double", "jansen_leg"])
def test_the_equation_that_figures_show_is_the_one_that_gives_the_force(name):
    system = c.build_system(name)
    rng = np.random.default_rng(0)
    q = system["q0"] + 0.1 * rng.normal(size=system["q0"].shape)
    v = rng.normal(size=q.shape)
    found = chapter.equation(system, q, v)
    assert np.allclose(found["A"] @ found["lambda"], found["b"])
    force = (found["J"].T @ found["lambda"]).reshape(q.shape)
    assert np.allclose(force, c.constraint_force(system, q, v))


@pytest.fixture(scope="module")
def shown(visit):
    return visit(make.PAGE)


def figure(shown, name):
    """A figure of the page, in the middle of the screen."""
    found = shown.locator(f"[data-figure={name}]")
    found.evaluate("x => x.scrollIntoView({block: 'center'})")
    found.page.wait_for_timeout(100)  # ms: canvases get their size
    return found


def drag(hand, right, down):
    """Take a hand with the mouse and move it by so many pixels; returns what lets it go."""
    box = hand.bounding_box()
    mouse = hand.page.mouse
    x = box["x"] + box["width"] / 2
    y = box["y"] + box["height"] / 2
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + right, y + down, steps=5)
    return mouse.up


def numbers(found, pattern):
    """Those of each match of a pattern in what a figure says."""
    text = found.inner_text().replace("\N{MINUS SIGN}", "-")
    return np.array(re.findall(pattern, text), float)


@pytest.mark.parametrize(("size", "theme"), SCREENS)
def test_figures_fit_the_screen_are_legible_and_pictures_on_paper(visit, size, theme):
    shown = visit(make.PAGE, viewport=size, color_scheme=theme)
    names = "[...document.querySelectorAll('[data-figure]')].map(x => x.dataset.figure)"
    assert shown.evaluate(names) == FIGURES
    assert shown.evaluate("document.documentElement.scrollWidth") == size["width"]
    inks = ["ink", "quiet", "d", "v", "lambda", "A", "b", "keyword"]
    for color in shown.evaluate("x => x.map(ink)", inks):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    shown.emulate_media(media="print")
    for still in shown, visit(make.PAGE, java_script_enabled=False):
        for found in still.locator("[data-figure]").all():
            assert found.locator("img").bounding_box()["height"] > 100
            assert not found.locator("canvas, button").filter(visible=True).count()


@pytest.mark.parametrize("width", [1440, 390])
def test_formulas_are_whole_and_those_in_a_line_stay_in_it(visit, width):
    shown = visit(make.PAGE, viewport={"width": width, "height": 844})
    clipped = """[...document.querySelectorAll(".block")].filter(x =>
        x.scrollHeight > x.clientHeight + 1).map(x => x.textContent)"""
    assert shown.evaluate(clipped) == []
    wide = """[...document.querySelectorAll(".chapter > p .inline")].filter(x =>
        !/inline|^math$/.test(getComputedStyle(x).display) || x.getBoundingClientRect().right >
        document.documentElement.clientWidth).map(x => x.textContent)"""
    assert shown.evaluate(wide) == []


@pytest.mark.parametrize("path", sorted(chapter.SOURCE.parent.glob("pictures/*.svg")), ids=str)
def test_on_a_phone_the_words_of_a_picture_are_legible_and_within_it(visit, path):
    shown = visit(path, viewport={"width": 358, "height": 800})
    sizes = """[...document.querySelectorAll("text")].map(x => [x.textContent,
        parseFloat(getComputedStyle(x).fontSize) * x.getScreenCTM().a])"""
    words = [(text, size) for text, size in shown.evaluate(sizes) if text.strip()]
    assert [text for text, size in words if size < 10.99] == []
    shown.close()


def test_a_picture_that_moves_stands_still_for_who_wants_that(visit):
    path = chapter.SOURCE.parent / "pictures" / "double.svg"
    moving = (
        "[...document.querySelectorAll('animate')].some(x => x.parentElement.checkVisibility())"
    )
    assert visit(path, reduced_motion="no-preference").evaluate(moving)
    quiet = visit(path)
    assert not quiet.evaluate(moving)
    assert quiet.evaluate("document.querySelector('.still').checkVisibility()")


def test_the_pendulums_at_the_top_come_apart_as_the_table_says(shown):
    found = figure(shown, "double")
    click(found, "All 20 s")
    assert "20.0 s" in found.inner_text()
    for method in c.make_methods(DT):
        run = c.run_method(c.build_system("double"), method, "semi_implicit", DT, 4000)
        worst = table.length(np.max(run.violations))
        assert f"{method}\noff by {worst}" in found.inner_text()


def test_the_pendulums_at_the_top_move_at_once_or_for_less_motion_show_their_end(visit):
    moving = visit(make.PAGE, reduced_motion="no-preference")
    found = figure(moving, "double")
    found.get_by_role("button", name="Pause").wait_for(timeout=30_000)
    late = re.compile(r"^1\d\.\d s$")  # when they have come apart
    found.get_by_text(late).wait_for(timeout=5_000)
    click(found, "Pause")
    said = found.inner_text()
    moving.wait_for_timeout(300)  # ms
    assert found.inner_text() == said
    moving.close()
    found = figure(visit(make.PAGE), "double")
    assert "20.0 s" in found.inner_text()
    assert found.get_by_role("button", name="Play").is_visible()


def test_from_level_the_rod_pulls_with_three_times_the_weight(shown):
    found = figure(shown, "question")
    drag(found.locator(".hand"), 0, -150)()  # let go from above: a harder pull
    found.get_by_text(re.compile("so far: [3-9][0-9].[0-9]+ N")).wait_for(timeout=30_000)
    click(found, "Let go level")
    found.get_by_text(f"The hardest pull so far: {3 * 9.81:.2f} N").wait_for(timeout=30_000)


@pytest.mark.parametrize("end", [(-140, -30), (40, -900), (-2000, 60)])
def test_g_and_its_rate_are_the_chapters_and_what_is_dragged_away_stays_in_sight(shown, end):
    found = figure(shown, "tangent")
    bob, tip = found.locator(".hand").all()
    drag(tip, 30, 40)()
    drag(bob, *end)()
    d, v = np.insert(numbers(found, r"[dv] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    said = numbers(found, r"[gġ] = (\S+) m²")
    sentence = found.locator(".whole").inner_text()
    canvas = found.locator("canvas").bounding_box()
    hand = bob.bounding_box()
    _, g, rate, _ = c.constraint_terms(c.build_system("pendulum"), d[None], v[None])
    assert said == pytest.approx([g[0], rate[0]], abs=0.01 * (1.0 + max(abs(d)) + max(abs(v))))
    error = np.linalg.norm(d) - 1.0
    assert ("too long" in sentence, "too short" in sentence) == (error > 0.01, error < -0.01)
    assert ("grows" in sentence, "shrinks" in sentence) == (said[1] > 0.0, said[1] < 0.0)
    for side, length in ("x", "width"), ("y", "height"):
        assert 0 <= hand[side] + 22 - canvas[side] <= canvas[length]


@pytest.mark.parametrize("gesture", ["hangs", "held", "thrown"])
def test_the_solve_is_the_chapters_hanging_held_or_thrown(visit, gesture):
    system = c.build_system("double")
    spin = 12.0 * (gesture == "thrown")  # rad/s, the fastest
    found = figure(visit(make.PAGE), "solve")
    found.evaluate("() => { performance.now = requestAnimationFrame = () => 0; }")  # time stops
    if gesture != "hangs":
        let_go = drag(found.get_by_role("button", name="Bob 1"), 90, -70)
    if gesture == "thrown":
        let_go()
    texts = [x.replace("\N{MINUS SIGN}", "-") for x in found.locator("mn").all_text_contents()]
    v = np.insert(numbers(found, r"v[₀₁] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    shown = np.split(np.array(texts, float), [8, 12, 14])  # J without the z axis, A, lambda, b
    first = shown[0][:2]
    x, y = shown[0][6:]  # d of each rod
    q = np.insert(np.cumsum([first, (x, y)], axis=0), 2, 0.0, axis=1)
    assert v == pytest.approx(spin * np.array([[0.0, 0.0, 0.0], [-y, x, 0.0]]), abs=0.1)
    jac, A, b, lam = chapter.equation(system, q, v).values()
    rounded = 0.15 + 0.1 * np.max(np.abs(v))  # to two digits
    for each, right in zip(shown, (jac.reshape(4, 3)[:, :2], A, lam, b), strict=True):
        assert each == pytest.approx(right.ravel(), abs=0.02 if right.ndim > 1 else rounded)


def test_all_numbers_of_the_solve_change_in_the_same_frame(visit):
    spy = """
    const drawn = [];
    CanvasRenderingContext2D.prototype.fillText = function(text) { drawn.push(text); };
    """
    page = visit(make.PAGE, reduced_motion="no-preference")
    page.evaluate(spy.replace("const drawn", "window.drawn"))
    found = figure(page, "solve")
    click(found, "Let go level")
    look = """async x => {
        const seen = [];
        for (let k = 0; k < 60; k++) {
            window.drawn.length = 0;
            await new Promise(requestAnimationFrame);
            const beside = window.drawn.filter(text => /^.?\\d\\.\\d\\d$/.test(text));
            const entry = x.querySelectorAll("mn")[9].textContent;
            if (beside.length) seen.push([beside.at(-1), entry]);
        }
        return seen;
    }"""
    seen = found.evaluate(look)
    assert len({beside for beside, _ in seen}) > 3
    for beside, entry in seen:
        assert beside == entry


def test_half_the_step_halves_the_drift_as_the_proof_says(shown):
    says = r"step (\d+) left\s+g = (.*) m²\s+½ Σ \(dt v\)² = (.*) m²"
    found = figure(shown, "drift")
    assert "step 1 would leave" in found.inner_text()
    click(found, "it halves")  # and the first step is taken to the end
    for k, dt in enumerate([0.1, 0.05, 0.025]):
        found.locator(SLIDER).fill(str(k))
        ((n, now, proof),) = numbers(found, says)
        level = c.build_system("pendulum") | {"q0": np.array([[1.0, 0.0, 0.0]])}
        run = c.run_method(level, "none", "semi_implicit", dt, int(n))
        assert n * dt == pytest.approx(0.7)
        assert now == proof == pytest.approx((np.sum(run.tip[-1] ** 2) - 1) / 2, abs=1e-6)
    assert "As you said: it halves. In the end g is" in found.inner_text()


def test_the_error_decays_rings_or_explodes_as_theory_says_and_not_before_the_guess(shown):
    limit = stability_limit(c.semi_implicit_step)
    found = figure(shown, "cliff")
    printed = found.page.get_by_text("diverged").first
    spoiler = found.page.get_by_text("until it does not hold at all")
    assert not printed.is_visible()
    assert not spoiler.is_visible()
    click(found, "at some point it explodes")
    for z, kind in (0.1, "decays"), (0.82, "rings"), (0.83, "explodes"), (0.9, "explodes"):
        found.locator(SLIDER).fill(str(round(100 * z) - 5))
        assert (f"{limit:.3f}" in found.inner_text()) == printed.is_visible() == (z > limit)
        assert spoiler.is_visible() == (z > limit)
        hangs = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.001, 0.0]])}
        run = c.run_method(hangs, "baumgarte", "semi_implicit", DT, 30, baumgarte=z / DT)
        error = table.length(run.violations[-1])
        assert f"It {kind}: after 30 steps it is {error}." in found.inner_text()


STARTS = {  # of one_step, by its buttons: d in m, v in m/s
    "Off its rod, at rest": ((0.0, -1.15, 0.0), (0.0, 0.0, 0.0)),
    "On its circle, in mid-swing": ((0.0, -1.0, 0.0), (2.0, 0.0, 0.0)),
    "Off, and thrown": ((0.0, -1.12, 0.0), (2.0, -1.0, 0.0)),
}


@pytest.mark.parametrize("start", STARTS)
def test_one_step_of_each_method_ends_where_the_chapters_does(shown, start):
    system = c.build_system("pendulum")
    d, v = np.array(STARTS[start])[:, None]
    found = figure(shown, "one_step")
    click(found, start)
    said = found.inner_text()
    for name, method in c.make_methods(0.2, baumgarte=2.0).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        q, _ = step(d, v, system["m"], method.make_force(system), 0.2)
        error = c.rod_lengths(system, q)[0] - 1.0
        words = f"{table.length(abs(error))} too {'long' if error > 0.0 else 'short'}"
        words = words if abs(error) > 1e-9 else "right"
        if method.post_step:
            plain, _ = c.semi_implicit_step(d, v, system["m"], method.make_force(system), 0.2)
            move = table.length(np.linalg.norm(q - plain))
            words += f", moved by {move}"
        if name == "project":
            words += ": −M⁻¹ J₀ᵀ μ"
        assert f"{name} {words}\n" in said + "\n"


def test_a_bob_at_rest_can_be_thrown_and_too_far_for_a_way_back_says_so(shown):
    found = figure(shown, "one_step")
    click(found, "Off its rod, at rest")
    _, tip = found.locator(".hand").all()
    drag(tip, 300, 0)()
    assert "project no way back onto the rods" in found.inner_text()
    click(found, "Off, and thrown")
    assert "project right" in found.inner_text()


def test_the_flat_pose_keeps_when_each_method_left_the_line(shown):
    system = c.build_system("peaucellier")
    kept = []
    found = figure(shown, "flat_pose")
    click(found, "all of them")
    click(found, "All 5 s")
    said = found.inner_text().replace("\N{NO-BREAK SPACE}", " ")
    for method in c.make_methods(DT):
        x = c.run_method(system, method, "semi_implicit", DT, 1000).tip[:, 0]
        gap = np.abs(x - x[0])
        gone = gap > 0.05
        words = f"left its line at {np.argmax(gone) * DT:.1f} s" if gone.any() else "on its line"
        worst = table.length(np.max(gap)).replace("um", "µm")
        assert f"{method}\n{words}, gap up to {worst}" in said
        kept += [method] * (not gone.any())
    assert f"No: {' and '.join(kept)} kept it there." in said


def test_equal_starts_stay_equal_and_others_part_as_runs_do(shown):
    found = figure(shown, "chaos")
    found.locator(SLIDER).fill(str(0))
    click(found, "All 20 s")
    assert "Of the 8 numbers in their places and velocities 8 are equal" in found.inner_text()
    found.locator(SLIDER).fill(str(5))
    click(found, "All 20 s")
    systems = [c.build_system("double", seed) for seed in (0, 1)]
    ends = [c.run_method(x, "baumgarte", "semi_implicit", DT, 4000).tip[-1] for x in systems]
    apart = table.length(np.linalg.norm(ends[1] - ends[0]))
    assert f"The tips are {apart} apart" in found.inner_text()
