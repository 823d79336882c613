"""What a run leaves: table, metrics.json and files, whole or not at all, nobody else's touched."""

import json
import re
import shlex
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BARE, FILES, FORCE, STEP, UNIX, contents, edited, python
from independent import energy_off, incidence_and_rods, motion, smallest_pulls, weight
from machines import as_scene, at_random, row, thrown, torn

import constraints as c
from curriculum.ch3_4_constraints.report import files, table
from curriculum.ch3_4_constraints.rods.truth import Truth
from curriculum.common import words
from curriculum.common.files import write_together


@pytest.fixture
def run(tmp_path, capsys):
    """run("--flag value"): what main printed, and what metrics.json holds."""

    def made(flags, *more, chapter=c):
        assert chapter.main([*flags.split(), *more, f"--out={tmp_path}"]) == 0
        text = (tmp_path / files.METRICS).read_text()
        return capsys.readouterr().out, json.loads(text, parse_constant=pytest.fail)

    return made


def cells(printed, name):
    """Those of a method in the table."""
    (line,) = re.findall(rf"^{name} +(.*)$", printed.partition("\nmethod ")[2], re.M)
    return re.split(" {2,}", line)


# --- what is measured ---
SYSTEM = thrown(at_random(row(3))) | {"load": np.array([[3.0, 0, -1], [0, 8, 0], [0.5, -2, 4]])}


def by_hand(system, name, dt, done):
    """max_violation, final_violation, energy_rel_max and tension_max of a run's states."""
    force = c.make_methods(dt, time_constant=0.03)[name].make_force(system)
    off = []
    pulls = []
    for q, v in zip(done.q, done.v, strict=True):
        now = system | {"q0": np.array(q)}
        _, d = incidence_and_rods(now)
        off.append(np.max(np.abs(np.linalg.norm(d, axis=1) - system["lengths"])))
        pulls.append(smallest_pulls(now, force(q, v) - weight(system)))
    return max(off), off[-1], energy_off(system, done.q, done.v), np.max(np.abs(pulls))


KEYS = "max_violation", "final_violation", "energy_rel_max", "tension_max"


def test_table_and_metrics_have_what_each_run_has_done(run, tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(as_scene(SYSTEM))
    flags = "--steps 60 --dt 0.01 --seed 3 --time-constant 0.03 --system"
    printed, metrics = run(flags, str(path), *BARE)
    assert printed.splitlines()[:2] == [
        "ch3.4 constraints | device cpu",
        f"integrated {path} (semi_implicit) for 60 steps of 0.01 s -> 0.6 s of sim time",
    ]
    used = {"system": "scene.json", "integrator": "semi_implicit", "dt": 0.01, "steps": 60}
    used |= {"seed": 3, "baumgarte": 20.0, "time_constant": 0.03, "rods": 3, "error_at": 0.6}
    assert used.items() <= metrics.items() and [*metrics["results"]] == sorted(c.make_methods())
    (known,) = motion(SYSTEM, [0.6])
    for name, found in metrics["results"].items():
        done = c.run_method(SYSTEM, name, "semi_implicit", 0.01, 60, time_constant=0.03)
        expected = by_hand(SYSTEM, name, 0.01, done)
        for key, x in zip(KEYS, expected, strict=True):
            assert found[key] == round(found[key], 12) == pytest.approx(x, rel=1e-6, abs=1e-11)
        error = np.max(np.linalg.norm(done.q[-1] - known, axis=1))
        assert found["error"] == pytest.approx(error, abs=1e-9)
        assert found["tip_final"] == [round(x, 6) for x in done.q[-1, 2]]
        assert found["operations"] == done.operations and found["conserves"]
        assert found["stopped"] is None
        worst, end, energy, pull, off, pace = cells(printed, name)
        assert worst == words.length(np.max(done.violations))
        assert end == words.length(done.violations[-1])
        assert energy == words.per_cent(found["energy_rel_max"])
        assert float(pull) == pytest.approx(found["tension_max"], rel=0.005)
        assert off == words.length(error) and float(pace) > 0.0


# --- figures in words ---
def test_a_place_is_no_finer_than_it_is_known():
    known = Truth(step=1, at="", q=np.zeros((1, 3)), uncertainty=2e-9)
    shown = [known.in_words(x) for x in (None, 1e-9, 3e-9)]
    assert shown == ["-", "< 2 nm", "3 nm"]


@pytest.mark.parametrize(
    ("most", "shown"),
    [
        (None, "-"),
        (0.0, "0"),
        (0.98765, "0.988"),
        (50.05, "50"),
        (123.456, "123"),
        (99_949.0, "99900"),
        (123_456.0, "1.23e5"),
        (4.9e9, "4.9e9"),
    ],
)
def test_a_force_has_three_digits(most, shown):
    assert table.force({"tension_max": most}) == shown


def test_columns_end_below_each_other_and_a_sentence_may_run_over():
    heads = [("", "method"), ("rods off", "mm"), ("", "a longer head")]
    rows = [["none", "12.5", "7"], ["a method", "lost at 3 s: and a long reason why"]]
    rows.append(["soft", "1,234,567.5", "-"])
    assert table.aligned(heads, rows) == [
        "             rods off",
        "method             mm  a longer head",
        "none             12.5              7",
        "a method  lost at 3 s: and a long reason why",
        "soft      1,234,567.5              -",
    ]


def test_figures_have_twelve_decimals_places_six_and_what_is_not_finite_is_null():
    row = {
        "stopped": "lost",
        "error": 0.1234567890126,
        "operations": 7,
        "tip_final": [1.23456789, -np.inf],
    }
    row |= {"energy_rel_max": np.float64(np.nan), "conserves": True}
    shown = {key: files.rounded(x) for key, x in row.items()}
    assert files.finite(shown) == row | {
        "error": 0.123456789013,
        "tip_final": [1.234568, None],
        "energy_rel_max": None,
    }


# --- what is said of them ---
VERDICTS = [  # the worst errors of none and baumgarte in m, and the ratio that is said, if it is
    (0.9, 0.2, "as expected (4.5 x)"),
    (0.61, 0.2, "as expected (3 x)"),
    (0.6, 0.2, ": 3, not above 3"),
    (0.1, 0.2, ": 0.5, not above 3"),
    (0.9, 0.0, "as expected (which has none)"),
    (2e-10, 1e-10, "rounding"),
    (3e-9, 1e-10, "as expected (30 x)"),
    (0.0, 0.0, "rounding"),
]


def verdict(capsys, worst=0.9, kept=0.2, moved=1.0, **stopped):
    """What is said of two runs whose shortest rod is 2 m."""
    q = np.array([[[0.0, 1.0, 0.0]], [[0.0, 1.0 - moved, 0.0]]])
    start = {"q0": q[0], "lengths": np.array([2.0, 3.0])}
    runs = {}
    for name in ("none", "baumgarte"):
        runs[name] = SimpleNamespace(q=q, start=start, stopped=stopped.get(name))
    results = {"none": {"max_violation": worst}, "baumgarte": {"max_violation": kept}}
    table.print_ratio(results=results, runs=runs)
    said = capsys.readouterr().out
    del results["none"]
    table.print_ratio(results=results, runs=runs)
    assert capsys.readouterr().out == ""
    return said


@pytest.mark.parametrize(("worst", "kept", "said"), VERDICTS)
def test_the_verdict_is_the_ratio_of_the_worst_errors_where_it_is_above_three(
    worst, kept, said, capsys
):
    assert said in verdict(capsys, worst, kept)


def test_there_is_no_verdict_of_runs_that_ended_or_of_what_stands_still(capsys):
    assert "nothing moves" in verdict(capsys, moved=1e-9)
    assert "4.5 x" in verdict(capsys, moved=3e-9)
    for name in ("none", "baumgarte"):
        assert verdict(capsys, **{name: "its loop kept no state"}) == ""


LIMITS = {  # flags, and by how much dt w is said to be past baumgarte's limit
    "--integrator euler --baumgarte 400": None,  # it is met, not passed
    "--integrator euler --baumgarte 401": ("2.005", "2"),
    "--integrator euler --baumgarte 500": ("2.5", "2"),
    "--integrator rk4 --dt 0.1 --baumgarte 30": ("3", "2.79"),
    "--integrator rk4 --dt 0.1 --baumgarte 30 --stabilization none": None,
}


@pytest.mark.parametrize("flags", LIMITS)
def test_a_limit_that_is_passed_is_named(flags, run):
    printed, _ = run(f"{flags} --system pendulum --steps 9", *BARE)
    said = re.search(r"dt w = (.*) is past its limit (.*)\n", printed)
    assert (said and said.groups()) == LIMITS[flags]


def test_methods_that_are_not_made_for_the_integrator_are_left_out_by_name(run, monkeypatch):
    def make_methods(*_, **__):
        return {
            "none": c.Method(c.make_force, ""),
            "mine": c.Method(c.make_force, "", integrator="rk4"),
            "ours": c.Method(c.make_force, "", integrator="euler"),
        }

    monkeypatch.setattr(c, "make_methods", make_methods)
    for flags, kept, names in (
        ("--steps 9", ["none"], "mine, ours"),
        ("--steps 9 --integrator rk4", ["mine", "none"], "ours"),
        ("--steps 9 --stabilization none", ["none"], None),
    ):
        printed, metrics = run(flags, *BARE)
        said = re.search("left out, .*: (.*)\n", printed)
        assert [*metrics["results"]] == kept and (said and said[1]) == names


# --- two things at once ---
def test_a_loop_that_ends_early_has_rows_and_no_verdict(run):
    changed = edited((STEP, STEP + "        if i == 30:\n            break\n"))
    printed, metrics = run("--steps 60", *BARE, chapter=changed)
    for name, found in metrics["results"].items():
        assert "0.15 s" in found["stopped"] and f"{name}: {found['stopped']}\n" in printed
        assert len(cells(printed, name)) == 6 and found["error"] > 0.0
    assert metrics["error_at"] == 0.15 and "largest rod error" not in printed


def test_drag_and_a_step_that_is_too_long_are_told_apart(run):
    drag = edited((FORCE, f"{FORCE} - 0.3 * v"))
    flags = "--integrator rk4 --dt 0.1 --steps 40 --baumgarte 30"
    for chapter in (c, drag):
        printed, metrics = run(flags, *BARE, chapter=chapter)
        assert cells(printed, "baumgarte") == [metrics["results"]["baumgarte"]["stopped"]]
        for name in ("none", "soft", "project"):
            assert metrics["results"][name]["conserves"] == (chapter is c)
            assert (cells(printed, name)[2] == "-") == (chapter is drag)
        assert printed.count("- energy off") == (chapter is drag)


@pytest.mark.parametrize("flags", ["--stabilization project", ""])
def test_an_edit_leaves_dashes_and_one_reason_for_one_method_and_for_all(flags, run):
    changed = edited((STEP, f"        v = v * (1.5 if i == 20 else 1.0)\n{STEP}"))
    printed, metrics = run(f"--steps 60 {flags}", *BARE, chapter=changed)
    for name, found in metrics["results"].items():
        assert cells(printed, name)[2:5] == ["-", "-", "-"]
        assert [found[key] for key in ("energy_rel_max", "tension_max", "error")] == [None] * 3
        assert "step 20" in found["unlike"] and found["max_violation"] > 0.0
    assert len(re.findall("^- ", printed, re.M)) == 1


def test_a_readers_own_row_is_in_all_files_and_fails_alone(run, tmp_path, monkeypatch):
    usual = c.make_methods
    own = {"torn": c.Method(c.make_force, "tears", torn)}
    monkeypatch.setattr(c, "make_methods", lambda *a, **k: usual(*a, **k) | own)
    printed, metrics = run("--system pendulum --steps 200")
    assert all(b"torn" in (tmp_path / name).read_bytes() for name in FILES)
    (said,) = cells(printed, "torn")
    assert said == metrics["results"]["torn"]["stopped"] and said.endswith("it is torn")
    assert metrics["results"]["none"]["stopped"] is None and len(cells(printed, "none")) == 6


def test_one_method_that_is_not_compiled_leaves_out_the_page_and_says_why(run, monkeypatch):
    def branching(system):
        force = c.make_force(system)
        return lambda q, v: force(q, v) if q[0, 1] < 9.0 else 0.0 * q

    usual = c.make_methods
    own = {"branches": c.Method(branching, "branches")}
    monkeypatch.setattr(c, "make_methods", lambda *a, **k: usual(*a, **k) | own)
    printed, metrics = run("--system pendulum --steps 9 --no-rerun")
    assert f"{files.PAGE} is left out: " in printed and f"{files.PAGE}\n" not in printed
    found = metrics["results"]
    assert found["branches"]["operations"] is None and found["none"]["operations"] > 0
    assert found["branches"]["tip_final"] == found["none"]["tip_final"]


def test_a_smoke_run_has_its_steps_whatever_else_is_asked(run):
    _, metrics = run("--smoke --steps 100 --stabilization none", *BARE)
    assert metrics["steps"] == c.SMOKE_STEPS


# --- what is written ---
def test_a_run_leaves_its_files_and_none_of_an_earlier_run(tmp_path, monkeypatch, capsys):
    """A system may be called as its folder. A file that is not made has a line that says why."""
    monkeypatch.chdir(tmp_path)
    flags = ["--system", "spin", "--out", "spin", "--steps", "9"]
    c.main(flags)
    (tmp_path / "spin" / "notes.txt").write_text("mine")
    assert contents(tmp_path).keys() == FILES | {"notes.txt"}
    capsys.readouterr()
    c.main([*flags, "--no-rerun", "--plain"])
    printed = capsys.readouterr().out
    assert f"{files.PAGE} is left out: " in printed and files.RECORDING not in printed
    assert cells(printed, "project")[4] == "-"
    assert contents(tmp_path).keys() == {files.METRICS, "notes.txt"}


@pytest.mark.parametrize("name", sorted(FILES))
@pytest.mark.parametrize("text", ["mine", '{"system": "mine"}', "[1]", 10**5 * "["], ids=len)
def test_a_folder_with_a_file_of_somebody_elses_is_refused_and_stays(name, text, tmp_path, refused):
    (tmp_path / name).write_text(text)
    for flags in ([], BARE):
        assert str(tmp_path / name) in refused("--out", tmp_path, *flags)
    assert contents(tmp_path) == {name: text.encode()}


EARLIER = {  # files as an earlier version has written them
    files.METRICS: json.dumps(dict.fromkeys([*files.EARLIER, "results"])),
    files.PAGE: "<!doctype html><title>double: which method holds its rods?</title>",
}


def test_files_of_an_earlier_version_are_a_runs_and_almost_like_them_are_not(tmp_path):
    for name, text in EARLIER.items():
        (tmp_path / name).write_text(text)
        assert files.is_ours(tmp_path / name)
        beside = text.replace("rods", "beams"), " " * files.HEAD + f"it wrote: {text}"
        for almost in beside:
            (tmp_path / name).write_text(almost)
            assert not files.is_ours(tmp_path / name)


def test_what_cannot_be_written_is_refused_before_it_is_computed(tmp_path, refused):
    (tmp_path / "file").touch()
    (tmp_path / files.PAGE).mkdir()
    for place in (tmp_path, tmp_path / "file", tmp_path / "file" / "below"):
        assert str(place) in refused("--out", place)
    assert len([*tmp_path.iterdir()]) == 2


FULL = """import resource, runpy, sys
most = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
runpy.run_path("constraints.py", run_name="__main__")
"""


@UNIX
def test_a_full_disk_leaves_all_files_as_they_were(tmp_path):
    """metrics.json is small enough, the page is not."""
    flags = "--no-rerun", f"--out={tmp_path}", "--stabilization=none", "--steps"
    assert python("-c", FULL, 10**8, *flags, 20).returncode == 0
    before = contents(tmp_path)
    assert len(before[files.METRICS]) < 10**4 < len(before[files.PAGE])
    done = python("-c", FULL, 10**4, *flags, 30)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert contents(tmp_path) == before


def test_nothing_is_removed_or_renamed_if_one_name_cannot_be_taken(tmp_path):
    write_together(tmp_path, {"a": "old", "b": "old"})
    (tmp_path / "c").mkdir()
    for changes in ({"a": None, "b": "new", "c": "new"}, {"c": None, "a": "new", "b": None}):
        with pytest.raises(OSError, match="c is not"):
            write_together(tmp_path, changes)
        assert contents(tmp_path) == {"a": b"old", "b": b"old"}
    with pytest.raises(TypeError):
        write_together(tmp_path, {"a": "new", "b": 0})
    write_together(tmp_path, {"a": None, "b": "new", "d": b"\xff"})
    assert contents(tmp_path) == {"b": b"new", "d": b"\xff"}


def test_whatever_goes_wrong_in_a_recording_its_run_is_written(run, monkeypatch, tmp_path):
    from curriculum.ch3_4_constraints.report import recording

    class Panic(BaseException):
        pass

    def older(*_):
        raise AttributeError("no memory_recording\nin this version")

    def panics(*_):
        raise Panic

    for broken, said in ((older, "no memory_recording in this version"), (panics, "Panic")):
        monkeypatch.setattr(recording, "record", broken)
        printed, _ = run("--steps 9")
        assert f"{files.RECORDING} is left out: {said};" in printed
        assert contents(tmp_path).keys() == FILES - {files.RECORDING}
    monkeypatch.setenv("RERUN", "off")
    printed, _ = run("--steps 9")
    assert f"{files.RECORDING} is left out: RERUN=off" in printed
    assert contents(tmp_path).keys() == FILES - {files.RECORDING}


def test_without_a_rerun_that_works_a_run_needs_numpy_alone_and_is_not_lost(tmp_path):
    for name in "rerun", "pyarrow", "scipy", "llvmlite":
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('no driver')")
    flags = "constraints.py", "--steps", 9, "--out", tmp_path / "out"
    done = python(*flags, variables={"PYTHONPATH": str(tmp_path)})
    assert f"{files.RECORDING} is left out: no driver;" in done.stdout
    assert done.returncode == 0 and contents(tmp_path / "out").keys() == FILES - {files.RECORDING}


def test_the_lines_that_show_files_can_be_pasted(run, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    out = tmp_path / "a b"
    printed, _ = run("--steps 9")
    c.main(["--steps=9", f"--out={out}"])
    viewer = shlex.split(files.look(out / files.RECORDING).partition(": ")[2])
    assert viewer[:3] == [sys.executable, "-m", "rerun"] and viewer[-1] == str(
        out / files.RECORDING
    )
    assert ("--web-viewer" in viewer) == (sys.platform == "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    assert "--web-viewer" not in files.look(out)
    assert shlex.split(re.search("look: (.*)\n", printed)[1])[1] == str(tmp_path / files.PAGE)
