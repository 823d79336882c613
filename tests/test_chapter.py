"""The chapter as a page: what each figure shows after a gesture, beside Python's own numbers."""

import re
from html import unescape

import numpy as np
import pytest
from conftest import ROOT, SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints.rods.stability import stability_limit
from curriculum.common import palette
from curriculum.common.words import length

site = "curriculum.ch3_4_constraints.site"
chapter = pytest.importorskip(f"{site}.chapter", reason="to make it: pip install -e '.[site]'")
scenes = pytest.importorskip(f"{site}.scenes")

FIGURES = ["double", "question", "tangent", "jacobian", "solve", "spring", "two_methods", "drift"]
FIGURES += ["pump", "cliff", "step_baumgarte", "step_impulse", "soft", "step_project", "one_step"]
FIGURES += ["work_precision_double", "flat_pose", "chaos", "jansen_leg"]
DESKTOP = {"width": 1440, "height": 900}
PHONE = {"width": 390, "height": 844}
SLIDER = "[type=range]"
DT = 0.005  # s: the step of all figures at first, but for spring's, drift's and one_step's
SOURCE = ROOT / "constraints.py"
FRAMES = """() => {
    const waiting = [];
    let now = 0;
    performance.now = () => 0;
    window.requestAnimationFrame = frame => waiting.push(frame);
    window.passes = () => { now += 100; waiting.splice(0).forEach(frame => frame(now)); };
}"""  # passes() is a frame, 0.1 s after the last one
DISCS = """() => {
    const {arc} = CanvasRenderingContext2D.prototype;
    const {clearRect} = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.clearRect = function(...box) {
        this.canvas.discs = [];
        clearRect.call(this, ...box);
    };
    CanvasRenderingContext2D.prototype.arc = function(x, y, ...more) {
        this.canvas.discs?.push([x, y]);
        arc.call(this, x, y, ...more);
    };
}"""  # a canvas then has `discs`: where they are in pixels, since it was cleared


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "chapter.html"
    path.write_text(chapter.page(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def shown(built, visit):
    return visit(built, viewport=DESKTOP)


@pytest.fixture
def stopped(built, visit):
    """The page, in which time passes only when a test lets it."""
    page = visit(built, viewport=DESKTOP)
    page.evaluate(DISCS)
    page.evaluate(FRAMES)
    yield page
    page.close()


def figure(shown, name):
    """A figure of the page, in the middle of the screen."""
    found = shown.locator(f"[data-figure={name}]")
    found.evaluate("x => x.scrollIntoView({block: 'center'})")
    return found


def middle(box):
    return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])


def drag(hand, right, down):
    """Take a hand with the mouse and move it by so many pixels; returns what lets it go."""
    mouse = hand.page.mouse
    x, y = middle(hand.bounding_box())
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + right, y + down, steps=5)
    return mouse.up


def said(found):
    return found.inner_text().replace("\N{MINUS SIGN}", "-").replace("\N{NO-BREAK SPACE}", " ")


def numbers(found, pattern):
    """Those of each match of a pattern in what a figure says."""
    return np.array(re.findall(pattern, said(found)), float)


def pendulum(*d):
    """A bob of 1 kg at d (2,) in m, on a rod of 1 m."""
    return c.build_system("pendulum") | {"q0": np.array([[*d, 0.0]])}


def run(system, method, seconds, dt=DT, **knobs):
    return c.run_method(system, method, "semi_implicit", dt, round(seconds / dt), **knobs)


# --- the page ---
def test_what_is_folded_is_the_files_and_a_fold_shows_its_key_lines(built):
    text = built.read_text(encoding="utf-8")
    text = re.sub("<summary>.*?</summary>", "", text, flags=re.S)
    listings = re.findall('<div class="code python".*?>(.*?)</div>', text, re.S)
    seen = [unescape(re.sub("<.*?>", "", listing)).strip() for listing in listings]
    regions = re.findall(r"# --- region: \w+ ---\n(.*?)# --- endregion", SOURCE.read_text(), re.S)
    for region in regions:
        assert region.strip() in seen
    for name, keys in chapter.KEYS.items():
        pattern = rf"^(?:def|class) {name}\b.*?(?=^\S)"
        (found,) = re.findall(pattern, SOURCE.read_text(), re.S | re.M)
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
    found = scenes.equation(system, q, v)
    assert np.allclose(found["A"] @ found["lambda"], found["b"])
    force = (found["J"].T @ found["lambda"]).reshape(q.shape)
    assert np.allclose(force, c.constraint_force(system, q, v))


def test_the_page_is_small_and_its_links_lead_into_it_or_to_a_figure(built):
    text = built.read_text(encoding="utf-8")
    assert len(text.encode()) < 480_000
    assert "<animate" not in text
    for link in re.findall(r'href="(?!https:)([^"]+)"', text):
        assert link.startswith("#"), link
        assert f'id="{link[1:]}"' in text, link
    folder = ROOT / "curriculum" / "ch3_4_constraints"
    paths = [path for room in ("page", "site") for path in (folder / room).rglob("*")]
    scripts = [path for path in paths if path.suffix in (".html", ".css", ".js")]
    assert sum(len(path.read_text().splitlines()) for path in scripts) < 2300


@pytest.mark.parametrize(("size", "theme"), [*SCREENS, (DESKTOP, "light")])
def test_figures_fit_the_screen_are_legible_and_pictures_on_paper(visit, built, size, theme):
    page = visit(built, viewport=size, color_scheme=theme)
    names = "[...document.querySelectorAll('[data-figure]')].map(x => x.dataset.figure)"
    assert page.evaluate(names) == FIGURES
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]
    wide = """[...document.querySelectorAll(".stage, .says, .block, table, .controls")].filter(x =>
        x.scrollWidth > x.clientWidth + 22).map(x => x.textContent)"""  # a hand may stand out
    assert page.evaluate(wide) == []
    inks = ["ink", "quiet", "d", "v", "lambda", "A", "b", "keyword", "rod1"]
    for color in page.evaluate("x => x.map(ink)", inks):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    page.emulate_media(media="print")
    for still in page, visit(built, java_script_enabled=False):
        for found in still.locator("[data-figure]").all():
            assert found.locator("img").bounding_box()["height"] > 100
            assert not found.locator("canvas, button, .lone").filter(visible=True).count()
        still.close()


def test_nothing_is_far_from_something_that_answers(shown):
    edges = """[...document.querySelectorAll('[data-figure]')].flatMap(x => {
        const {top, bottom} = x.getBoundingClientRect();
        return [top + scrollY, bottom + scrollY];
    })"""
    whole = shown.evaluate("document.documentElement.scrollHeight")
    ends = np.array([0.0, *shown.evaluate(edges), whole]).reshape(-1, 2)
    assert np.max(ends[:, 1] - ends[:, 0]) < 4000


@pytest.mark.parametrize("size", [DESKTOP, PHONE])
def test_formulas_are_whole_their_scripts_small_and_those_in_a_line_stay_in_it(visit, built, size):
    page = visit(built, viewport=size)
    clipped = """[...document.querySelectorAll(".block")].filter(x =>
        x.scrollHeight > x.clientHeight + 1).map(x => x.textContent)"""
    assert page.evaluate(clipped) == []
    wide = """[...document.querySelectorAll(".chapter > p .inline")].filter(x =>
        !/inline|^math$/.test(getComputedStyle(x).display) || x.getBoundingClientRect().right >
        document.documentElement.clientWidth).map(x => x.textContent)"""
    assert page.evaluate(wide) == []
    sizes = """[...document.querySelectorAll("msub, msup")].map(x => [...x.children].map(y =>
        parseFloat(getComputedStyle(y).fontSize)))"""
    for base, script in page.evaluate(sizes):
        assert script < 0.9 * base
    page.close()


@pytest.mark.parametrize("path", sorted(chapter.SOURCE.parent.glob("pictures/*.svg")), ids=str)
def test_on_a_phone_the_words_of_a_picture_are_legible(visit, path):
    page = visit(path, viewport={"width": 358, "height": 800})
    sizes = """[...document.querySelectorAll("text")].map(x => [x.textContent,
        parseFloat(getComputedStyle(x).fontSize) * x.getScreenCTM().a])"""
    words = [(text, size) for text, size in page.evaluate(sizes) if text.strip()]
    assert [text for text, size in words if size < 10.99] == []
    page.close()


@pytest.mark.parametrize("size", [{"width": 1440, "height": 600}, PHONE])
def test_an_address_shows_one_figure_as_large_as_the_window_and_still_in_hand(visit, built, size):
    page = visit(built, viewport=size)
    page.evaluate("location.hash = 'figure=tangent'")
    found = page.locator("[data-figure=tangent]")
    page.wait_for_function("document.querySelector('.alone')?.style.translate")
    seen = page.locator(".chapter > *").filter(visible=True)
    assert seen.count() == 1
    box = found.bounding_box()
    shares = box["width"] / size["width"], box["height"] / size["height"]
    assert 0.97 < max(shares) < 1.005
    assert box["x"] >= 0
    canvas = found.locator("canvas")
    ratio = "x => x.width / x.getBoundingClientRect().width"
    assert canvas.evaluate(ratio) == pytest.approx(1.0, rel=0.02)  # sharp
    bob, _ = found.locator(".hand").all()
    before = middle(bob.bounding_box())
    drag(bob, 60, -40)()
    assert middle(bob.bounding_box()) == pytest.approx(before + [60, -40], abs=1.5)
    found.get_by_role("link").click()
    page.locator("h1").wait_for()
    assert page.locator(".alone").count() == 0
    page.close()


@pytest.mark.parametrize("name", ["double", "question", "pump", "jansen_leg"])
def test_a_figure_alone_waits_until_it_is_started(visit, built, name):
    page = visit(built, viewport=DESKTOP, reduced_motion="no-preference")
    page.evaluate("name => { location.hash = `figure=${name}`; }", name)
    page.wait_for_function("document.querySelector('.alone')?.style.translate")
    buttons = page.locator(f"[data-figure={name}]").get_by_role("button")
    assert {"Play", "Pause"} & {*buttons.all_inner_texts()} == {"Play"}
    page.close()


# --- a figure, a gesture, a number ---
def test_the_opening_begins_alike_and_at_rest_and_comes_apart_as_runs_do(shown):
    found = figure(shown, "double")
    assert said(found).count("rods off by < 1 pm") == 5
    assert "0.0 s" in said(found)
    for index, dt in (2, DT), (4, 0.02):
        found.locator(SLIDER).fill(str(index))
        click(found, "All 20 s")
        assert "20.0 s" in said(found)
        for method in c.make_methods(dt):
            ended = run(c.build_system("double"), method, 20.0, dt)
            worst = f"rods off by {length(np.max(ended.violations))}"
            lost = re.search(rf"{method}\nlost at", said(found))
            assert lost if ended.stopped else f"{method}\n{worst}" in said(found)


def test_one_bob_that_is_thrown_throws_all_five_with_rods_of_their_length(stopped):
    found = figure(stopped, "double")
    discs = "x => [...x.querySelectorAll('canvas')].map(x => x.discs)"
    bob = found.get_by_role("button", name="Bob 1").nth(3)
    let_go = drag(bob, -40, 70)
    held = np.array(found.evaluate(discs))  # (5, 3, 2): an anchor and two bobs
    rods = np.linalg.norm(np.diff(held, axis=1), axis=2)
    assert held == pytest.approx(np.broadcast_to(held[3], held.shape), abs=1e-6)
    assert rods == pytest.approx(rods[0, 0], rel=1e-6)
    assert rods[0, 0] > 55.0  # pixels
    assert "0.0 s" in said(found)
    let_go()
    for _ in range(3):
        stopped.evaluate("passes()")
    thrown = np.array(found.evaluate(discs))
    assert "0.2 s" in said(found)
    moved = thrown[:, 2] - held[:, 2]
    assert np.all(np.linalg.norm(moved, axis=1) > 0.5 * rods[0, 0])  # at 12 rad/s
    assert np.ptp(moved, axis=0) == pytest.approx([0.0, 0.0], abs=0.4 * rods[0, 0])
    click(found, "Let go level")
    level = np.array(found.evaluate(discs))
    assert np.ptp(level[:, :, 1]) < 0.1 * rods[0, 0]


def test_the_bob_comes_to_the_pointer_and_pulls_by_how_far_it_fell(shown):
    found = figure(shown, "question")
    click(found, "Let go level")
    found.get_by_text(f"The hardest pull so far: {3 * 9.81:.2f} N").wait_for(timeout=30_000)
    canvas = found.locator("canvas").bounding_box()
    scale = min((canvas["width"] - 12) / 2.4, (canvas["height"] - 12) / 2.55)  # pixels for 1 m
    anchor = middle(canvas) + [0.0, 0.5 * scale * (1.1 - 1.45)]
    shown.mouse.move(*(anchor + [0.6 * scale, -0.6 * scale]))  # far from the bob
    shown.mouse.down()
    assert "Now let it go" in said(found)
    bob = middle(found.locator(".hand").bounding_box()) - anchor
    assert bob == pytest.approx(scale * np.array([1.0, -1.0]) / 2**0.5, abs=2.0)
    shown.mouse.up()
    hardest = 9.81 * (3.0 - 2.0 * bob[1] / scale)  # N
    pulls = """least => parseFloat(document.querySelector("[data-figure=question] .says")
        .textContent.match(/[\\d.]+/)[0]) > least"""
    shown.wait_for_function(pulls, arg=0.99 * hardest)
    click(found, "Pause")
    assert numbers(found, r"so far: (\S+) N") < 1.01 * hardest


@pytest.mark.parametrize("dt", [0.1, 0.4])
def test_the_spring_ends_with_the_energy_that_integrators_leave_it(shown, dt):
    found = figure(shown, "spring")
    found.locator(SLIDER).fill(str([0.05, 0.1, 0.2, 0.4].index(dt)))
    for name, integrator in c.INTEGRATORS.items():
        q, v = np.array([[1.0]]), np.array([[0.0]])
        for _ in range(round(12.8 / dt)):
            q, v = integrator(q, v, np.ones((1, 1)), lambda q, v: -q, dt)
        assert f"{name} has {(q**2 + v**2).item():.2f} times" in said(found)


@pytest.mark.parametrize("end", [(-140, -30), (40, -900), (-2000, 60)])
def test_g_and_its_rate_are_the_chapters_and_what_is_dragged_away_stays_in_sight(shown, end):
    found = figure(shown, "tangent")
    bob, tip = found.locator(".hand").all()
    drag(tip, 30, 40)()
    drag(bob, *end)()
    d, v = np.insert(numbers(found, r"[dv] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    seen = numbers(found, r"[gġ] = (\S+) m²")
    sentence = found.locator(".whole").inner_text()
    canvas = found.locator("canvas").bounding_box()
    _, g, rate, _ = c.constraint_terms(c.build_system("pendulum"), d[None], v[None])
    assert seen == pytest.approx([g[0], rate[0]], abs=0.01 * (1.0 + max(abs(d)) + max(abs(v))))
    error = np.linalg.norm(d) - 1.0
    assert ("too long" in sentence, "too short" in sentence) == (error > 0.01, error < -0.01)
    assert ("grows" in sentence, "shrinks" in sentence) == (seen[1] > 0.0, seen[1] < 0.0)
    place = middle(bob.bounding_box()) - [canvas["x"], canvas["y"]]
    assert np.all((place >= 0.0) & (place <= [canvas["width"], canvas["height"]]))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_velocity_that_is_nearly_along_the_circle_is_along_it(stopped, way):
    found = figure(stopped, "tangent")
    bob, tip = found.locator(".hand").all()
    canvas = found.locator("canvas").bounding_box()
    scale = min((canvas["width"] - 12) / 3.0, (canvas["height"] - 12) / 1.95)
    along = way * scale * np.array([0.24, -0.18])  # the bob is at 0.66, -0.88
    drag(tip, *(middle(bob.bounding_box()) + along + 1.0 - middle(tip.bounding_box())))()
    assert numbers(found, r"ġ = (\S+) m²") == [0.0]
    assert "stays so" in said(found)


def test_the_entries_of_J_follow_a_bob_and_say_what_they_are(shown):
    found = figure(shown, "jacobian")
    canvas = found.locator("canvas").bounding_box()
    scale = min((canvas["width"] - 12) / 4.0, (canvas["height"] - 12) / 3.1)
    drag(found.get_by_role("button", name="Bob 0"), -60, 30)()
    q = np.array([[0.6 - 60 / scale, -0.8 - 30 / scale, 0.0], [1.4, -1.4, 0.0]])
    jac, *_ = c.constraint_terms(c.build_system("double"), q, np.zeros((2, 3)))
    wanted = jac.reshape(2, 2, 3)[:, :, :2].reshape(2, 4)
    cells = found.locator(".cell")
    texts = [x.replace("\N{MINUS SIGN}", "-") for x in cells.locator("span").all_text_contents()]
    assert np.array(texts, float).reshape(2, 4) == pytest.approx(wanted, abs=0.02)
    assert found.locator("[aria-pressed=true]").count() == 1
    cells.nth(5).click()
    value = texts[5]
    assert cells.nth(5).get_attribute("aria-pressed") == "true"
    assert f"Bob 0 along y: g of rod 1 changes by {value} m²" in said(found)
    cells.nth(2).hover()
    assert "Rod 0 does not end at bob 1" in said(found)


@pytest.mark.parametrize("gesture", ["hangs", "held", "thrown"])
def test_the_solve_is_the_chapters_hanging_held_or_thrown(stopped, gesture):
    system = c.build_system("double")
    spin = 12.0 * (gesture == "thrown")  # rad/s, the fastest
    found = figure(stopped, "solve")
    if gesture != "hangs":
        let_go = drag(found.get_by_role("button", name="Bob 1"), 90, -70)
    if gesture == "thrown":
        let_go()
    texts = [x.replace("\N{MINUS SIGN}", "-") for x in found.locator("mn").all_text_contents()]
    v = np.insert(numbers(found, r"v[₀₁] = \((\S+), (\S+)\)"), 2, 0.0, axis=1)
    seen = np.split(np.array(texts, float), [8, 12, 14])  # J without the z axis, A, lambda, b
    first = seen[0][:2]
    x, y = seen[0][6:]  # d of each rod
    q = np.insert(np.cumsum([first, (x, y)], axis=0), 2, 0.0, axis=1)
    assert v == pytest.approx(spin * np.array([[0.0, 0.0, 0.0], [-y, x, 0.0]]), abs=0.1)
    jac, A, b, lam = scenes.equation(system, q, v).values()
    rounded = 0.15 + 0.1 * np.max(np.abs(v))  # to two digits
    for each, right in zip(seen, (jac.reshape(4, 3)[:, :2], A, lam, b), strict=True):
        assert each == pytest.approx(right.ravel(), abs=0.02 if right.ndim > 1 else rounded)


def test_the_entry_beside_a_bob_and_the_one_in_A_change_in_the_same_frame(stopped):
    stopped.evaluate("""() => {
        CanvasRenderingContext2D.prototype.fillText = text => { window.beside = text; };
    }""")
    found = figure(stopped, "solve")
    click(found, "Let go level")
    seen = set()
    for _ in range(12):
        stopped.evaluate("window.beside = null, passes()")
        drawn = found.evaluate("x => x.querySelectorAll('mn')[9].textContent")
        words = found.evaluate("x => x.querySelector('b.A').textContent")
        assert drawn == words
        seen.add(words)
    assert len(seen) > 1


@pytest.mark.parametrize("how", ["slider", "line"])
def test_a_time_shows_both_runs_as_they_were_then(shown, how):
    found = figure(shown, "two_methods")
    found.locator(SLIDER).fill("100")
    if how == "line":
        drag(found.get_by_role("button", name="The time"), 60, 0)()
    (time,) = numbers(found, r"at (\S+) s:")
    assert time == 2.0 if how == "slider" else 2.5 < time < 8.0
    for method in "none", "baumgarte":
        then = run(c.build_system("double"), method, time)
        assert f"{method} {length(then.violations[-1])}" in said(found)


def test_a_long_step_leaves_a_wedge_and_half_the_step_halves_the_drift(shown):
    says = r"step (\d+) g = (.*) m²"
    found = figure(shown, "drift")
    assert re.findall(says, said(found)) == [("1", "?")]
    click(found, "Then the circle")
    click(found, "Then the wedge")
    ((_, g),) = numbers(found, says)
    assert g == pytest.approx(0.5 * (0.3**2 * 9.81) ** 2, abs=1e-6)  # of the first step
    slider = found.locator(SLIDER)
    assert slider.is_disabled()
    click(found, "it halves")
    assert found.locator(".verdict").inner_text() == "Now try it."
    for k, dt in enumerate([0.1, 0.05, 0.025]):
        slider.fill(str(k))
        ((n, now),) = numbers(found, says)
        ended = run(pendulum(1.0, 0.0), "none", 0.7, dt)
        assert n * dt == pytest.approx(0.7)
        assert now == pytest.approx((np.sum(ended.tip[-1] ** 2) - 1) / 2, abs=1e-6)
    assert "As you said: it halves. In the end g is" in said(found)


def test_the_pump_gains_energy_as_its_run_does_and_less_with_a_stiffer_spring(shown):
    found = figure(shown, "pump")
    gains = []
    for index, w in (1, 20.0), (3, 80.0):
        found.locator(SLIDER).fill(str(index))
        click(found, "All 20 s")
        ended = run(pendulum(1.0, 0.0), "baumgarte", 20.0, baumgarte=w)
        gains.append((ended.energies[-1] - ended.energies[0]) / 9.81)
        assert gains[-1] > 0.0
        assert f"It has gained {100 * gains[-1]:.2g} % of" in said(found)
        error = np.linalg.norm(ended.tip[-1]) - 1.0
        assert f"{length(abs(error))} too {'long' if error > 0.0 else 'short'}" in said(found)
    assert gains[1] < 0.5 * gains[0]


def test_the_error_dies_rings_or_explodes_as_its_eigenvalues_say_and_not_before_the_guess(shown):
    limit = stability_limit(c.semi_implicit_step)
    found = figure(shown, "cliff")
    slider = found.locator(SLIDER)
    spoiler = shown.get_by_text("lost at 1.51 s: diverged")
    told = shown.get_by_text("Where is that cliff?")
    guess = found.get_by_role("button", name="at some point it explodes")
    assert slider.is_disabled()
    assert told.is_visible()
    assert not spoiler.is_visible()
    apart = middle(slider.bounding_box()) - middle(guess.bounding_box())
    assert 0.0 < apart[1] < 150.0
    guess.click()
    for z, kind in (0.1, "decays"), (0.82, "rings"), (0.83, "explodes"), (0.85, "explodes"):
        slider.fill(str(round(100 * z) - 5))
        assert (f"{limit:.3f}" in found.locator(".verdict").inner_text()) == (z > limit)
        assert spoiler.is_visible() == (z > limit)
        ended = run(pendulum(0.0, -1.001), "baumgarte", 60 * DT, baumgarte=z / DT)
        error = length(ended.violations[-1])
        assert f"It {kind}: after 60 steps it is {error}." in said(found)
        step = np.array([[1.0 - 2.0 * z, -(z**2)], [1.0 - 2.0 * z, 1.0 - z**2]])  # of u and g
        wanted = sorted(np.linalg.eigvals(step), reverse=True)
        (seen,) = numbers(found, r"Eigenvalues: (\S+) and (\S+)")
        assert seen == pytest.approx(np.real(wanted), abs=6e-4)


STARTS = {  # of one_step, by its buttons: d in m, v in m/s
    "Off its rod, at rest": ((0.0, -1.15, 0.0), (0.0, 0.0, 0.0)),
    "On its circle, in mid-swing": ((0.0, -1.0, 0.0), (2.0, 0.0, 0.0)),
    "Off, and thrown": ((0.0, -1.12, 0.0), (2.0, -1.0, 0.0)),
}


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("name", ["step_baumgarte", "step_impulse", "step_project", "one_step"])
def test_one_step_of_each_method_ends_where_the_chapters_does(shown, name, start):
    system = c.build_system("pendulum")
    d, v = np.array(STARTS[start])[:, None]
    found = figure(shown, name)
    click(found, start)
    methods = c.make_methods(0.2, baumgarte=2.0)
    seen = {word for word in methods if re.search(rf"^{word} ", said(found), re.M)}
    assert seen == (set(methods) if name == "one_step" else {"none", name.removeprefix("step_")})
    for word in seen:
        method = methods[word]
        step = c.stabilized(c.semi_implicit_step, system, method)
        q, _ = step(d, v, system["m"], method.make_force(system), 0.2)
        error = c.rod_lengths(system, q)[0] - 1.0
        words = f"{length(abs(error))} too {'long' if error > 0.0 else 'short'}"
        words = words if abs(error) > 1e-9 else "right"
        if method.post_step:
            plain, _ = c.semi_implicit_step(d, v, system["m"], method.make_force(system), 0.2)
            words += f", moved by {length(np.linalg.norm(q - plain))}: -M⁻¹ J₀ᵀ μ"
        assert f"{word} {words}\n" in said(found) + "\n"


def test_a_bob_that_is_thrown_too_far_for_a_way_back_says_so(shown):
    found = figure(shown, "one_step")
    click(found, "Off its rod, at rest")
    _, tip = found.locator(".hand").all()
    drag(tip, 300, 0)()
    assert "project no way back onto the rods" in said(found)


@pytest.mark.parametrize("values", [(0.05, 0.95, 1.0), (0.02, 0.8, 30.0)])
def test_a_soft_rod_rests_where_the_chapters_does_whatever_the_mass(shown, values):
    time_constant, impedance, mass = values
    found = figure(shown, "soft")
    places = [0.01, 0.02, 0.03, 0.04, 0.05], [0.8, 0.9, 0.95], [0.1, 0.3, 1.0, 3.0, 10.0, 30.0]
    for slider, place, value in zip(found.locator(SLIDER).all(), places, values, strict=True):
        slider.fill(str(place.index(value)))
    method = c.make_methods(DT, time_constant=time_constant, impedance=impedance)["soft"]
    system = pendulum(0.0, -1.0) | {"m": np.array([[mass]])}
    step = c.stabilized(c.semi_implicit_step, system, method)
    rests = c.trajectory(step, system, method.make_force(system), DT, 300)[0][-1]
    error = c.rod_lengths(system, rests)[0] - 1.0
    assert error == pytest.approx((1.0 - impedance) * time_constant**2 * 9.81, rel=0.01)
    assert f"At rest the rod is {length(error)} too long" in said(found)


def test_a_tolerance_shows_what_choose_advises(shown):
    found = figure(shown, "work_precision_double")
    x, y, _, height = found.locator("canvas").bounding_box().values()
    shown.mouse.move(x + 516, y + 0.515 * height)  # between two of its steps
    assert found.locator(".whole").first.inner_text() == "rk4 with baumgarte"
    before = said(found)
    drag(found.get_by_role("button", name="The tolerance"), -70, 0)()  # to the left: coarser
    assert said(found) != before
    found.locator(SLIDER).fill("1")
    assert "Right to 1 cm" in said(found)
    answer = c.choose(c.build_system("double"), 1e-2)
    rows = [row.rung for row in answer.rows if not row.ends]
    assert len(rows) == 3
    for rung in rows:
        cost = float(f"{rung.operations:.4g}")
        words = rf"{rung.scheme}\s+{1e3 * rung.dt:.3g} ms\s+{cost:,.0f}"
        assert re.search(words, said(found)), words


def test_the_flat_pose_keeps_when_each_method_left_the_line(shown):
    system = c.build_system("peaucellier")
    kept = []
    found = figure(shown, "flat_pose")
    click(found, "all of them")
    click(found, "All 5 s")
    for method in c.make_methods(DT):
        x = run(system, method, 5.0).tip[:, 0]
        gap = np.abs(x - x[0])
        gone = gap > 0.05
        words = f"left its line at {np.argmax(gone) * DT:.1f} s" if gone.any() else "on its line"
        assert f"{method}\n{words}, gap up to {length(np.max(gap))}" in said(found)
        kept += [method] * (not gone.any())
    assert f"No: {' and '.join(kept)} kept it there." in said(found)


def test_equal_starts_stay_equal_and_others_part_as_runs_do(shown):
    found = figure(shown, "chaos")
    found.locator(SLIDER).fill("0")
    click(found, "All 20 s")
    assert "Of the 8 numbers in their places and velocities 8 are equal" in said(found)
    found.locator(SLIDER).fill("5")
    click(found, "All 20 s")
    ends = [run(c.build_system("double", seed), "baumgarte", 20.0).tip[-1] for seed in (0, 1)]
    apart = length(np.linalg.norm(ends[1] - ends[0]))
    assert f"The tips are {apart} apart" in said(found)
    assert "velocities 0 are equal" in said(found)


def test_the_leg_falls_as_its_run_does_and_a_hand_pulls_its_foot(stopped):
    found = figure(stopped, "jansen_leg")
    click(found, "Play")
    for _ in range(11):  # the first one begins
        stopped.evaluate("passes()")
    ended = run(c.build_system("jansen_leg"), "baumgarte", 1.0)
    assert f"rods off by {length(np.max(ended.violations))}" in said(found)
    foot = found.get_by_role("button", name="Joint 5")
    ends = []
    for right in -60, 60:
        click(found, "Again")
        let_go = drag(foot, right, 0)
        for _ in range(8):
            stopped.evaluate("passes()")
        ends.append(middle(foot.bounding_box()))
        let_go()
    assert ends[1][0] - ends[0][0] > 30.0  # pixels
