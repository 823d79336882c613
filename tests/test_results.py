"""What a run leaves behind: each step measured, table and metrics, the same bytes everywhere."""

import json
import tempfile
from contextlib import redirect_stdout
from functools import cache, partial
from io import StringIO
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints import publish, recording, run_checks, tables
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, run
from curriculum.common import compiled, steps
from curriculum.common.ruler import true_position

import numpy as np
import pytest
from conftest import feel, python, true_run

DOUBLE = c.build_system("double")


def test_the_pace_is_the_time_of_the_steps_over_their_number(monkeypatch):
    """By a clock that says one second has gone by, whenever it is asked for the second time."""
    clock = count()
    for module in (steps, compiled):
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=clock.__next__))
    assert run(DOUBLE, steps=4).pace == 500000.0  # a second for the first, and for the others
    assert run(DOUBLE, steps=4, way=steps.Plain).pace == 1e6
    found = run(DOUBLE, hold=40.0, dt=0.05, steps=16)  # in two blocks: what blows up is not slow
    assert found.stopped and found.pace == pytest.approx(2e6 / 16)


# --- what the command writes and prints ---
NUMBERS = "--no-rerun", "--no-picture", "--no-page"


@cache
def results(flags="", steps=200):
    """The metrics of a short run with these flags, and the lines that it prints."""
    printed = StringIO()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(printed):
        c.main([*NUMBERS, "--steps", str(steps), "--out", folder, *flags.split()])
        text = Path(folder, "metrics.json").read_text(encoding="utf-8")
    found = json.loads(text, parse_constant=lambda name: pytest.fail(name))
    assert text == json.dumps(found, indent=2, sort_keys=True) + "\n"
    return found, printed.getvalue().splitlines()


def marked(lines, mark):
    """The sentences below the table that begin with a mark."""
    return [line for line in lines if line.startswith(mark)]


FLAGS = dict.fromkeys(("--seed 1", "--system triple", "--integrator rk4"), "none")
FLAGS |= {"--baumgarte 10": "baumgarte", "--time-constant 0.05": "soft", "--impedance 0.5": "soft"}
FLAGS |= {"--dt 0.004": "impulse", "--steps 201": "project"}


@pytest.mark.parametrize(("flag", "mode"), FLAGS.items())
def test_every_flag_reaches_the_result_and_stands_beside_it(flag, mode):
    (found, _), (plain, _) = results(f"{flag} --stabilization {mode}"), results()
    assert found["results"][mode] != plain["results"][mode]
    name, value = flag.strip("-").replace("-", "_").split()
    assert found[name] == type(found[name])(value)


def test_plain_is_the_same_run_to_the_byte_and_of_the_mode_that_was_asked_for():
    flags = "--stabilization project"
    (found, _), (plain, lines) = results(flags, 150), results(f"{flags} --plain", 150)
    assert " ".join(lines[1:3]).endswith("in plain numpy: the lines as   they stand")
    same = {"project": found["results"]["project"] | {"error": None}}  # no truth is looked for
    assert plain == found | {"results": same, "known": plain["known"]}


def test_links_smoke_and_steps_say_how_many():
    found, _ = results("--system chain --links 3", 1)
    assert found["rods"] == 3 == round(found["results"]["none"]["tip_final"][0])
    smoke, _ = results("--smoke")
    assert 200 < smoke["steps"] < 4000 and smoke == results(steps=smoke["steps"])[0]
    _, _, system = c.parse(["--system", "chain", "--links", "1000", "--show-step"])
    assert len(system["pairs"]) == 1000


def test_a_tolerance_is_held_at_two_seconds_whatever_step_it_finds(monkeypatch):
    recorded = []
    monkeypatch.setattr(recording, "record", lambda found: recorded.append(found) or b"")
    found, lines = results("--integrator gauss --tol 1e-6 --dt 0.005 --rerun", 450)
    errors = {mode: row["error"] for mode, row in found["results"].items()}
    assert found["dt"] > 0.005 and found["error_at"] == pytest.approx(2.0)
    assert min(errors.values()) <= found["tol"] == 1e-6 < max(errors.values())
    (line,) = marked(lines, "--tol")
    assert all((mode in line.split("not met by")[1]) == (x > 1e-6) for mode, x in errors.items())
    (shown,) = recorded  # soft is as stiff as that step allows
    q, v, hold = shown.runs["soft"].q, shown.runs["soft"].v, c.hold_table(shown.dt)["soft"]
    expected = [c.tensions(shown.system, *state, hold) for state in zip(q, v, strict=True)]
    assert np.array_equal(shown.tensions["soft"](q, v), expected)


def test_a_run_shorter_than_any_step_meets_its_tolerance_in_one():
    found, _ = results("--integrator gauss --tol 1e-9 --dt 5e-5", 1)
    assert (found["dt"], found["steps"]) == (5e-5, 1)


@pytest.mark.parametrize("system", ["chain --links 50", "peaucellier"])
def test_a_tolerance_that_nobody_could_judge_is_refused(system, capsys):
    with pytest.raises(SystemExit, match="2"):
        results(f"--integrator gauss --tol 0.001 --system {system}", 400)
    line = capsys.readouterr().err
    assert "error: argument --tol: " in line and " 0.001 m" in line and line.count("\n") == 1


def test_metrics_are_the_run_rounded_and_the_table_fits_a_terminal():
    found, lines = results()
    here = run(DOUBLE, hold=20.0, steps=200)
    truth, _ = true_position(true_run(DOUBLE), 1.0)
    error = np.linalg.norm(here.q[-1] - truth, axis=1).max()
    wanted = here.violations.max(), here.violations[-1], drift(DOUBLE, here), error
    row, keys = found["results"]["baumgarte"], "max_violation final_violation energy_rel_max error"
    assert [row[key] for key in keys.split()] == pytest.approx(wanted, abs=1e-11)
    assert row["tip_final"] == np.round(here.tip[-1], 6).tolist() and found["error_at"] == 1.0
    # a line above tells how the steps were done: the longer, the busier the machine has been
    table = [*marked(lines, "     "), *marked(lines, ("mode ", *c.hold_table()))]
    assert len(table) == 7 and "at 1 s" in table[1] and max(map(len, table)) <= 80


def test_the_truth_begins_on_right_rods_where_a_file_has_rounded_its_places(tmp_path, monkeypatch):
    """Or at what is typed: a mistake in a project of the reader's shows in the run itself."""
    file, found = tmp_path / "rounded.json", []
    monkeypatch.setattr(publish, "publish", lambda *made: found.append(made[0].truth) or "")
    monkeypatch.chdir(tmp_path)
    for x in (0.70710678, 0.5**0.5):  # m; off by 2 nm, and by rounding
        bob = {"position": [x, x, 0], "velocity": [-2, 2, 0]}
        rods = [{"pair": [0, -1], "length": 1}]
        file.write_text(json.dumps({"anchors": [[0, 0, 0]], "particles": [bob], "rods": rods}))
        c.main(["--system", str(file), "--steps", "400", "--stabilization", "project", *NUMBERS])
    rounded, exact = found
    assert max(x.uncertainty for x in found) < 1e-11
    assert np.abs(rounded.q - exact.q).max() < 1e-12
    assert run_checks.righted(DOUBLE, lambda *_: 1 / 0) is DOUBLE


def test_energy_that_jumps_in_a_step_is_told_of():
    """A tonne on light links, whose way back from a whip adds to the energy."""
    found, lines = results("--system heavy_tip --integrator rk4 --stabilization project", 2000)
    system = c.build_system("heavy_tip")
    here = run(system, "rk4", "project", steps=2000)
    jump = np.abs(np.diff(here.energies)).max() / energy_scale(system)
    row = here.summary(energy_scale(system), SimpleNamespace(step=0, q=None))
    here.energies = -here.energies  # it falls as much
    fallen = here.summary(energy_scale(system), SimpleNamespace(step=0, q=None))
    assert row["energy_step_max"] == fallen["energy_step_max"]
    assert found["results"]["project"]["energy_step_max"] == pytest.approx(jump) and jump > 0.1
    assert len(marked(lines, "* project: energy jumps by ")) == len(marked(lines, "project* ")) == 1
    assert not any("jumps" in line for line in results()[1])


def test_an_error_of_energy_is_a_share_of_m_g_l_or_where_that_is_zero_of_a_joule(monkeypatch):
    monkeypatch.setattr(c, "GRAVITY", np.array([6.0, -8.0, 0.0]))
    assert energy_scale(DOUBLE) == 2.0 * 10.0 * 2.0
    monkeypatch.setattr(c, "GRAVITY", 0.0 * c.GRAVITY)
    found, lines = results.__wrapped__("--system spin --stabilization none", 20)
    joules = run(c.build_system("spin"), steps=20).energies
    lost = np.abs(joules - joules[0]).max()
    assert found["results"]["none"]["energy_rel_max"] == pytest.approx(lost) and lost > 1.0
    assert f" {tables.per_cent(lost)} " in marked(lines, "none* ")[0]


def test_a_length_has_two_digits_and_a_unit():
    words = {0.384014620396: "38 cm", 0.0013: "0.13 cm", 0.996: "1 m", 23.4: "23 m", 0.0: "< 1 pm"}
    words |= {3.4e-5: "34 um", 5.5e-9: "5.5 nm", 9.98e-13: "< 1 pm", 1.26e-12: "1.3 pm"}
    assert {metres: tables.length(metres) for metres in words} == words


def test_jobs_take_turns_and_their_first_round_is_not_counted():
    done = []
    jobs = {name: partial(lambda name: done.append(name) or len(done), name) for name in "ab"}
    assert tables.in_turns(jobs, 2) == {"a": [3, 5], "b": [4, 6]} and "".join(done) == "ababab"


def test_every_mark_and_dash_in_the_table_has_its_sentence():
    _, lines = results("--dt 0.05 --baumgarte 40", c.SMOKE_STEPS)
    for mark in ("baumgarte* ", "* baumgarte div", "- baumgarte: stopped before 2 s"):
        assert len(marked(lines, mark)) == 1
    assert "= 2 is past the limit 0.828" in marked(lines, "baumgarte: dt w ")[0]
    words = "--integrator midpoint:2 --stabilization baumgarte --baumgarte 500"
    _, lines = results(words, 5)  # a rule with no known limit
    assert not any("past the limit" in line for line in lines)
    words = "--system peaucellier --stabilization impulse"
    _, lines = results(words, 1000)
    assert "18 m/s^2 unanswered" in marked(lines, "* impulse")[0]
    assert "is not known" in marked(lines, "- impulse")[0]
    _, lines = results("--integrator rk4 --dt 1.5 --stabilization project", 20)
    assert " steps in halves, and stopped at step " in marked(lines, "* project took ")[0]
    assert "at 0.025 s is not looked" in marked(results("--plain", 5)[1], "- ")[0]
    for rule in ("semi_implicit", "gauss:3"):  # a hopeless step still gives results
        found, lines = results(f"--dt 100 --integrator {rule}", 10)
        stopped = {mode: row["stopped"] for mode, row in found["results"].items() if row["stopped"]}
        assert {"none", "baumgarte"} <= stopped.keys()
        assert all(marked(lines, f"* {mode} ")[0].endswith(stopped[mode]) for mode in stopped)
    assert marked(results("--dt 5", 5)[1], "none* ")[0].split()[1:4] == ["-", "-", "-"]


def test_no_truth_is_believed_where_a_run_finds_that_what_is_compiled_lies(monkeypatch):
    """As where floats feel on the way what symbols do not: it was found by compiled steps."""

    def drag(q, v):
        return -v if isinstance(q[0, 1], float) and q[0, 1] < -0.5 else 0.0 * v

    feel(monkeypatch, drag)
    found, lines = results("--stabilization none", 400)
    assert found["known"] is found["results"]["none"]["error"] is None
    assert "the truth at 2 s is not believed:" in marked(lines, "- none: ")[0]


VERDICTS = {
    "": "as expected",
    "--system pendulum": "as expected",
    "--baumgarte 0.5": "UNEXPECTED",
    "--steps 799": None,  # too short to tell
    "--stabilization baumgarte": None,  # nothing to compare with
    "--system chain --links 3": None,  # not the chapter's
    "--dt 0.05 --baumgarte 40": None,  # diverges
    "--baumgarte 0": None,  # is none itself
    "--integrator rk4 --dt 0.001 --system pendulum": None,  # hardly drifts
}


@pytest.mark.parametrize(("flags", "word"), VERDICTS.items())
def test_the_verdict_is_the_ratio_of_the_worst_rod_errors_where_that_tells_something(flags, word):
    found, lines = results(flags, c.SMOKE_STEPS)
    said = marked(lines, "verdict: worst rod error, none / baumgarte = ")
    assert len(said) == bool(word)
    for line in said:
        none, helped = (found["results"][mode]["max_violation"] for mode in ("none", "baumgarte"))
        assert f" = {none / helped:.1f}: {word}" in line
        assert (none > 3.0 * helped) == (word == "as expected")


# --- the same bytes, whatever numpy and its BLAS choose, and without llvmlite, too ---
# what numpy found here beyond its baseline: naming anything else would only earn a warning
FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", ()))
PLAIN = {"NPY_DISABLE_CPU_FEATURES": FEATURES, "OPENBLAS_NUM_THREADS": "1"}
OTHER, INFO = {"OPENBLAS_NUM_THREADS": "3"}, Path("/proc/cpuinfo")
for settings, feature, kernel in ((PLAIN, "sse2", "Prescott"), (OTHER, "avx", "Sandybridge")):
    if INFO.exists() and feature in INFO.read_text("utf-8").split():
        settings["OPENBLAS_CORETYPE"] = kernel  # of OpenBLAS; the default is the newest
RUNS = """
import hashlib, sys
cases, folder, *missing = sys.argv[1:]
sys.modules.update(dict.fromkeys(missing))  # as if these were not installed
import constraints
simulate, numbers = constraints.simulate, hashlib.sha256()
def noted(*arguments):
    run = simulate(*arguments)
    for series in (*run, run.q, run.v):
        numbers.update(series.tobytes())
    return run
constraints.simulate = noted  # metrics are rounded: look at every bit, and at the ruler's
for flags in cases.splitlines():
    constraints.main([*flags.split(), "--no-rerun", "--no-picture", "--no-page", "--out", folder])
    metrics = open(f"{folder}/metrics.json").read()
    assert '"stopped": "' not in metrics
    numbers.update(metrics.encode())
for seed in range(100):
    numbers.update(constraints.build_system("pendulum", seed)["q0"].tobytes())
print(numbers.hexdigest())
"""
CASES = ["triple --steps 20 --integrator gauss", "jansen_leg --steps 5 --integrator rk4"]
CASES += ["tight_cable --steps 5", "chain --links 41 --steps 5"]
CASES = ["--smoke", *(f"--stabilization project --dt 0.02 --system {case}" for case in CASES)]


def test_metrics_are_the_same_bytes_everywhere(tmp_path):
    """With llvmlite, and without it under other kernels."""
    digests = set()
    for variables, *missing in ([PLAIN], [OTHER, "llvmlite"]):
        arguments = "\n".join(CASES), tmp_path, *missing
        done = python("-c", RUNS, *arguments, variables=variables, timeout=300)
        assert (done.returncode, done.stderr) == (0, "")
        digests.add(done.stdout.splitlines()[-1])
    assert len(digests) == 1


def test_smoke_twice_is_the_same_files_and_the_same_recording(tmp_path):
    """A server keeps its layout, or else a viewer in a browser makes up its own."""
    one, two = folders = tmp_path / "one", tmp_path / "and two"
    done = python(c.__file__, "--smoke", "--out", one)
    assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    c.main(["--smoke", "--out", str(two)])
    names = {path.name for path in one.iterdir()} - {publish.RECORDING}
    assert names == {publish.METRICS, publish.PICTURE, publish.PAGE}
    assert all((one / name).read_bytes() == (two / name).read_bytes() for name in names)
    recordings = [folder / publish.RECORDING for folder in folders]
    for words in (["verify", recordings[0]], ["compare", *recordings], ["print", recordings[0]]):
        told = python("-m", "rerun_cli", "rrd", *words)
        assert told.returncode == 0, told.stderr
    layout = [line for line in told.stdout.splitlines() if "BlueprintActivation" in line]
    assert any("make_active: true, make_default: true" in line for line in layout)


def test_a_table_without_a_way_to_find_the_truth_gives_the_other_rows(monkeypatch):
    table = c.hold_table

    def without(*given):
        return {name: hold for name, hold in table(*given).items() if name != "project"}

    monkeypatch.setattr(c, "hold_table", without)
    found, lines = results("", 6)
    assert sorted(found["results"]) == ["baumgarte", "impulse", "none", "soft"]
    assert "is not looked for: hold_table has no row project" in " ".join(" ".join(lines).split())


def test_a_row_of_the_table_that_is_no_hold_is_named(monkeypatch):
    table = c.hold_table
    monkeypatch.setattr(c, "hold_table", lambda *given: table(*given) | {"mine": (1.0, 2.0)})
    with pytest.raises(ValueError, match=r"^mine is \(1.0, 2.0\) in hold_table; must be a Hold"):
        results("", 5)
