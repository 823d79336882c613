"""The page of a scene: its bits in node, its words beside Python's, and what Chromium shows."""

import json
import re
import shutil
import subprocess
from functools import partial
from html import unescape
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import SCREENS, click, contrast

import constraints as c
from curriculum.ch3_4_constraints.mechanics import choice as choosing
from curriculum.ch3_4_constraints.mechanics import systems
from curriculum.ch3_4_constraints.mechanics.reference import Reference
from curriculum.ch3_4_constraints.pages import answer, page
from curriculum.ch3_4_constraints.results import advice, output, palette, recording, table

USUAL = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02}
BITS = [("double", "rk4"), ("jansen_leg", "semi_implicit")]
METHODS = list(c.make_methods())
NO_BROWSER = """
const document = {documentElement: null}, getComputedStyle = () => null;
const matchMedia = () => ({addEventListener() {}});
"""
TAKE_STEPS = """
const scene = %s;
%s
const found = scene.methods.map(method => {
  const motion = new Motion(scene, method, Motion.knobs(scene, %s));
  for (let k = 0; k < %d; k++) motion.step();
  return [method, Array.from(motion.state)];
});
console.log(JSON.stringify(found));
"""


def node(script):
    """What a script prints as JSON."""
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    command = ["node", "-"]
    whole = NO_BROWSER + script
    done = subprocess.run(command, input=whole, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    return json.loads(done.stdout)


def states(chapter, system, integrator, steps, knobs=USUAL, **settings):
    """{method: (q, v)} after so many steps that node takes, with the page's knobs set so."""
    scene = page.as_script(page.scene_of(chapter, system, integrator, knobs, {}))
    script = TAKE_STEPS % (scene, page.page_file("parts.js"), json.dumps(settings), steps)
    return {x: np.reshape(state, (2, -1, 3)) for x, state in node(script)}


def edited(**changes):
    """The chapter as somebody has edited it."""
    return SimpleNamespace(**vars(c) | changes)


@pytest.mark.parametrize(("name", "integrator"), BITS)
def test_steps_of_the_page_are_pythons_bits(name, integrator):
    system = c.build_system(name)
    found = states(c, system, integrator, 300)
    rows = c.make_methods()
    assert [*found] == [x for x in METHODS if rows[x].integrator in (None, integrator)]
    for method, state in found.items():
        run = c.run_method(system, method, integrator, 0.005, 300)
        assert np.array_equal(state, [run.q[-1], run.v[-1]]), method


def test_steps_that_are_the_same_but_for_what_follows_are_written_once():
    scene = page.scene_of(c, c.build_system("double"), "rk4", USUAL, {})
    assert scene["same_step"]["project"] == "none" and "project" not in scene["steps"]
    assert {*scene["same_step"].values()} == scene["steps"].keys()


@pytest.mark.parametrize("hand", [[1.0, -2.0, 0.0], [100.0, -2.0, 0.0]])
def test_sliders_and_a_hand_pull_each_method_and_the_readers_own_as_a_force_would(hand):
    carried = np.array([[0.0, 3.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # N
    system = {**c.build_system("triple"), "load": carried}
    knobs = {"baumgarte": 40.0, "time_constant": 0.05}

    def methods(dt, baumgarte=20.0, time_constant=0.02):
        mine = c.Method(partial(c.make_force, w=0.5 / dt), "a spring for this step")
        return c.make_methods(dt, baumgarte, time_constant) | {"mine": mine}

    def pull(q, v):  # by a damped spring, not harder than three times all weights
        pull = 50.0 * (np.array(hand) - q[1] - 0.1 * v[1])
        pull = pull * np.minimum(1.0, 30.0 * np.sum(system["m"]) / np.sqrt(pull @ pull))
        return pull * np.array([[0.0], [1.0], [0.0]])

    def pulled(method, q, v):
        return method.make_force({**system, "load": carried + pull(q, v)})(q, v)

    chapter = edited(make_methods=methods)
    of_a_hand = {"hand": hand[:2], "pulls": [0, 50, 0]}
    found = states(chapter, system, "semi_implicit", 100, dt=0.01, **of_a_hand, **knobs)
    assert {*found} == {*methods(0.01)}
    for name, method in methods(0.01, **knobs).items():
        step = c.stabilized(c.semi_implicit_step, system, method)
        run = c.simulate(step, system, partial(pulled, method), 0.01, 100)
        assert found[name] == pytest.approx(np.array([run.q[-1], run.v[-1]]), abs=1e-7)


def test_a_chapter_needs_the_names_that_are_listed_and_the_knobs_that_it_has():
    def methods(dt=0.005, stiffness=20.0):
        spring = partial(c.make_force, w=stiffness)
        return {"none": c.Method(c.make_force, ""), "spring": c.Method(spring, "")}

    own = {name: getattr(c, name) for name in output.CHAPTER}
    chapter = SimpleNamespace(**own | {"make_methods": methods})
    args, system = c.parse_args(["--dt", "0.01", "--steps", "100", "--within", "1m"])
    args.knobs = {"stiffness": 30.0}
    knobs = {"dt": 0.01, "stiffness": 30.0}
    found = states(chapter, system, "semi_implicit", 100, knobs, stiffness=60.0)
    run = c.run_method(system, "baumgarte", "semi_implicit", 0.01, 100, baumgarte=60.0)
    assert np.array_equal(found["spring"], [run.q[-1], run.v[-1]])
    results = {"spring": {"stopped": None, "max_violation": 0.0}}
    assert recording.record(args, system, {"spring": run}, results, "", chapter)
    choice = choosing.choose(chapter, system, args)
    assert {x.method for x in choice.settings} == {"none", "spring"}


def test_a_page_lives_whatever_the_names_in_the_readers_loops_are():
    def smaller(new, var, let, this, function, const, state, Math, t1):
        return var, let, this, function, const, state, Math, t1, 0.5 * new

    def is_large(new, *others):
        return new > 0.1

    def settle(system, q_start, q, v, dt):
        start = [q[0, 0] * k for k in range(1, 10)]
        end = c.tracing.while_loop(is_large, smaller, *start, most=99, failure="none")
        return q, v * (1.0 + 1e-3 * end[0] + 1e-3 * end[8])

    own = {"mine": c.Method(c.make_force, "settles", settle)}
    chapter = edited(make_methods=lambda **knobs: own)
    system = c.build_system("double")
    found = states(chapter, system, "semi_implicit", 20)["mine"]
    step = c.stabilized(c.semi_implicit_step, system, own["mine"])
    run = c.simulate(step, system, c.make_force(system), 0.005, 20)
    assert found == pytest.approx(np.array([run.q[-1], run.v[-1]]), abs=1e-12)


def test_what_a_page_cannot_hold_is_refused_in_a_sentence():
    def refused(system, force=c.external_force, integrator="semi_implicit"):
        chapter = edited(external_force=force, make_methods=partial(rows, force))
        with pytest.raises(page.NoPage) as why:
            page.scene_of(chapter, system, integrator, USUAL, {})
        return str(why.value)

    def rows(force, **knobs):
        return {"mine": c.Method(lambda system: partial(force, system), "no rods")}

    system = c.build_system("double")
    assert "more than 40 rods" in refused(c.build_system("chain", links=41))
    assert "gauss steps are too slow" in refused(system, integrator="gauss")
    assert "leaves the plane z = 0" in refused(system, lambda system, q, v: np.ones_like(q))
    assert "branches on a value" in refused(system, lambda system, q, v: q if q[0, 0] > 0 else -q)
    system["v0"][1, 2] = 1.0
    assert "in the plane z = 0 only" in refused(system)


def test_a_page_begins_with_what_its_scene_is():
    assert page.about({"about": "A leg of wood. It walks."}) == "A leg of wood"
    for nothing in "", " ", ".":
        told = page.about({**c.build_system("double"), "about": nothing})
        assert told == "2 bobs, 2 kg, on 2 m of rods"
    assert page.about(c.build_system("double")) == "2 bobs, 2 kg, on 2 m of rods"
    assert page.about(c.build_system("pendulum")) == "1 bob, 1 kg, on 1 m of rods"
    loaded = c.build_system("double") | {"load": np.array([[0.0, 3.0, 4.0], [0.0, -20.0, 0.0]])}
    assert page.about(loaded) == "2 bobs, 2 kg, on 2 m of rods, under loads of 25 N"


def test_energy_should_stay_where_gravity_and_loads_alone_act():
    def conserves(force, **more):
        system = {**c.build_system("double"), **more}
        return page.scene_of(edited(external_force=force), system, "rk4", USUAL, {})["conserves"]

    def braked(system, q, v=None):
        return c.external_force(system, q, v) - 0.5 * v

    assert conserves(c.external_force)
    assert conserves(c.external_force, load=np.full((2, 3), [0.1, 0.3, 0.0]))
    assert not conserves(braked)


def test_lengths_and_shares_are_written_as_the_table_writes_them():
    numbers = [x * 10.0**k for x in (1.0, 1.26, 3.14159, 9.949, 9.96) for k in range(-14, 3)]
    script = (
        page.page_file("parts.js")
        + f"""
    console.log(JSON.stringify({json.dumps(numbers)}.map(x => [metric(x), perCent(x)])));
    """
    )
    for x, (length, share) in zip(numbers, node(script), strict=True):
        assert length == table.length(x)
        if x > 1e-6:
            assert share == table.per_cent(x)


def played(*flags, chapter=c, choice=None, edited=False):
    """The text of the page of a run with these flags, and what metrics.json says of its methods."""
    args, system = c.parse_args(flags)
    runs = {}
    results = {}
    for name in args.methods:
        knobs = args.knobs
        runs[name] = c.run_method(system, name, args.integrator, args.dt, args.steps, **knobs)
    reference = c.mechanics.find_reference(system, c.make_force(system), c.project, runs.values())
    methods = c.make_methods(args.dt, **args.knobs)
    for name, run in runs.items():
        results[name] = c.summary(system, run, methods[name], reference)
        acts = chapter.external_force, chapter.energy
        results[name]["conserves"] = systems.conserves(system, *acts)
    return page.play(chapter, args, system, results, reference, choice, edited)


@pytest.fixture(scope="module")
def pages(visit, tmp_path_factory):
    """pages(*flags, **context) -> the page of a run with these flags."""
    path = tmp_path_factory.mktemp("page") / "play.html"

    def opened(*flags, chapter=c, choice=None, edited=False, **context):
        path.write_text(played(*flags, chapter=chapter, choice=choice, edited=edited), "utf-8")
        return visit(path, **context)

    return opened


@pytest.fixture(scope="module")
def double(pages):
    return pages()


@pytest.fixture
def still(double):
    """The page of the double pendulum, as the run was, at rest."""
    click(double, "As it was")
    double.evaluate("clock.set(false); run.begin()")
    return double


def steps(shown, many):
    shown.evaluate(f"for (let k = 0; k < {many}; k++) run.step(); drawing.draw()")


def run(name, dt, many, **knobs):
    """That of the double pendulum."""
    with np.errstate(all="ignore"):
        return c.run_method(c.build_system("double"), name, "semi_implicit", dt, many, **knobs)


def metres(x):
    return table.length(x)


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
    shown = pages(
        "--steps", "9", edited=True, viewport=size, color_scheme=theme, device_scale_factor=2
    )
    boxes = [tile.bounding_box() for tile in shown.locator(".tile").all()]
    seen = sum(x["width"] * (min(size["height"], x["y"] + x["height"]) - x["y"]) for x in boxes)
    assert len(boxes) == len(METHODS) and seen >= 0.4 * size["width"] * size["height"]
    assert shown.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert 'name="viewport" content="width=device-width' in shown.content()
    names = ["ink", "quiet", "long", "short", *(f"m{k}" for k in range(len(palette.METHODS)))]
    for color in shown.evaluate("names => names.map(ink)", names):
        assert contrast(color.strip(), palette.PAPER[theme == "dark"]) >= 4.5
    sizes = "all => all.map(x => [x.width / x.clientWidth, x.height / x.clientHeight])"
    sharp = shown.locator("canvas").evaluate_all(sizes)
    assert len(sharp) == len(METHODS) + 1 and np.ravel(sharp) == pytest.approx(2.0, abs=0.02)
    assert shown.locator("#time").inner_text() == "0.00 s", "it waits for who wants less motion"
    assert "moves without those edits" in shown.locator("header").inner_text()
    shown.emulate_media(color_scheme="dark" if theme == "light" else "light")
    shown.wait_for_function("x => ink('ink').includes(x)", arg=palette.INK[theme == "light"])


def test_on_paper_it_is_light_and_without_what_only_a_screen_can_do(pages):
    shown = pages("--steps", "9", choice=chosen(), color_scheme="dark")
    shown.emulate_media(media="print", color_scheme="dark")
    shown.wait_for_function("x => ink('ink') === x", arg=palette.INK[0])
    assert not any(x.is_visible() for x in shown.locator("button, input, #say").all())
    for kept in "#says", "#found tbody", "#ladder", "#title":
        assert shown.locator(kept).first.is_visible()


def test_it_opens_at_the_step_of_the_run_and_says_so(pages):
    for flags, facts in (
        ((), "semi_implicit, steps of 5 ms, as in the run."),
        (("--dt", "0.0125"), "semi_implicit, steps of 12.5 ms, as in the run."),
        (
            ("--integrator", "rk4"),
            "rk4, steps of 5 ms, as in the run. impulse is left out: it is made",
        ),
    ):
        shown = pages(*flags, "--steps", "9")
        assert shown.locator("#facts").inner_text().startswith(facts)
    colors = shown.locator("figcaption b").evaluate_all("all => all.map(x => x.className)")
    assert colors == [f"m{k}" for k, x in enumerate(METHODS) if x != "impulse"], "each its own"
    assert (
        shown.locator("#found [scope=row]").evaluate_all("all => all.map(x => x.className)")
        == colors
    )


def cells(text, table):
    """{method: its cells} of a table in the text of a page."""
    body = re.findall("<tbody>(.*?)</table>", text, re.S)[table]
    found = {}
    for row in body.split("<tr>")[1:]:
        _, name, *others = re.split("<t[hd][^>]*>", row)
        found[name] = [unescape(cell).strip() for cell in others]
    return found


def test_terminal_metrics_and_page_say_the_same_of_a_run(tmp_path, capsys):
    flags = ["--baumgarte", "400", "--dt", "0.004", "--steps", "2500", "--no-rerun"]
    c.main([*flags, f"--out={tmp_path}"])
    printed = capsys.readouterr().out.splitlines()
    metrics = json.loads((tmp_path / output.METRICS).read_text())
    text = (tmp_path / output.PAGE).read_text()
    assert "<caption>The run: semi_implicit, 10 s in steps of 4 ms." in text
    for name, found in cells(text, 0).items():
        row = metrics["results"][name]
        [line] = [x for x in printed if x.split(" ")[0] in (name, f"{name}*")]
        if row["stopped"]:
            assert found == [row["stopped"]] and row["stopped"] in line
            continue
        # metrics have twelve decimals: what is below 1 pm may be rounded up to it
        rods = [row[key] * (1.0 - 1e-9) for key in ("max_violation", "final_violation")]
        lengths = list(map(table.length, rods))
        assert found[:-1] == [*lengths, table.energy(row), table.length(row["error"])]
        assert re.findall(" {2,}".join(map(re.escape, found[:3])), line), "in this order"
        assert found[3] in line
        assert found[4] == advice.thousands(row["operations"])
    assert "stopped" in str(metrics["results"]["baumgarte"])


def test_terminal_metrics_and_page_give_the_same_answer(tmp_path, capsys):
    c.main(["--within", "1mm", "--no-rerun", f"--out={tmp_path}"])
    printed = capsys.readouterr().out
    choice = json.loads((tmp_path / output.METRICS).read_text())["choice"]
    text = (tmp_path / output.PAGE).read_text()
    says, holds = re.findall('<p id="(?:says|holds)">(.*?)<(?:p|/div)\\b', text)
    steps = cells(text, 1)
    heads = re.findall(f'<th scope="col">({"|".join(c.INTEGRATORS)})', text)
    for index in choice["places"]:
        row = choice["settings"][index]
        step = advice.milliseconds(row["dt"])
        cell = steps[row["method"]][heads.index(row["integrator"])]
        assert re.sub("</?b>", "", cell) == f"{step}: {advice.thousands(row['operations'])}"
    shown = sum(": " in cell for row in steps.values() for cell in row)
    assert shown == len(choice["places"])
    assert text.count("<td><b>") == 1
    for key, words in ("places", says), ("rods_hold", holds or says):
        row = choice["settings"][choice[key][0]]
        setting = f"{row['integrator']} with {row['method']} at {advice.milliseconds(row['dt'])}"
        assert f": {setting}" in words and f": {setting}" in printed


FOUND = [  # integrator, method, step in s, error in m, operations a second
    ("semi_implicit", "none", 0.02, 0.9e-3, 5000.0),  # by luck, as the next one shows
    ("semi_implicit", "none", 0.01, 2e-3, 10000.0),
    ("semi_implicit", "none", 0.005, 2e-2, 20000.0),
    ("semi_implicit", "impulse", 0.02, 2e-3, 6000.0),
    ("semi_implicit", "impulse", 0.01, 5e-4, 12000.0),
    ("semi_implicit", "impulse", 0.005, 1e-4, 24000.0),
    ("rk4", "none", 0.04, 9e-4, 8000.0),
    ("rk4", "none", 0.02, 3e-5, 16000.0),
    ("rk4", "none", 0.01, 2e-6, 32000.0),
    ("rk4", "project", 0.04, 5e-5, 8200.0),
    ("rk4", "project", 0.02, 4e-6, 16400.0),
    ("rk4", "project", 0.01, 4e-7, 32800.0),
    ("rk4", "project", 0.005, 3e-8, 65600.0),
]


def chosen(within=1e-3, uncertainty=1e-12):
    """What --within may have found."""
    settings = []
    for integrator, method, dt, error, operations in FOUND:
        row = error / 10.0, 0.0, error, operations, 0.0, None
        settings.append(choosing.Setting(integrator, method, dt, *row))
    reference = Reference(400, "at 2 s", np.zeros((2, 3)), uncertainty)
    return choosing.Choice(within, 20.0, 2.0, reference, 20.0, [], ["gauss"], settings, [], [])


def answers(choice, scene, *flags):
    """What the page says of a choice, of a run with these flags."""
    return answer.answers(c.parse_args(flags)[0], choice, scene)


def with_all(choice, **known):
    return choice._replace(settings=[x._replace(**known) for x in choice.settings])


def test_an_answer_is_the_cheapest_step_that_is_no_luck_and_a_tie_goes_to_the_better():
    found = answers(chosen(), {"colors": {}, "conserves": True})
    assert found["1 mm"]["says"] == (
        "Right to 1 mm after 2 s, rods for 20 s: rk4 with project at 40 ms; with semi_implicit,"
        " impulse at 10 ms, for 1.5 times the operations."
    )
    steps = cells(f"<tbody>{found['1 mm']['rows']}</table>", 0)
    assert steps["none"] == ["2 cm off at 5 ms", "40 ms: 8,000"]
    assert steps["impulse"] == ["10 ms: 12,000", "–"]
    assert steps["project"] == ["–", "<b>40 ms: 8,200</b>"]
    assert found["1 µm"]["says"].endswith(
        "rk4 with project at 10 ms; with semi_implicit, nothing that was tried."
    )
    assert list(found) == ["1 cm", "1 mm", "100 µm", "1 µm"]
    unsure = answers(chosen(uncertainty=9e-7), {"colors": {}, "conserves": True})
    assert list(unsure) == ["1 cm", "1 mm", "100 µm"]
    exact = answers(chosen(1e-9), {"colors": {}, "conserves": True})
    assert list(exact) == ["1 cm", "1 mm", "100 µm", "1 µm", "1 nm"]
    assert exact["1 nm"]["says"] == (
        "Right to 1 nm after 2 s, rods for 20 s: nothing is, down to steps of 5 ms."
    )


def test_places_whose_rods_are_wrong_later_are_no_answer_and_say_so():
    scene = {"colors": {}, "conserves": True}
    found = answers(with_all(chosen(), rods=0.0044), scene)["1 mm"]
    assert found["says"].endswith(": nothing is, down to steps of 5 ms.")
    steps = cells(f"<tbody>{found['rows']}</table>", 0)
    assert steps["project"] == ["–", "30 nm off at 5 ms; rods, 4.4 mm later"]
    assert steps["none"] == ["2 cm off at 5 ms", "2 µm off at 10 ms; rods, 4.4 mm later"]


def test_rods_alone_say_what_they_cost_in_places_and_energy():
    scene = {"colors": {}, "conserves": True}
    holds = answers(with_all(chosen(), rods=1e-4, energy=0.35), scene)["1 mm"]["holds"]
    assert holds == (
        "If rods alone matter, within 1 mm for 20 s: semi_implicit with none at 20 ms;"
        " its energy is off by 35 %."
    )
    wrong = with_all(chosen(), rods=1e-4, energy=0.02, error=0.5)
    holds = answers(wrong, scene)["1 mm"]["holds"]
    assert holds.endswith("; but places are 50 cm off after 2 s; its energy is off by 2 %.")
    braked = with_all(chosen(), rods=1e-4, energy=None)
    assert "energy" not in answers(braked, scene)["1 mm"]["holds"]


def test_what_only_the_shortest_step_is_right_to_may_be_luck_and_says_so():
    found = answers(chosen(), {"colors": {}, "conserves": True})["100 µm"]
    steps = cells(f"<tbody>{found['rows']}</table>", 0)
    assert steps["impulse"] == ["perhaps 5 ms: no shorter step was tried", "–"]


def test_what_is_lost_says_when_why_and_in_which_steps():
    lost = with_all(chosen(), rods=None, energy=None, lost="at 3.35 s: diverged")
    found = answers(lost, {"colors": {}, "conserves": True})["1 mm"]
    steps = cells(f"<tbody>{found['rows']}</table>", 0)
    assert steps["impulse"] == ["lost at 3.35 s in steps of 5 ms: diverged", "–"]


def test_an_answer_has_the_command_that_runs_it_and_asks_for_other_tolerances(tmp_path):
    flags = "--stabilization=project", "--within", "1mm", "--smoke", "--no-rerun", "--no-page"
    found = answers(chosen(), {"colors": {}, "conserves": True}, *flags, "--dt=0.01")
    typed = re.findall("<code>(.*?)</code>", found["1 mm"]["how"])
    assert [x.partition("--")[2] for x in typed] == [
        "no-rerun --no-page --integrator rk4 --dt 0.04 --steps 500"
    ]
    words = typed[0].split()
    c.main([*words[words.index("--no-rerun") :], f"--out={tmp_path}"])
    metrics = json.loads((tmp_path / output.METRICS).read_text())
    assert (metrics["integrator"], metrics["dt"], metrics["steps"]) == ("rk4", 0.04, 500)
    for within, flag in ("1 cm", "1cm"), ("1 µm", "1um"):
        asks = f"Of the steps tried for 1 mm, without gauss: <code>--within {flag}</code>"
        assert asks in found[within]["how"]
    assert found["1 µm"]["says"].startswith("Without gauss, right to 1 µm after 2 s")
    assert found["1 cm"]["says"].startswith("Right to 1 cm after 2 s")
    tried = chosen()._replace(untried=[])
    assert "ithout" not in str(answers(tried, {"colors": {}, "conserves": True})["1 µm"])


def test_where_nobody_knows_the_true_motion_the_answer_is_of_rods_and_says_why():
    unknown = Reference(400, "at 2 s", why="chaos decides")
    choice = with_all(chosen(), error=None)._replace(reference=unknown)
    found = answers(choice, {"colors": {}, "conserves": True})["1 mm"]
    assert found["says"].startswith("Chaos decides. Rods within 1 mm for 20 s: ")
    assert found["holds"] == ""


def test_the_reader_changes_the_tolerance_among_those_that_were_measured(pages):
    shown = pages("--steps", "9", choice=chosen())
    tolerances = shown.locator("#tolerances button")
    assert tolerances.all_inner_texts() == ["1 cm", "1 mm", "100 µm", "1 µm"]
    pressed = "all => all.filter(x => x.ariaPressed === 'true').map(x => x.textContent)"
    assert tolerances.evaluate_all(pressed) == ["1 mm"]
    found = answers(chosen(), page.scene_of(c, c.build_system("double"), "rk4", USUAL, {}))
    assert shown.locator("#says").inner_text() == found["1 mm"]["says"]
    assert shown.locator("#how code").inner_text().endswith("--dt 0.04 --steps 500")
    click(shown, "1 µm")
    assert "--dt 0.01 --steps 2000" in shown.locator("#how code").first.inner_text()
    assert tolerances.evaluate_all(pressed) == ["1 µm"]
    assert shown.locator("#says").inner_text() == found["1 µm"]["says"]
    assert shown.locator("#within").inner_text() == "1 µm"
    project = shown.locator("#ladder tr").filter(has_text="project")
    assert project.inner_text().split("\t") == ["project", "–", "10 ms: 32,800"]


def test_without_an_answer_stands_the_command_that_finds_one(pages):
    shown = pages("--out=one", "--system", "triple", "--out", "two", "--steps", "9")
    command = shown.locator("#says code").inner_text()
    assert command.endswith(" --system triple --steps 9 --within 1mm")
    assert "out" not in command
    assert shown.locator("#tolerances button, #ladder").count() == 0


def test_as_it_was_has_the_numbers_of_the_run_and_draws_its_pose(still):
    click(still, "True motion")
    steps(still, 400)
    fine = run("project", 0.005 / 20, 400 * 20).q[::20]
    for k, name in enumerate(METHODS):
        found = run(name, 0.005, 400)
        errors = c.rod_lengths(c.build_system("double"), found.q[-1]) - 1.0
        worst = errors[np.argmax(np.abs(errors))]
        words = f"{metres(abs(worst))} too {'long' if worst > 0 else 'short'}"
        expected = "rods are right" if name == "project" else words
        assert still.locator(".off").nth(k).inner_text() == expected
        now = np.max(np.linalg.norm(found.q[-1] - fine[-1], axis=-1))
        tile = still.locator(".tile").nth(k)
        assert tile.get_by_text(f"{metres(now)} from true motion").count() == 1
        away = np.max(np.linalg.norm(found.q - fine, axis=-1))
        assert f"{name} {metres(away)}" in told(still)
    click(still, "Energy")
    for name in METHODS:
        energies = run(name, 0.005, 400).energies
        change = (energies - energies[0]) / (2 * 9.81 * 2)  # of m g L
        most = change[np.argmax(np.abs(change))]
        sign = "+" if most > 0 else "−"
        assert f"{name} {sign}{table.per_cent(abs(most))}" in told(still)
    tile = "run.copies[1].view"
    found = run("baumgarte", 0.005, 400)
    for color, places in ("ink", found.q[-1]), ("reference", fine[-1]):
        lines = [x["at"] for x in drawn(still, tile, "line", color)]
        rods = np.array([[np.zeros(3), places[0]], places])[..., :2]
        assert np.sort(lines, axis=1) == pytest.approx(np.sort(rods, axis=1))
    [trail] = drawn(still, tile, "line", "m1")
    assert np.array(trail["at"]) == pytest.approx(found.tip[-301:, :2]), "of 1.5 s"
    click(still, "Again")
    lines = [x["at"] for x in drawn(still, tile, "line", "reference")]
    assert np.max(lines) == pytest.approx(np.max(found.q[0])), "the true motion begins again, too"


@pytest.mark.parametrize("stretch", [0.2, -0.2])
def test_what_is_too_long_is_red_and_what_is_too_short_dashed_blue(still, stretch):
    color = "long" if stretch > 0 else "short"
    still.evaluate(f"run.copies[1].state.set([1 + {stretch}, 0, 0, 2 + {stretch}, 0, 0])")
    wrong = [
        x for x in drawn(still, "run.copies[1].view", "line") if x["color"] in ("long", "short")
    ]
    assert [x["color"] for x in wrong] == [color], "of the first rod; the second is right"
    assert sorted(x for x, _ in wrong[0]["at"]) == pytest.approx(sorted([1, 1 + stretch]))
    assert bool(wrong[0]["dash"]) == (color == "short")
    still.evaluate("run.copies[1].rods = run.copies[1].errors; drawing.draw()")
    assert still.locator(".off").nth(1).inner_text() == f"20 cm too {color}"


def test_the_plot_draws_each_worst_rod_in_decades_and_names_it_where_its_line_ends(still):
    steps(still, 100)
    words = {x["text"]: x["at"] for x in drawn(still, "board.plot", "words")}
    assert [words[x][1] for x in ("1 m", "10 cm", "100 µm", "≤ 1 µm")] == [0, -1, -4, -6]
    worst = np.max(run("none", 0.005, 100).violations)
    curves = [x for x in drawn(still, "board.plot", "line") if x["width"] == 2]
    end = pytest.approx([0.5, np.log10(worst)])
    assert curves[0]["at"][-1] == end
    assert words[f"none {metres(worst)}"] == end
    assert len({tuple(x["dash"]) for x in curves}) == len(METHODS), "told apart without colours"


def test_a_method_that_is_lost_says_when_and_why_and_what_helps(still):
    still.locator("#baumgarte input").fill("10")  # 320/s: beyond what 5 ms endure
    steps(still, 200)
    when = 0.005 * (len(run("baumgarte", 0.005, 200, baumgarte=320.0).q) - 1)
    lost = still.locator(".lost")
    assert [x != "" for x in lost.all_inner_texts()] == [x == "baumgarte" for x in METHODS]
    words = f"lost at {when:.2f} s: its rods flew apart. Try a shorter step."
    baumgarte = METHODS.index("baumgarte")
    assert lost.nth(baumgarte).inner_text() == words and "baumgarte lost" in told(still)
    changed = still.evaluate("""() => {
      const seen = new MutationObserver(() => {});
      for (const live of document.querySelectorAll("[aria-live=polite]")) {
        seen.observe(live, {childList: true, characterData: true, subtree: true});
      }
      for (let k = 0; k < 9; k++) { run.step(); drawing.draw(); }
      return seen.takeRecords().length;
    }""")
    assert changed == 0, "it is announced once"
    hands = still.locator(".tile").nth(baumgarte).locator("[inert] .hand")
    assert hands.count() == 2, "no longer pulled"
    project = METHODS.index("project")
    still.evaluate(f"run.copies[{project}].state.set([1e4, 0, 0, 1e4, 0, 0], 6)")  # m/s
    steps(still, 1)
    assert "s: no way back onto the rods. Try a shorter step." in lost.nth(project).inner_text()
    click(still, "Again")
    assert not any(lost.all_inner_texts())


def test_time_passes_while_a_hand_pulls_and_what_it_adds_is_no_error(still):
    hand = still.locator(".tile").nth(3).locator(".hand").last
    click(still, "Energy")
    for key in "Escape", "Tab", "Shift":  # or by the mouse alone
        box = hand.bounding_box()
        before = still.evaluate("run.time")
        still.mouse.move(box["x"] + 22, box["y"] + 22)
        still.mouse.down()
        still.mouse.move(box["x"] + 3000, box["y"])  # far away, but the hand's force is bounded
        still.wait_for_function("before => run.time > before + 0.1", arg=before)
        string = drawn(still, "run.copies[3].view", "line")[-1]
        assert string["dash"] and string["at"][1][0] - string["at"][0][0] > 10
        still.keyboard.press(key)
        still.mouse.up()
        assert not still.evaluate("hand.copy || clock.going"), "it stands still again"
        assert not any(still.locator(".lost").all_inner_texts())
        assert still.locator(".off").nth(METHODS.index("project")).inner_text() == "rods are right"
        assert "%" not in told(still)
    steps(still, 4)  # from where it was let go, no method's energy changes by much
    assert still.evaluate("largest(run.copies.map(({worst}) => worst.energy))") < 0.05


def test_a_bob_that_is_taken_at_its_edge_goes_as_far_as_the_mouse(still):
    box = still.locator(".tile").nth(3).locator(".hand").last.bounding_box()
    x, y = still.evaluate("run.copies[3].point(1)")
    still.mouse.move(box["x"] + 10, box["y"] + 22)  # on the right a narrow tile ends
    still.mouse.down()
    still.mouse.move(box["x"] + 10, box["y"] - 28)
    place, scale = still.evaluate("[knobs.hand, run.copies[3].view.scale[0]]")
    still.mouse.up()
    assert place == pytest.approx([x, y + 50.0 / scale], abs=2.0 / scale)


def test_time_that_went_before_a_hand_pulled_goes_on_after_it(still):
    click(still, "Play")
    still.evaluate("hand.drag(run.copies[0], 0, [0, 0]); hand.letGo()")
    assert still.evaluate("clock.going && !hand.copy")
    click(still, "Pause")
    assert not still.evaluate("clock.going")
    shown = still.locator("#time").inner_text()
    assert shown == still.evaluate("`${fixed(run.time, 2)} s`"), "what was told less often, too"


def test_a_processor_that_is_too_slow_shows_slow_motion_and_does_not_race(still):
    told = still.evaluate("""() => {
      clock.going = true;
      clock.advance(1000); // s, in one frame
      drawing.told = 0;
      drawing.draw();
      const told = [clock.late, clock.owed, run.time < 100, byId("time").textContent];
      clock.set(false);
      return told;
    }""")
    assert told[:-1] == [True, 0, True] and told[-1].endswith(" s, in slow motion")
    click(still, "Again")
    assert still.locator("#time").inner_text() == "0.00 s"


def test_any_bob_is_reached_by_keys_and_keys_of_the_browser_are_its_own(still):
    focused = "document.activeElement"
    hand = still.locator(".tile").first.locator(".hand").last
    assert still.locator("a, button, input").first.inner_text() == "Play"
    hand.focus()
    still.keyboard.press("PageDown")
    assert "none: pull bob 1 of 2" in still.evaluate(f"{focused}.ariaLabel")
    still.keyboard.press("Alt+ArrowRight")
    assert not still.evaluate("hand.copy || clock.going"), "that is the browser's"
    still.keyboard.press("ArrowRight")
    still.wait_for_function("() => run.time > 0.1")
    still.keyboard.press("Escape")
    assert not still.evaluate("hand.copy || clock.going"), "it is let go"
    x, taken = still.evaluate("[run.copies[0].point(0)[0], run.taken]")
    assert x > run("none", 0.005, taken).q[-1, 0, 0]


def test_a_finger_takes_the_nearest_bob_of_all_and_scrolls_where_none_is_near(pages):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
    shown = pages("--system", "windows", "--steps", "9", **phone)
    tile = shown.locator(".tile").first
    hands = tile.locator(".hand")
    many = len(c.build_system("windows")["m"])
    assert hands.count() == many
    styles = hands.evaluate_all("all => all.map(getComputedStyle).map(x => x.pointerEvents)")
    assert {*styles} == {"auto"}
    boxes = [hand.bounding_box() for hand in hands.all()]
    for k, box in enumerate(boxes):
        shown.touchscreen.tap(box["x"] + 22, box["y"] + 22)
        assert f"pull bob {k + 1} of {many}" in shown.evaluate("document.activeElement.ariaLabel")
    x = tile.bounding_box()["x"] + 80
    y = min(box["y"] for box in boxes) - 15
    assert shown.evaluate(f"document.elementFromPoint({x}, {y}).className") != "hand"


def test_sliders_set_exact_values_say_them_and_begin_again_if_they_must(pages):
    shown = pages(
        "--steps", "9", "--dt", "0.0033", "--baumgarte", "17.3", "--time-constant", "0.0271"
    )
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
    click(still, "How stiff a spring?")
    assert still.evaluate("[knobs.dt, knobs.baumgarte]") == [0.005, 20.0]
    assert still.locator("#asked label").get_attribute("id") == "baumgarte"
    assert still.locator("#questions").get_by_text("energy").count() == 1
    assert pages("--steps", "1").locator("#questions").get_by_text("energy").count() == 0

    def braked(system, q, v=None):
        return c.external_force(system, q, v) - 0.5 * v

    shown = pages("--steps", "99", chapter=edited(external_force=braked))
    assert shown.locator("#questions").get_by_text("energy").count() == 0
    energies = shown.locator("#found td:nth-child(4)").all_inner_texts()
    assert {*energies} == {"-"}


def test_half_the_step_is_compared_at_the_same_time(still):
    click(still, "What does half the step buy?")
    still.evaluate("clock.set(false); run.begin()")
    steps(still, 200)
    for name in METHODS:
        worst = [np.max(run(name, dt, round(1.0 / dt)).violations) for dt in (0.005, 0.0025)]
        assert f"{name} {metres(worst[0])}, {metres(worst[1])}" in told(still)
    click(still, "As it was")
    assert "cm, " not in told(still)


def test_the_step_slider_reaches_the_longest_step_that_is_advised(pages):
    choice = with_all(chosen(), rods=1e-4, energy=0.01)
    shown = pages("--integrator", "rk4", "--steps", "9", choice=choice)
    values = shown.evaluate("sliders[0].values")
    assert max(values) == 0.05 and 0.04 in values
    long = [x._replace(dt=5.0 * x.dt) for x in choice.settings]
    shown = pages("--integrator", "rk4", "--steps", "9", choice=choice._replace(settings=long))
    assert max(shown.evaluate("sliders[0].values")) == 0.2


@pytest.mark.parametrize("wide", [1100, 390])
def test_a_wide_scene_fills_its_tiles_and_no_bob_is_cut_off(pages, wide):
    shown = pages("--system", "windows", "--steps", "9", viewport={"width": wide, "height": 900})
    rooms = shown.locator(".tile").evaluate_all("all => all.map(x => x.clientHeight)")
    scale = shown.evaluate("run.copies[0].view.scale[0]")
    assert max(rooms) <= 180 and 2.0 * scale > 0.3 * max(rooms)
    edges = """() => run.copies.flatMap(copy => copy.points.map(point => {
      const [x, y] = copy.view.pixels(point);
      return Math.min(x, y, copy.view.width - x, copy.view.height - y);
    }))"""
    for _ in range(40):
        steps(shown, 10)
        assert min(shown.evaluate(edges)) > 7.0
