"""The table, metrics.json, and the files of a run: whole or not at all, nobody else's touched."""

import json
import re
import signal
import tempfile
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BARE, FILES, contents, python

import constraints as c
from curriculum.ch3_4_constraints.mechanics.reference import Reference
from curriculum.ch3_4_constraints.results import output, table
from curriculum.common import files
from curriculum.common.tracing.tape import StepChanged


@pytest.fixture
def run(tmp_path, capsys):
    """run("--flag value"): what main printed, and what metrics.json holds."""

    def made(flags, *more):
        assert c.main([*flags.split(), *more, "--out", str(tmp_path)]) == 0
        text = (tmp_path / output.METRICS).read_text()
        return capsys.readouterr().out, json.loads(text, parse_constant=pytest.fail)

    return made


def cells(printed, name):
    """Those of a method in the last table."""
    (line,) = re.findall(rf"^{name} +(.*)$", printed.rpartition("\nmethod ")[2], re.M)
    return re.split(" {2,}", line)


def test_a_run_prints_the_courses_first_lines_and_what_metrics_json_and_python_have(run):
    printed, metrics = run("--smoke --seed 3 --time-constant 0.03", *BARE)
    assert printed.startswith(
        "ch3.4 constraints | device cpu\n"
        "integrated double (semi_implicit) for 800 steps of 0.005 s -> 4.00 s of sim time\n"
        "seed 3; compiled to "
    )
    used = {"system": "double", "integrator": "semi_implicit", "dt": 0.005, "steps": 800, "seed": 3}
    used |= {"baumgarte": 20.0, "time_constant": 0.03, "rods": 2}
    assert used.items() <= metrics.items() and metrics["error_at"] == 2.0  # s
    system = c.build_system("double", 3)
    exact = c.run_method(system, "project", "gauss", 0.01, 200).q[-1]  # at 2 s
    for name, found in metrics["results"].items():
        method = c.make_methods(0.005, time_constant=0.03)[name]
        done = c.run_method(system, name, "semi_implicit", 0.005, 800, time_constant=0.03)
        pulls = partial(c.tensions, system, force=method.make_force(system))
        hardest = np.max(np.abs([*map(pulls, done.q, done.v)]))
        assert found["tension_max"] == pytest.approx(hardest, abs=1e-9)
        drift = (done.energies - done.energies[0]) / (2.0 * 9.81 * 2.0)
        worst = np.max(done.violations)
        end = done.violations[800]
        energy = np.max(np.abs(drift))
        keys = "max_violation", "final_violation", "energy_rel_max"
        for key, x in zip(keys, (worst, end, energy), strict=True):
            assert found[key] == round(found[key], 12) == pytest.approx(x, abs=0.51e-12)
        assert found["tip_final"] == [round(x, 6) for x in done.tip[800]]
        error = np.max(np.linalg.norm(done.q[400] - exact, axis=1))
        assert found["error"] == pytest.approx(error, abs=1e-9)
        *shown, pull, off, pace = cells(printed, name)
        assert shown == [table.length(worst), table.length(end), table.per_cent(energy)]
        assert float(pull) == pytest.approx(found["tension_max"], rel=0.01)
        assert off == table.length(error) and float(pace) > 0.0


def test_what_a_reader_must_know_is_said_in_lines_that_fit_a_terminal(run, tmp_path):
    printed, metrics = run("--integrator rk4 --dt 0.1 --steps 40 --baumgarte 30", *BARE)
    assert max(map(len, printed.replace(str(tmp_path), "out").splitlines())) <= 80
    assert metrics["results"].keys() == c.make_methods(1.0).keys() - {"impulse"}
    said = " ".join(printed.split())
    assert "impulse is left out: it is not made for rk4" in said
    assert "baumgarte: dt w = 3 is past its limit 2.79" in said
    assert cells(printed, "baumgarte") == [metrics["results"]["baumgarte"]["stopped"]]
    soft = c.run_method(c.build_system("double"), "soft", "rk4", 0.1, 40, baumgarte=30.0)
    share = table.per_cent(np.max(np.abs(np.diff(soft.energies))) / (2.0 * 9.81 * 2.0))
    assert cells(printed, r"soft\*") and f"* soft: energy jumps by {share}" in said


def test_a_length_has_two_digits_and_its_unit_and_a_share_is_per_cent():
    known = Reference(step=1, at="", q=np.zeros((1, 3)), uncertainty=2e-9)
    words = [table.error(x, known) for x in (None, 1e-9, 3e-9)]
    assert words == ["-", "< 2 nm", "3 nm"]
    assert [*map(table.per_cent, (0.384, 1.0, 2.44e-5))] == ["38 %", "100 %", "0.0024 %"]
    words = map(table.length, (9.9e-13, 4.56e-10, 2.34e-8, 9.94e-4, 9.96e-4, 0.384, 0.999, 123.4))
    assert [*words] == ["< 1 pm", "460 pm", "23 nm", "990 µm", "1 mm", "38 cm", "1 m", "120 m"]


def test_a_readers_own_row_is_in_all_files_and_fails_alone(run, tmp_path, monkeypatch):
    def torn(system, q_start, q, v, dt):
        low = {"most": 5, "failure": "it is torn"}
        return c.tracing.while_loop(lambda x: x[0, 1] < -0.5, lambda x: x, q, **low), v

    usual = c.make_methods
    own = {"torn": c.Method(c.make_force, "tears", torn)}
    monkeypatch.setattr(c, "make_methods", lambda *a, **k: usual(*a, **k) | own)
    printed, metrics = run("--system pendulum --steps 400")
    assert all(b"torn" in (tmp_path / name).read_bytes() for name in FILES)
    assert re.fullmatch(r"lost at [\d.]+ s: it is torn", *cells(printed, "torn"))
    assert metrics["results"]["none"]["stopped"] is None


@pytest.mark.parametrize("flags", ["--smoke", "--smoke --system triple --integrator rk4"])
def test_the_verdict_is_the_ratio_of_the_worst_errors_where_it_is_above_three(flags, run):
    printed, metrics = run(flags, *BARE)
    rows = metrics["results"]
    ratio = rows["none"]["max_violation"] / rows["baumgarte"]["max_violation"]
    said = f"largest rod error, none > 3 x baumgarte: as expected ({ratio:.2g} x)\n"
    assert ratio > 3.0 and said in printed


NO_VERDICTS = ["--smoke --baumgarte 600", "--smoke --system spin"]


@pytest.mark.parametrize("flags", [*NO_VERDICTS, "--smoke --stabilization none"])
def test_there_is_no_verdict_of_a_lost_run_another_system_or_one_method(flags, run):
    printed, _ = run(flags, *BARE)
    assert "largest rod error" not in printed


def told(system, capsys, integrator="semi_implicit", steps=400, dt=0.005, **knobs):
    """What the verdict says of none and baumgarte, in one line, and their rows."""
    reference = Reference(1, "")
    runs = {}
    rows = {}
    for name in ("none", "baumgarte"):
        runs[name] = c.run_method(system, name, integrator, dt, steps, **knobs)
        method = c.make_methods(dt, **knobs)[name]
        rows[name] = c.summary(system, runs[name], method, reference)
    table.verdict(rows, runs)
    return " ".join(capsys.readouterr().out.split()), rows, runs


def test_where_baumgarte_does_not_help_the_verdict_says_why(capsys):
    double = c.build_system("double")
    said, rows, _ = told(double, capsys, baumgarte=0.1)
    ratio = rows["none"]["max_violation"] / rows["baumgarte"]["max_violation"]
    assert ratio < 3.0 and said == (
        f"largest rod error, none / baumgarte: {ratio:.2g}; "
        "with this w, step and time baumgarte holds rods no better, or not by much"
    )
    triple = c.build_system("triple", 36)
    said, rows, runs = told(triple, capsys, steps=4000)
    gain = np.max(runs["baumgarte"].energies - runs["baumgarte"].energies[0]) / (9.0 * 9.81)
    assert rows["none"]["max_violation"] < rows["baumgarte"]["max_violation"]
    assert said.endswith(f"; baumgarte has gained {table.per_cent(gain)} of m g L in energy")
    said, _, _ = told(double, capsys, "gauss", 20)
    assert said == "largest rod error: none and baumgarte differ by rounding only"
    still = double | {"load": -double["m"] * c.GRAVITY}
    said, _, _ = told(still, capsys)
    assert said == "largest rod error: nothing moves, so none and baumgarte have nothing to hold"


def test_what_external_force_does_beside_is_no_error_of_energy(monkeypatch, run):
    """A drag takes energy; a load's work is counted, and a spring's where energy has it."""
    printed, metrics = run("--steps 60 --integrator rk4 --dt 0.1", *BARE)
    assert "energy jumps" in printed and "- energy off" not in printed
    usual = c.external_force
    monkeypatch.setattr(c, "external_force", lambda system, q, v=None: usual(system, q) - 0.3 * v)
    printed, metrics = run("--steps 60 --integrator rk4 --dt 0.1", *BARE)
    assert "- energy off: external_force does work that energy does not count" in printed
    assert "energy jumps" not in printed and "energy had" not in printed
    assert not any(row["conserves"] for row in metrics["results"].values())
    assert cells(printed, r"none\*?")[2] == "-"


def test_a_run_that_is_lost_says_how_its_energy_had_grown(run):
    """Below its limit: dt w is 0.1. Beyond it the limit is named instead."""
    printed, metrics = run("--integrator euler --stabilization baumgarte", *BARE)
    said = re.search(r"baumgarte: its energy had grown by (\d+) % of m g L at ([\d.]+) s", printed)
    euler = c.run_method(c.build_system("double"), "baumgarte", "euler", 0.005, 4000)
    gain = (euler.energies[round(float(said[2]) / 0.005)] - euler.energies[0]) / (4.0 * 9.81)
    assert gain == pytest.approx(float(said[1]) / 100.0, rel=0.1) and gain > 1.0
    assert "past its limit" not in printed
    printed, _ = run("--integrator euler --baumgarte 500 --stabilization baumgarte", *BARE)
    assert "dt w = 2.5 is past its limit 2" in printed and "energy had grown" not in printed


LIMITS = {  # w and dt in flags, and what is said of baumgarte's limit under euler, 2
    "--baumgarte 400": None,  # which is met, not passed
    "--baumgarte 401": "dt w = 2.005 is past its limit 2\n",
}


@pytest.mark.parametrize("flags", LIMITS)
def test_a_limit_that_is_met_is_not_passed(flags, run):
    printed, _ = run(f"{flags} --integrator euler --system pendulum --steps 9", *BARE)
    said = re.search("dt w = .*\n", printed)
    assert (said and said[0]) == LIMITS[flags]


def test_a_run_that_blew_up_says_nothing_of_the_motion(run):
    """Euler's soft on the double gets 10,000 times as quick before it is lost or not."""
    printed, metrics = run("--integrator euler --steps 2400 --stabilization soft", *BARE)
    assert metrics["results"]["soft"]["energy_rel_max"] > 1.0
    assert "is long" not in printed
    printed, _ = run("--system double --dt 0.1 --steps 40 --integrator gauss", *BARE)
    exact = c.run_method(c.build_system("double"), "none", "gauss", 0.1, 40)
    assert f"a step of 0.1 s is long: in {exact.time_scale:.2g} s the motion" in printed


def test_errors_are_of_two_seconds_whatever_the_step(run):
    printed, metrics = run("--dt 0.02 --steps 150 --stabilization project", *BARE)
    row = metrics["results"]["project"]
    assert (metrics["error_at"], metrics["dt"]) == (2.0, 0.02) and "at 2 s" in printed
    assert cells(printed, "project")[4] == table.length(row["error"])


def test_what_is_not_finite_is_null_in_metrics_and_the_rest_is_rounded():
    found = output.rounded([1.23456, -np.inf, np.nan, None, "lost", True], 3)
    assert found == [1.235, None, None, None, "lost", True]


def test_methods_that_the_file_has_are_left_out_by_name_and_no_others(run, monkeypatch):
    def make_methods(*_, **__):
        return {
            "none": c.Method(c.make_force, ""),
            "mine": c.Method(c.make_force, "", integrator="rk4"),
        }

    monkeypatch.setattr(c, "make_methods", make_methods)
    said = " is left out: it is not made for "
    printed, metrics = run("--smoke", *BARE)
    assert f"mine{said}semi_implicit\n" in printed and printed.count(said) == 1
    assert [*metrics["results"]] == ["none"]
    printed, _ = run("--smoke --integrator rk4", *BARE)
    assert said not in printed


def test_a_smoke_run_has_its_steps_whatever_else_is_asked(run):
    printed, metrics = run("--smoke --steps 100 --stabilization none", *BARE)
    assert metrics["steps"] == c.SMOKE_STEPS and f"for {c.SMOKE_STEPS} steps of" in printed


def test_a_jump_of_energy_is_blamed_on_rods_that_had_left_before_it_and_on_no_others():
    """Energy jumps from state 2 to 3. Rods leave at state 2, or at state 4."""
    row = {"tension_max": 1.0, "conserves": True, "energy_rel_max": 0.5, "max_violation": 0.2}
    for violations, blamed in (([0, 0, 0.2, 0, 0], True), ([0, 0, 0, 0, 0.2], False)):
        run = SimpleNamespace(
            energies=np.array([0.0, 0.1, 0.0, -20.0, -19.0]),
            violations=np.array(violations),
            loads=10.0,
            shortest=1.0,
        )
        (said,) = table.doubts(row, run)
        assert said.startswith("energy jumps by 50 % of m g L in one step")
        assert said.endswith("; rods had left the constraint by 20 cm") == blamed
        assert ("rods had left" in said) == blamed


def test_a_force_is_doubted_if_rods_are_off_by_what_can_make_it():
    """30 times all loads comes from an angle of 1/30, which rods that are off by 1/900 make."""
    run = SimpleNamespace(loads=10.0, shortest=2.0, energies=np.zeros(2))
    row = {"tension_max": 300.0, "conserves": True, "energy_rel_max": 0.0}
    for off, doubted in ((2.0 * 0.08 / 900.0, False), (2.0 * 0.12 / 900.0, True)):
        assert bool(table.doubts(row | {"max_violation": off}, run)) == doubted
    row |= {"tension_max": 99.0, "max_violation": 1.0}  # less than ten times its loads
    assert table.doubts(row, run) == []


def test_a_force_that_may_be_larger_between_the_steps_says_so(run):
    words = "over: the largest force at the steps; between them it may be larger\n"
    flags = "--system chain --links 5 --seed 3 --stabilization project --steps"
    printed, _ = run(f"{flags} 200 --dt 0.02 --integrator gauss", *BARE)
    assert cells(printed, "project")[3] == "over 450" and words in printed
    printed, _ = run(f"{flags} 20", *BARE)
    assert words not in printed


def test_the_time_that_was_simulated_is_never_told_as_zero(run):
    printed, _ = run("--dt 1e-6 --steps 100", *BARE)
    assert "for 100 steps of 1e-06 s -> 0.0001 s of sim time\n" in printed


FORCES = [  # the largest force at the steps, the share by which it may be larger, and what is shown
    (123.456, 0.0, "123"),
    (123.456, 0.01, "120"),
    (123.456, 0.3, "over 120"),
    (129.9, 0.3, "over 120"),  # and not over 130
    (50.05, 0.0, "50.0"),
    (0.98765, 0.0, "0.988"),
    (1574.0, 0.0, "1570"),
    (99_949.0, 0.0, "99900"),
    (123_456.0, 0.0, "1.23e5"),
    (4.9e9, 0.3, "over 4.9e9"),
    (0.0, 0.0, "0"),
    (None, None, "-"),
]


@pytest.mark.parametrize(("most", "between", "shown"), FORCES)
def test_a_force_has_the_digits_that_it_keeps_between_steps(most, between, shown):
    assert table.force({"tension_max": most, "tension_between": between}) == shown


def test_the_largest_force_is_the_hardest_push_or_pull_and_knows_its_neighbours():
    def largest(*pulls):
        found = table.largest_force(np.array(pulls, float))
        return found["tension_max"], found["tension_between"]

    times = np.linspace(-1.0, 1.0, 8)  # none at the peak
    parabola = -(5.0 - 2.0 * times**2)  # which pushes
    assert largest(*np.stack([0.0 * times, parabola], axis=1)) == pytest.approx(
        (np.max(-parabola), 5.0 / np.max(-parabola) - 1.0), abs=0.01
    )
    assert largest([1.0], [9.0], [1.0]) == (9.0, pytest.approx(2.0 / 9.0))
    assert largest([9.0], [1.0], [1.0]) == (9.0, 0.0)  # nothing is before the start
    assert largest([1.0], [np.nan], [3.0]) == (3.0, 0.0)
    assert largest([8.0], [3.0], [np.nan], [3.0]) == (8.0, 0.0)  # a gap in what is lower
    most, between = largest([1.0], [4.0], [np.nan], [4.0], [1.0])  # steep towards a gap
    assert most == 4.0 and between >= 0.75
    assert largest([np.nan], [np.nan]) == (None, None)
    assert largest([1.0, np.nan], [2.0, 3.0]) == (3.0, 0.0)  # one rod is enough


def edited_loop(edit):
    """The chapter's loop as a reader may edit it: after step i, edit(i, system, v, dt) gives dt.

    v is that of the state that was reached, and may be changed. Without a dt the loop ends.
    """

    def simulate(step_fn, system, force, dt, steps):
        q = system["q0"].copy()
        v = system["v0"].copy()
        all_q = np.full((steps + 1, *q.shape), np.nan)
        all_v = np.full((steps + 1, *v.shape), np.nan)
        all_q[0] = q
        all_v[0] = v
        for i in range(steps):
            q, v = step_fn(q, v, system["m"], force, dt)
            dt = edit(i, system, v, dt)
            all_q[i + 1] = q
            all_v[i + 1] = v
            if dt is None:
                break
        return c.Run(system, all_q, all_v)

    return simulate


def shorter_steps(i, system, v, dt):
    return dt / 2 if i == 40 else dt


def heavier_tip(i, system, v, dt):
    if i == 40:
        system["m"][-1] = 5.0
    return dt


def a_kick(i, system, v, dt):
    if i == 40:
        v[0] *= 1.5
    return dt


def an_early_kick(i, system, v, dt):
    if i == 0:
        v[0, 1] -= 0.5
    return dt


def a_break(i, system, v, dt):
    return dt if i < 40 else None


EDITS = [shorter_steps, heavier_tip, a_kick, an_early_kick, a_break]


@pytest.mark.parametrize("edit", EDITS)
def test_an_edit_in_the_loop_is_obeyed_and_the_same_with_plain(edit, monkeypatch, tmp_path, capsys):
    def results(simulate, flag):
        monkeypatch.setattr(c, "simulate", simulate)
        c.main(["--steps=60", "--no-rerun", flag, f"--out={tmp_path}"])
        found = json.loads((tmp_path / output.METRICS).read_text())["results"]
        nothing = {"error": None, "operations": None}  # which --plain does not find
        return {name: row | nothing for name, row in found.items()}

    usual = results(c.simulate, "--no-page")
    plain = results(edited_loop(edit), "--plain")
    capsys.readouterr()
    compiled = results(edited_loop(edit), "--page")
    printed = capsys.readouterr().out
    assert compiled == plain and all(plain[name] != usual[name] for name in usual)
    assert all(len(cells(printed, name)) == 6 for name in usual)
    alone = results(edited_loop(edit), "--stabilization=project")
    assert alone == {"project": plain["project"]}  # no edit reaches the next method
    edits = f"{output.PAGE} shows the scene without what the loop edits"
    said = "its loop ended at 0.205 s" if edit is a_break else edits
    assert said in printed


def tip_of(files):
    """The x of the tip at the end of a run under none, in m, by its metrics.json."""
    return json.loads(files[output.METRICS])["results"]["none"]["tip_final"][0]


def test_what_changes_beside_arguments_ends_a_run_before_a_file(monkeypatch, tmp_path, capsys):
    wind = np.zeros(3)  # m/s^2

    def blows(i, system, v, dt):
        wind[0] = 3.0 * (i > 100)
        return dt

    def blown(system, q, v=None):
        return system["m"] * (c.GRAVITY + wind)

    run = ["--stabilization=none", "--steps=200", f"--out={tmp_path}"]
    c.main(run)
    before = contents(tmp_path)
    capsys.readouterr()
    monkeypatch.setattr(c, "external_force", blown)
    monkeypatch.setattr(c, "simulate", edited_loop(blows))
    with pytest.raises(StepChanged, match=r"step \d+ .*--plain"):
        c.main(run)
    assert contents(tmp_path) == before and "none" not in capsys.readouterr().out
    wind[0] = 0.0
    c.main([*run, "--plain"])
    assert tip_of(contents(tmp_path)) > tip_of(before) + 0.1  # m


def test_a_run_leaves_its_files_and_none_of_an_earlier_run(tmp_path, monkeypatch, capsys):
    """A system may be called as its folder. A file that is not made has a line that says why."""
    monkeypatch.chdir(tmp_path)
    run = ["--system", "spin", "--out", "spin", "--steps", "9"]
    c.main(run)
    (tmp_path / "spin" / "notes.txt").write_text("mine")
    assert contents(tmp_path).keys() == FILES | {"notes.txt"}
    c.main([*run, "--no-rerun", "--plain"])
    printed = capsys.readouterr().out
    assert f"{output.PAGE} is left out: steps are not compiled" in printed
    assert "- no reference: steps are not compiled" in printed
    assert cells(printed, r"project\*")[4] == "-"
    assert contents(tmp_path).keys() == {output.METRICS, "notes.txt"}


@pytest.mark.parametrize("name", sorted(FILES))
@pytest.mark.parametrize("text", ["mine", '{"system": "mine"}', "[1]", 10**5 * "["], ids=len)
def test_a_folder_with_a_file_of_somebody_elses_is_refused_and_stays(name, text, tmp_path, refused):
    (tmp_path / name).write_text(text)
    assert f"{name} is not of a run" in refused("--out", tmp_path)
    assert contents(tmp_path) == {name: text.encode()}


def test_what_cannot_be_written_is_refused_before_it_is_computed(tmp_path, refused):
    (tmp_path / "file").touch()
    (tmp_path / output.PAGE).mkdir()
    for place in (tmp_path, tmp_path / "file", tmp_path / "file" / "below"):
        assert f"error: {place}" in refused("--out", place)
    assert len([*tmp_path.iterdir()]) == 2


def test_files_are_written_all_or_none_and_a_signal_waits_for_the_last(tmp_path, monkeypatch):
    heed = signal.signal(signal.SIGINT, signal.default_int_handler)  # it may be ignored
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")  # which may be another file system
    files.write_together(tmp_path, {"a": "old", "c": "old"})
    with pytest.raises(TypeError):
        files.write_together(tmp_path, {"a": "new", "b": 0, "c": None})
    assert contents(tmp_path) == {"a": b"old", "c": b"old"}

    def interrupted(*paths):
        monkeypatch.undo()  # once is enough
        signal.raise_signal(signal.SIGINT)
        files.Path.replace(*paths)

    monkeypatch.setattr(files.Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.write_together(tmp_path, {"a": "new", "b": "new", "c": None})
    signal.signal(signal.SIGINT, heed)
    assert contents(tmp_path) == {"a": b"new", "b": b"new"}


def test_rerun_may_be_switched_off(tmp_path):
    run = "constraints.py", "--steps", 9, "--out", tmp_path
    done = python(*run, variables={"RERUN": "off"})
    assert f"{output.RECORDING} is left out: RERUN=off switches rerun off\n" in done.stdout
    assert done.returncode == 0 and contents(tmp_path).keys() == FILES - {output.RECORDING}


def test_whatever_goes_wrong_in_a_recording_its_run_is_written(tmp_path, monkeypatch, capsys):
    from curriculum.ch3_4_constraints.results import recording

    class Panic(BaseException):
        pass

    def older(*_):
        raise AttributeError("no memory_recording\nin this version")

    def panics(*_):
        raise Panic

    for broken, said in ((older, "no memory_recording in this version"), (panics, "Panic")):
        monkeypatch.setattr(recording, "record", broken)
        assert c.main(["--steps", "9", f"--out={tmp_path}"]) == 0
        assert f"{output.RECORDING} is left out: {said}; pip" in capsys.readouterr().out
        assert contents(tmp_path).keys() == FILES - {output.RECORDING}


@pytest.mark.parametrize("error", ["ModuleNotFoundError", "RuntimeError", "AttributeError"])
def test_without_a_rerun_that_works_a_run_needs_numpy_alone_and_is_not_lost(error, tmp_path):
    for name in "rerun", "pyarrow", "scipy", "llvmlite":
        (tmp_path / f"{name}.py").write_text(f"raise {error}('no driver')")
    run = "constraints.py", "--steps", 9, "--out", tmp_path / "out"
    done = python(*run, variables={"PYTHONPATH": str(tmp_path)})
    why = "no driver; pip install --upgrade rerun-sdk may help"
    assert f"{output.RECORDING} is left out: {why}\n" in done.stdout
    assert done.returncode == 0 and contents(tmp_path / "out").keys() == FILES - {output.RECORDING}
