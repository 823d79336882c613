"""The chapter as a page: what is built, and in Chromium what its reader touches and sees."""

import re

import numpy as np
import pytest
from conftest import SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints import palette, table

builder = "curriculum.ch3_4_constraints.chapter"
chapter = pytest.importorskip(builder, reason="to make it: pip install -e '.[site]'")
FIGURES = ["question", "tangent", "jacobian", "two_methods", "drift", "cliff", "energy", "soft"]
FIGURES += ["tiles", "flat_pose", "chaos"]  # in the order of the text
DT = 0.005  # s: the step of all figures at first, but for drift's


def test_the_committed_page_is_what_its_builder_makes_and_links_lead_somewhere():
    text = chapter.page()
    assert chapter.PAGE.read_text(encoding="utf-8") == text, "make it again, by the chapter.py"
    assert chapter.PAGE.stat().st_size <= 300_000
    for link in re.findall(r'href="(?!https:)([^"]+)"', text):
        path, _, anchor = link.partition("#")
        assert (chapter.HERE / path).exists(), link
        assert path or f'id="{anchor}"' in text, link


@pytest.fixture
def page(visit):
    return visit(chapter.PAGE)


def figure(page, name):
    """The figure of this name, in the middle of the screen."""
    found = page.locator(f"[data-figure={name}]")
    found.evaluate("x => x.scrollIntoView({block: 'center'})")
    page.wait_for_timeout(100)  # ms: canvases get their size, and clocks learn that they are seen
    return found


def seen(found):
    """All that a figure shows."""
    drawn = found.evaluate("x => [...x.querySelectorAll('canvas')].map(y => y.toDataURL())")
    return drawn, found.inner_text()


def slide(found, label, k):
    """Put a slider on its k-th value."""
    found.locator(f"label:has(span:text-is('{label}')) input").fill(str(k))


def touch(found):
    """Move the first hand, the first slider or press the last button of a figure."""
    hand, slider = found.locator(".hand").first, found.locator("[type=range]:enabled").first
    if hand.count():
        hand.press("ArrowUp")
    elif slider.count():
        slider.press("ArrowRight")
    else:
        found.get_by_role("button").last.click()


def numbers(found, pattern):
    """Those of a pattern in what a figure says."""
    text = found.inner_text().replace("\N{MINUS SIGN}", "-")
    match = re.search(pattern, text)
    assert match, f"{pattern!r} is not in {text!r}"
    return [float(x.replace(",", "")) for x in match.groups()]


@pytest.mark.parametrize(("size", "theme"), SCREENS)
def test_each_figure_waits_until_it_is_touched_and_then_moves(visit, size, theme):
    shown = visit(chapter.PAGE, viewport=size, color_scheme=theme)
    names = "[...document.querySelectorAll('[data-figure]')].map(x => x.dataset.figure)"
    assert shown.evaluate(names) == FIGURES
    for name in FIGURES:
        found = figure(shown, name)
        before = seen(found)
        shown.wait_for_timeout(60)
        assert seen(found) == before, f"{name} moves by itself"
        touch(found)
        shown.wait_for_timeout(60)
        assert seen(found) != before, name
    assert shown.evaluate("document.documentElement.scrollWidth") == size["width"]
    inks = ["ink", "quiet", "d", "v", "lambda", "rod1", "keyword", "string", "number", "name"]
    for color in shown.evaluate("x => x.map(ink)", inks):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5


def test_what_is_out_of_sight_asks_for_no_frames(visit):
    moving = visit(chapter.PAGE, reduced_motion="no-preference")
    moving.evaluate("""() => { // what moves always waits for a frame
      globalThis.pending = 0;
      const ask = requestAnimationFrame, took = f => now => { pending -= 1; f(now); };
      globalThis.requestAnimationFrame = f => { pending += 1; return ask(took(f)); };
    }""")
    figure(moving, "energy")
    moving.wait_for_function("() => pending > 0", polling=50)
    moving.evaluate("document.querySelector('#setup').scrollIntoView()")
    moving.wait_for_function("() => pending === 0", polling=50)


def test_without_javascript_figures_are_pictures(visit):
    still = visit(chapter.PAGE, java_script_enabled=False)
    for name in FIGURES:
        picture = still.locator(f"[data-figure={name}] img")
        assert picture.bounding_box()["height"] > 100, name
        caption = still.locator(f"[data-figure={name}] figcaption").inner_text()
        assert caption.replace("ġ", "gdot") == picture.get_attribute("alt")


def test_from_level_the_rod_pulls_with_three_times_the_weight(page):
    found = figure(page, "question")
    click(found, "Let go level")
    found.get_by_text(f"The hardest pull so far: {3 * 9.81:.2f} N").wait_for(timeout=5000)


def test_j_is_the_chapters_entry_by_entry(page):
    found = figure(page, "jacobian")
    for bob, key in ("Bob 0", "ArrowLeft"), ("Bob 1", "ArrowRight"):
        found.get_by_role("button", name=bob).press(key)
    words = [x.replace("\N{MINUS SIGN}", "-") for x in found.locator("td").all_inner_texts()]
    entries = np.reshape(words, (2, 2, 2)).astype(float)  # of a rod, under a particle, x and y
    q = np.zeros((2, 3))
    q[:, :2] = np.cumsum([entries[0, 0], entries[1, 1]], axis=0)  # d of each rod
    jac, *_ = c.constraint_terms(c.build_system("double"), q, np.zeros((2, 3)))
    assert entries == pytest.approx(jac.reshape(2, 2, 3)[:, :, :2], abs=0.011)


@pytest.mark.parametrize("answer", ["it stays", "it halves", "it falls to a quarter"])
def test_half_the_step_halves_the_drift_as_the_proof_says(page, answer):
    found, g = figure(page, "drift"), []
    assert found.get_by_role("button", name="One step").is_disabled()
    click(found, answer)
    for k, dt in enumerate([0.1, 0.05, 0.025]):
        slide(found, "step", k)
        click(found, "All 0.7 s")
        n, now, proof = numbers(found, r"after (\d+) steps g = (.*) m²\s+½ Σ \(dt v\)² = (.*) m²")
        level = c.build_system("pendulum") | {"q0": np.array([[1.0, 0.0, 0.0]])}
        run = c.run_method(level, "none", "semi_implicit", dt, int(n))
        assert now == proof == pytest.approx((np.sum(run.tip[-1] ** 2) - 1) / 2, abs=1e-6)
        g.append(now)
    assert np.divide(g[:-1], g[1:]) == pytest.approx(2, rel=0.03)
    verdict = found.locator(".verdict").inner_text()
    assert verdict.startswith("As you said: it halves" if "halves" in answer else "No: it halves")


def test_the_error_decays_rings_or_explodes_as_theory_says(page):
    found, limit = figure(page, "cliff"), c.STABILITY_LIMIT["semi_implicit"]
    click(found, "at some point it explodes")
    for z, kind in (0.1, "decays"), (0.82, "rings"), (0.83, "explodes"), (0.9, "explodes"):
        assert (z > limit) == (kind == "explodes")
        slide(found, "dt w", round(100 * z) - 5)
        hangs = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.001, 0.0]])}
        run = c.run_method(hangs, "baumgarte", "semi_implicit", DT, 30, baumgarte=z / DT)
        error = table.length(run.violations[-1]).replace("um", "µm")
        assert f"It {kind}: after 30 steps it is {error}." in found.inner_text()
    verdict = f"As you said: it dies sooner, then later again, and past {limit:.3f} it explodes."
    assert found.locator(".verdict").inner_text() == verdict


def test_a_soft_rods_stretch_grows_with_its_time_constant_squared_and_its_load(page):
    found = figure(page, "soft")
    for load, k, time_constant in (1, 3, 0.15), (1, 4, 0.2), (3, 4, 0.2):
        slide(found, "lower bob", load - 1)
        slide(found, "time constant", k)
        stretch = (1 - 0.95) * time_constant**2 * 9.81 * (1 + load)
        found.get_by_text(f"Each is {table.length(stretch)} too long").wait_for(timeout=5000)


def test_the_same_start_has_the_same_bits(page):
    found = figure(page, "chaos")
    slide(found, "difference", 0)
    click(found, "All 20 s")
    assert numbers(found, r"(.*) of (.*) numbers have the same 64 bits") == [4001 * 8] * 2
