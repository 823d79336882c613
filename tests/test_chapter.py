"""The chapter as a page: what each figure shows after a gesture, beside Python's own numbers."""

import re
from html import unescape
from inspect import getsource

import numpy as np
import pytest
from conftest import (
    RECORD,
    SCREENS,
    click,
    contrast,
    drag,
    drawn,
    draws,
    middle,
    misplaced,
    near,
    places,
)

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
FRAMES = """() => {
    const waiting = [];
    let now = 0;
    performance.now = () => now;
    window.requestAnimationFrame = frame => waiting.push(frame);
    window.passes = () => { now += 50.001; waiting.splice(0).forEach(frame => frame(now)); };
}"""  # passes() is a frame, 0.05 s after the last one
METHODS = list(c.make_methods())
PENDULUM = c.build_system("pendulum") | {"q0": np.array([[1.0, 0.0, 0.0]])}
DOUBLE = c.build_system("double")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "chapter.html"
    path.write_text(chapter.page(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def shown(built, visit):
    """The page, in which time passes only when a test lets it, and what is drawn is recorded."""
    page = visit(built, viewport=DESKTOP)
    page.evaluate(RECORD)
    page.evaluate(FRAMES)
    return page


def figure(shown, name):
    """A figure of the page, in the middle of the screen."""
    found = shown.locator(f"[data-figure={name}]")
    found.evaluate("x => x.scrollIntoView({block: 'center'})")
    return found


def pass_frames(found, many):
    """Let time pass: 0.05 s a frame, but for the first one of a clock that is started."""
    found.page.evaluate("many => { while (many--) passes(); }", many)


def slide(found, index):
    found.locator(SLIDER).fill(str(index))


def said(found):
    return found.inner_text().replace("\N{MINUS SIGN}", "-").replace("\N{NO-BREAK SPACE}", " ")


def values(found):
    """The numbers that its elements are."""
    return [float(x.replace("\N{MINUS SIGN}", "-")) for x in found.all_text_contents()]


def numbers(found, pattern):
    """Those of each match of a pattern in what a figure says."""
    return np.array(re.findall(pattern, said(found)), float)


def reads(found, pattern, wanted, within=1e-6):
    """The numbers in a figure's text are as wanted."""
    near(numbers(found, pattern), wanted, within)


def shows(found, *texts, on=0, within=1e-6, **marks):
    """A figure says these texts, and a canvas of it draws these marks: KIND_COLOUR=places."""
    for text in texts:
        assert text in said(found)
    for mark, wanted in marks.items():
        draws(found, *mark.split("_"), wanted, on, within)


def off_by(bob):
    """What the page says of a rod of 1 m from the origin to there."""
    error = np.linalg.norm(bob) - 1.0
    side = "long" if error > 0.0 else "short"
    return f"{length(abs(error))} too {side}" if abs(error) > 5e-7 else "right"


def spun(q, spin):
    """Velocities of a double pendulum whose lower rod turns by spin (3,) in rad/s."""
    return np.array([np.zeros(3), np.cross(spin, q[1] - q[0])])


def pendulum(*d):
    """A bob of 1 kg at d (2,) in m, on a rod of 1 m."""
    return c.build_system("pendulum") | {"q0": np.array([[*d, 0.0]])}


def run(system, method, seconds, dt=DT, **knobs):
    return c.run_method(system, method, "semi_implicit", dt, round(seconds / dt), **knobs)


# --- the page ---
@pytest.mark.parametrize(("name", "keys"), chapter.KEYS.items())
def test_what_is_folded_is_the_files_and_a_fold_shows_its_key_lines(name, keys):
    code = getsource(getattr(c, name))
    parts = re.sub("<(?!/summary).*?>", "", chapter.folded(code, "python")).split("</summary>")
    head, whole = unescape(parts[0]), unescape(parts[-1])  # one, if nothing is folded
    assert whole.strip() == code.strip()
    assert ("\n    ..." in head) == ("more lines" in head)
    assert all(key in head for key in keys)


def test_the_page_is_small_and_its_links_lead_into_it_or_to_a_figure(built):
    text = built.read_text(encoding="utf-8")
    assert len(text.encode()) < 480_000
    assert "<animate" not in text
    links = re.findall(r'href="(?!https:)([^"]+)"', text)
    assert [link for link in links if f'id="{link[1:]}"' not in text or link[0] != "#"] == []
    scripts = [x for room in ("page", "site") for x in chapter.HERE.glob(f"{room}/**/*.[chj]*[sl]")]
    assert sum(len(path.read_text().splitlines()) for path in scripts) < 2300  # nobody reads more


MISFITS = """() => {
    const all = (...of) => [...document.querySelectorAll(of)];
    const {clientWidth, scrollWidth, scrollHeight} = document.documentElement;
    const size = x => parseFloat(getComputedStyle(x).fontSize);
    const edges = all("[data-figure]").map(x => x.getBoundingClientRect());
    const far = edges.map(({top}, k) => top - (edges[k - 1]?.bottom ?? -scrollY));
    const gap = Math.max(...far, scrollHeight - scrollY - edges.at(-1).bottom);
    const wrong = [
        ...all(".stage, .says, .block, table, .controls").filter(x =>
            x.scrollWidth > x.clientWidth + 22), // a hand may stand out
        ...all(".block").filter(x => x.scrollHeight > x.clientHeight + 1),
        ...all(".chapter > p .inline").filter(x => x.getBoundingClientRect().right > clientWidth
            || !/inline|^math$/.test(getComputedStyle(x).display)),
        ...all("msub, msup").filter(x => !(size(x.children[1]) < 0.9 * size(x.children[0]))),
    ].map(x => x.outerHTML);
    if (scrollWidth > clientWidth) wrong.push("the page is wider than the screen");
    if (clientWidth > 1000 && gap > 4000) wrong.push("much text without a figure");
    return wrong;
}"""


@pytest.mark.parametrize(("size", "theme"), [*SCREENS, (DESKTOP, "light")])
def test_all_fits_the_screen_is_legible_and_a_picture_on_paper(visit, built, size, theme):
    page = visit(built, viewport=size, color_scheme=theme)
    names = "[...document.querySelectorAll('[data-figure]')].map(x => x.dataset.figure)"
    assert page.evaluate(names) == FIGURES
    assert page.evaluate(MISFITS) == []
    inks = ["ink", "quiet", "d", "v", "lambda", "A", "b", "keyword", "rod1"]
    for color in page.evaluate("x => x.map(ink)", inks):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    page.emulate_media(media="print")
    for still in page, visit(built, java_script_enabled=False):
        for found in still.locator("[data-figure]").all():
            assert found.locator("img").bounding_box()["height"] > 100
            assert not found.locator("canvas, button, .lone").filter(visible=True).count()
        still.close()


@pytest.mark.parametrize("path", sorted(chapter.HERE.glob("pictures/*.svg")), ids=str)
def test_on_a_phone_the_words_of_a_picture_are_legible(visit, path):
    page = visit(path, viewport={"width": 358, "height": 800})
    small = """[...document.querySelectorAll("text")].map(x => x.textContent.trim() &&
        parseFloat(getComputedStyle(x).fontSize) * x.getScreenCTM().a < 10.99 && x.textContent)"""
    assert not any(page.evaluate(small))
    page.close()


def alone(page, name):
    """A figure that an address shows alone."""
    page.evaluate("name => { location.hash = `figure=${name}`; }", name)
    page.locator(".alone[style*=translate]").wait_for()  # the page allows no eval, in which to poll
    return page.locator(f"[data-figure={name}]")


@pytest.mark.parametrize("size", [{"width": 1440, "height": 600}, PHONE])
def test_an_address_shows_one_figure_as_large_as_the_window_and_still_in_hand(visit, built, size):
    page = visit(built, viewport=size)
    found = alone(page, "tangent")
    assert page.locator(".chapter > *").filter(visible=True).count() == 1
    x, _, width, height = found.bounding_box().values()
    assert x >= 0
    assert 0.97 < max(width / size["width"], height / size["height"]) < 1.005
    ratio = "x => x.width / x.getBoundingClientRect().width"
    near(found.locator("canvas").evaluate(ratio), 1.0, 0.02)  # sharp
    bob = found.locator(".hand").first
    before = middle(bob)
    drag(bob, 60, -40)()
    near(middle(bob), before + [60, -40], 1.5)
    found.get_by_role("link").click()
    page.locator("h1").wait_for()
    assert page.locator(".alone").count() == 0
    page.close()


@pytest.mark.parametrize("name", ["double", "question", "pump", "jansen_leg"])
def test_a_figure_alone_waits_until_it_is_started(visit, built, name):
    page = visit(built, viewport=DESKTOP, reduced_motion="no-preference")
    buttons = alone(page, name).get_by_role("button").all_inner_texts()
    assert {"Play", "Pause"} & {*buttons} == {"Play"}
    page.close()


# --- a figure, a gesture, what it says and draws ---
def test_words_stand_in_sight_apart_and_beside_what_has_their_colour(visit, built):
    page = visit(built, viewport=DESKTOP)
    page.evaluate(RECORD)
    for name in FIGURES:
        assert misplaced(figure(page, name)) == []
    page.close()


def test_the_opening_begins_alike_and_at_rest_and_comes_apart_as_runs_do(shown):
    found = figure(shown, "double")
    assert said(found).count("rods off by < 1 pm") == 5
    for index, dt in (2, DT), (4, 0.02):
        slide(found, index)
        click(found, "All 20 s")
        for k, method in enumerate(METHODS):
            ended = run(DOUBLE, method, 20.0, dt)
            bobs = {f"disc_m{k}": [] if ended.lost else ended.q[-1]}
            lost = f"lost at {len(ended.q) * dt:.1f} s: diverged"
            worst = f"rods off by {length(np.max(ended.violations))}\n"
            shows(found, f"{method}\n{lost if ended.lost else worst}", on=k, **bobs)
    click(found, "Play")
    pass_frames(found, 5)
    shows(found, "0.2 s")  # it begins again


@pytest.mark.parametrize("waits", [0, 4])
def test_one_bob_throws_all_five_or_is_let_go_at_rest_if_it_was_held_still(shown, waits):
    found = figure(shown, "double")
    slide(found, 2)
    before = places(found, "disc", "m3", 3)
    let_go = drag(found.get_by_role("button", name="Bob 1").nth(3), -40, 70)
    pass_frames(found, waits)
    q = places(found, "disc", "m3", 3)
    shows(found, "0.0 s")
    let_go()
    pass_frames(found, 5)
    turn = np.sign(np.cross(before[1] - before[0], q[1] - q[0]))
    system = DOUBLE | {"q0": q, "v0": spun(q, (0.0 if waits else 12.0) * turn)}
    for k, method in enumerate(METHODS):
        shows(found, on=k, **{f"disc_m{k}": run(system, method, 0.2).q[-1]})
    click(found, "Let go level")
    shows(found, on=3, disc_m3=DOUBLE["q0"])


def test_a_bob_feels_its_weight_and_a_pull_that_grows_with_how_far_it_fell(shown):
    found = figure(shown, "question")
    x, y, _, _ = found.locator("canvas").bounding_box().values()
    shown.mouse.move(*(drawn(found, "disc", "quiet")[0].pixels + [x + 80, y + 80]))
    shown.mouse.down()  # from far away it comes to the pointer
    shows(found, "Now let it go", disc_ink=[[0.5**0.5, -(0.5**0.5)]])
    shown.mouse.up()
    weight = np.array([0.0, -9.81, 0.0])  # N
    for frames in 1, 6:
        pass_frames(found, frames)
        [d] = places(found, "disc", "ink")
        pull = 9.81 * (-3.0 * d[1] - 2.0 * 0.5**0.5)  # N
        arrow = [d, d - 0.03 * pull * d]
        shows(found, within=1e-3, arrow_quiet=[[d, d + 0.03 * weight]], arrow_lambda=[arrow])
        near(float(drawn(found, "words", "lambda")[0].text[:-2]), pull, 0.06)
    reads(found, r"so far: (\S+) N", [pull], 0.02)
    found.get_by_role("checkbox").uncheck()
    pass_frames(found, 7)
    fallen = d + 0.5 * 0.3**2 * weight
    shows(found, "Nothing holds it", within=2e-3, disc_ink=[fallen], arrow_lambda=[])
    found.get_by_role("checkbox").check()
    click(found, "Let go level")
    pass_frames(found, 1)
    shows(found, disc_ink=[[1.0, 0.0]])


@pytest.mark.parametrize(("index", "dt"), [(1, 0.1), (3, 0.4)])
def test_the_spring_goes_and_ends_as_each_integrator_leaves_it(shown, index, dt):
    found = figure(shown, "spring")
    slide(found, index)
    drag(found.get_by_role("button"), -20, 30)()
    place, speed, _ = places(found, "disc", "ink")[0]
    start = {"q0": np.array([[place]]), "v0": np.array([[speed]]), "m": np.ones((1, 1))}
    curves = drawn(found, "line", "ink")
    dashes = """all => all.map(x =>
        x.getAttribute("stroke-dasharray").split(",").filter(Boolean).map(Number))"""
    assert [x.dash for x in curves] == found.locator("path").evaluate_all(dashes)
    for (name, integrator), curve in zip(c.INTEGRATORS.items(), curves, strict=True):
        motion = c.trajectory(integrator, start, lambda q, v: -q, dt, round(12.8 / dt))
        states = np.hstack(motion)[:, :, 0]
        near(curve.at[:, :2], states[np.max(np.abs(states), axis=1) < 9.0])
        energies = np.sum(states**2, axis=1)
        shows(found, f"{name} has {energies[-1] / energies[0]:.2f} times")


@pytest.mark.parametrize("end", [(-140, -30), (40, -900), (-2000, 60)])
def test_g_and_its_rate_are_the_chapters_and_what_is_dragged_away_stays_in_sight(shown, end):
    found = figure(shown, "tangent")
    bob, tip = found.locator(".hand").all()
    drag(tip, 30, 40)()
    drag(bob, *end)()
    [(d, tip)] = places(found, "arrow", "v")
    v = (tip - d) / 0.6
    _, g, rate, _ = c.constraint_terms(PENDULUM, d[None], v[None])
    reads(found, r"[dv] = \((\S+), (\S+)\)", [d[:2], v[:2]], 0.006)
    reads(found, r"[gġ] = (\S+) m²", [*g, *rate], 6e-4)
    foot = d + d * ((tip - d) @ d) / (d @ d)  # of what v has along the rod
    grows = "grows" if rate > 0.0 else "shrinks"
    sentence = f"The rod is {off_by(d)}, and {grows}."
    shows(found, sentence, line_v=[[d, foot]])
    near(drawn(found, "line", "quiet")[1].at, [tip, foot])
    [tangent] = places(found, "line", "pale")
    near((tangent - d) @ d, [0.0, 0.0])
    assert misplaced(found) == []


@pytest.mark.parametrize("way", [1.5, -1.5])
def test_what_is_nearly_on_the_circle_or_along_it_is_so(shown, way):
    found = figure(shown, "tangent")
    bob, tip = found.locator(".hand").all()
    circle = drawn(found, "line", "quiet")[0].pixels  # 40 steps from three o'clock on
    center = np.mean(circle[[0, 20]], axis=0)
    [d] = drawn(found, "disc", "ink")
    drag(bob, *(center + 1.02 * (circle[35] - center) - d.pixels))()
    along = way * (circle[36] - circle[34])
    drag(tip, *(along + 1.0 + middle(bob) - middle(tip)))()
    reads(found, r"[gġ] = (\S+) m²", [0.0, 0.0])
    shows(found, "The rod is right, and stays so")


def test_the_entries_of_J_follow_a_bob_and_say_and_show_what_they_are(shown):
    found = figure(shown, "jacobian")
    drag(found.get_by_role("button", name="Bob 0"), -60, 30)()
    q = places(found, "disc", "ink")
    jac, *_ = c.constraint_terms(DOUBLE, q, np.zeros((2, 3)))
    entries = values(found.locator(".cell span"))
    near(entries, jac.reshape(4, 3)[:, :2].ravel(), 0.006)
    for k, cell in enumerate(found.locator(".cell").all()):
        cell.click() if k % 2 else cell.hover()
        rod, bob, axis = np.unravel_index(k, (2, 2, 2))
        assert cell.get_attribute("aria-pressed") == "true"
        means = f"Bob {bob} along {'xy'[axis]}: g of rod {rod} changes by {entries[k]:.2f} m²"
        none = "Rod 0 does not end at bob 1"
        arrow = [q[bob], q[bob] + 0.5 * np.eye(3)[axis]]
        shows(found, none if k in (2, 3) else means, arrow_v=[arrow])
        assert drawn(found, "line", ["d", "rod1"][rod])[0].width == 8


def test_the_entry_beside_a_bob_and_the_one_in_A_change_in_the_same_frame(shown):
    found = figure(shown, "solve")
    click(found, "Let go level")
    seen = set()
    for _ in range(12):
        pass_frames(found, 1)
        beside = drawn(found, "words", "A")[0].text
        assert found.locator("mn").nth(9).text_content() == beside
        assert found.locator("b.A").text_content() == beside
        seen.add(beside)
    assert 1 < len(seen) < 4, "not in each frame: nobody could read that"


@pytest.mark.parametrize("gesture", ["hangs", "held", "thrown"])
def test_the_solve_is_the_chapters_and_its_arrows_are_the_forces_on_each_bob(shown, gesture):
    found = figure(shown, "solve")
    click(found, "Hang")
    if gesture != "hangs":
        let_go = drag(found.get_by_role("button", name="Bob 1"), 90, -70)
    if gesture == "thrown":
        let_go()
    q = places(found, "disc", "ink")
    v = spun(q, [0.0, 0.0, 12.0 * (gesture == "thrown")])
    shows(found, arrow_v=np.stack([q, q + 0.15 * v], axis=1))
    jac, A, b, lam = scenes.equation(DOUBLE, q, v).values()
    near(A @ lam, b)
    rods = c.constraint_force(DOUBLE, q, v)
    for start, tip in places(found, "arrow", "lambda"):
        rods[np.argmin(np.linalg.norm(q - start, axis=1))] -= (tip - start) / 0.025
    near(rods, np.zeros((2, 3)))
    entries = np.hstack([jac.reshape(4, 3)[:, :2].ravel(), A.ravel(), lam, b])
    near(values(found.locator("mn")), entries, 0.006)
    reads(found, r"v[₀₁] = \((\S+), (\S+)\)", v[:, :2], 0.006)
    straight, arc = drawn(found, "line", "A")
    near(straight.at, [q[0], 1.6 * q[0]])
    assert [x.radius for x in drawn(found, "disc")] == pytest.approx([4.9, 7.0, 7.0])
    d = np.diff(q, axis=0, prepend=0.0)
    near(arc.at[[0, -1]], q[0] + 0.45 * d)
    beside, *names = places(found, "words")  # of A, and of each lambda across its rod from that
    assert np.max((names - q + 0.3 * d) @ (beside - q[0])) < 0.0
    assert misplaced(found) == []
    if gesture == "held":
        let_go()


@pytest.mark.parametrize(("drags", "least", "most"), [(None, 20, 20), (0, 2, 2), (60, 2.5, 8)])
def test_a_time_shows_both_runs_as_they_were_then(shown, drags, least, most):
    found = figure(shown, "two_methods")
    if drags is not None:
        slide(found, 100)
    if drags:
        drag(found.get_by_role("button"), drags, 0)()
    (time,) = numbers(found, r"at (\S+) s:")
    assert least <= time <= most
    shows(found, on=1, line_ink=[[[time, -6.0], [time, np.log10(3.0)]]])
    now = round(time / DT)
    for color, method in ("m0", "none"), ("m1", "baumgarte"):
        whole = run(DOUBLE, method, 20.0)
        error = f"{method} {length(whole.violations[now])}"
        shows(found, error, **{f"disc_{color}": whole.q[now]})
        curve = DT * np.arange(0, 4001, 4), np.log10(np.maximum(1e-6, whole.violations[::4]))
        near(drawn(found, "line", color, 1)[0].at.T[:2], curve)


def test_a_long_step_leaves_a_wedge_and_half_the_step_halves_the_drift(shown):
    says = r"step (\d+) g = (.*) m²"
    found = figure(shown, "drift")
    start = np.array([1.0, 0.0, 0.0])
    end = np.array([1.0, -(0.3**2) * 9.81, 0.0])  # of the first step
    for sentence, button, seen, many in [  # parts of the circle and of the wedge
        ("A long step first", "Then the circle", start, (0, 1)),
        ("The circle that", "Then the wedge", start, (1, 1)),
        ("The wedge between", "Now shorter steps", end, (1, 67)),
    ]:
        shows(found, sentence, button, arrow_v=[[start, end]], line_d=[[0.0 * start, seen]])
        assert tuple(len(drawn(found, "line", color)) for color in ("quiet", "long")) == many
        if seen is start:
            shows(found, "step 1 g = ? m²")
            click(found, button)
    reads(found, says, [[1.0, 0.5 * (end @ end - 1.0)]])
    near(np.linalg.norm(drawn(found, "line", "ink")[0].at, axis=1), np.ones(41))
    near(drawn(found, "line", "long")[64].at, [end / np.linalg.norm(end), end])
    slider = found.locator(SLIDER)
    assert slider.is_disabled()
    click(found, "it halves")
    assert found.locator("[aria-pressed=true]").inner_text() == "it halves"
    shows(found, "Now try it.")
    for k, dt in enumerate([0.1, 0.05, 0.025]):
        slider.fill(str(k))
        ended = run(PENDULUM, "none", 0.7, dt)
        reads(found, says, [[0.7 / dt, (np.sum(ended.tip[-1] ** 2) - 1.0) / 2.0]])
        near(drawn(found, "line", "v")[0].at, ended.tip)
        lengths = np.linalg.norm(ended.tip, axis=1)
        wedge, drifts = np.split(places(found, "line", "long"), [65])  # of the last step; of all
        near(drifts, np.stack([ended.tip / lengths[:, None], ended.tip], axis=1))
        near(wedge[:, 1], np.linspace(*ended.tip[-2:], 65))
        circles = [*wedge[:, 0], *drawn(found, "line", "ink")[0].at]  # about the origin
        near(np.linalg.norm(circles, axis=1), np.full(65 + 41, lengths[-2]))
    shows(found, "As you said: it halves. In the end g is")


def test_the_pump_gains_energy_as_its_run_does_and_less_with_a_stiffer_spring(shown):
    found = figure(shown, "pump")
    gains = []
    for index, w in (1, 20.0), (3, 80.0):
        slide(found, index)
        click(found, "All 20 s")
        ended = run(PENDULUM, "baumgarte", 20.0, baumgarte=w)
        gains.append(np.diff(ended.energies[[0, -1]])[0] / 9.81)
        tip = ended.tip[-1]
        error = np.linalg.norm(tip) - 1.0
        bob = tip * (1.0 + 20.0 * error) / (1.0 + error)
        gained = f"It has gained {100 * gains[-1]:.2g} % of"
        shows(found, gained, off_by(tip), disc_ink=[bob])
        near(drawn(found, "line", "m1", 1)[0].at[-1, :2], [20.0, gains[-1]])
    assert 0.0 < gains[1] < 0.5 * gains[0]
    [before] = [x.at for x in drawn(found, "line", "quiet", 1) if x.dash]
    near(before[-1, :2], [20.0, gains[0]])


def test_the_error_dies_rings_or_explodes_as_its_eigenvalues_say_and_not_before_the_guess(shown):
    limit = stability_limit(c.semi_implicit_step)
    found = figure(shown, "cliff")
    slider = found.locator(SLIDER)
    spoiler = shown.get_by_text("lost at 1.51 s: diverged")
    guess = found.get_by_role("button", name="at some point it explodes")
    assert slider.is_disabled()
    assert not spoiler.is_visible()
    guess.click()
    for z, kind in (0.1, "decays"), (0.82, "rings"), (0.83, "explodes"), (0.85, "explodes"):
        slide(found, round(100 * z) - 5)
        told = f"past {limit:.3f} it explodes" in said(found)
        assert told == spoiler.is_visible() == (z > limit)
        ended = run(pendulum(0.0, -1.001), "baumgarte", 60 * DT, baumgarte=z / DT)
        errors = 1e3 * (np.linalg.norm(ended.tip, axis=1) - 1.0)  # mm
        ends = np.transpose([np.arange(61), np.clip(errors, -1.3, 1.3)])
        stems = np.stack([ends * [1.0, 0.0], ends], axis=1)
        sentence = f"It {kind}: after 60 steps it is {length(ended.violations[-1])}."
        shows(found, sentence, line_m1=stems, disc_m1=ends[np.abs(errors) < 1.3])
        step = np.array([[1.0 - 2.0 * z, -(z**2)], [1.0 - 2.0 * z, 1.0 - z**2]])  # of u and g
        wanted = np.sort(np.real(np.linalg.eigvals(step)))[::-1]
        reads(found, r"Eigenvalues: (\S+) and (\S+)", [wanted], 6e-4)
        discs = np.transpose([wanted, 0.0 * wanted])
        ticks = drawn(found, "words", None, 1)
        near([float(x.text.replace("−", "-")) for x in ticks], [x.at[0] for x in ticks], 0.02)
        grows = np.abs(wanted) > 1.0
        shows(found, on=1, disc_long=discs[grows].tolist(), disc_m1=discs[~grows].tolist())


@pytest.mark.parametrize(
    ("name", "across", "beside", "below"),
    [
        ("cliff", [-1.0, 61.0], {"1 mm": 1, "0": 0, "−1 mm": -1}, {"20": 20, "40": 40}),
        (
            "work_precision_double",
            [-np.log10(0.3), -np.log10(2e-7)],
            {"1000": 3, "10⁴": 4, "10⁵": 5, "10⁶": 6, "10⁷": 7},
            {"10 cm": 1, "1 mm": 3, "10 µm": 5},
        ),
    ],
)
def test_a_chart_rules_a_line_through_each_tick_and_names_it_there(
    shown, name, across, beside, below
):
    found = figure(shown, name)
    shows(found, line_pale=[[[x, y] for x in across] for y in beside.values()])
    named = {x.text: x.at for x in drawn(found, "words", "quiet")}
    near([named[text][1] for text in beside], [*beside.values()], 0.05)
    near([named[text][0] for text in below], [*below.values()], 0.1)


STARTS = {  # of one_step, by its buttons: d in m, v in m/s
    "Off its rod, at rest": ((0.0, -1.15, 0.0), (0.0, 0.0, 0.0)),
    "On its circle, in mid-swing": ((0.0, -1.0, 0.0), (2.0, 0.0, 0.0)),
    "Off, and thrown": ((0.0, -1.12, 0.0), (2.0, -1.0, 0.0)),
}
FIRST = {"step_baumgarte": 0, "step_impulse": 0, "step_project": 2, "one_step": 2}


def one_step(method, d, v):
    """Where a step of 0.2 s takes the bob."""
    method = c.make_methods(0.2, baumgarte=2.0)[method]
    step = c.stabilized(c.semi_implicit_step, PENDULUM, method)
    return step(d, v, PENDULUM["m"], method.make_force(PENDULUM), 0.2)[0][0]


@pytest.mark.parametrize("name", FIRST)
def test_one_step_of_each_method_ends_where_the_chapters_does(shown, name):
    found = figure(shown, name)
    for start in [None, *STARTS]:  # at first it is at one of these
        if start:
            click(found, start)
        d, v = np.array(STARTS[start or [*STARTS][FIRST[name]]])[:, None]
        before = f"Before the step the rod is {off_by(d)}"
        shows(found, before, arrow_v=[[*d, *(d + 0.2 * v)]], disc_ink=d)
        assert misplaced(found) == []
        for k, word in enumerate(METHODS):
            if name not in ("one_step", f"step_{word}") and word != "none":
                shows(found, **{f"disc_m{k}": []})
                continue
            q = one_step(word, d, v)
            says = f"{word} {off_by(q)}"
            if word == "project":
                plain = one_step("none", d, v)
                says += f", moved by {length(np.linalg.norm(q - plain))}: -M⁻¹ J₀ᵀ μ"
                shows(found, arrow_lambda=[[plain, q]])
            shows(found, f"{says}\n", **{f"disc_m{k}": [q]})


def test_a_bob_that_is_thrown_too_far_for_a_way_back_says_so(shown):
    found = figure(shown, "one_step")
    click(found, "Off its rod, at rest")
    bob, tip = found.locator(".hand").all()
    drag(tip, 300, 0)()
    shows(found, "project no way back onto the rods")
    drag(bob, 30, -60)()
    told = off_by(places(found, "arrow", "v")[0, 0])
    assert "short" in told
    shows(found, f"Before the step the rod is {told}")


@pytest.mark.parametrize(
    ("indices", "T", "p", "mass"), [((4, 2, 2), 0.05, 0.95, 1.0), ((1, 0, 5), 0.02, 0.8, 30.0)]
)
def test_a_soft_rod_rests_where_the_chapters_does_whatever_the_mass(shown, indices, T, p, mass):
    found = figure(shown, "soft")
    for k, index in enumerate(indices):
        found.locator(SLIDER).nth(k).fill(str(index))
    system = pendulum(0.0, -1.0) | {"m": np.array([[mass]])}
    error = run(system, "soft", 1.5, time_constant=T, impedance=p).violations[-1]
    formula = (1.0 - p) * T**2 * 9.81
    near(error, formula, 0.01 * formula)
    bob = [0.0, -1.0 - 150.0 * error]
    told = f"At rest the rod is {length(error)} too long.", f"= {length(formula)}", f"{mass:g} kg"
    shows(found, *told, disc_ink=[bob], line_long=[[[0.0, -1.0], bob]])
    near(drawn(found, "disc", "ink")[0].radius, 5.0 + 4.0 * np.cbrt(mass))
    assert misplaced(found) == []


def test_a_tolerance_shows_what_choose_advises(shown):
    found = figure(shown, "work_precision_double")
    x, y, _, height = found.locator("canvas").bounding_box().values()
    shown.mouse.move(x + 516, y + 0.515 * height)  # between two of its steps
    assert found.locator(".whole").first.inner_text() == "rk4 with baumgarte"
    drag(found.get_by_role("button", name="The tolerance"), -70, 0)()  # to the left: coarser
    assert "Right to 1 mm" not in said(found)
    slide(found, 1)
    lines = np.concatenate([line.at for line in drawn(found, "line")])
    assert np.min(lines[:, 0]) > -np.log10(0.3001), "none begins left of its axis"
    touched, goal = drawn(found, "line", "ink")
    near(goal.at[:, 0], [2.0, 2.0])
    assert len(touched.at) > 4
    rows = [row.rung for row in c.choose(DOUBLE, 1e-2).rows if not row.ends]
    assert len(rows) == 3
    for rung in rows:
        cost = float(f"{rung.operations:.4g}")
        shows(found, "Right to 1 cm", f"{rung.scheme}\t{1e3 * rung.dt:.3g} ms\t{cost:,.0f}")
        discs = places(found, "disc", f"m{METHODS.index(rung.scheme.method)}")
        at = np.array([-np.log10(rung.places), np.log10(cost), 0.0])
        assert np.min(np.linalg.norm(discs - at, axis=1)) < 0.01


def test_the_flat_pose_keeps_when_each_method_left_the_line(shown):
    system = c.build_system("peaucellier")
    right = system["q0"][-1, 0]
    kept = []
    found = figure(shown, "flat_pose")
    click(found, "all of them")
    click(found, "All 5 s")
    for k, method in enumerate(METHODS):
        ended = run(system, method, 5.0)
        gap = np.abs(ended.tip[:, 0] - right)
        gone = np.flatnonzero(gap > 0.05)
        says = f"left its line at {gone[0] * DT:.1f} s" if len(gone) else "on its line"
        bobs = {f"disc_m{k}": ended.q[-1]}
        shows(found, f"{method}\n{says}, gap up to {length(np.max(gap))}", on=k, **bobs)
        kept += [method] * (len(gone) == 0)
        red = [x.at[1, 0] for x in drawn(found, "line", "long", k) if x.width == 3]
        near(red, [right] * (len(gone) > 0))
    shows(found, f"No: {' and '.join(kept)} kept it there.")


def test_equal_starts_stay_equal_and_others_part_as_runs_do(shown):
    found = figure(shown, "chaos")
    for index, angle in enumerate([1e-12, 1e-9, 1e-6, 1e-3], 1):
        slide(found, index)
        pass_frames(found, 1)
        shows(found, f"The tips are {length(angle * np.linalg.norm(DOUBLE['q0'][1]))} apart")
    for index, seed, equal in (0, 0, 8), (5, 1, 0):
        slide(found, index)
        click(found, "All 20 s")
        first, second = (run(c.build_system("double", x), "baumgarte", 20.0) for x in (0, seed))
        apart = np.linalg.norm(second.tip[-1] - first.tip[-1])
        told = f"The tips are {length(apart)} apart", f"velocities {equal} are equal"
        shows(found, *told, disc_ink=first.q[-1], disc_m1=second.q[-1])
        near(drawn(found, "line", "m1", 1)[0].at[-1, :2], [20.0, np.log10(max(apart, 1e-12))])


def test_the_leg_falls_as_its_run_does_and_a_hand_pulls_its_foot(shown):
    found = figure(shown, "jansen_leg")
    click(found, "Play")
    pass_frames(found, 21)  # the first one begins
    ended = run(c.build_system("jansen_leg"), "baumgarte", 1.0)
    worst = f"rods off by {length(np.max(ended.violations))}"
    shows(found, worst, disc_ink=ended.q[-1], line_quiet=[ended.tip[1:]])
    click(found, "Again")
    shows(found, disc_ink=ended.q[0])
    before = drawn(found, "disc", "ink")[-1].pixels
    let_go = drag(found.get_by_role("button", name="Joint 5"), 60, 0)
    pass_frames(found, 16)
    foot = drawn(found, "disc", "ink")[-1]
    near(drawn(found, "line", "quiet")[-1].pixels, [foot.pixels, before + [60.0, 0.0]])
    assert foot.at[0] > ended.tip[150, 0] + 0.05
    let_go()
