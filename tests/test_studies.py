"""Studies: many seeds, one by one and together; when they turn over; and races with engines."""

import base64
import math
import re
import zlib
from xml.etree import ElementTree

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs, chaos, real_thing, speed_vs_error
from curriculum.ch3_4_constraints.studies import map as plane
from curriculum.ch3_4_constraints.studies._runs import Task, double, energy_scale, run
from curriculum.ch3_4_constraints.tables import spread
from curriculum.common import llvm

import numpy as np
import pytest
from conftest import feel
from test_steps import branching, motor


def test_a_race_runs_to_where_a_run_ends_bit_for_bit():
    """Whether all states are kept or only the end."""
    system = c.build_system("double")
    found = run(system, "rk4", "none", 0.01, 200, range(0, 201, 50))
    for samples in (1, 4):
        task = Task(system, samples, 2.0 / samples, None)
        for machine in {False, peers.NATIVE}:
            _, ends = peers.ours(task, "rk4", machine=machine)(200 // samples)
            assert np.array_equal(ends, found.q[4 // samples :: 4 // samples, :, :2])


@pytest.mark.parametrize("steps", [1000, 10])
def test_a_member_ends_where_it_ends_alone_bit_for_bit(steps, monkeypatch):
    """In machine code, or in numpy calls; starts are those that build_system draws."""
    feel(monkeypatch, motor)
    monkeypatch.setattr(llvm, "available", lambda: peers.NATIVE and steps == 1000)
    crowd = chaos.ensemble("double", range(3, 12))
    for key in chaos.RUNS:
        ends = chaos.follow(crowd, *key, steps)
        for k in (0, 8):
            system = c.build_system("double", 3 + k)
            alone = run(system, *key, chaos.DT, steps)
            gained = (alone.energies[-1] - alone.energies[0]) / energy_scale(system)
            expected = alone.violations.max(), gained, alone.tip[-1]
            assert all(np.array_equal(x[k], y) for x, y in zip(ends, expected, strict=True))


def test_many_members_want_a_force_that_can_be_compiled(monkeypatch):
    asked, forces = [], {"branches on": branching}
    forces["changes"] = lambda q, v: asked.append(1) or -v
    forces["does something else"] = lambda q, v: -v if q.dtype == float else 9.0 + q
    for why, force in forces.items():
        feel(monkeypatch, force)
        with pytest.raises(SystemExit, match=f"many members .* compiled: it {why}"):
            chaos.follow(chaos.ensemble("double", range(2)), "rk4", "none", 1)
    assert not asked  # what a trace left there is gone


def test_the_tables_say_what_the_ends_are_and_medians_quartiles_and_errors():
    none, baumgarte = np.array([1.0, 5, 7, 9]), np.array([2.0, 2, 2, 2])
    tips = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 2, 0], [0, -2, 0]])
    runs = zip(chaos.RUNS, (none, baumgarte, baumgarte), strict=True)
    found = {key: chaos.Ends(rods, -0.5 * rods, tips) for key, rods in runs}
    assert [*chaos.ordering(found).values()] == [4, 3, 2, 0.5, 3.0, 4.5]
    _, *row, spread_out = chaos.fates(found)[0].values()
    assert row == [6.0, 9.0, -3.0] and spread_out == pytest.approx(math.sqrt(0.5 + 2.0))
    assert chaos.standard_error([1.0, 2.0, 3.0]) == pytest.approx(1.0 / math.sqrt(3.0))
    assert spread([5.0, 1.0, 4.0, 2.0, 3.0], "us") == {"us": 3.0, "us q1": 2.0, "us q3": 4.0}


def test_neighbours_part_as_the_linear_equations_say_and_otherwise_in_proportion_to_time():
    upright = chaos.ensemble("double", range(4))
    upright["q0"][:] = [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]
    rates = chaos.growth(upright, 4.0, 2.0, 0.005)
    assert rates == pytest.approx(np.full((4, 4), math.sqrt(9.81 * (2.0 + math.sqrt(2.0)))), 1e-6)
    rates = chaos.growth(chaos.ensemble("pendulum", range(10)), 20.0, 140.0, 0.02)
    assert chaos.RENEW * rates.sum(axis=1).mean() == pytest.approx(math.log(160.0 / 20.0), abs=0.5)


def test_the_command_prints_three_tables_but_for_times_the_same_and_wants_fast(monkeypatch, capsys):
    for name, small in {"WORK": 4000, "REPEATS": 1, "SECONDS": 0.1}.items():
        monkeypatch.setattr(chaos, name, small)
    monkeypatch.setattr(chaos, "growth", lambda *_: np.ones((3, 20)))
    printed = []
    for native in (False, True):
        monkeypatch.setattr(_runs, "NATIVE", native)
        chaos.main(["--seeds", "3"])
        timed, *rest = capsys.readouterr().out.partition("(b)")
        assert "(a)" in timed and "(c)" in rest[1]
        assert ("pip install -e '.[fast]'" in timed) is not native
        printed.append(rest)
    assert printed[0] == printed[1]


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
    for name in ("a.svg", "b.svg"):
        plane.main(["--size", "16", "--seconds", "5", "--out", str(tmp_path / name)])
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert drawn == (tmp_path / "b.svg").read_text(encoding="utf-8")
    words = [x.text for x in ElementTree.fromstring(drawn).iter("{http://www.w3.org/2000/svg}text")]
    assert {"-180\u00b0", "second rod's angle at the start", "5 s", "never", "none"} < {*words}
    data = base64.b64decode(re.search('base64,([^"]*)', drawn)[1])  # the map, before its key
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(zlib.decompress(data[data.index(b"IDAT") + 4 :])) == 17 * (17 + 16 // plane.STRIP)


# --- other engines, and what a method costs ---
@pytest.mark.parametrize("rods, dt", [(1, 0.005), (4, 0.005), (25, 0.005), (3, 0.05)])
def test_soft_is_mujocos_equality_constraint_of_a_tendon(rods, dt):
    """All fields with a name here, some per cent off the rods; at 0.05 s both take two steps."""
    pytest.importorskip("mujoco", reason="the extra compare brings it")
    rng = np.random.default_rng(rods)
    for _ in range(5):
        rows = real_thing.names(peers.random_chain(rng, rods), dt)
        assert len(rows) == 8 and max(row["largest gap"] for row in rows) < 1e-12


PEERS = {  # an engine: its runs of a task, coarse and fine; its crowd's; how near that is, in m
    "mujoco": (
        lambda task: map(peers.hinges(task), (60, 20_000)),
        lambda task: peers.hinges(task)(2000),
        1e-7,
    ),
    "heyoka": (
        lambda task: (peers.heyoka(task, tol)(1) for tol in (1e-3, 1e-16)),
        lambda task: peers.heyoka_crowd(task, 1e-14)(1),
        1e-9,
    ),
}


@pytest.mark.parametrize("package", PEERS)
def test_a_peer_finds_the_same_motion_the_finer_it_goes_and_its_crowd_ends_where_ours_does(package):
    """The last register of a crowd is not full; one member after the other is checked."""
    pytest.importorskip(package, reason="the extras compare and peers bring them")
    runs, crowd, close = PEERS[package]
    task, system = double(end=True), chaos.ensemble("double", range(9))
    far, near = (task.error(q) for _, q in runs(task))
    assert near < 1e-8 * far
    _, found = crowd(Task(system, 1, 5.0, None))
    ours = _runs.crowd(system, "gauss:8", "none", 0.05)
    ours.advance(100)
    assert np.abs(found - ours.states()[0][..., :2]).max() < close


def test_gauss_meets_the_high_precision_of_a01_and_rk4_at_its_step_not_even_the_low_one():
    """Outputs are those of the closed form, which is at the bottom after Gamma(1/4)^2 / sqrt(16 pi)
    of sqrt(L / g): a quarter of the lemniscate's length."""
    quarter = math.gamma(0.25) ** 2 / math.sqrt(16.0 * math.pi * 9.81)
    xy = real_thing.level_pendulum(quarter * np.array([0.0, 1.0, 2.0, 401.0]))
    np.testing.assert_allclose(xy, [[1, 0], [0, -1], [-1, 0], [0, -1]], rtol=0, atol=1e-11)
    task = real_thing.a01(2000.0 if peers.NATIVE else 60.0)
    for mode in ("none", "project"):
        assert task.error(peers.ours(task, "gauss", mode)(2)[1]) < 1e-2 * real_thing.HIGH
    assert task.error(peers.ours(task, "rk4", "project")(2)[1]) > 100.0 * real_thing.HIGH


def test_a_method_is_ahead_if_none_solves_fewer_linear_systems_for_a_smaller_error():
    """rk4: four; midpoint:6: (6 / 2)^2 + 1; projecting adds its rounds, and one for velocities."""
    system = c.build_system("double")
    for rule, forces in (("rk4", 4.0), ("midpoint:6", 10.0)):
        none, both = (speed_vs_error.solves(system, rule, m, 0.01, 20) for m in ("none", "project"))
        assert none == forces and 2.0 <= both - none <= 5.0
    cost = [(4, 1e-3), (5, 1e-3), (6, 1e-6), (7, 1e-5), (9, 1e-14), (10, 1e-15)]
    rows = [{"solves": solves, "error": error} for solves, error in cost]
    found = speed_vs_error.ahead(rows)  # below rounding all errors are equal
    assert [row["solves"] for row in found] == [4, 6, 9]


def test_a_race_is_won_by_the_least_time_and_its_bars_are_ours_over_theirs(monkeypatch):
    """A climb ends at what reaches the error and does not lose it at the next rung; of two ladders
    the quicker one counts; a racer judged in all pays for what it builds."""
    clock = [0.0]
    monkeypatch.setattr(real_thing.time, "perf_counter", lambda: clock[0])

    def ladder(built, *rungs):
        """Rungs of seconds and errors in m."""

        def build():
            clock[0] += built
            return lambda per: (rungs[per][0], np.array([[[rungs[per][1], 0.0]]]))

        return {str(seconds): (build, per) for per, (seconds, _) in enumerate(rungs)}

    lucky = ladder(0.5, (0.25, 1e-4), (0.5, 1.0), (2.0, 1e-4), (4.0, 1e-4), (6.0, 0.0), (7.0, 0.0))
    quick = ladder(0.25, (1.0, 1e-4), (3.0, 0.0), (5.0, 0.0))
    soon = ladder(0.0, (1.125, 1e-4), (3.125, 0.0), (5.0, 0.0))
    racers = {"ours": [lucky, quick], "heyoka": [lucky], "ours, Python": [quick, soon]}
    limits = [("ours", "heyoka", 0.6), ("ours", "X", 1.0), ("ours, Python", "heyoka", 0.4)]
    task = Task(c.build_system("pendulum"), 1, 1.0, lambda q: float(q[0, 0, 0]))
    won = {1e-3: (1.0, 2.0, 1.125), 1e-5: (3.0, 6.0, 3.125)}
    for error, best in won.items():
        rows, bars = real_thing.race(task, racers, error, limits)
        each = zip(racers, best, strict=True)
        expected = [(engine, str(x), f"{best[0] / x:.2g}") for engine, x in each]
        assert [(row["engine"], row["setting"], row["ours/it"]) for row in rows] == expected
        if error == 1e-3:
            assert [(share, limit) for _, share, limit in bars] == [(0.5, 0.6), (1.125 / 2.5, 0.4)]
