"""The exercises: solved they pass, unedited they ask, and a wrong answer is told of."""

import json
import shutil
import subprocess
import tomllib
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
WRONG = tomllib.loads(Path(__file__).with_name("wrong_answers.toml").read_text("utf-8"))
LISTED = ["git", "ls-files", "--modified", "--", "ex*.py", "my_linkage.json"]
EDITED = shutil.which("git") and subprocess.run(LISTED, cwd=HERE, capture_output=True).stdout
TEXT = (HERE / "solutions/README.md").read_text("utf-8")


@pytest.fixture
def load(tmp_path):
    """load(name, right, wrong) -> an exercise solved, with `wrong` for `right` in its solution."""

    def of(name, right="\n", wrong="\n"):
        path, answers = HERE / f"solutions/{name}.py", ModuleType(name)
        answers.__file__, source = str(path), path.read_text("utf-8")
        assert right in source
        exec(compile(source.replace(right, wrong), path, "exec"), vars(answers))
        exercise = solutions.solve(name, vars(answers))
        exercise.NOTE = tmp_path / "outputs/note.json"
        if hasattr(exercise, "predict"):
            write_down(exercise.NOTE, exercise.predict(), {})
        return exercise

    return of


@pytest.mark.parametrize("name", CHECKS)
def test_a_solution_passes_and_prints_what_its_text_says(name, python):
    done = python("-m", f"{FOLDER}.solutions.{name}")
    blocks = {block["command"]: block["body"] for block in figures.BLOCK.finditer(TEXT)}
    assert blocks[f"python -m {FOLDER}.solutions.{name}"] == done.stdout
    assert done.returncode == 0 and f"{name}.py: solved" in done.stdout


@pytest.mark.skipif(bool(EDITED), reason="somebody is at work on the exercises")
def test_an_unedited_exercise_is_skipped_with_what_to_do(python):
    """By the command that the text gives; and the scripts themselves end by saying the same."""
    done = python("-m", "pytest", "-p", "no:cacheprovider", HERE)
    asked = [line.partition("to do: ")[2] for line in done.stdout.splitlines() if "to do: " in line]
    assert done.returncode == 0 and len(asked) == len(CHECKS)
    assert f"\n{asked[0]}\n" in (HERE / "README.md").read_text("utf-8")
    for name, to_do in ((ONE, asked[0]), (FIVE, asked[-1])):
        ran = python("-m", f"{FOLDER}.{name}")
        assert (ran.returncode, ran.stdout.splitlines()[-1]) == (0, to_do)


@pytest.mark.parametrize(("name", "says"), [(name, says) for name in WRONG for says in WRONG[name]])
def test_a_wrong_answer_is_told_of(name, says, load):
    with pytest.raises(Wrong, match=says):
        CHECKS[name](load(name, *WRONG[name][says]))


def test_a_guess_counts_only_as_it_was_written_down_before_the_run(load):
    """A wrong one counts; none, or one that was changed afterwards, does not."""
    CHECKS[ONE](load(ONE, '"factor": 16,', '"factor": 2,'))
    changed = load(ONE)
    with pytest.raises(Wrong, match="before the run you wrote down"):
        CHECKS[ONE](changed)
    changed.NOTE.write_text("")  # as a full disk leaves it: written again
    changed.main()
    CHECKS[ONE](changed)
    changed.NOTE.unlink()
    with pytest.raises(Blank, match="run it"):
        CHECKS[ONE](changed)
    with pytest.raises(Wrong, match="a number is wanted"):
        write_down(changed.NOTE, {"factor": "16"}, {"factor": None})


def test_a_linkage_is_a_scene_ones_own_and_has_a_loop(load, python, tmp_path):
    solution, scene = load(FIVE), json.loads((HERE / "solutions/my_linkage.json").read_text())
    windows = json.loads((test_answers.SCENES / "windows.json").read_text())
    solution.SCENE = tmp_path / "mine.json"
    ends = [{"position": [0, 1, 0]}, {"position": [1, 0, 0], "velocity": [-0.5, 0, 0]}]
    shorter = scene | {"particles": ends, "rods": [{"pair": [0, -1]}, {"pair": [1, -1]}]}
    for content, says in (
        (windows, "make your own"),
        (scene | {"rods": scene["rods"][:2]}, "close no loop"),
        (scene | {"rods": []}, "rods is"),
        (shorter | {"anchors": [[0, 0, 0]]}, r"rods\[1\] is stretched at -0.5 m/s"),
    ):
        solution.SCENE.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises((Wrong, SceneError), match=says):
            CHECKS[FIVE](solution)
    broken = python("-c", f"import {FOLDER}.ex5_linkage as x; x.SCENE = 'no.json'; x.run(x.main)")
    assert broken.returncode == 1 and len(broken.stdout.splitlines()) == 1


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
    double, linkage = c.build_system("double"), load(FIVE)
    breaks = [("semi_implicit", 166.0), ("rk4", 480.0)]
    breaks += [("euler", w) for w in (5.0, 20.0, 100.0, 390.0)]
    assert all(run(double, *case).stopped for case in breaks)
    assert not any(
        run(double, *case).stopped for case in (("semi_implicit", 165.0), ("rk4", 460.0))
    )
    impulse = load(FOUR)  # its spring is x'' = -x' - x at dt 1: what z = 1 makes
    assert impulse.step_matrix("semi_implicit", 1.0).tolist() == [[0.0, 0.0], [-1.0, 0.0]]
    assert impulse.step_matrix("euler", 1.0).tolist() == [[1.0, 1.0], [-1.0, 0.0]]
    undamped = load(FOUR, "-z * v", "0.0 * v")
    edges = [undamped.decays(*x) for x in (("euler", 0.1), ("semi_implicit", 1.9), ("rk4", 2.8))]
    assert edges == [False, True, True] and not undamped.decays("semi_implicit", 2.1)
    fast, start = (c.build_system(str(x)) for x in (linkage.SCENE, HERE / "my_linkage.json"))
    fast["v0"] = 3.0 * fast["v0"]
    held = [mode for mode in c.hold_table() if linkage.worst(fast, mode) <= linkage.SHARE]
    assert held == ["project"]
    assert EDITED or all(linkage.worst(start, mode) <= linkage.SHARE for mode in c.hold_table())
