"""What a run hands over: every flag counts, and table, verdict and metrics say what was run."""

import json
from itertools import count
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import drift, run
from curriculum.ch3_4_constraints.tables import length, per_cent
from curriculum.common import steps as motion
from curriculum.common.runs import distance
from curriculum.common.ruler import true_position

import pytest

MODES = list(c.hold_table())


@pytest.fixture
def results(tmp_path, capsys):
    """results(flags): the metrics of a short run with these flags, and the lines that it prints."""

    def of(flags="", steps=200):
        c.main(["--no-rerun", "--steps", str(steps), "--out", str(tmp_path), *flags.split()])
        text = (tmp_path / "metrics.json").read_text(encoding="utf-8")
        found = json.loads(text, parse_constant=lambda name: pytest.fail(name))
        assert text == json.dumps(found, indent=2, sort_keys=True) + "\n"
        return found, capsys.readouterr().out.splitlines()

    return of


def marked(lines, mark="* "):
    """The sentences below the table that begin with a mark."""
    return [line for line in lines if line.startswith(mark)]


@pytest.mark.parametrize(
    ("flag", "mode"),
    [
        ("--seed 1", "none"),
        ("--system triple", "none"),
        ("--integrator rk4", "none"),
        ("--baumgarte 10", "baumgarte"),
        ("--time-constant 0.05", "soft"),
        ("--impedance 0.5", "soft"),
        ("--dt 0.004", "impulse"),
        ("--steps 201", "project"),
    ],
)
def test_every_flag_reaches_the_result_and_stands_beside_it(flag, mode, results):
    (found, _), (plain, _) = results(flag), results()
    assert found["results"][mode] != plain["results"][mode]
    name, value = flag.strip("-").replace("-", "_").split()
    assert found[name] == type(found[name])(value)


def test_links_are_the_rods_of_a_chain(results):
    for links in (3, 6):
        found, _ = results(f"--system chain --links {links}", 1)
        assert found["rods"] == links
        assert found["results"]["none"]["tip_final"][0] == pytest.approx(links, rel=2e-3)


def test_smoke_is_a_short_run_whatever_steps_says(results):
    smoke, _ = results("--smoke", 7)
    assert 7 < smoke["steps"] < 4000
    assert smoke == results(steps=smoke["steps"])[0]
    assert smoke["error_at"] == 2.0


def test_no_step_is_lost_where_seconds_divide_badly(results):
    """2001 * 0.001 / 0.001 is 2000.9999999999998."""
    found, _ = results("--dt 0.001 --stabilization none", 2001)
    assert found["steps"] == 2001


def test_a_tolerance_is_held_at_two_seconds_whatever_step_it_finds(results):
    found, lines = results("--integrator gauss --tol 1e-6 --dt 0.005", 450)
    errors = {mode: row["error"] for mode, row in found["results"].items()}
    assert found["dt"] > 0.005 and found["error_at"] == pytest.approx(2.0)
    assert min(errors.values()) <= 1e-6 < max(errors.values())
    (line,) = marked(lines, "--tol")
    assert all((mode in line.split("not met by")[1]) == (x > 1e-6) for mode, x in errors.items())


@pytest.mark.parametrize("flags", ["--links 40 --system chain", "--system heavy_tip"])
def test_a_tolerance_that_nobody_could_judge_is_refused(flags, results, capsys):
    with pytest.raises(SystemExit, match="2"):
        results(f"--integrator gauss --tol 0.001 {flags}", 400)
    line = capsys.readouterr().err
    assert "error: argument --tol: " in line and " 0.001 m" in line and line.count("\n") == 1


def test_metrics_are_the_run_rounded(results):
    found, _ = results()
    system, row = c.build_system("double"), found["results"]["baumgarte"]
    here = run(system, hold=20.0, steps=200)
    assert row["tip_final"] == [round(x, 6) for x in here.tip[-1].tolist()]
    assert row["max_violation"] == round(float(here.violations.max()), 12)
    assert row["final_violation"] == round(float(here.violations[-1]), 12)
    assert row["energy_rel_max"] == round(float(drift(system, here)), 12)
    truth, _ = true_position(lambda rule, dt, steps: run(system, rule, "project", dt, steps), 1.0)
    assert found["error_at"] == 1.0
    assert row["error"] == pytest.approx(distance(here.q[-1], truth), abs=1e-11)


@pytest.mark.parametrize(
    ("metres", "words"),
    [
        (0.384014620396, "38 cm"),
        (0.0013, "0.13 cm"),
        (0.996, "1 m"),
        (23.4, "23 m"),
        (3.4e-5, "34 um"),
        (5.5e-9, "5.5 nm"),
        (9.98e-13, "< 1 pm"),
        (0.0, "< 1 pm"),
        (1.26e-12, "1.3 pm"),
    ],
)
def test_a_length_has_two_digits_and_a_unit(metres, words):
    assert length(metres) == words


def test_the_table_is_the_metrics_with_units_and_the_pace(results, monkeypatch):
    """By a clock that says one second has gone by, whenever it is asked for the second time."""
    monkeypatch.setattr(motion, "time", SimpleNamespace(perf_counter=count().__next__))
    found, lines = results(steps=100)
    start = next(k for k, line in enumerate(lines) if line.startswith("mode ")) + 1
    for mode, line in zip(MODES, lines[start:], strict=False):
        row = found["results"][mode]
        rods = [length(row[key] - 5e-13) for key in ("max_violation", "final_violation")]
        rest = per_cent(row["energy_rel_max"]), length(row["error"]), "1e+04"
        assert line.split() == " ".join((mode, *rods, *rest)).split()
    assert f"at {found['error_at']:g} s" in lines[start - 1]
    assert max(map(len, lines[1 : start + 5])) <= 80


def test_every_mark_and_dash_in_the_table_has_its_sentence(results):
    found, lines = results("--dt 0.05 --baumgarte 40")
    assert marked(lines, "baumgarte* ")
    (line,) = marked(lines)
    assert found["results"]["baumgarte"]["stopped"] in line and line.startswith("* baumgarte div")
    assert "- baumgarte: stopped before 2 s" in lines
    assert any("dt*omega 2 is past the limit 0.828" in line for line in lines)
    _, lines = results("--system chain --links 41", 5)
    (line,) = marked(lines, "- ")
    assert "is not known" in line


@pytest.mark.parametrize("rule", c.INTEGRATORS)
def test_a_hopeless_step_still_gives_results(rule, results):
    found, lines = results(f"--dt 100 --integrator {rule}", 10)
    for mode, row in found["results"].items():
        told = [x for x in marked(lines, f"* {mode} ") if x.endswith(str(row["stopped"]))]
        assert len(told) == (row["stopped"] is not None)
    assert found["results"]["none"]["stopped"] and found["results"]["baumgarte"]["stopped"]


@pytest.mark.parametrize(
    ("flags", "verdict"),
    [("", "as expected"), ("--system pendulum", "as expected"), ("--baumgarte 0.5", "UNEXPECTED")],
)
def test_the_verdict_is_the_ratio_of_the_worst_rod_errors(flags, verdict, results):
    found, lines = results(f"--smoke {flags}")
    (line,) = marked(lines, "verdict: ")
    none, helped = (found["results"][mode]["max_violation"] for mode in ("none", "baumgarte"))
    assert f" = {none / helped:.1f}: {verdict}" in line


@pytest.mark.parametrize(
    "flags",
    [
        "--steps 700",  # too short to tell
        "--stabilization none",  # nothing to compare with
        "--stabilization baumgarte",
        "--system chain",  # not the chapter's
        "--dt 0.05 --baumgarte 40",  # diverges
        "--baumgarte 0",  # is none itself
        "--integrator gauss --dt 0.05",  # does not drift
    ],
)
def test_no_verdict_where_it_would_mean_nothing(flags, results):
    assert not marked(results(flags, 1000)[1], "verdict")
