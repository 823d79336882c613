"""What a run hands over: every flag counts, and table, verdict and metrics.json say what was
simulated."""

import json
from itertools import count
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import drift, run
from curriculum.common import motion
from curriculum.common.motion import distance
from curriculum.common.ruler import true_position

import pytest


@pytest.fixture
def results(tmp_path, capsys):
    """results(*flags): the metrics of a short run with these flags, and the lines that it
    prints."""

    def of(*flags):
        c.main(["--no-rerun", "--steps", "200", "--out", str(tmp_path), *flags])
        found = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
        return found, capsys.readouterr().out.splitlines()

    return of


@pytest.mark.parametrize(
    ("flag", "value", "mode"),
    [
        ("--seed", "1", "none"),
        ("--system", "triple", "none"),
        ("--integrator", "rk4", "none"),
        ("--baumgarte", "10", "baumgarte"),
        ("--time-constant", "0.05", "soft"),
        ("--impedance", "0.5", "soft"),
        ("--dt", "0.004", "impulse"),
        ("--steps", "201", "project"),
    ],
)
def test_every_flag_reaches_the_result_and_stands_beside_it(flag, value, mode, results):
    (found, _), (plain, _) = results(flag, value), results()
    assert found["results"][mode] != plain["results"][mode]
    noted = found[flag.strip("-").replace("-", "_")]
    assert noted == type(noted)(value)


def test_links_are_the_rods_of_a_chain(results):
    for links in (3, 6):
        found, _ = results("--system", "chain", "--links", str(links), "--steps", "1")
        assert found["rods"] == links
        assert found["results"]["none"]["tip_final"][0] == pytest.approx(links, rel=2e-3)


def test_smoke_is_a_short_run_whatever_steps_says(results):
    smoke, _ = results("--smoke", "--steps", "7")
    assert 7 < smoke["steps"] < 4000
    assert smoke == results("--steps", str(smoke["steps"]))[0]
    assert smoke["error_at"] == 2.0


def test_metrics_are_the_run_rounded(results, tmp_path):
    found, _ = results()
    text = (tmp_path / "metrics.json").read_text(encoding="utf-8")
    assert text == json.dumps(found, indent=2, sort_keys=True) + "\n"
    system, row = c.build_system("double"), found["results"]["baumgarte"]
    here = run(system, hold=20.0, steps=200)
    assert row["tip_final"] == [round(x, 6) for x in here.tip[-1].tolist()]
    for key, value in (
        ("max_violation", here.violations.max()),
        ("final_violation", here.violations[-1]),
    ):
        assert row[key] == round(float(value), 12)
    assert row["energy_rel_max"] == round(float(drift(system, here)), 12)
    truth, _ = true_position(lambda rule, dt, steps: run(system, rule, "project", dt, steps), 1.0)
    assert found["error_at"] == 1.0 and row["error"] == pytest.approx(
        distance(here.q[-1], truth), abs=1e-11
    )


def test_the_table_is_the_metrics_and_the_pace(results, monkeypatch):
    """By a clock that says one second has gone by, whenever it is asked for the second time."""
    monkeypatch.setattr(motion, "time", SimpleNamespace(perf_counter=count().__next__))
    found, lines = results("--steps", "100")
    first = [line.partition(" ")[0] for line in lines]
    start = first.index("mode") + 1
    assert first[start : start + 5] == list(c.hold_table()) and sorted(found["results"]) == sorted(
        c.hold_table()
    )
    for line in lines[start : start + 5]:
        mode, *numbers = line.split()
        row = found["results"][mode]
        keys = ("max_violation", "final_violation", "energy_rel_max", "error")
        assert [float(x) for x in numbers[:4]] == pytest.approx(
            [row[key] for key in keys], rel=0.05
        )
        assert [float(x) for x in numbers[4:6]] == pytest.approx(row["tip_final"][:2], abs=1e-3)
        assert float(numbers[6]) == 1e6 / 100
    assert any(f"at {found['error_at']:g} s, m" in line for line in lines[:start])


@pytest.mark.parametrize(
    ("flags", "verdict"),
    [("", "as expected"), ("--system pendulum", "as expected"), ("--baumgarte 0.5", "UNEXPECTED")],
)
def test_the_verdict_is_the_ratio_of_the_worst_rod_errors(flags, verdict, results):
    found, lines = results("--smoke", *flags.split())
    (line,) = (line for line in lines if line.startswith("verdict: "))
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
    _, lines = results("--steps", "1000", *flags.split())
    assert not [line for line in lines if line.startswith("verdict")]
