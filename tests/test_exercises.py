"""The exercises: solved they pass, unedited they ask, and a wrong answer is told of."""

import difflib
import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import constraints as c
from curriculum.ch3_4_constraints.exercises import Blank, test_answers
from curriculum.ch3_4_constraints.studies import figures
from curriculum.ch3_4_constraints.studies._runs import run

import pytest

HERE = Path(test_answers.__file__).parent
CHECKS, judge = test_answers.CHECKS, test_answers.test_answer
LISTED = [
    "git",
    "ls-files",
    "--modified",
    "--",
    "ex*.py",
    "my_linkage.json",
]  # nothing where there is no repository
EDITED = shutil.which("git") and subprocess.run(LISTED, cwd=HERE, capture_output=True).stdout
unedited = pytest.mark.skipif(bool(EDITED), reason="somebody is at work on the exercises")


@pytest.fixture
def load(tmp_path, monkeypatch):
    """load(name, right, wrong) -> a solution, put in place of its exercise for a test, with `wrong`
    for `right`."""

    def load(name, right="", wrong=""):
        path = HERE / f"solutions/{name}.py"
        source = path.read_text(encoding="utf-8")
        assert right in source
        module = ModuleType(f"{test_answers.FOLDER}.solutions.{name}")
        module.__file__ = str(path)
        exec(compile(source.replace(right, wrong) if right else source, path, "exec"), vars(module))
        if hasattr(module, "NOTE"):
            module.NOTE = tmp_path / "outputs/note.json"
        monkeypatch.setitem(sys.modules, f"{test_answers.FOLDER}.{name}", module)
        return module

    return load


TEXT = (HERE / "solutions/README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", CHECKS)
def test_a_solution_passes_and_prints_what_its_text_says(name, load, capsys):
    solution = load(name)
    solution.main()
    judge(name)
    printed = capsys.readouterr().out
    blocks = {block["command"]: block["body"] for block in figures.BLOCK.finditer(TEXT)}
    assert blocks[f"python -m {solution.__name__}"] == printed


@pytest.mark.parametrize("name", CHECKS)
@unedited
def test_a_solution_is_its_exercise_but_for_the_blanks(name):
    exercise, solution = (
        (HERE / f"{folder}{name}.py").read_text().splitlines() for folder in ("", "solutions/")
    )
    changes = [
        tag
        for tag in difflib.SequenceMatcher(None, exercise, solution, False).get_opcodes()
        if tag[0] != "equal"
    ]
    changed = [line for _, first, last, *_ in changes for line in exercise[first:last]]
    assert all("blank" in line or f"exercises.{name}" in line for line in changed)
    assert any("blank(" in line for line in changed)


@unedited
def test_an_unedited_exercise_is_skipped_with_what_to_do():
    """By the command that the text gives; and the scripts themselves say the same."""
    asked = []
    for name, check in CHECKS.items():
        with pytest.raises(Blank) as blank:
            check(importlib.import_module(f"{test_answers.FOLDER}.{name}"))
        asked.append(str(blank.value))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", HERE.relative_to(c.HERE)]
    done = subprocess.run(command, cwd=c.HERE, capture_output=True, text=True)
    assert done.returncode == 0 and f"{len(CHECKS)} skipped" in done.stdout
    assert [line for line in done.stdout.splitlines() if line.startswith("to do: ")] == [
        f"to do: {x}" for x in asked
    ]
    assert f"\n{asked[0]}\n" in (HERE / "README.md").read_text(encoding="utf-8")
    script = subprocess.run(
        [sys.executable, "-m", f"{test_answers.FOLDER}.ex1_drift"], cwd=c.HERE, capture_output=True
    )
    assert (
        script.returncode == 0 and script.stdout.decode().strip() == asked[0] and not script.stderr
    )


WRONG = [
    ("ex1_drift", '"rod": "grows"', '"rod": "stays"', "rod: not"),
    ("ex1_drift", "15.9", "4", "factor: not"),
    ("ex1_drift", '"heavy": "the same"', '"heavy": "larger"', "heavy: not"),
    ("ex1_drift", "0.5 * dt**2", "dt**2", "expected_g"),
    ("ex2_solve", "rate @ rate", "0.0", "a chain of 1, w 0"),
    ("ex2_solve", "-2.0 * w", "-w", "w 20 rad/s"),
    ("ex2_solve", "- w**2 * g", "+ w**2 * g", "w 20 rad/s"),
    ("ex3_chaos", "a.tobytes() == b.tobytes()", "np.allclose(a, b)", "last bit"),
    ("ex3_chaos", "gap > 1.0", "gap > 0.0", "parted"),
    ("ex3_chaos", "else math.inf", "else 0.0", "never"),
    ("ex3_chaos", "34.4", "26.9", "1e-12: not"),
    ("ex3_chaos", "60.0", "34.4e12", "1e-24: not"),
    ("ex4_cliff", "(middle, high) if", "(low, middle) if not", "bisect"),
    ("ex4_cliff", "0.5 * (low + high)", "0.95 * low + 0.05 * high", "calls"),
    ("ex4_cliff", "-2.0 * z * v", "-z * v", "step_matrix"),
    ("ex5_linkage", 'return "impulse"', 'return "baumgarte"', "mm off"),
    ("ex5_linkage", 'return "impulse"', 'return "project"', "solves more"),
    ("ex5_linkage", '"loses": "baumgarte"', '"loses": "none"', "the remedies are"),
    ("ex5_linkage", '"loses": "baumgarte"', '"loses": "project"', "it does hold"),
    ("ex5_linkage", '"holds": "impulse"', '"holds": "soft"', "it does not hold"),
]


@pytest.mark.parametrize(
    ("name", "right", "wrong", "says"), WRONG, ids=[f"{row[0]}: {row[2]}" for row in WRONG]
)
def test_a_wrong_answer_fails_and_is_told_where(name, right, wrong, says, load, capsys):
    solution = load(name, right, wrong)
    if hasattr(solution, "NOTE"):
        solution.main()
    with pytest.raises(pytest.fail.Exception, match=says):
        judge(name)


def test_a_prediction_counts_only_if_it_was_written_down_before_the_run(load, capsys):
    """A wrong one counts; none, or one that was changed afterwards, does not."""
    guess = load("ex1_drift", '"factor": 16,', '"factor": 2,')
    with pytest.raises(pytest.skip.Exception, match="run it"):
        judge("ex1_drift")
    guess.main()
    judge("ex1_drift")
    load("ex1_drift").main()
    with pytest.raises(pytest.fail.Exception, match="before the run you wrote down"):
        judge("ex1_drift")


def test_a_linkage_is_a_scene_ones_own_and_has_a_loop(load, tmp_path):
    solution = load("ex5_linkage")
    solution.SCENE = test_answers.SCENES / "windows.json"
    with pytest.raises(pytest.fail.Exception, match="make your own"):
        judge("ex5_linkage")
    scene = json.loads((HERE / "solutions/my_linkage.json").read_text(encoding="utf-8"))
    solution.SCENE = tmp_path / "open.json"
    solution.SCENE.write_text(json.dumps(scene | {"rods": scene["rods"][:2]}), encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match="close no loop"):
        judge("ex5_linkage")
    solution.SCENE.write_text(json.dumps(scene | {"rods": []}), encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match="rods is"):
        judge("ex5_linkage")


def test_the_numbers_in_the_answers_are_those_of_the_runs(load):
    """Those that no script prints, as they are written there."""
    pendulum, double = c.build_system("pendulum"), c.build_system("double")
    no_turn = run(pendulum, hold=c.Hold(0.0, 0.0, 0.0, 0.0, None, None)).violations
    said = [
        f"{-c.rod_errors(pendulum, run(pendulum, 'rk4').q[-1])[0]:.1e} m shorter",
        f"is {no_turn[100]:.1f} m off after half a second and {no_turn[-1]:.0f} m after 20",
    ]
    tips = [double | {"m": double["m"] * [[1.0], [ratio]]} for ratio in (10.0, 1.0, 0.1)]
    said += [f"{run(system).violations[-1]:.3f} m" for system in tips]
    weak, weight = load("ex2_solve", "rate @ rate", "0.0"), double["m"] * c.GRAVITY
    ran = c.simulate(
        c.rk4_step,
        double,
        lambda q, v: weight + weak.rod_force(double, q, v, weight, 20.0),
        0.005,
        1000,
    )
    said.append(f"stretched by {ran.violations.max():.1f} m")
    chaos = load("ex3_chaos")
    chaos.DT, chaos.STEPS = 0.5 * chaos.DT, 2 * chaos.STEPS
    gaps = [chaos.tip(double) - chaos.tip(chaos.turned(double, angle)) for angle in (1e-3, 1e-12)]
    first, last = (chaos.parted(c.dot(gap, gap) ** 0.5, chaos.DT) for gap in gaps)
    said.append(f"the first line stays, {first:.1f} s, and the last becomes {last:.1f} s")
    assert [words for words in said if words not in " ".join(TEXT.split())] == []


def test_what_the_answers_say_of_cliffs_is_so(load):
    holds = {
        ("semi_implicit", 165.0): True,
        ("semi_implicit", 166.0): False,
        ("rk4", 460.0): True,
        ("rk4", 480.0): False,
    }
    holds |= {("euler", w): False for w in (5.0, 20.0, 100.0, 390.0)}
    double = c.build_system("double")
    assert {(rule, w): not run(double, rule, w).stopped for rule, w in holds} == holds
    impulse = load("ex4_cliff", "-2.0 * z * v - z**2 * x", "-z * v - z**2 * x")
    assert impulse.step_matrix("semi_implicit", 1.0).tolist() == [[0.0, 0.0], [-1.0, 0.0]]
    assert impulse.step_matrix("euler", 1.0).tolist() == [[1.0, 1.0], [-1.0, 0.0]]
    linkage = load("ex5_linkage")
    fast = c.build_system(str(linkage.SCENE))
    fast["v0"] = 3.0 * fast["v0"]
    assert [mode for mode in c.hold_table() if linkage.worst(fast, mode) <= linkage.SHARE] == [
        "project"
    ]


@unedited
def test_every_mode_holds_the_scene_that_exercise_5_starts_from(load):
    exercise = load("ex5_linkage")
    start = c.build_system(str(HERE / exercise.SCENE.name))
    assert all(exercise.worst(start, mode) <= exercise.SHARE for mode in c.hold_table())
