"""What a run hands over: every flag counts, metrics.json and the recording hold what was simulated."""

import json

import numpy as np
import pytest

import constraints as c
from curriculum.common import recording


def results(tmp_path, *flags):
    c.main(["--no-rerun", "--steps", "200", "--out", str(tmp_path), *flags])
    return json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))


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
def test_every_flag_reaches_the_result(flag, value, mode, tmp_path, capsys):
    assert results(tmp_path, flag, value)["results"][mode] != results(tmp_path)["results"][mode]
    capsys.readouterr()


def test_links_are_the_rods_of_a_chain(tmp_path, capsys):
    for links in (3, 6):
        found = results(tmp_path, "--system", "chain", "--links", str(links), "--steps", "1")
        assert found["results"]["none"]["tip_final"][0] == pytest.approx(links, rel=2e-3)
    capsys.readouterr()


def test_metrics_are_the_run_rounded(tmp_path, capsys):
    found = results(tmp_path)
    run = c.simulate(c.build_system("double"), hold=20.0, steps=200)
    row = found["results"]["baumgarte"]
    assert row["tip_final"] == [round(x, 6) for x in run["q"][1].tolist()]
    for key in ("max_violation", "final_violation", "energy_rel_max"):
        assert row[key] == round(float(run[key]), 12)
    truth, _ = c.true_position(c.build_system("double"), 1.0)
    assert found["error_at"] == 1.0 and row["error"] == round(c.distance(run["q"], truth), 8)
    capsys.readouterr()


def test_the_table_shows_cost_and_error_in_their_units(tmp_path, capsys):
    results(tmp_path, "--stabilization", "none")
    words = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("none ")).split()
    run = c.simulate(c.build_system("double"), steps=200)
    assert float(words[1]) == pytest.approx(float(run["max_violation"]), rel=1e-3)
    assert words[9] == "us" and words[11] == "x"
    assert 1e-6 * float(words[8]) * float(words[10]) == pytest.approx(0.005, rel=0.05)


def test_the_recording_shows_what_was_simulated(monkeypatch, tmp_path):
    system, taken = c.build_system("triple"), {}
    monkeypatch.setattr(recording, "record", lambda path, name, movers, anchors: taken.update(movers))
    runs = {m: c.simulate(system, "rk4", c.hold_table()[m], 0.005, 100, range(0, 101, 10)) for m in ("none", "soft")}
    c.log_rerun(tmp_path / "a.rrd", system, runs, 0.005)
    assert [taken[mode][0] for mode in runs] == [0, 3]  # red and orange, whichever modes are there
    for mode, run in runs.items():
        _, seconds, points, segments, curves = taken[mode]
        assert np.allclose(seconds, np.arange(0, 0.51, 0.05)) and np.array_equal(points, run["kept"]["q"])
        heads, tails = segments[:, :, 1], segments[:, :, 0]
        assert np.array_equal(heads, points) and np.abs(tails[:, 0]).max() < 1e-15
        assert np.abs(tails[:, 1:] - points[:, :-1]).max() < 1e-15
        rods, energy = curves.values()
        assert np.array_equal(10.0**rods > 1e-3, run["kept"]["violation"] > 1e-3)
        assert np.array_equal(energy, run["kept"]["energy"])


def test_palette_is_red_and_green_for_the_two_modes_of_the_chapter():
    assert [recording.PALETTE[k][0] for k in (0, 1)] == ["red", "green"]
    assert list(c.hold_table())[:2] == ["none", "baumgarte"]
