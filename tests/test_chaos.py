"""The study of many seeds: its starts, its members, what it counts, its exponent, its memory and
its command."""

import json
import math
import tracemalloc

import constraints as c
from curriculum.ch3_4_constraints.studies import chaos
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, run
from curriculum.common import motion

import numpy as np
import pytest

DT = 0.005


@pytest.mark.parametrize("name", ["pendulum", "double", "triple", "chain"])
def test_the_starts_are_those_of_build_system(name):
    system = chaos.ensemble(name, range(5, 20))
    for k, seed in ((0, 5), (1, 6), (14, 19)):
        alone = c.build_system(name, seed)
        assert all(system[key][k].tobytes() == alone[key].tobytes() for key in ("q0", "v0"))


@pytest.mark.parametrize(("name", "steps"), [("double", 1000), ("triple", 50)])
def test_a_member_ends_where_it_ends_alone_bit_for_bit_in_batches_of_any_size(
    name, steps, monkeypatch
):
    monkeypatch.setattr(motion, "BLOCK", 4096)  # so that there are many blocks of steps, too
    found = {}
    for size in (5, 9):
        monkeypatch.setattr(chaos, "BATCH", size)
        found[size] = chaos.crowds(name, range(3, 12), DT, steps)
    for rule, mode in chaos.RUNS:
        ends = found[9][rule, mode]
        assert all(
            a.tobytes() == b.tobytes() for a, b in zip(ends, found[5][rule, mode], strict=True)
        )
        for k in (0, 5, 8):
            system = c.build_system(name, 3 + k)
            alone = run(system, rule, mode, DT, steps)
            gained = (alone.energies[-1] - alone.energies[0]) / energy_scale(system)
            expected = alone.violations.max(), drift(system, alone), gained, alone.tip[-1]
            assert all(
                x[k].tobytes() == e.tobytes() for x, e in zip(ends, expected, strict=True)
            ), (rule, mode, k)


def test_the_tables_say_what_the_ends_are_and_count_who_is_lost():
    nan = math.nan
    none, baumgarte = np.array([1.0, 5.0, 7.0, 9.0, nan]), np.array([2.0, 2.0, 2.0, 2.0, 1.0])
    tips = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 2.0, 0], [0, -2.0, 0], [nan] * 3])
    runs = zip(chaos.RUNS, (none, baumgarte, baumgarte), strict=True)
    found = {key: chaos.Ends(rods, 0.5 * rods, -0.5 * rods, tips) for key, rods in runs}
    row = chaos.ordering(found)
    assert (row["seeds"], row["none > baumgarte"], row["over 3x"]) == (5, 3, 2)
    assert (row["least ratio"], row["50 %"], row["largest"]) == (0.5, 3.0, 4.5)
    row, other, _ = chaos.fates(found)
    assert (row["lost"], row["rods m"], row["worst"], other["lost"]) == (1, 6.0, 9.0, 0)
    assert (row["energy off, worst"], row["gained"]) == (4.5, -3.0)
    assert row["tips spread m"] == pytest.approx(math.sqrt(0.5 + 2.0))


def test_a_member_that_flies_apart_is_lost_alone():
    system = chaos.ensemble("double", range(4))
    whole, _ = chaos.follow(system, "semi_implicit", "none", DT, 100)
    system["v0"][2, :, 1] = 1e6  # m/s
    ends, _ = chaos.follow(system, "semi_implicit", "none", DT, 100)
    for once, then in zip(whole, ends, strict=True):
        assert np.isnan(then[2]).all()
        assert np.delete(once, 2, axis=0).tobytes() == np.delete(then, 2, axis=0).tobytes()


@pytest.mark.parametrize(("name", "square"), [("pendulum", 1.0), ("double", 2.0 + math.sqrt(2.0))])
def test_neighbours_of_a_pendulum_on_end_part_as_the_linear_equations_say(name, square):
    upright = chaos.ensemble(name, range(4))
    upright["q0"] = np.zeros_like(upright["q0"]) + np.arange(1.0, c.SYSTEMS[name] + 1.0)[
        :, None
    ] * [0.0, 1.0, 0.0]
    rates, rods, lost = chaos.growth(upright, 4.0, 2.0, DT)
    assert rates.shape == (4, 4)
    assert rates == pytest.approx(math.sqrt(9.81 * square), rel=1e-6)
    assert max(rods, lost) < 1e-12


def test_neighbours_of_a_pendulum_part_in_proportion_to_time_and_no_faster():
    rates, _, _ = chaos.growth(chaos.ensemble("pendulum", range(10)), 20.0, 140.0, 4 * DT)
    assert chaos.RENEW * rates.sum(axis=1).mean() == pytest.approx(math.log(160.0 / 20.0), abs=0.5)


def test_memory_grows_neither_with_steps_nor_with_batches(monkeypatch):
    monkeypatch.setattr(chaos, "BATCH", 200)
    monkeypatch.setattr(chaos, "RUNS", chaos.RUNS[:1])
    peaks = []
    for seeds, steps in ((200, 200), (200, 1000), (400, 200)):
        tracemalloc.start()
        chaos.crowds("double", range(seeds), DT, steps)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert max(peaks) < 1.1 * peaks[0], peaks


def test_the_command_writes_what_it_prints_and_the_same_bytes_twice(monkeypatch, tmp_path, capsys):
    drawn, flags = [], ["--quick", "--seeds", "3", "--first", "2", "--seconds", "0.1"]
    less = {
        "WORK": 4000,
        "SIZES": (1000,),
        "growth": lambda system, *_: (np.ones((3, 20)), 1.23e-10, 4.56e-10),
    }
    for name, value in less.items():
        monkeypatch.setattr(chaos, name, value)
    monkeypatch.setattr(chaos, "record", lambda path, *scene: drawn.append(scene) or path.touch())
    for folder in ("a", "b"):
        assert chaos.main([*flags, "--out", str(tmp_path / folder)]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.replace(str(tmp_path), "").splitlines())) <= 100
    texts = [(tmp_path / folder / "metrics.json").read_bytes() for folder in ("a", "b")]
    assert texts[0] == texts[1]
    metrics = json.loads(texts[0])
    assert (metrics["first"], metrics["seeds"], metrics["steps"]) == (2, 3, 20)
    assert metrics["answers"][0]["rows"] == [
        chaos.ordering(chaos.crowds("double", range(2, 5), DT, 20))
    ]

    _, _, linkage, runs, _, _, pulls = drawn[0]
    pulls = pulls()
    for (rule, mode), (key, found) in zip(chaos.RUNS, runs.items(), strict=True):
        system, hold = c.build_system("double", 3), c.hold_table(DT)[mode]
        alone = run(system, rule, mode, DT, 20, found.kept)
        assert (key, linkage["pairs"][2:4]) == (f"{rule}_{mode}", [(2, -1), (3, 2)])
        assert np.array_equal(found.q[:, 2:4], alone.q)
        assert np.allclose(
            pulls[key][:, 2:4], c.tensions(system, alone.q, alone.v, hold), rtol=1e-12
        )
    chaos.main([*flags, "--no-rerun", "--out", str(tmp_path / "a")])
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["metrics.json"]
