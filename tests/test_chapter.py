"""The chapter as a page: what is built, and in Chromium what its reader touches and sees."""

import re

import numpy as np
import pytest
from conftest import SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints.mechanics.stability import stability_limit
from curriculum.ch3_4_constraints.results import palette, table

builder = "curriculum.ch3_4_constraints.pages.chapter"
chapter = pytest.importorskip(builder, reason="to make it: pip install -e '.[site]'")
FIGURES = ["question", "tangent", "solve", "drift", "cliff", "flat_pose", "chaos"]
SLIDER = "[type=range]"
DT = 0.005  # s: the step of all figures at first, but for drift's


def test_the_committed_page_is_what_its_builder_makes_and_its_links_work_from_anywhere():
    text = chapter.page()
    assert chapter.PAGE.read_text(encoding="utf-8") == text, "make it again, by the chapter.py"
    for link in re.findall(r'href="(?!https:)([^"]+)"', text):
        assert link.startswith("#"), link
        assert f'id="{link[1:]}"' in text, link


@pytest.fixture(scope="module")
def shown(visit):
    return visit(chapter.PAGE)


def figure(shown, name):
    """A figure of the page, in the middle of the screen."""
    found = shown.locator(f"[data-figure={name}]")
    found.evaluate("x => x.scrollIntoView({block: 'center'})")
    found.page.wait_for_timeout(100)  # ms: canvases get their size
    return found


def drag(hand, right, down):
    """Take a hand with the mouse and move it by so many pixels; returns what lets it go."""
    box, mouse = hand.bounding_box(), hand.page.mouse
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
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
    shown = visit(chapter.PAGE, viewport=size, color_scheme=theme)
    names = "[...document.querySelectorAll('[data-figure]')].map(x => x.dataset.figure)"
    assert shown.evaluate(names) == FIGURES
    assert shown.evaluate("document.documentElement.scrollWidth") == size["width"]
    inks = ["ink", "quiet", "d", "v", "lambda", "A", "b", "keyword"]
    for color in shown.evaluate("x => x.map(ink)", inks):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    shown.emulate_media(media="print")
    for still in shown, visit(chapter.PAGE, java_script_enabled=False):
        for found in still.locator("[data-figure]").all():
            assert found.locator("img").bounding_box()["height"] > 100
            assert not found.locator("canvas, button").filter(visible=True).count()


def test_from_level_the_rod_pulls_with_three_times_the_weight(shown):
    found = figure(shown, "question")
    click(found, "Let go level")
    found.get_by_text(f"The hardest pull so far: {3 * 9.81:.2f} N").wait_for(timeout=5000)


@pytest.mark.parametrize("end", [(-140, -30), (40, -900), (-2000, 60)])
def test_g_and_its_rate_are_the_chapters_and_what_is_dragged_away_stays_in_sight(shown, end):
    found = figure(shown, "tangent")
    bob, tip = found.locator(".hand").all()
    drag(tip, 30, 40)()
    drag(bob, *end)()
    d, v = np.insert(numbers(found, r"[dv] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    _, g, rate, _ = c.constraint_terms(c.build_system("pendulum"), d[None], v[None])
    said = numbers(found, r"[gġ] = (\S+) m²")
    assert said == pytest.approx([g[0], rate[0]], abs=0.01 * (1.0 + max(abs(d)) + max(abs(v))))
    canvas, hand = found.locator("canvas").bounding_box(), bob.bounding_box()
    for side, length in ("x", "width"), ("y", "height"):
        assert 0 <= hand[side] + 22 - canvas[side] <= canvas[length]


@pytest.mark.parametrize("gesture", ["hangs", "held", "thrown"])
def test_the_solve_is_the_chapters_hanging_held_or_thrown(visit, gesture):
    found, system = figure(visit(chapter.PAGE), "solve"), c.build_system("double")
    spin = 12.0 * (gesture == "thrown")  # rad/s, the fastest
    found.evaluate("() => { performance.now = requestAnimationFrame = () => 0; }")  # time stops
    if gesture != "hangs":
        let_go = drag(found.get_by_role("button", name="Bob 1"), 90, -70)
    if gesture == "thrown":
        let_go()
    texts = [x.replace("\N{MINUS SIGN}", "-") for x in found.locator("mn").all_text_contents()]
    shown = np.split(np.array(texts, float), [8, 12, 14])  # J without the z axis, A, lambda, b
    first, (x, y) = shown[0][:2], shown[0][6:]  # d of each rod
    q = np.insert(np.cumsum([first, (x, y)], axis=0), 2, 0.0, axis=1)
    v = np.insert(numbers(found, r"v[₀₁] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    assert v == pytest.approx(spin * np.array([[0.0, 0.0, 0.0], [-y, x, 0.0]]), abs=0.1)
    jac, A, b, lam = chapter.equation(system, q, v).values()
    rounded = 0.15 + 0.1 * np.max(np.abs(v))  # to two digits
    for each, right in zip(shown, (jac.reshape(4, 3)[:, :2], A, lam, b), strict=True):
        assert each == pytest.approx(right.ravel(), abs=0.02 if right.ndim > 1 else rounded)


def test_half_the_step_halves_the_drift_as_the_proof_says(shown):
    found, says = figure(shown, "drift"), r"step (\d+): g = (.*) m²\s+½ Σ \(dt v\)² = (.*) m²"
    click(found, "it halves")
    for k, dt in enumerate([0.1, 0.05, 0.025]):
        found.locator(SLIDER).fill(str(k))
        click(found, "All 0.7 s")
        ((n, now, proof),) = numbers(found, says)
        level = c.build_system("pendulum") | {"q0": np.array([[1.0, 0.0, 0.0]])}
        run = c.run_method(level, "none", "semi_implicit", dt, int(n))
        assert now == proof == pytest.approx((np.sum(run.tip[-1] ** 2) - 1) / 2, abs=1e-6)
    assert "As you said: it halves. In the end g is" in found.inner_text()


def test_the_error_decays_rings_or_explodes_as_theory_says_and_not_before_the_guess(shown):
    found, limit = figure(shown, "cliff"), stability_limit(c.semi_implicit_step)
    printed = found.page.get_by_text("diverged").first
    assert not printed.is_visible()
    click(found, "at some point it explodes")
    for z, kind in (0.1, "decays"), (0.82, "rings"), (0.83, "explodes"), (0.9, "explodes"):
        found.locator(SLIDER).fill(str(round(100 * z) - 5))
        assert (f"{limit:.3f}" in found.inner_text()) == printed.is_visible() == (z > limit)
        hangs = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.001, 0.0]])}
        run = c.run_method(hangs, "baumgarte", "semi_implicit", DT, 30, baumgarte=z / DT)
        error = table.length(run.violations[-1]).replace("um", "µm")
        assert f"It {kind}: after 30 steps it is {error}." in found.inner_text()


def test_the_flat_pose_keeps_when_each_method_left_the_line(shown):
    found, system = figure(shown, "flat_pose"), c.build_system("peaucellier")
    click(found, "all five")
    click(found, "All 5 s")
    for method in c.make_methods(DT):
        x = c.run_method(system, method, "semi_implicit", DT, 1000).tip[:, 0]
        gone = np.abs(x - x[0]) > 0.05
        words = f"left its line at {np.argmax(gone) * DT:.1f} s" if gone.any() else "on its line"
        assert f"{method}\n{words}" in found.inner_text()
    assert "No: impulse and project kept it there." in found.inner_text()


def test_equal_starts_stay_equal_and_others_part_as_runs_do(shown):
    found = figure(shown, "chaos")
    found.locator(SLIDER).fill(str(0))
    click(found, "All 20 s")
    assert "8 of their 8 numbers have the same bits" in found.inner_text()
    found.locator(SLIDER).fill(str(5))
    click(found, "All 20 s")
    systems = [c.build_system("double", seed) for seed in (0, 1)]
    ends = [c.run_method(x, "baumgarte", "semi_implicit", DT, 4000).tip[-1] for x in systems]
    apart = table.length(np.linalg.norm(ends[1] - ends[0]))
    assert f"The tips are {apart} apart" in found.inner_text()
