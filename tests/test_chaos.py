"""Many seeds: their starts, members, exponent and command; and the map of when one turns over."""

import json
import math
import zlib

import constraints as c
from curriculum.ch3_4_constraints.studies import chaos
from curriculum.ch3_4_constraints.studies import map as plane
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, run

import numpy as np
import pytest

DT = 0.005


def branching(system, q, v=None):
    """Gravity, and drag on the way down."""
    f = system["m"] * c.GRAVITY
    return f - 0.1 * v if v[0, 1] < 0.0 else f


@pytest.mark.parametrize(("force", "steps"), [(None, 1000), (branching, 40)])
def test_a_member_ends_where_it_ends_alone_bit_for_bit_in_batches(force, steps, monkeypatch):
    """Whether a force can be traced or branches; starts are those that build_system draws."""
    monkeypatch.setattr(c, "external_force", force or c.external_force)
    found = []
    for size in (5, 9):
        monkeypatch.setattr(chaos, "BATCH", size)
        found.append(chaos.crowds("double", range(3, 12), DT, steps))
    for key in chaos.RUNS:
        few, all_at_once = (ends[key] for ends in found)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(few, all_at_once, strict=True))
        for k in (0, 8):
            system = c.build_system("double", 3 + k)
            alone = run(system, *key, DT, steps)
            gained = (alone.energies[-1] - alone.energies[0]) / energy_scale(system)
            expected = alone.violations.max(), drift(system, alone), gained, alone.tip[-1]
            ends = [x[k] for x in all_at_once]
            assert all(x.tobytes() == e.tobytes() for x, e in zip(ends, expected, strict=True))


def test_the_tables_say_what_the_ends_are_and_count_who_is_lost():
    none, baumgarte = np.array([1.0, 5, 7, 9, math.nan]), np.array([2.0, 2, 2, 2, 1])
    tips = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0], [math.nan] * 3])
    runs = zip(chaos.RUNS, (none, baumgarte, baumgarte), strict=True)
    found = {key: chaos.Ends(rods, 0.5 * rods, -0.5 * rods, tips) for key, rods in runs}
    row = chaos.ordering(found)
    assert (row["seeds"], row["none > baumgarte"], row["over 3x"]) == (5, 3, 2)
    assert (row["least ratio"], row["50 %"], row["largest"]) == (0.5, 3.0, 4.5)
    row, other, _ = chaos.fates(found)
    assert (row["lost"], row["rods m"], row["worst"], other["lost"]) == (1, 6.0, 9.0, 0)
    assert (row["energy off, worst"], row["gained"]) == (4.5, -3.0)
    assert row["tips spread m"] == pytest.approx(math.sqrt(0.5 + 2.0))
    assert chaos.standard_error([1.0, 2.0, 3.0]) == pytest.approx(1.0 / math.sqrt(3.0))


def test_a_member_that_flies_apart_is_lost_alone():
    system, both = chaos.ensemble("double", range(3)), []
    for upward in (0.0, 1e6):  # m/s
        system["v0"][2, :, 1] = upward
        both.append(chaos.follow(system, "semi_implicit", "none", DT, 100)[0])
    for once, then in zip(*both, strict=True):
        assert np.isnan(then[2]).all() and once[:2].tobytes() == then[:2].tobytes()


def test_neighbours_part_as_the_linear_equations_say_and_otherwise_in_proportion_to_time():
    for name, square in (("pendulum", 1.0), ("double", 2.0 + math.sqrt(2.0))):
        upright = chaos.ensemble(name, range(4))
        upright["q0"][:] = np.arange(1.0, c.SYSTEMS[name] + 1.0)[:, None] * [0.0, 1.0, 0.0]
        rates, rods, lost = chaos.growth(upright, 4.0, 2.0, DT)
        assert rates == pytest.approx(np.full((4, 4), math.sqrt(9.81 * square)), rel=1e-6)
        assert max(rods, lost) < 1e-12
    rates, _, _ = chaos.growth(chaos.ensemble("pendulum", range(10)), 20.0, 140.0, 4 * DT)
    assert chaos.RENEW * rates.sum(axis=1).mean() == pytest.approx(math.log(160.0 / 20.0), abs=0.5)


def test_the_command_writes_what_it_prints_and_the_same_bytes_twice(monkeypatch, tmp_path, capsys):
    flags = ["--quick", "--seeds", "3", "--first", "2", "--seconds", "0.1", "--out"]
    known = {"WORK": 4000, "SIZES": (1000,), "growth": lambda *_: (np.ones((3, 20)), 1e-9, 4e-9)}
    for name, value in known.items():
        monkeypatch.setattr(chaos, name, value)
    texts = []
    for name in "ab":
        assert chaos.main([*flags, str(tmp_path / name)]) == 0
        texts.append((tmp_path / name / "metrics.json").read_bytes())
    metrics, found = json.loads(texts[0]), chaos.crowds("double", range(2, 5), DT, 20)
    assert texts[0] == texts[1] and metrics["answers"][0]["rows"] == [chaos.ordering(found)]
    lines = capsys.readouterr().out.replace(str(tmp_path), "").splitlines()
    assert max(map(len, lines)) <= 100


def test_a_rod_turns_over_when_its_angle_passes_the_upright(tmp_path):
    """Beside the angles of single runs, unwrapped; half is mirrored, and none is seen to leak."""
    places = np.stack(np.meshgrid(range(8), range(8), indexing="ij"), axis=-1)
    angles = plane.angle(8)[places].reshape(-1, 2)
    turns = plane.first_turns(angles, "impulse", 5.0)
    for start, turn in zip(angles[::5], turns[::5], strict=True):
        system = c.build_system("double") | {"q0": plane.starts(start[None])[0]}
        q = run(system, hold="impulse", steps=1000, keep=range(0, 1001, plane.LOOK)).q
        d = q[:, 1] - q[:, 0]
        turned = np.abs(np.unwrap(np.arctan2(d[:, 0], -d[:, 1]))) > math.pi
        assert turn == (np.argmax(turned) if turned.any() else 0)
    assert 0 < np.count_nonzero(turns) < 64 and np.array_equal(turns, turns[::-1])
    paths = [tmp_path / name for name in ("a.png", "b.png")]
    for path in paths:
        plane.main(["--size", "16", "--seconds", "5", "--out", str(path)])
    data = paths[0].read_bytes()
    assert data == paths[1].read_bytes() and data[:8] == b"\x89PNG\r\n\x1a\n"
    rows = zlib.decompress(data[data.index(b"IDAT") + 4 :])
    assert len(rows) == 17 * (16 + 1 + 16 // plane.STRIP)
