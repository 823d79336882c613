"""Exercises: answers are right, mistakes are not, and a blank says where it is."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import python

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step

PACKAGE = "curriculum.ch3_4_constraints.exercises"
NAMES = sorted(path.stem for path in Path(checks.__file__).parent.glob("ex*.py"))
CHECKS = {name: getattr(checks, name.partition("_")[2]) for name in NAMES}
MISTAKES = [
    ("ex1_drift", "guess", lambda: {"rod": "grows", "factor": 16}),
    ("ex1_drift", "guess", lambda: {"rod": "shrinks", "factor": 4}),
    ("ex1_drift", "expected_g", lambda speeds, dt: 0.5 * dt**2 * np.sum(speeds[:-1] ** 2)),
    ("ex1_drift", "expected_g", lambda speeds, dt: [0.5 * dt**2 * np.sum(speeds**2)] * 2),
    ("ex2_solve", "jdotv", lambda d, d_dot: d @ d_dot),
    ("ex2_solve", "target", lambda g, gdot, w: -w * gdot - w**2 * g),
    ("ex3_chaos", "guess", lambda: {1e-12: 27.2, 1e-24: 60.0}),
    ("ex3_chaos", "guess", lambda: {1e-12: 34.4, 1e-24: 120.0}),
    ("ex4_cliff", "guess", lambda: ["semi_implicit", "euler"]),
    ("ex4_cliff", "guess", lambda: "semi_implicit"),
    ("ex4_cliff", "step_matrix", lambda step_fn, z: np.array([[0.0, 1.0], [-(z**2), -z]])),
    ("ex5_xpbd", "substep", lambda system, q, v, h: (xpbd_step(system, q, v, h)[0], v)),
    ("ex5_xpbd", "substep", lambda system, q, v, h: xpbd_step(system, q + h * v, v, h)),
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


@pytest.fixture
def solved(monkeypatch):
    """solved(name): the module of an exercise, with the answers in place of its blanks."""

    def fill(name):
        exercise = import_module(f"{PACKAGE}.{name}")
        for key, answer in vars(import_module(f"{PACKAGE}.solutions.{name}")).items():
            if key[0] != "_":
                monkeypatch.setattr(exercise, key, answer, raising=False)
        return exercise

    return fill


@pytest.mark.parametrize("name", CHECKS)
def test_the_answers_are_right(name, solved, capsys):
    assert checks.verdict(CHECKS[name], solved(name)) == 0
    assert capsys.readouterr().out.endswith("\nsolved\n")


def test_a_launch_angle_that_is_higher_is_higher():
    level = c.build_system("pendulum") | {"q0": np.array([[1.0, 0.0, 0.0]])}
    turned = import_module(f"{PACKAGE}.ex3_chaos").turned(level, 0.5)
    assert np.allclose(turned["q0"], [[np.cos(0.5), np.sin(0.5), 0.0]])


def test_a_solution_is_right_under_a_drag_of_ones_own(solved, monkeypatch, capsys):
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * c.GRAVITY - v)
    assert checks.verdict(checks.solve, solved("ex2_solve")) == 0
    assert capsys.readouterr().out.endswith("\nsolved\n")


def test_xpbd_keeps_the_length_of_a_free_rod_and_the_momentum_of_its_ends():
    chain = checks.random_chain(np.random.default_rng(0), 2)
    m = chain["m"]
    rod = chain | {"pairs": [(1, 0)], "lengths": chain["lengths"][1:]}
    q, v = xpbd_step(rod, rod["q0"], rod["v0"], 0.01)
    assert np.allclose(c.rod_lengths(rod, q), rod["lengths"], rtol=1e-14)
    assert np.allclose(np.sum(m * v, axis=0), np.sum(m * (rod["v0"] + 0.01 * c.GRAVITY), axis=0))


def test_sub_steps_of_xpbd_are_so_many_short_steps():
    chain = checks.random_chain(np.random.default_rng(0), 3)
    q = chain["q0"]
    v = chain["v0"]
    at_once = xpbd_step(chain, q, v, 0.03, substeps=3)
    for _ in range(3):
        q, v = xpbd_step(chain, q, v, 0.01)
    assert np.allclose(at_once, (q, v), rtol=0.0, atol=1e-12)


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
