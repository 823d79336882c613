"""Which integrator, method and step: what is advised is right at all times, and twice it is not."""

import json
import math
import shlex
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from conftest import BARE, FORCE, STEP, edited
from independent import energy_off, motion
from machines import at_random, four_bar, make_system, row, thrown

import constraints as c
from curriculum.ch3_4_constraints.report.files import METRICS, PAGE
from curriculum.ch3_4_constraints.rods import choice
from curriculum.ch3_4_constraints.rods.advice import advice
from curriculum.ch3_4_constraints.rods.schemes import Stepper, scheme_of

CASES = {  # a system, how far it may be off in m, and how many steps of 5 ms the run has
    "double": (c.build_system("double"), 4e-3, 400),
    "four-bar": (four_bar(), 1e-4, 100),
    "space": (thrown(at_random(row(3))), 1e-2, 200),
}


class Case(NamedTuple):
    """A system with its Answer."""

    system: dict
    answer: choice.Answer
    times: np.ndarray  # (401,) in s
    places: np.ndarray  # the true ones at these times, (401, N, 3) in m


@pytest.fixture(scope="module", params=CASES)
def case(request):
    system, within, steps = CASES[request.param]
    answer = c.choose(system, within, steps=steps)
    times = np.linspace(0.0, answer.seconds, 401)
    return Case(system, answer, times, motion(system, times))


def measured(system, scheme, dt, span):
    """The run of a scheme by itself; its worst rod, and energy as a share of its scale."""
    run = c.run_method(system, scheme.method, scheme.integrator, dt, math.floor(span / dt + 1e-6))
    if run.lost:
        return run, math.inf, math.inf
    return run, run.violations.max(), energy_off(system, run.q, run.v)


def places_off(case, run):
    """The largest distance in m from the true places, at all times that are among a run's steps."""
    at = np.round(case.times / run.dt).astype(int)
    shared = np.abs(at * run.dt - case.times) < 1e-9
    assert np.sum(shared) > 5
    return np.max(np.linalg.norm(run.q[at[shared]] - case.places[shared], axis=2))


def is_right(case, rung, dt, span=None, places=True):
    """Whether a run of a rung's scheme is right."""
    run, rods, energy = measured(case.system, rung.scheme, dt, span or rung.span)
    good = rods <= case.answer.within and energy <= 0.05
    return good and (not places or places_off(case, run) <= case.answer.within)


def test_what_is_advised_is_right_at_all_times_and_twice_the_step_is_not(case):
    answer = case.answer
    assert {x.rung.scheme.integrator for x in answer.rows} == {*c.INTEGRATORS}
    assert answer.verdict is answer.rows[0]
    for found in answer.rows:
        rung = found.rung
        assert rung.span >= answer.seconds > 0.0 and not found.ends
        for dt in (rung.dt, rung.dt / 2.0, rung.dt / 4.0):
            assert is_right(case, rung, dt)
        for part in (15 / 16, 7 / 8):  # whose times are not among those with known places
            assert is_right(case, rung, part * rung.dt, places=False)
        assert not is_right(case, rung, 2.0 * rung.dt, found.twice.span)
    work = [x.rung.operations for x in answer.rows]
    assert work == sorted(work)


def test_the_figures_of_a_rung_are_the_worst_of_its_run(case):
    answer = case.answer
    for rung in [*(x.rung for x in answer.rows), *(x.twice for x in answer.rows)]:
        run, rods, energy = measured(case.system, rung.scheme, rung.dt, rung.span)
        assert rung.rods == pytest.approx(rods, rel=1e-5, abs=1e-15)
        assert rung.energy == pytest.approx(energy, rel=1e-5, abs=1e-15)
        assert rung.places == pytest.approx(places_off(case, run), rel=0.02)


def test_a_rung_is_right_up_to_the_last_state_that_is(case):
    rung = min((x.twice for x in case.answer.rows), key=lambda x: x.held / x.dt)
    held = rung.span
    for k in range(rung.steps):
        if not is_right(case, rung, rung.dt, (k + 1) * rung.dt, places=False):
            held = k * rung.dt
            break
    assert rung.held == pytest.approx(held)


def test_a_rung_that_is_lost_has_the_figures_of_the_time_before():
    chapter = c.this_chapter()
    path, _ = choice.known_path(chapter, PENDULUM, 0.25, 20, None)
    rung = Stepper(chapter, PENDULUM, scheme_of(chapter, "euler", "baumgarte", {})).take(
        0.25, 5.0, path, 1e-3
    )
    run = c.run_method(PENDULUM, "baumgarte", "euler", 0.25, 20)
    assert run.lost == f"lost {rung.lost}" and rung.places == math.inf
    assert rung.rods == pytest.approx(run.violations.max(), rel=1e-5) and rung.held == 0.0


@pytest.mark.parametrize("case", ["four-bar"], indirect=True)
def test_if_only_rods_must_be_right_something_cheaper_is(case):
    answer = case.answer
    rung = answer.rods.rung
    assert rung.operations < 0.8 * answer.verdict.rung.operations
    assert is_right(case, rung, rung.dt, places=False)
    assert not is_right(case, rung, rung.dt)


# --- which schemes are tried, and how far ---
def rk2_step(q, v, m, force, dt):
    half = v + 0.5 * dt * force(q, v) / m
    return q + dt * half, v + dt * force(q + 0.5 * dt * v, half) / m


def stiffer(dt=0.005, **knobs):
    """The methods, and one more."""
    mine = c.Method(lambda system: c.make_force(system, 40.0), "stiffer")
    return c.make_methods(dt, **knobs) | {"stiffer": mine}


PENDULUM = make_system([[0.6, -0.3, 0.2]], row(1), m=3.0)


def chosen(within=1e-3, steps=100, dt=0.005, system=PENDULUM, each=iter, **changes):
    """The Answer of a chapter in which something is changed."""
    chapter = c.this_chapter()._replace(**changes)
    system = c.rods.check_run(system, c.PIVOT, dt, steps, c.external_force)
    return choice.choose(chapter, system, within, dt, steps, {}, each=each)


RK4 = {"rk4": c.rk4_step}


def rungs(answer):
    """{integrator: what is said of it}, without times of this machine."""
    rows = {x.rung.scheme.integrator: (x.rung, x.twice, x.ends) for x in answer.rows}
    return rows | {x.integrator: x for x in answer.missing}


def test_a_readers_own_integrator_and_method_are_tried_and_no_others_row_changes():
    tried = []

    def noted(names):
        tried.extend(names)
        return iter(names)

    usual = rungs(chosen())
    found = rungs(chosen(integrators=c.INTEGRATORS | {"rk2": rk2_step}))
    assert found.keys() == usual.keys() | {"rk2"} and 0.005 <= found["rk2"][0].dt < 0.1
    assert {name: found[name] for name in usual} == usual
    chosen(integrators={"rk2": rk2_step}, make_methods=stiffer, each=noted)
    assert tried == [f"rk2 with {x}" for x in stiffer() if x != "impulse"]


def right_at(test):
    """An integrator that is rk4 where test(dt) is not 0, and else too slow: only places are off."""

    def step(q, v, m, force, dt):
        right = c.rk4_step(q, v, m, force, dt)
        wrong = c.rk4_step(q, v, m, force, 0.9 * dt)
        return [np.where(test(dt) > 0.0, x, y) for x, y in zip(right, wrong, strict=True)]

    return {"mine": step}


def near(dt, wanted):
    return np.where(np.abs(dt / wanted - 1.0) < 1e-6, 1.0, 0.0)


LUCK = {  # where an integrator is right, and the longest step that is right with all shorter ones
    "one step": (lambda dt: near(dt, 0.04) + np.where(dt < 0.0026, 1.0, 0.0), 0.0025),
    "two steps": (lambda dt: near(dt, 0.04) + near(dt, 0.02) + np.where(dt < 6e-3, 1, 0), 0.005),
    "no other part": (lambda dt: near(dt, 0.01) + np.where(dt < 0.0051, 1.0, 0.0), 0.005),
    "no other part of the longest": (lambda dt: near(dt, 0.08) + np.where(dt < 0.041, 1, 0), 0.04),
}


@pytest.mark.parametrize("name", LUCK)
def test_what_is_right_by_luck_is_not_advised(name):
    test, longest = LUCK[name]
    answer = chosen(integrators=right_at(test))
    assert answer.verdict.rung.dt == longest and not answer.verdict.is_longest
    never = chosen(integrators=right_at(lambda dt: near(dt, 0.04)))
    assert never.verdict is None
    (missing,) = never.missing
    assert missing.best.dt == 0.04 and missing.shortest < 0.01


def test_of_an_integrator_whose_rungs_are_right_by_luck_only_that_is_said():
    """With drag, so that no energy is to blame."""

    def drag(system, q, v):
        return c.external_force(system, q, v) - 0.1 * v

    powers = right_at(lambda dt: sum(near(dt, 0.005 * 2.0**k) for k in range(-12, 9)))
    answer = chosen(integrators=powers, external_force=drag)
    said = advice(SimpleNamespace(system=PENDULUM), answer).missing
    assert not answer.rows and answer.missing[0].best.energy is None
    assert len(said) == 1 and "luck" in said[0]


def test_where_nothing_is_right_for_the_whole_time_it_is_right_for_as_long_as_is_said():
    """Under euler the energy grows."""
    only = {"euler": c.euler_step}
    system = c.build_system("pendulum")
    answer = chosen(0.1, 8000, system=system, integrators=only)
    found = answer.verdict
    rung = found.rung
    assert found.ends and answer.seconds <= rung.span < answer.whole == 40.0
    for longer in (1.0, 1.2):
        _, rods, energy = measured(system, rung.scheme, rung.dt, longer * rung.span)
        assert (rods <= 0.1 and energy <= 0.05) == (longer == 1.0)


def test_where_energy_need_not_stay_it_does_not_count(monkeypatch):
    """A drag takes it; places are those of a motion with drag."""
    usual = c.external_force
    monkeypatch.setattr(c, "external_force", lambda system, q, v: usual(system, q, v) - 5.0 * v)
    rung = chosen(integrators=RK4).verdict.rung
    run, _, energy = measured(PENDULUM, rung.scheme, rung.dt, 0.5)
    assert rung.energy is None and energy > 0.05 and rung.dt > 0.01
    known = motion(PENDULUM, np.arange(len(run.q)) * rung.dt, lambda q, v: -5.0 * v)
    assert rung.places == pytest.approx(np.max(np.linalg.norm(run.q - known, axis=2)), rel=0.02)


# --- where the motion is not known ---
@pytest.mark.parametrize("links", [60, 61])
def test_of_many_rods_at_least_rods_and_energy_are_right(links):
    system = c.build_system("chain", links=links)
    answer = chosen(1e-3, 12, system=system, integrators=RK4)
    rung = answer.verdict.rung
    assert (answer.seconds > 0.0) == (rung.places is not None) == (links <= 60)
    _, rods, energy = measured(system, rung.scheme, rung.dt, 0.06)
    assert rods <= 1e-3 and energy <= 0.05 and rung.span == 0.06
    assert bool(answer.why) == (links > 60)


@pytest.mark.parametrize(("known", "seconds"), [(100, 0.5), (0, 0.0)])
def test_a_time_that_nobody_knows_is_halved_until_it_is(known, seconds, monkeypatch):
    usual = choice.true.true_motion

    def true_motion(chapter, system, dt, last, **how):
        found = usual(chapter, system, dt, last, **how)
        return found if last <= known else found._replace(q=None, why="chaos")

    monkeypatch.setattr(choice.true, "true_motion", true_motion)
    answer = chosen(steps=400, integrators=RK4)
    rung = answer.verdict.rung
    assert answer.seconds == seconds and "chaos" in answer.why and rung.span == 2.0
    assert (rung.places is None) == (known == 0)


def test_a_tolerance_below_what_is_known_leaves_rods_and_energy():
    answer = chosen(1e-14, integrators=RK4, system=c.build_system("double"))
    rung = answer.verdict.rung
    assert answer.why and answer.seconds == 0.0 and rung.places is None and rung.rods <= 1e-14


def test_by_as_much_as_places_are_not_known_they_have_to_be_nearer(monkeypatch):
    usual = choice.known_path

    def vague(*what):
        path, why = usual(*what)
        return path._replace(uncertainty=9e-4), why

    monkeypatch.setattr(choice, "known_path", vague)
    for found in chosen(1e-3).rows:
        assert found.rung.places <= 1e-4 < found.twice.places


EXTREME = {
    "a step of days": {"dt": 1e6, "steps": 9, "integrators": RK4},
    "mass ratios": {
        "system": make_system([[1, 0, 0], [1, -2, 0]], row(2), m=[1e-6, 1e5]),
        "steps": 40,
    },
    "a tolerance as large as the machine": {"within": 1e6, "integrators": RK4},
}


@pytest.mark.parametrize("name", EXTREME)
def test_what_is_extreme_has_an_answer_too(name):
    answer = chosen(**EXTREME[name])
    assert answer.verdict.rung.rods <= answer.within and answer.verdict.rung.energy <= 0.05


# --- what is said of it ---
def test_cells_have_the_figures_and_a_mark_where_one_is_more_than_it_may_be(case):
    answer = case.answer
    said = advice(SimpleNamespace(system=case.system), answer)
    unit = {4e-3: 1e-3, 1e-4: 1e-6, 1e-2: 1e-2}[answer.within]
    pairs = [rung for row in answer.rows for rung in (row.rung, row.twice)]
    assert [line.rung for line in said.lines] == pairs
    for name, cells, rung in said.lines:
        step, span, places, rods, energy, work = (cell.rstrip("!%").strip("< ") for cell in cells)
        assert float(step) == pytest.approx(1e3 * rung.dt, rel=5e-3)
        assert float(span) == pytest.approx(rung.span, rel=5e-3)
        assert float(places) == pytest.approx(rung.places / unit, rel=0.05)
        assert float(rods) == pytest.approx(rung.rods / unit, rel=0.5)
        assert float(energy) == pytest.approx(max(0.01, 100.0 * rung.energy), rel=0.05)
        assert float(work.replace(",", "")) > 0.0
        wrong = [rung.places > answer.within, rung.rods > answer.within, rung.energy > 0.05]
        assert [cell.endswith("!") for cell in cells[2:5]] == wrong
        assert ("fails" in name) == any(wrong)


SHORT = "--dt=0.01", "--steps=64"


def plain_figures(rung):
    """A Rung as metrics.json has it."""
    scheme = {"integrator": rung.scheme.integrator, "method": rung.scheme.method}
    found = scheme | {key: x for key, x in rung._asdict().items() if key != "scheme"}
    return {key: None if x == math.inf else x for key, x in found.items()}


def test_terminal_metrics_page_and_python_say_the_same_and_the_command_is_right(tmp_path, capsys):
    """In lines that fit a terminal, and without times of this machine."""
    c.main(["--system=pendulum", *SHORT, "--no-rerun", f"--out={tmp_path}", "--within=1mm"])
    printed = capsys.readouterr().out
    lines = printed[printed.index("\nRight to 1 mm") : printed.index("\nwrote")].splitlines()
    assert len(lines) <= 17 and max(map(len, lines)) <= 80
    found = json.loads((tmp_path / METRICS).read_bytes())["choice"]
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    answer = c.choose(c.build_system("pendulum"), 1e-3, 0.01, 64)
    for x, y in zip(answer.rows, found["rows"], strict=True):
        assert y == plain_figures(x.rung) | {"ends": x.ends, "twice": plain_figures(x.twice)}
        for said in (printed, page):
            assert str(x.rung.scheme) in said and f"{1e3 * x.rung.dt:.3g}" in said
    assert found["places_to"] == answer.seconds == 0.64 and not answer.missing
    rung = answer.verdict.rung
    command = printed.partition("Run it: ")[2].partition("\nwrote")[0].replace("\\\n", " ")
    words = shlex.split(command[command.index("--system") :])
    c.main([*words, "--no-page", f"--out={tmp_path}"])
    done = json.loads((tmp_path / METRICS).read_bytes())
    (name,) = done["results"]
    assert f"{done['integrator']} with {name}" == str(rung.scheme)
    row = done["results"][name]
    assert done["dt"] * done["steps"] == rung.span and row["error"] <= 1e-3
    assert row["max_violation"] == pytest.approx(rung.rods, rel=1e-5)


def test_without_the_flag_nothing_is_sought(tmp_path, monkeypatch):
    monkeypatch.setattr(choice, "Search", None)
    c.main(["--steps", "20", *BARE, "--out", str(tmp_path)])
    assert json.loads((tmp_path / METRICS).read_bytes())["choice"] is None


MINE = ('    "rk4": rk4_step,\n', '    "mine": lambda *_: 1 / 0,\n    "rk4": rk4_step,\n')
NO_ANSWERS = {  # a word of the reason: what is changed in the file, and flags
    "not compiled": ([], ["--plain"]),
    "changes v": ([(STEP, f"        v = v * (1.0 + 0.5 * (i == 3))\n{STEP}")], []),
    "are not": ([(FORCE, f"{FORCE} + 1.0 * (q[0, 0] > 0.0)")], []),
    "division": ([MINE], []),
    "moves": ([], ["--system", "upright"]),
}


@pytest.mark.parametrize("word", NO_ANSWERS)
def test_where_there_is_no_answer_a_reason_says_why(word, tmp_path, capsys):
    changes, flags = NO_ANSWERS[word]
    run = "--steps", "20", "--within", "1mm", *flags, *BARE, "--out", str(tmp_path)
    edited(*changes).main([*run])
    found = json.loads((tmp_path / METRICS).read_bytes())["choice"]
    assert found["rows"] == [] and word in found["why"]
    assert found["why"][:20] in capsys.readouterr().out
