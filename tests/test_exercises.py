"""Exercises: answers are right, mistakes are not, and a blank says where it is."""

import re
from functools import cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import python

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step

PACKAGE = "curriculum.ch3_4_constraints.exercises"
FOLDER = Path(checks.__file__).parents[1]
NAMES = sorted(path.stem for path in FOLDER.glob("exercises/ex*.py"))
PLAN = (FOLDER / "teaching.md").read_text(encoding="utf-8")
CHECKS = {name: getattr(checks, name.partition("_")[2]) for name in NAMES}
MISTAKES = [
    ("ex1_drift", "guess", lambda: {"rod": "grows", "factor": 16}),
    ("ex1_drift", "guess", lambda: {"rod": "shrinks", "factor": 4}),
    ("ex1_drift", "expected_g", lambda speeds, dt: 0.5 * dt**2 * np.sum(speeds[:-1] ** 2)),
    ("ex1_drift", "expected_g", lambda speeds, dt: [0.5 * dt**2 * np.sum(speeds**2)] * 2),
    ("ex2_solve", "jdotv", lambda d, d_dot: d @ d_dot),
    ("ex2_solve", "target", lambda g, gdot, w: -w * gdot - w**2 * g),
    ("ex2_solve", "target", lambda g, gdot, w: -2.0 * w * gdot - w * g),
    ("ex3_chaos", "guess", lambda: {1e-12: 27.2, 1e-24: 60.0}),
    ("ex3_chaos", "guess", lambda: {1e-12: 34.4, 1e-24: 120.0}),
    ("ex4_cliff", "guess", lambda: dict.fromkeys(("euler", "semi_implicit", "rk4"), "earlier")),
    ("ex4_cliff", "guess", lambda: dict.fromkeys(("euler", "semi_implicit", "rk4"), "later")),
    ("ex4_cliff", "step_matrix", lambda step_fn, z: np.array([[0.0, 1.0], [-(z**2), -z]])),
    ("ex5_xpbd", "substep", lambda system, q, v, h: (xpbd_step(system, q, v, h)[0], v)),
    ("ex5_xpbd", "substep", lambda system, q, v, h: xpbd_step(system, q + h * v, v, h)),
]
RIGHT = [  # though others than the solutions
    ("ex1_drift", "guess", lambda: {"rod": "shrinks", "factor": 15}),
    ("ex1_drift", "expected_g", lambda speeds, dt: 0.5 * np.sum((dt * speeds) ** 2) + 1e-8),
    ("ex3_chaos", "guess", lambda: {1e-12: 34.0, 1e-24: 75.0}),
]


@pytest.mark.parametrize("name", CHECKS)
def test_an_exercise_says_where_its_first_blank_is(name, capsys):
    exercise = import_module(f"{PACKAGE}.{name}")
    assert checks.verdict(CHECKS[name], exercise) == 0
    place, what = capsys.readouterr().out.splitlines()[-1].split(": ", 1)
    path = Path(exercise.__file__)
    line = path.read_text(encoding="utf-8").splitlines()[int(place.split()[-1]) - 1]
    assert place.startswith(path.name) and f'blank("{what}")' in line


def test_a_flag_that_an_exercise_does_not_have_is_refused_in_a_line():
    done = python("-m", f"{PACKAGE}.ex1_drift", "--sloved")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "ex1_drift.py: error: " in done.stderr and "--sloved" in done.stderr


MAINS = {name: cache(import_module(f"{PACKAGE}.{name}").main) for name in NAMES}


@pytest.fixture
def solved():
    """solved(name): the module of an exercise, with the answers in place of its blanks.

    Its main runs once in all tests: no answer that is wrong gets so far, but for guesses.
    """
    filled = []  # [(module, what it was)]

    def fill(name):
        exercise = import_module(f"{PACKAGE}.{name}")
        filled.append((exercise, {**vars(exercise)}))
        checks.fill_in(exercise)
        exercise.main = MAINS[name]
        return exercise

    yield fill
    for exercise, before in filled:
        vars(exercise).update(before)


@pytest.fixture
def line(capsys):
    """line(exercise): the last line of what its check prints, if all is right."""

    def last(exercise):
        assert checks.verdict(CHECKS[Path(exercise.__file__).stem], exercise) == 0
        return capsys.readouterr().out.splitlines()[-1]

    return last


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_answer_is_off_by_a_share_of_the_largest_right_number_whatever_its_sign(sign):
    assert checks.off_by(sign * np.array([2.0, -0.5]), sign * np.array([4.0, -1.0])) == 0.5
    assert checks.off_by(sign * 3.0, sign * 4.0) == 0.25


@pytest.mark.parametrize("name", CHECKS)
def test_the_answers_are_right_and_the_last_line_says_what_is_solved(name, solved, line):
    last = line(solved(name))
    said, what, figure, code = last.split()
    assert (said, what) == ("solved", name)
    assert float(figure) > 0.0 and len(bytes.fromhex(code)) == 4
    (wanted,) = re.findall('grep -rhoE "([^"]+)"', PLAN)  # how a teacher collects it
    assert re.fullmatch(wanted, last) and PLAN.count(f"`solved {name} ") == PLAN.count(last)


@pytest.mark.parametrize(("name", "blank", "answer"), RIGHT)
def test_everybody_who_is_right_has_the_same_line(name, blank, answer, solved, monkeypatch, line):
    exercise = solved(name)
    usual = line(exercise)
    monkeypatch.setattr(exercise, blank, answer)
    assert line(exercise) == usual


def test_under_a_drag_of_ones_own_the_solution_is_right_and_the_line_another(
    solved, monkeypatch, line
):
    exercise = solved("ex2_solve")
    usual = line(exercise)
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY - v)
    assert line(exercise) != usual


def test_an_integrator_of_ones_own_changes_no_exercise(solved, monkeypatch, line):
    exercise = solved("ex4_cliff")
    usual = line(exercise)
    monkeypatch.setitem(c.INTEGRATORS, "mine", lambda q, v, m, force, dt: (q, v))
    monkeypatch.setattr(exercise, "main", MAINS["ex4_cliff"].__wrapped__)
    assert line(exercise) == usual


def test_the_teachers_plan_is_ninety_minutes_of_figures_and_exercises_that_there_are():
    chapter = (FOLDER / "README.md").read_text(encoding="utf-8")
    begins = [int(minute) for minute in re.findall(r"^\*\*Minute (\d+):", PLAN, re.M)]
    assert begins == list(range(0, 90, 10))
    addresses = re.findall(r"chapter\.html#figure=(\w+)", PLAN)
    assert {*addresses} <= {*re.findall(r"\(pictures/(\w+)\.svg\)", chapter)}
    rows = {row[0]: row[2] for row in re.findall(r"^\| (\d)( [^|]+)\| (\d+) \|", PLAN, re.M)}
    assert len(rows) == len(NAMES)
    for name in NAMES:
        about = import_module(f"{PACKAGE}.{name}").__doc__
        assert f"({rows[name[2]]} minutes)" in about


@pytest.mark.parametrize(("name", "blank", "mistake"), MISTAKES)
def test_a_mistake_is_wrong_by_so_much_and_has_a_hint(
    name, blank, mistake, solved, monkeypatch, capsys
):
    exercise = solved(name)
    monkeypatch.setattr(exercise, blank, mistake)
    assert checks.verdict(CHECKS[name], exercise) == 1
    *_, wrong, hint = capsys.readouterr().out.splitlines()
    assert wrong.startswith("wrong: ") and (": off by " in wrong or ": not " in wrong)
    assert hint.startswith("hint: ")
