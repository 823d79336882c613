"""The table, metrics.json, and the files of a run: whole or not at all, nobody else's touched."""

import json
import re
import signal
import tempfile
from functools import partial

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
        worst, end = np.max(done.violations), done.violations[800]
        energy, jump = np.max(np.abs(drift)), np.max(np.abs(np.diff(drift)))
        keys = "max_violation", "final_violation", "energy_rel_max", "energy_step_max"
        for key, x in zip(keys, (worst, end, energy, jump), strict=True):
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
    share = table.per_cent(metrics["results"]["soft"]["energy_step_max"])
    assert cells(printed, r"soft\*") and f"* soft: energy jumps by {share}" in said


def test_a_length_has_two_digits_and_its_unit_and_a_share_is_per_cent():
    known = Reference(step=1, at="", q=np.zeros((1, 3)), uncertainty=2e-9)
    words = [table.error(x, known) for x in (None, 1e-9, 3e-9)]
    assert words == ["-", "< 2 nm", "3 nm"]
    assert [*map(table.per_cent, (0.384, 1.0, 2.44e-5))] == ["38 %", "100 %", "0.0024 %"]
    words = map(table.length, (9.9e-13, 4.56e-10, 2.34e-8, 9.94e-4, 9.96e-4, 0.384, 0.999, 123.4))
    assert [*words] == ["< 1 pm", "460 pm", "23 nm", "990 um", "0.1 cm", "38 cm", "1 m", "120 m"]


def test_a_readers_own_row_is_in_all_files_and_fails_alone(run, tmp_path, monkeypatch):
    def torn(system, q_start, q, v, dt):
        low = {"most": 5, "failure": "it is torn"}
        return c.while_loop(lambda x: x[0, 1] < -0.5, lambda x: x, q, **low), v

    usual, own = c.make_methods, {"torn": c.Method(c.make_force, "tears", torn)}
    monkeypatch.setattr(c, "make_methods", lambda *a, **k: usual(*a, **k) | own)
    printed, metrics = run("--system pendulum --steps 400")
    assert all(b"torn" in (tmp_path / name).read_bytes() for name in FILES)
    assert re.fullmatch(r"lost at [\d.]+ s: it is torn", *cells(printed, "torn"))
    assert metrics["results"]["none"]["stopped"] is None


VERDICTS = {
    "--smoke": ["as expected"],
    "--smoke --baumgarte 0.1": ["UNEXPECTED"],
    "--smoke --baumgarte 600": [],  # which is lost
    "--smoke --system chain --links 2": [],
    f"--steps {c.SMOKE_STEPS - 1}": ["as expected"],
}


@pytest.mark.parametrize(("flags", "words"), VERDICTS.items())
def test_the_verdict_is_of_the_chapters_systems_and_of_runs_long_enough(flags, words, run):
    printed, _ = run(flags, *BARE)
    assert re.findall("as expected|UNEXPECTED", printed) == words


def edited_loop(edit):
    """The page's loop as a reader may edit it: after step i, edit(i, system, v, dt) gives dt.

    v is that of the state that was reached, and may be changed. Without a dt the loop ends.
    """

    def simulate(step_fn, system, force, dt, steps):
        q = np.full_like(system["q0"], np.nan, shape=(steps + 1, *system["q0"].shape))
        v = np.full_like(q, np.nan)
        q[0] = system["q0"]
        v[0] = system["v0"]
        for i in range(steps):
            q[i + 1], v[i + 1] = step_fn(q[i], v[i], system["m"], force, dt)
            dt = edit(i, system, v[i + 1], dt)
            if dt is None:
                break
        return c.Run(q, v, q[:, -1], c.constraint_violation(system, q), c.energy(system, q, v))

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
    usual, windy = (json.loads(x[output.METRICS]) for x in (before, contents(tmp_path)))
    still, moved = (x["results"]["none"]["tip_final"][0] for x in (usual, windy))
    assert moved > still + 0.1  # m


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


@pytest.mark.parametrize("error", ["ModuleNotFoundError", "RuntimeError"])
def test_without_a_rerun_that_works_a_run_needs_numpy_alone_and_is_not_lost(error, tmp_path):
    for name in "rerun", "pyarrow", "scipy", "llvmlite":
        (tmp_path / f"{name}.py").write_text(f"raise {error}('no driver')")
    run = "constraints.py", "--steps", 9, "--out", tmp_path / "out"
    done = python(*run, variables={"PYTHONPATH": str(tmp_path)})
    why = "no driver; pip install rerun-sdk may help"
    assert f"{output.RECORDING} is left out: {why}\n" in done.stdout
    assert done.returncode == 0 and contents(tmp_path / "out").keys() == FILES - {output.RECORDING}
