"""The exercises: solved they pass, unedited they ask, and a wrong answer is told of."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import constraints as c
from curriculum.ch3_4_constraints.exercises import Wrong, checks, solved, write_down
from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.ch3_4_constraints.studies import figures
from curriculum.ch3_4_constraints.studies._runs import run

import pytest
from conftest import MISTAKES, python

HERE, FOLDER, CHECKS = Path(checks.__file__).parent, checks.__package__, checks.CHECKS
ONE, TWO, THREE, FOUR, FIVE = CHECKS
WRONG = [(name, *row) for name, rows in MISTAKES["exercises"].items() for row in rows]
LISTED = ["git", "ls-files", "--modified", "--", "ex*.py", "my_linkage.json"]
EDITED = shutil.which("git") and subprocess.run(LISTED, cwd=HERE, capture_output=True).stdout
TEXT = (HERE / "solutions/README.md").read_text(encoding="utf-8")


def load(name, right="\n", wrong="\n"):
    """An exercise solved, with `wrong` for what is right in its solution."""
    path, answers = HERE / f"solutions/{name}.py", ModuleType(name)
    source, answers.__file__ = path.read_text(encoding="utf-8"), str(path)
    assert right in source
    exec(compile(source.replace(right, wrong), path, "exec"), vars(answers))
    return solved(name, answers)


@pytest.mark.parametrize("name", CHECKS)
def test_a_solution_passes_and_prints_what_its_text_says(name):
    done = python("-m", f"{FOLDER}.{name}", "--solved", stderr=subprocess.STDOUT)
    blocks = {block["command"]: block["body"] for block in figures.BLOCK.finditer(TEXT)}
    assert done.returncode == 0 and f"{name}.py: solved" in done.stdout
    assert blocks[f"python -m {FOLDER}.{name} --solved"] == done.stdout


@pytest.mark.skipif(bool(EDITED), reason="somebody is at work on the exercises")
@pytest.mark.parametrize("name", CHECKS)
def test_an_unedited_exercise_ends_by_what_it_wants_next(name):
    done = python("-m", f"{FOLDER}.{name}")
    assert (done.returncode, done.stderr) == (0, "")
    assert re.fullmatch(rf"{name}\.py, line \d+: .{{20,}}", done.stdout.splitlines()[-1])


@pytest.mark.parametrize(("name", "right", "wrong", "says"), WRONG)
def test_a_wrong_answer_is_told_of(name, right, wrong, says):
    with pytest.raises(Wrong, match=says):
        CHECKS[name](load(name, right, wrong))


def test_a_guess_counts_only_as_it_was_written_down_before_the_run(tmp_path, capsys):
    """A wrong one counts; one that was changed afterwards does not."""
    note, wrong = tmp_path / "outputs/note.json", load(ONE, '"factor": 16,', '"factor": 2,')
    for _ in range(2):
        write_down(note, wrong.predict())
        assert capsys.readouterr().out.startswith("you wrote down {'rod': 'grows', 'factor': 2,")
    with pytest.raises(Wrong, match="before, you wrote down"):
        write_down(note, load(ONE).predict())


def test_a_linkage_is_a_scene_ones_own_and_has_a_loop(tmp_path):
    solution, scene = load(FIVE), json.loads((HERE / "solutions/my_linkage.json").read_text())
    solution.SCENE = tmp_path / "mine.json"
    for rods, error, says in ((2, Wrong, "close no loop"), (0, SceneError, "rods is")):
        solution.SCENE.write_text(json.dumps(scene | {"rods": scene["rods"][:rods]}), "utf-8")
        with pytest.raises(error, match=says):
            CHECKS[FIVE](solution)
    broken = python("-c", f"import {FOLDER}.{FIVE} as x; x.SCENE = 'no.json'; x.run(x.main)")
    assert (broken.returncode, broken.stdout.count("\n"), broken.stderr) == (1, 1, "")


def test_the_numbers_in_the_answers_are_those_of_the_runs(capsys):
    """Those that no script prints, as they are written there."""
    pendulum, double = c.build_system("pendulum"), c.build_system("double")
    shorter = -c.rod_errors(pendulum, run(pendulum, "rk4").q[-1])[0]
    said = [f"{shorter:.1e} m shorter"]
    tips = [double | {"m": double["m"] * [[1.0], [ratio]]} for ratio in (10.0, 1.0, 0.1)]
    said += [f"{run(system).violations[-1]:.3f} m" for system in tips]
    load(TWO, "rate @ rate", "0.0").main()
    worst = float(re.search("with weight .* ([^ ]+) m", capsys.readouterr().out)[1])
    chaos = load(THREE)
    chaos.DT, chaos.STEPS = 0.5 * chaos.DT, 2 * chaos.STEPS
    chaos.main()
    times = re.findall(r" ([\d.]+) s\n", capsys.readouterr().out)
    lines = "the first two lines stay, {0} and {1} s, and the last becomes {4} s"
    said += [f"stretched by {worst:g} m", lines.format(*times)]
    assert [words for words in said if words not in " ".join(TEXT.split())] == []


def test_what_the_answers_say_of_cliffs_and_of_linkages_is_so():
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
    linkage = load(FIVE)
    fast = c.build_system(str(linkage.SCENE))
    fast["v0"] = 3.0 * fast["v0"]
    held = [mode for mode in c.hold_table() if linkage.worst(fast, mode) <= linkage.SHARE]
    assert held == ["project"]
    start = c.build_system(str(HERE / "my_linkage.json"))
    if not EDITED:
        assert all(linkage.worst(start, mode) <= linkage.SHARE for mode in c.hold_table())
