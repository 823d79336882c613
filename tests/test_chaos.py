"""Many seeds: their starts, members, exponent and command; and the map of when one turns over."""

import math
import zlib

import constraints as c
from curriculum.ch3_4_constraints.studies import chaos
from curriculum.ch3_4_constraints.studies import map as plane
from curriculum.ch3_4_constraints.studies._runs import energy_scale, run

import numpy as np
import pytest
from test_steps import branching, feel, motor


@pytest.mark.parametrize(("force", "steps"), [(motor, 1000), (branching, 40)])
def test_a_member_ends_where_it_ends_alone_bit_for_bit(force, steps, monkeypatch):
    """Whether a force can be traced or branches; starts are those that build_system draws."""
    feel(monkeypatch, force)
    crowd = chaos.ensemble("double", range(3, 12))
    for key in chaos.RUNS:
        ends = chaos.follow(crowd, *key, steps)
        for k in (0, 8):
            system = c.build_system("double", 3 + k)
            alone = run(system, *key, chaos.DT, steps)
            gained = (alone.energies[-1] - alone.energies[0]) / energy_scale(system)
            expected = alone.violations.max(), gained, alone.tip[-1]
            assert all(np.array_equal(x[k], y) for x, y in zip(ends, expected, strict=True))


def test_the_tables_say_what_the_ends_are():
    none, baumgarte = np.array([1.0, 5, 7, 9]), np.array([2.0, 2, 2, 2])
    tips = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]])
    runs = zip(chaos.RUNS, (none, baumgarte, baumgarte), strict=True)
    found = {key: chaos.Ends(rods, -0.5 * rods, tips) for key, rods in runs}
    assert [*chaos.ordering(found).values()] == [4, 3, 2, 0.5, 3.0, 4.5]
    row, *_ = chaos.fates(found)
    assert [*row.values()][1:-1] == [6.0, 9.0, -3.0]
    assert row["tips spread m"] == pytest.approx(math.sqrt(0.5 + 2.0))
    assert chaos.standard_error([1.0, 2.0, 3.0]) == pytest.approx(1.0 / math.sqrt(3.0))


def test_a_member_that_flies_apart_is_lost_alone():
    slow, fast = chaos.ensemble("double", range(3)), chaos.ensemble("double", range(3))
    fast["v0"][2, :, 1] = 1e6  # m/s
    once, then = (chaos.follow(x, "semi_implicit", "none", 100) for x in (slow, fast))
    assert not then.rods[2] < 100.0  # m: it is far off, or no number
    assert all(np.array_equal(x[:2], y[:2]) for x, y in zip(once, then, strict=True))


def test_neighbours_part_as_the_linear_equations_say_and_otherwise_in_proportion_to_time():
    upright = chaos.ensemble("double", range(4))
    upright["q0"][:] = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]
    rates = chaos.growth(upright, 4.0, 2.0, 0.005)
    assert rates == pytest.approx(np.full((4, 4), math.sqrt(9.81 * (2.0 + math.sqrt(2.0)))), 1e-6)
    rates = chaos.growth(chaos.ensemble("pendulum", range(10)), 20.0, 140.0, 0.02)
    assert chaos.RENEW * rates.sum(axis=1).mean() == pytest.approx(math.log(160.0 / 20.0), abs=0.5)


def test_the_command_prints_three_tables_and_but_for_times_the_same_twice(monkeypatch, capsys):
    monkeypatch.setattr(chaos, "WORK", 4000)
    monkeypatch.setattr(chaos, "SECONDS", 0.4)
    monkeypatch.setattr(chaos, "growth", lambda *_: np.ones((3, 20)))
    texts = []
    for _ in range(2):
        chaos.main(["--quick", "--seeds", "3"])
        texts.append(capsys.readouterr().out.partition("(b)"))
    crowd = chaos.ensemble("double", range(3))
    row = chaos.ordering({key: chaos.follow(crowd, *key, 20) for key in chaos.RUNS})
    assert texts[0][1:] == texts[1][1:] and "(a)" in texts[0][0] and "(c)" in texts[0][2]
    assert f"{row['median']:.3g}" in texts[0][2].splitlines()[2].split()


def test_a_rod_turns_over_when_its_angle_passes_the_upright(tmp_path):
    """Beside the angles of single runs, unwrapped; half is mirrored."""
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
    for name in ("a.png", "b.png"):
        plane.main(["--size", "16", "--seconds", "5", "--out", str(tmp_path / name)])
    data = (tmp_path / "a.png").read_bytes()
    assert data == (tmp_path / "b.png").read_bytes() and data[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(zlib.decompress(data[data.index(b"IDAT") + 4 :])) == 17 * (17 + 16 // plane.STRIP)
