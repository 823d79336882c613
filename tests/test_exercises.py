"""The exercises: solved they pass, unedited they ask, and a wrong answer is told of."""

import json
import runpy
import shutil
import signal
import subprocess
from pathlib import Path
from types import ModuleType

import constraints as c
from curriculum.ch3_4_constraints.exercises import Blank, Wrong, solutions, test_answers, write_down
from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.ch3_4_constraints.studies import figures
from curriculum.ch3_4_constraints.studies._runs import run

import pytest

HERE = Path(test_answers.__file__).parent
CHECKS, FOLDER = test_answers.CHECKS, test_answers.FOLDER
ONE, TWO, THREE, FOUR, FIVE = CHECKS
LISTED = ["git", "ls-files", "--modified", "--", "ex*.py", "my_linkage.json"]
EDITED = shutil.which("git") and subprocess.run(LISTED, cwd=HERE, capture_output=True).stdout
TEXT = (HERE / "solutions/README.md").read_text(encoding="utf-8")


@pytest.fixture
def load(tmp_path):
    """load(name, right, wrong) -> an exercise solved, with `wrong` for `right` in its solution."""

    def of(name, right="", wrong=""):
        source = (HERE / f"solutions/{name}.py").read_text(encoding="utf-8")
        assert right in source
        answers = ModuleType(name)
        answers.__file__ = str(HERE / f"solutions/{name}.py")
        exec(source.replace(right, wrong) if right else source, vars(answers))
        exercise = solutions.solve(name, vars(answers))
        exercise.NOTE = tmp_path / "outputs/note.json"
        if hasattr(exercise, "predict"):
            write_down(exercise.NOTE, exercise.predict(), {})
        return exercise

    return of


@pytest.fixture
def script(monkeypatch, capsys):
    """script(name or function): the exit status of a script, and the text that it printed."""
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # these are the tests' own

    def of(what, *arguments):
        with pytest.raises(SystemExit) as end:
            what(*arguments) if callable(what) else runpy.run_path(what, run_name="__main__")
        print(repr(end.value.code)[-3000:], file=__import__("sys").__stderr__)
        return end.value.code, capsys.readouterr().out

    return of


@pytest.mark.parametrize("name", CHECKS)
def test_a_solution_passes_and_prints_what_its_text_says(name, script):
    blocks = {block["command"]: block["body"] for block in figures.BLOCK.finditer(TEXT)}
    status, printed = script(HERE / f"solutions/{name}.py")
    assert printed == blocks[f"python -m {FOLDER}.solutions.{name}"]
    assert status == 0 and f"{name}.py: solved" in printed


@pytest.mark.skipif(bool(EDITED), reason="somebody is at work on the exercises")
def test_an_unedited_exercise_is_skipped_with_what_to_do(python, script):
    """By the command that the text gives; and the scripts themselves end by saying the same."""
    done = python("-m", "pytest", "-p", "no:cacheprovider", HERE)
    asked = [line.partition("to do: ")[2] for line in done.stdout.splitlines() if "to do: " in line]
    assert done.returncode == 0 and len(asked) == len(CHECKS)
    assert f"\n{asked[0]}\n" in (HERE / "README.md").read_text(encoding="utf-8")
    for name in (ONE, FIVE):
        status, printed = script(HERE / f"{name}.py")
        assert (status, printed.splitlines()[-1]) == (0, asked[[*CHECKS].index(name)])


WRONG = [
    (ONE, '"rod": "grows", "factor": 15.9', '"rod": "stays", "factor": 15.9', "rod: not"),
    (ONE, "15.9", "4", "factor: not"),
    (ONE, "0.5 * dt**2", "dt**2", "expected_g"),
    (ONE, '"why": why', '"why": "It grows."', "why: "),
    (TWO, "rate @ rate", "0.0", "right at rest, wrong in motion"),
    (TWO, "rate @ rate", "2.1 * (rate @ rate)", "turning: a chain of 1 in motion, w 0"),
    (TWO, "jac * inverse_m", "jac * 1.1", "mobility: a chain of 1 at rest"),
    (TWO, "-2.0 * w", "-w", "half the damping"),
    (TWO, "- w**2 * g", "- 1.1 * w**2 * g", "wanted: a chain of 1 in motion, w 20"),
    (THREE, "a.tobytes() == b.tobytes()", "np.allclose(a, b)", "last bit"),
    (THREE, "gap > 1.0", "gap > 0.0", "parted"),
    (THREE, "else math.inf", "else 0.0", "never"),
    (THREE, "34.4", "26.9", "1e-12: not"),
    (FOUR, "(middle, high) if", "(low, middle) if not", "bisect"),
    (FOUR, "0.5 * (low + high)", "0.95 * low + 0.05 * high", "calls"),
    (FOUR, "-z * v", "-2.0 * z * v", "step_matrix: of euler"),
    (FOUR, "1.0)]).T", "1.0)])", "it is transposed"),
    (FIVE, 'return "impulse"', 'return "baumgarte"', "mm off"),
    (FIVE, 'return "impulse"', 'return "project"', "solves more"),
    (FIVE, '"loses": "baumgarte"', '"loses": "project"', "it does hold"),
    (FIVE, '"holds": "impulse"', '"holds": "soft"', "it does not hold"),
]


@pytest.mark.parametrize(("name", "right", "wrong", "says"), WRONG)
def test_a_wrong_answer_is_told_of(name, right, wrong, says, load):
    with pytest.raises(Wrong, match=says):
        CHECKS[name](load(name, right, wrong))


def test_a_guess_counts_only_as_it_was_written_down_before_the_run(load):
    """A wrong one counts; none, or one that was changed afterwards, does not."""
    CHECKS[ONE](load(ONE, '"factor": 16,', '"factor": 2,'))
    changed = load(ONE)
    with pytest.raises(Wrong, match="before the run you wrote down"):
        CHECKS[ONE](changed)
    changed.NOTE.write_text("")  # as a full disk leaves it: written again
    assert write_down(changed.NOTE, changed.predict(), {}) == changed.predict()
    CHECKS[ONE](changed)
    changed.NOTE.unlink()
    with pytest.raises(Blank, match="run it"):
        CHECKS[ONE](changed)
    with pytest.raises(Wrong, match="a number is wanted"):
        write_down(changed.NOTE, {"factor": "16"}, {"factor": None})


def test_a_linkage_is_a_scene_ones_own_and_has_a_loop(load, script, tmp_path):
    solution, scene = load(FIVE), json.loads((HERE / "solutions/my_linkage.json").read_text())
    windows = json.loads((test_answers.SCENES / "windows.json").read_text())
    solution.SCENE = tmp_path / "mine.json"
    for content, error, says in (
        (windows, Wrong, "make your own"),
        (scene | {"rods": scene["rods"][:2]}, Wrong, "close no loop"),
        (scene | {"rods": []}, SceneError, "rods is"),
    ):
        solution.SCENE.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises(error, match=says):
            CHECKS[FIVE](solution)
    status, said = script(solution.run, solution.main)
    assert status == 1 and "rods is" in said.splitlines()[-1]


def test_the_numbers_in_the_answers_are_those_of_the_runs(load):
    """Those that no script prints, as they are written there."""
    pendulum, double = c.build_system("pendulum"), c.build_system("double")
    no_turn = run(pendulum, hold=c.hold_table()["none"]._replace(use_jdotv=0.0)).violations
    said = [f"{-c.rod_errors(pendulum, run(pendulum, 'rk4').q[-1])[0]:.1e} m shorter"]
    said += [f"is {no_turn[100]:.1f} m off after half a second and {no_turn[-1]:.0f} m after 20"]
    tips = [double | {"m": double["m"] * [[1.0], [ratio]]} for ratio in (10.0, 1.0, 0.1)]
    said += [f"{run(system).violations[-1]:.3f} m" for system in tips]
    weak, w = load(TWO, "rate @ rate", "0.0"), double["m"] * c.GRAVITY

    def force(q, v):
        return w + weak.rod_force(double, q, v, w, 20.0)

    worst = c.simulate(c.rk4_step, double, force, 0.005, 1000).violations.max()
    chaos = load(THREE)
    chaos.DT, chaos.STEPS = 0.5 * chaos.DT, 2 * chaos.STEPS
    others = c.build_system("double", 1), *(chaos.turned(double, a) for a in (1e-3, 1e-12))
    gaps = [chaos.tip(double) - chaos.tip(x) for x in others]
    times = [f"{chaos.parted(c.dot(gap, gap) ** 0.5, chaos.DT):.1f}" for gap in gaps]
    lines = "the first two lines stay, {} and {} s, and the last becomes {} s"
    said += [f"stretched by {worst:.1f} m", lines.format(*times)]
    assert [words for words in said if words not in " ".join(TEXT.split())] == []


def test_what_the_answers_say_of_cliffs_and_of_linkages_is_so(load):
    holds = {("semi_implicit", 165.0): True, ("semi_implicit", 166.0): False}
    holds |= {("rk4", 460.0): True, ("rk4", 480.0): False}
    holds |= {("euler", w): False for w in (5.0, 20.0, 100.0, 390.0)}
    double = c.build_system("double")
    assert {(rule, w): not run(double, rule, w).stopped for rule, w in holds} == holds
    impulse = load(FOUR)  # its spring is x'' = -x' - x at dt 1: what z = 1 makes
    assert impulse.step_matrix("semi_implicit", 1.0).tolist() == [[0.0, 0.0], [-1.0, 0.0]]
    assert impulse.step_matrix("euler", 1.0).tolist() == [[1.0, 1.0], [-1.0, 0.0]]
    undamped = load(FOUR, "-z * v", "0.0 * v")
    edges = [undamped.decays(*x) for x in (("euler", 0.1), ("semi_implicit", 1.9), ("rk4", 2.8))]
    assert edges == [False, True, True] and not undamped.decays("semi_implicit", 2.1)
    linkage, start = load(FIVE), c.build_system(str(HERE / "my_linkage.json"))
    fast = c.build_system(str(linkage.SCENE))
    fast["v0"] = 3.0 * fast["v0"]
    held = [mode for mode in c.hold_table() if linkage.worst(fast, mode) <= linkage.SHARE]
    assert held == ["project"]
    if not EDITED:
        assert all(linkage.worst(start, mode) <= linkage.SHARE for mode in c.hold_table())
