"""Studies: what they measure is so, and a peer that is missing or fails is told of."""

import math
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import constraints as c
from curriculum.ch3_4_constraints import texts
from curriculum.ch3_4_constraints.studies import chaos
from curriculum.ch3_4_constraints.studies import speed_vs_error as speed

G = 9.81
PEER = "a peer: pip install -e '.[peers]'"
needs_scipy = pytest.mark.skipif(find_spec("scipy") is None, reason=PEER)


def test_an_error_is_that_of_the_worst_particle_and_counts_if_the_next_step_has_it_too():
    off = np.array([[[3.0, 4.0, 0.0], [1.0, 0.0, 0.0]]])
    assert speed.distance(off, np.zeros((1, 2, 3))) == 5.0
    assert speed.distance(np.nan * off, off) == math.inf
    errors = {10: 1e-4, 20: 1e-2, 40: 1e-4, 80: 1e-6}
    assert speed.first_there(errors, 1e-3) == 40
    assert speed.first_there(errors, 1e-6) is None


def test_all_who_race_end_where_joint_angles_do():
    for name in "llvmlite", "mujoco", "heyoka", "scipy":
        pytest.importorskip(name, reason=PEER)
    q0 = np.stack([c.build_system("double", seed)["q0"] for seed in range(130)])
    ends = speed.reference(q0)
    known = ends[:1]  # of seed 0, as speed.SYSTEM
    go = speed.ours(partial(speed.whole_gauss, 8, 1e-13))(80)
    for _ in range(2):
        assert speed.distance(go()[1], known) < 1e-12
    assert speed.distance(speed.our_crowd(q0, 400)()[1], ends) < 1e-10
    assert speed.distance(speed.mujoco_hinges(2000)()[1], known) < 1e-8
    for count in 1, 20:
        assert speed.distance(speed.heyoka(q0[:count], 1e-14)()[1], ends[:count]) < 1e-11


@needs_scipy
def test_a_peer_that_fails_says_so_in_its_row_and_one_that_is_missing_how_to_get_it(
    monkeypatch, capsys
):
    def failing(steps):
        raise RuntimeError("no such engine")

    monkeypatch.setattr(speed, "find_spec", {"llvmlite", "scipy", "mujoco"}.__contains__)
    monkeypatch.setattr(speed, "mujoco_hinges", failing)
    monkeypatch.setattr(speed, "race", lambda *_: None)
    monkeypatch.setattr(speed, "our_crowd", lambda *_: None)
    speed.main(["--quick"])
    missing, *rows = capsys.readouterr().out.splitlines()
    assert missing == "heyoka is not installed and left out: pip install -e '.[peers]'"
    assert rows[-1].startswith("MuJoCo") and rows[-1].endswith(" failed: no such engine")


@needs_scipy
def test_the_race_prints_a_ratio_at_each_error(monkeypatch, capsys):
    alone = speed.SYSTEM["q0"][None]
    known = speed.reference(alone)

    def racer(seconds):
        return lambda: (seconds, known)

    monkeypatch.setattr(speed, "find_spec", lambda _: True)
    monkeypatch.setattr(speed, "heyoka", lambda q0, tol: racer(4e-6))
    engines = {
        "slow, {} steps": {1: racer(5e-6), 2: racer(5e-6)},
        "quick, {} steps": {1: racer(1e-6), 2: racer(9e-6)},
    }
    speed.race("title", engines, alone, 3)
    lines = capsys.readouterr().out.splitlines()
    assert lines[-4] == "1e-03 m  ours quick, 1 steps: 1.0 us  heyoka tol 1e-01: 4.0 us  ratio 0.25"
    assert [line[:5] for line in lines[-4:]] == ["1e-03", "1e-06", "1e-09", "1e-12"]


@pytest.mark.parametrize(
    ("q0", "rate", "tolerance"),
    [
        ([(0.0, 1.0)], math.sqrt(G), 1e-3),  # balanced: e^(t sqrt(g / L))
        ([(0.0, -1.0)], 0.0, 0.05),  # it hangs, and swings: no growth but that of a phase
        # both balanced: w^2 of M w^2 x = K x, M = [[2, 1], [1, 1]], K = g diag(2, 1)
        ([(0.0, 1.0), (0.0, 2.0)], math.sqrt(G * (2.0 + math.sqrt(2.0))), 1e-3),
    ],
)
def test_neighbours_part_as_the_linear_theory_says(q0, rate, tolerance):
    many = np.tile([(x, y, 0.0) for x, y in q0], (100, 1, 1))
    found = chaos.rates(c.build_system("chain", links=len(q0)), many, 2, 0.005)[1]
    assert np.allclose(found, rate, atol=tolerance)


def test_the_text_has_what_chaos_prints():
    text = (Path(chaos.__file__).parent / "README.md").read_text(encoding="utf-8")
    assert texts.printed("python -m curriculum.ch3_4_constraints.studies chaos") in text
