"""The table, metrics.json, and the files of a run: whole or not at all, nobody else's touched."""

import ast
import json
import re
import signal
from itertools import cycle

import numpy as np
import pytest
from conftest import BARE, python

import constraints as c
from curriculum.ch3_4_constraints import output, table
from curriculum.common import files

FILES = {output.METRICS, output.PAGE, output.RECORDING}


@pytest.fixture
def run(tmp_path, capsys):
    """run("--flag value"): what main printed, and what metrics.json holds."""

    def made(flags, *more):
        assert c.main([*flags.split(), *more, "--out", str(tmp_path)]) == 0
        text = (tmp_path / output.METRICS).read_text()
        return capsys.readouterr().out, json.loads(text, parse_constant=pytest.fail)

    return made


def cells(printed, name):
    """Those of a method in the table."""
    (line,) = re.findall(rf"^{name} +(.*)$", printed.partition("\nmethod ")[2], re.M)
    return re.split(" {2,}", line)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_run_prints_the_courses_first_lines_and_what_metrics_json_and_python_have(run):
    printed, metrics = run("--smoke --seed 3", *BARE)
    assert printed.startswith(
        "ch3.4 constraints | device cpu\n"
        "integrated double (semi_implicit) for 800 steps of 0.005 s -> 4.00 s of sim time\n"
        "seed 3; compiled to "
    )
    used = {"system": "double", "integrator": "semi_implicit", "dt": 0.005, "steps": 800, "seed": 3}
    assert used.items() <= metrics.items() and metrics["baumgarte"] == 20.0
    assert metrics["error_at"] == 2.0  # s
    for name, found in metrics["results"].items():
        done = c.run_method(c.build_system("double", 3), name, "semi_implicit", 0.005, 800)
        drift = (done.energies - done.energies[0]) / (2.0 * 9.81 * 2.0)
        worst, end = np.max(done.violations), done.violations[800]
        energy, jump = np.max(np.abs(drift)), np.max(np.abs(np.diff(drift)))
        keys = "max_violation", "final_violation", "energy_rel_max", "energy_step_max"
        for key, x in zip(keys, (worst, end, energy, jump), strict=True):
            assert abs(found[key] - x) <= 0.51e-12 and found[key] == round(found[key], 12)
        assert found["tip_final"] == [round(x, 6) for x in done.tip[800]]
        *lengths, pace = cells(printed, name)
        assert lengths.pop(2) == table.per_cent(energy) and float(pace) > 0.0
        assert lengths == [table.length(x) for x in (worst, end, found["error"])]


def test_what_a_reader_must_know_is_said_in_lines_that_fit_a_terminal(run, tmp_path, monkeypatch):
    monkeypatch.setattr(c, "constraint_residual", lambda *a, **k: 1.1e-3)
    printed, metrics = run("--integrator rk4 --dt 0.1 --steps 90 --baumgarte 30 --no-page")
    assert max(map(len, printed.replace(str(tmp_path), "out").splitlines())) <= 80
    assert metrics["results"].keys() == c.stabilizations(1.0).keys() - {"impulse"}
    for words in (
        "impulse is left out: it is not made for rk4",
        "a step of 0.1 s is long: it is 0.31 sqrt(L/g) of the shortest rod",
        "baumgarte: dt w = 3 is past its limit 2.79",
        "* project: no tensions make an acceleration of 0.0011 m/s^2 that its rods ask for",
    ):
        assert words in " ".join(printed.split())


def test_a_length_has_two_digits_and_its_unit():
    words = map(table.length, (9.9e-13, 4.56e-10, 2.34e-8, 9.94e-4, 9.96e-4, 0.384, 0.999, 123.4))
    assert [*words] == ["< 1 pm", "460 pm", "23 nm", "990 um", "0.1 cm", "38 cm", "1 m", "120 m"]


def test_a_run_that_diverges_ends_before_rods_are_off_by_100_times_their_length(run):
    printed, metrics = run("--dt 0.05 --baumgarte 50 --steps 800 --seed 0", *BARE)
    system, baumgarte = c.build_system("double"), ("baumgarte", "semi_implicit")
    done = c.run_method(system, *baumgarte, 0.05, 800, baumgarte=50.0)
    q, _ = c.one_step(system, *baumgarte, done.q[-1], done.v[-1], 0.05, baumgarte=50.0)
    assert np.max(done.violations) < 200.0 <= c.constraint_violation(system, q)
    lost = f"lost at {0.05 * (len(done.tip) - 1):.3g} s: diverged"
    assert metrics["results"]["baumgarte"]["stopped"] == lost
    jump = np.argmax(np.abs(np.diff(done.energies)) > 0.1 * 2.0 * 9.81 * 2.0)
    off = f"{lost}; rods had left the constraint by {table.length(done.violations[jump])}"
    assert " ".join(cells(printed, "baumgarte")) == off
    assert "verdict: " not in printed


def test_a_readers_own_rows_are_in_help_table_and_all_files(run, tmp_path, capsys, monkeypatch):
    """One whose step fails ends, and no other; one that makes energy jump has a mark."""

    def torn(system, q_start, q, v, dt):
        return c.while_loop(lambda x: x[0, 1] < -0.5, lambda x: x, q, 5, "it is torn"), v

    def halt(system, q_start, q, v, dt):
        return q, np.where(q[0, 1] < -0.5, 0.0, 1.0) * v

    own = {"torn": c.Stabilization(post_step=torn), "halt": c.Stabilization(post_step=halt)}
    usual = c.stabilizations
    monkeypatch.setattr(c, "stabilizations", lambda *a, **k: usual(*a, **k) | own)
    with pytest.raises(SystemExit):
        c.main(["--help"])
    assert "none,baumgarte,impulse,soft,project,torn,halt" in capsys.readouterr().out
    printed, metrics = run("--system pendulum --steps 400")
    assert all(b"torn" in (tmp_path / name).read_bytes() for name in FILES)
    states = c.run_method(c.build_system("pendulum"), "none", "semi_implicit", 0.005, 400).q
    last = int(np.argmax(states[:, 0, 1] < -0.5)) - 1
    assert cells(printed, "torn") == [f"lost at {0.005 * last:.3g} s: it is torn"]
    assert metrics["results"]["none"]["stopped"] is None
    share = table.per_cent(metrics["results"]["halt"]["energy_step_max"])
    assert cells(printed, r"halt\*") and f"* halt: energy jumps by {share} of m g L" in printed


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ("--smoke", "as expected, over 3"),
        ("--smoke --baumgarte 0.1", "UNEXPECTED, not over 3"),
        ("--smoke --baumgarte 0", None),
        ("--smoke --stabilization baumgarte", None),
        ("--smoke --system chain --links 2", None),
        (f"--steps {c.SMOKE_STEPS - 1}", None),
    ],
)
def test_the_verdict_is_of_the_chapters_systems_and_of_runs_long_enough(flags, words, run):
    printed, metrics = run(flags, *BARE)
    lines = re.findall("^verdict: worst rod error, none / baumgarte = (.*): (.*)$", printed, re.M)
    if words:
        none, other = (metrics["results"][x]["max_violation"] for x in ("none", "baumgarte"))
    assert lines == ([(f"{none / other:.1f}", words)] if words else [])


def test_plain_names_each_method_first_has_no_reference_and_the_same_figures(run):
    _, compiled = run("--steps 60", *BARE)
    printed, plain = run("--steps 60 --plain", *BARE)
    names = list(c.stabilizations(1.0))
    assert printed.splitlines()[1 : len(names) + 1] == names
    assert "- no reference: steps are not compiled" in printed and "plain numpy" in printed
    assert [cells(printed, name)[3] for name in names] == ["-"] * len(names)
    for name, found in plain["results"].items():
        assert found == compiled["results"][name] | {"error": None}


def test_show_step_prints_python_or_why_not_and_writes_nothing(tmp_path, capsys, monkeypatch):
    c.main(["--show-step", "--system", "pendulum", "--out", str(tmp_path / "x")])
    (function,) = ast.parse(capsys.readouterr().out).body
    assert "9.81" in ast.unparse(function) and not [*tmp_path.iterdir()]
    monkeypatch.setattr(c, "external_force", lambda system, q, v: -q if q[0, 1] < 9.0 else q)
    c.main(["--show-step", "--out", str(tmp_path / "x")])
    assert "it branches on a value" in capsys.readouterr().out


def test_a_simulate_of_chapter_3_3_returns_three_arrays_and_is_shown(run, monkeypatch):
    def simulate(step_fn, system, force, dt, steps):
        q, v, rows = system["q0"], system["v0"], []
        for _ in range(steps + 1):
            rows.append((q[-1], c.constraint_violation(system, q), c.energy(system, q, v)))
            q, v = step_fn(q, v, system["m"], force, dt)
        return map(np.array, zip(*rows, strict=True))

    _, usual = run("--steps 40", *BARE)
    monkeypatch.setattr(c, "simulate", simulate)
    printed, metrics = run("--steps 40")
    assert "- not known: this simulate returns no states" in printed
    for name, found in metrics["results"].items():
        assert cells(printed, name)[3:] == ["-", "-"]
        assert found == usual["results"][name] | {"error": None, "constraint_residual": None}


def test_without_gravity_energy_is_a_share_of_something(run, monkeypatch):
    monkeypatch.setattr(c, "GRAVITY", 0.0 * c.GRAVITY)
    _, metrics = run("--system spin --smoke")
    assert 0.0 < metrics["results"]["impulse"]["energy_rel_max"] < 1e3


def test_a_run_leaves_its_files_and_none_of_an_earlier_run(tmp_path, monkeypatch, capsys):
    """A system may be called as its folder. A page that cannot be made has a line that says why."""
    monkeypatch.chdir(tmp_path)
    run = ["--system", "spin", "--out", "spin", "--steps", "9"]
    c.main(run)
    (tmp_path / "spin" / "notes.txt").write_text("mine")
    assert contents(tmp_path).keys() == FILES | {"notes.txt"}
    gust = cycle([c.GRAVITY, 0.0 * c.GRAVITY, -c.GRAVITY])  # what is compiled has one for ever
    monkeypatch.setattr(c, "external_force", lambda system, q, v: system["m"] * next(gust))
    c.main([*run, "--no-rerun"])
    printed = capsys.readouterr().out
    assert f"{output.PAGE} is left out: " in printed and "- no reference: steps are not" in printed
    assert contents(tmp_path).keys() == {output.METRICS, "notes.txt"}


@pytest.mark.parametrize("name", sorted(FILES))
@pytest.mark.parametrize("text", ["mine", '{"system": "mine"}', "[1]"])
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


def test_states_that_take_too_much_memory_are_refused_with_what_fits(refused, tmp_path):
    fit = int(4e9 / (2 * 5 * 96))  # particles, methods, bytes
    line = refused("--steps", fit + 1, "--out", tmp_path)
    assert f"{fit + 1} steps take more than 4 GB; {fit} fit" in line
    assert c.parse_args(["--steps", str(fit), "--out", str(tmp_path)])


def test_files_are_written_all_or_none_and_a_signal_waits_for_the_last(tmp_path, monkeypatch):
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
    assert contents(tmp_path) == {"a": b"new", "b": b"new"}


def test_without_rerun_a_run_needs_numpy_alone_and_a_line_says_how_to_get_it(tmp_path):
    code = """import sys
sys.modules |= dict.fromkeys(["rerun", "pyarrow", "scipy", "llvmlite"])
import constraints
constraints.main(sys.argv[1:])"""
    done = python("-c", code, "--steps", "9", "--no-page", "--out", tmp_path)
    assert f"{output.RECORDING} is left out: it needs rerun: pip install rerun-sdk\n" in done.stdout
    assert done.returncode == 0 and contents(tmp_path).keys() == {output.METRICS}
