"""Texts and exercises: what is said is so, what is pointed to is there, answers are judged."""

import ast
import importlib
import json
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from functools import cache, partial
from pathlib import Path
from types import ModuleType

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.exercises.checks import Blank, Wrong, first_guess, solved
from curriculum.ch3_4_constraints.studies import __main__ as studies
from curriculum.ch3_4_constraints.studies import figures, hard_cases, shown
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.ch3_4_constraints.systems import SceneError

import numpy as np
import pytest
from conftest import MISTAKES, complaint

CODE = re.compile(r"^```.*?^```$", re.S | re.M)
TEXTS = {x.relative_to(figures.ROOT).as_posix(): x.read_text("utf-8") for x in figures.TEXTS}
BLOCKS = {b["command"]: b for text in TEXTS.values() for b in figures.BLOCK.finditer(text)}
LISTINGS = [x for x, block in BLOCKS.items() if block["kind"] == "listing of"]
SHOWN = "python -m curriculum.ch3_4_constraints.studies shown"
SOLVED = [x for x in BLOCKS if x.endswith(" --solved")]
HERE = [x for x in BLOCKS if x.startswith(("python constraints.py", SHOWN))] + SOLVED
HERE.remove(f"{SHOWN} hour")  # it takes minutes, as what is not compared at all: figures.py
COMPARED = [BLOCKS[x]["body"] for x in HERE]


@pytest.mark.parametrize("command", HERE)
def test_a_figure_in_a_text_is_what_its_command_prints(command, tmp_path, monkeypatch, capsys):
    _, *words = shlex.split(command)
    if words[0] != "-m":
        c.main([*words[1:], "--no-rerun", "--no-page", "--no-picture", "--out", str(tmp_path)])
    elif words[1] == studies.__package__:
        studies.main(words[2:])
    else:
        monkeypatch.setattr(sys, "argv", words[1:])
        monkeypatch.setattr(checks, "run_script", lambda main: main())
        monkeypatch.delitem(sys.modules, words[1], raising=False)
        runpy.run_module(words[1], run_name="__main__", alter_sys=True)
    printed = figures.machine_free(capsys.readouterr().out.strip("\n"))
    assert printed == figures.machine_free(BLOCKS[command]["body"])


@pytest.mark.parametrize("command", LISTINGS)
def test_a_listing_in_a_text_is_the_code_that_runs(command):
    assert BLOCKS[command]["body"] == figures.listed(command)


def test_the_sign_of_an_error_by_hand_is_the_sign_found_and_its_rule_is_named():
    """Under semi_implicit a spinning rod is too short by dt d'.d' / w, under euler too long."""
    for _, rule, _, by_hand, found in shown.by_hand():
        assert rule in c.INTEGRATORS and found == pytest.approx(by_hand, rel=0.03)
    rows = {rule: (g, size) for rule, g, size, _ in shown.turning()}
    assert rows["semi_implicit"][0] == pytest.approx(-rows["semi_implicit"][1], rel=1e-6)
    assert rows["euler"][0] == pytest.approx(rows["euler"][1], rel=0.01)
    assert abs(rows["rk4"][0]) < 1e-6 * rows["rk4"][1]
    system = c.build_system("double")
    states = run(system, hold="baumgarte", keep=range(0, 4001, 10)).q
    off = np.array([c.rod_errors(system, q) for q in states])
    assert off.min() < -0.02 and off.max() < 1e-5


def test_the_lines_for_a_notebook_run_and_a_clock_tells_the_time(monkeypatch):
    section = TEXTS["README.md"].partition("## In a notebook")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```python\n(.*?)^```$", section, re.S | re.M)
    monkeypatch.setattr(c, "external_force", c.external_force)  # which they change
    space, own = {}, 0
    for lines in blocks:
        exec(lines, space)
        if "q_before" in lines:  # the loop of one's own
            own += np.array_equal(space["violations"], space["run"].violations)
    assert own == 1
    assert space["run"].q[-1][0] == pytest.approx([10.0, 0.0, 0.0], abs=1e-9)
    assert len(space["run"].tip) == 2001 and space["run"].violations.max() < 1e-5


def test_figures_goes_on_after_a_failure_and_odd_words_are_refused(tmp_path, monkeypatch, capsys):
    block = "<!-- printed by: {0} -->\n```text\n$ {0}\n{1}\n```\n"
    lost = "<!-- listing of: page.md f -->\n```python\nold\n```\n"
    page, fails, works = tmp_path / "page.md", "python -c raise", "python -c print(1)"
    page.write_text(lost + block.format(fails, "old") + block.format(works, "old"))
    monkeypatch.setattr(figures, "TEXTS", [page])
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    assert figures.main([]) == 1
    capsys.readouterr()
    assert page.read_text() == lost + block.format(fails, "old") + block.format(works, "1")
    assert "no block of a text" in complaint(capsys, "--only", "zzz", main=figures.main)
    assert "none contains 'zzz'" in complaint(capsys, "--methods", "zzz", main=hard_cases.main)


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_has_figures_and_points_to_what_is_there(name):
    blocks = list(figures.BLOCK.finditer(TEXTS[name]))
    assert blocks  # and a command that is shown is the one that was run:
    assert all(block["prompt"] in (None, f"$ {block['command']}\n") for block in blocks)
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", CODE.sub("", TEXTS[name])):
        target, _, heading = link.partition("#")
        path = figures.ROOT / name if not target else (figures.ROOT / name).parent / target
        assert path.exists(), link
        titles = re.findall(r"^#+ (.*)$", path.read_text("utf-8"), re.M) if heading else []
        anchors = [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]
        assert not heading or heading in anchors, link
    names = re.findall(r"`(?:([a-z]\w*)\(\)|([A-Z_]{4,}))`", TEXTS[f"{c.CHAPTER}/README.md"])
    assert len(names) > 10 and all(hasattr(c, a or b) for a, b in names)


@pytest.mark.parametrize("name", [name for name in TEXTS if "solutions" not in name])
def test_a_decimal_in_prose_stands_in_a_table_of_its_section(name):
    """To its digits, as it is or in cm, mm or per cent; tests compare these tables."""
    given = {"3.11", "3.10", "4.0", "3.3", "3.4", "0.6"}  # Python, MuJoCo, chapters; on paper
    decimal, number = r"(?<![\w.])\d+\.\d+", r"\d+\.?\d*(?:e[-+]\d+)?"
    for section in re.split(r"^(?=## )", TEXTS[name], flags=re.M):
        tables = "\n".join(body for body in COMPARED if body in section)
        printed = [float(x) for x in re.findall(number, tables)]
        prose = re.sub(r"`[^`]*`|^    .*$", "", CODE.sub("", section), flags=re.M)
        for said in set(re.findall(decimal, prose)) - given:
            digits = len(said.partition(".")[2])
            as_said = {f"{scale * x:.{digits}f}" for x in printed for scale in (1.0, 100.0, 1000.0)}
            assert said in as_said, f"{said}: {section.splitlines()[0]}"


# --- exercises ---
FOLDER, PACKAGE, CHECKS = Path(checks.__file__).parent, checks.__package__, checks.CHECKS
ONE, TWO, THREE, FOUR, FIVE = CHECKS
WRONG = [(name, *row) for name, rows in MISTAKES["exercises"].items() for row in rows]
SHAPES = [(name, *row) for name, rows in MISTAKES["shapes"].items() for row in rows]
LISTED = ["git", "ls-files", "--modified", "--", "ex*.py", "my_linkage.json"]
EDITED = shutil.which("git") and subprocess.run(LISTED, cwd=FOLDER, capture_output=True).stdout
unedited = pytest.mark.skipif(bool(EDITED), reason="somebody is at work on the exercises")


def load(name, right="\n", wrong="\n"):
    """An exercise solved, with `wrong` for what is right in its solution."""
    path, answers = FOLDER / f"solutions/{name}.py", ModuleType(name)
    source, answers.__file__ = path.read_text(encoding="utf-8"), str(path)
    assert right in source
    exec(compile(source.replace(right, wrong), path, "exec"), vars(answers))
    return solved(importlib.reload(importlib.import_module(f"{PACKAGE}.{name}")), answers)


@cache
def shown_by(name):
    """What the main of an exercise shows with right answers; of an experiment 9 steps will do."""
    exercise = load(name)
    if name == FOUR:
        exercise.STEPS = 9
    return exercise.main() if name != TWO else None  # of whose run nothing is judged


@pytest.mark.parametrize(("name", "right", "wrong", "says"), WRONG)
def test_a_wrong_answer_is_told_of(name, right, wrong, says):
    ran = shown_by(name)
    exercise = load(name, right, wrong)
    with pytest.raises(Wrong, match=says):
        checks.check_before_run(name, exercise)
        CHECKS[name](exercise, ran)


def test_a_guess_is_understood_as_it_is_written_and_counts_as_it_was_before_the_run(tmp_path):
    ran, exercise = shown_by(ONE), load(ONE)
    for guess in (("Grow", "16", "same"), (" grows ", 16.0, "The same")):
        answer = dict(zip(("rod", "factor", "heavy"), guess, strict=True))
        exercise.answer = answer.copy
        CHECKS[ONE](exercise, ran)
    for factor in (2, 16):  # a wrong guess counts, however right the one that stands there later
        assert first_guess(tmp_path / "note.json", {"factor": factor}) == {"factor": 2}
    for guess, noted in ((np.inf, np.inf), (np.int64(3), "3"), ({"later"}, "{'later'}")):
        (tmp_path / "note.json").unlink()
        assert first_guess(tmp_path / "note.json", {"rk4": guess}) == {"rk4": noted}


@unedited
@pytest.mark.parametrize("name", CHECKS)
def test_an_exercise_ends_by_the_next_blank_of_its_file(name, monkeypatch, capsys):
    tree, ended = ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8")), []
    monkeypatch.setattr(checks, "run_script", lambda main: ended.append(main()))
    monkeypatch.setattr(checks, "first_guess", lambda note, guess: guess)
    functions = [x for x in tree.body if isinstance(x, ast.FunctionDef)]
    functions = [x for x in functions if "blank(" in ast.unparse(x)]
    answers = dict(vars(load(name)))
    for k, function in enumerate(functions):
        exercise = importlib.reload(importlib.import_module(f"{PACKAGE}.{name}"))
        for filled in functions[:k]:
            setattr(exercise, filled.name, answers[filled.name])
        exercise.judge(exercise.main)
        *_, said = capsys.readouterr().out.splitlines()
        line = int(re.fullmatch(rf"{name}\.py, line (\d+): .{{20,}}", said)[1])
        assert ended.pop() == 0 and function.lineno < line <= function.end_lineno


@pytest.mark.parametrize(("name", "right", "wrong", "says"), SHAPES)
def test_an_answer_of_another_shape_is_told_of_before_a_run_stops_in_a_line_of_its_own(
    name, right, wrong, says, monkeypatch, capsys
):
    ended = []
    monkeypatch.setattr(checks, "run_script", lambda main: ended.append(main()))
    monkeypatch.setattr(checks, "first_guess", lambda note, guess: guess)
    exercise = load(name, right, wrong)
    exercise.judge(exercise.main)
    assert ended == [1] and capsys.readouterr().out.splitlines()[-1].startswith(says)


def test_a_linkage_is_ones_own_has_a_loop_and_tells_remedies_apart(tmp_path, monkeypatch, capsys):
    solution, scene = load(FIVE), (FOLDER / "solutions/my_linkage.json").read_text("utf-8")
    solution.SCENE, rods = tmp_path / "mine.json", json.loads(scene)["rods"]
    for changed, error, says in (
        ({"rods": rods[:2]}, Wrong, "close no loop"),
        ({"rods": []}, SceneError, "rods is"),
        (json.loads(scene.replace("[10.0,", "[0.5,")), Blank, "every remedy holds it"),
        (json.loads(scene.replace("[10.0,", "[1e5,")), Wrong, "no remedy holds it"),
    ):
        solution.SCENE.write_text(json.dumps(json.loads(scene) | changed), "utf-8")
        with pytest.raises(error, match=says):
            CHECKS[FIVE](solution, solution.main())
    ended, _ = [], capsys.readouterr()
    monkeypatch.setattr(checks, "run_script", lambda main: ended.append(main()))
    solution.SCENE = tmp_path / "no.json"
    solution.judge(solution.main)
    assert ended == [1] and capsys.readouterr().out.count("\n") == 1


def test_the_numbers_in_the_answers_are_those_of_the_runs(capsys):
    """Those that no script prints, as they are written there."""

    def shorter(system, rule):
        """How much, in m, its first rod is at the end."""
        return -c.rod_errors(system, run(system, rule).q[-1])[0]

    double, leg = c.build_system("double"), c.build_system("jansen_leg")
    hung = shown.bobs((0.0, -1.0), v=[(3.0, 0.0)])
    said = [f"{shorter(c.build_system('pendulum'), 'rk4'):.1e} m shorter"]
    said += [f"{shorter(hung, 'semi_implicit'):.3f} m too short"]
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
    for mode in ("baumgarte", "soft"):
        off = 1e3 * run(leg, hold=mode).violations
        said += [f"{off[:401].max():.1f} mm", f"{off.max():.1f} mm"]
    said += [f"{name} --solved" for name in CHECKS]
    solutions = " ".join((FOLDER / "solutions/README.md").read_text(encoding="utf-8").split())
    assert [words for words in said if words not in solutions] == []


def test_what_the_answers_say_of_cliffs_and_of_linkages_is_so():
    double = c.build_system("double")
    lost = ("semi_implicit", 166.0), ("euler", 5.0), ("euler", 390.0)
    assert all(run(double, *x).stopped for x in [*lost, ("rk4", 480.0), ("rk4", 500.0)])
    held = ("semi_implicit", 165.0), ("rk4", 460.0), ("rk4", 490.0)
    assert not any(run(double, *x).stopped for x in held)
    impulse = load(FOUR)  # its spring is gddot = -gdot - g at dt 1: what z = 1 makes
    assert impulse.step_matrix("semi_implicit", 1.0).tolist() == [[0.0, 0.0], [-1.0, 0.0]]
    assert impulse.step_matrix("euler", 1.0).tolist() == [[1.0, 1.0], [-1.0, 0.0]]
    free = load(FOUR, "-z * v", "0.0 * v")  # with no damping at all
    cliffs = [free.bisect(partial(free.decays, x), 0.01, 5.0, 1e-9) for x in c.STABILITY_LIMIT]
    assert cliffs == pytest.approx([0.01, 2.0, np.sqrt(8.0)])
    linkage = load(FIVE)
    start, fast = map(c.build_system, (str(FOLDER / "my_linkage.json"), str(linkage.SCENE)))
    fast["v0"] = 3.0 * fast["v0"]
    for system, holding in ((fast, ["project"]), (start, [*c.hold_table()])):
        held = [mode for mode in c.hold_table() if linkage.worst(system, mode) <= linkage.SHARE]
        assert held == holding or system is start and EDITED
