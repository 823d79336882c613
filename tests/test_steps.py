"""Many steps at once are the steps of the lines as they stand, in every way that they are done."""

import random as dice
import time
from datetime import datetime
from functools import partial, singledispatch
from itertools import product
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.scene_files import misfit
from curriculum.ch3_4_constraints.studies._runs import SCENES, run
from curriculum.common import compiled, crowds, native
from curriculum.common.gauss import make_gauss
from curriculum.common.ruler import once_for_all
from curriculum.common.steps import Plain
from curriculum.common.trace import Stop, repeat

import numpy as np
import pytest


class Python(compiled.Compiled):
    """A step that stays Python."""

    def improve(self, pace):
        pass


class Machine(compiled.Compiled):
    """A step that is machine code from the start on."""

    def trace(self, *state):
        super().trace(*state)
        if self.runner and native.available():
            self.to_machine(0)


WAYS, DOUBLE, PENDULUM = (Python, Machine, Plain), *map(c.build_system, ("double", "pendulum"))
MEMBERS = native.LANES + 3  # more than go in step


def in_every_way(rule, system, hold, dt, steps, ways=WAYS):
    """The Run of a system or a crowd, one and the same: to the last bit, and numpy's to rounding;
    with the same sentence and kind of stop, and as many steps in halves."""
    runs = [run(system, rule, hold, dt, steps, range(steps + 1), way) for way in ways]
    first, plain = runs[0], runs[-1]
    for found in runs[:-1]:
        assert found.way.startswith("compiled") == first.way.startswith("compiled")
        assert found[6:9] == plain[6:9] and all(map(np.array_equal, found[:6], first[:6]))
        assert all(map(partial(np.allclose, rtol=1e-7, atol=1e-9), found[:6], plain[:6]))
    return first


def crowd_of(system, v):
    return system | {"q0": system["q0"] + 0.0 * v, "v0": v}


def feel(monkeypatch, force):
    """Have the rods feel gravity and force(q, v)."""
    monkeypatch.setattr(c, "external_force", lambda s, q, v: s["m"] * c.GRAVITY + force(q, v))


def halving(q):
    """Where a loop that works in place ends, and what its turns kept."""
    kept = []

    def body(x):
        kept.append(q * x)
        x *= 0.5
        return x, np.sum(x * x) / 1e-6

    return repeat(body, q, 60, "no end"), kept


class Controller(SimpleNamespace):
    def __call__(self, q, v):
        gain, self.hold.gain = self.hold.gain, q[0, 0]
        return -gain * v


CALLS, CLOCK, DEVICE = 0, partial(time.perf_counter), dice.SystemRandom()


def forces():
    """Forces, made anew for each run, that numpy takes, and most of which a trace would freeze;
    their names say, up to a colon, what the run says of them."""
    global CALLS
    CALLS, calls, start, seen, ticks = 0, 0, [], set(), iter(range(1000))
    endless = {"of": Controller, "file": open, "lock": np.lib}
    endless["self"] = [endless]
    rng, controller = np.random.default_rng(3), Controller(hold=SimpleNamespace(gain=1.0))

    class Slot:
        __slots__, gain = ("speed",), 1.0

        def __call__(self, q, v):
            return -v

    slotted, ones = Slot(), np.ones(1)
    np.random.seed(3)  # noqa: NPY002
    noise = np.vectorize(lambda q, v: np.random.random())  # noqa: NPY002

    def count(q, v):
        global CALLS
        CALLS += 1
        return np.full(q.shape, CALLS // 5 % 2)

    def counter(q, v):
        nonlocal calls
        calls += 1
        return np.full(q.shape, calls // 5 % 2)

    return {
        "changes the list start": lambda q, v: start.append(q.copy()) or 40.0 * (start[0] - q),
        "changes the array turns": lambda q, v, turns=ones: v * turns.__isub__(0.1),
        "changes the set seen": lambda q, v: -v if seen.add(len(seen)) or len(seen) % 2 else v,
        "changes the global CALLS": count,
        "changes the global gain": lambda q, v: setattr(Slot, "gain", -Slot.gain) or Slot.gain * v,
        "changes the variable calls": singledispatch(counter),  # in a closure of the library
        "changes the attribute gain of controller": lambda q, v: controller(q, v),
        "the random generator rng": partial(lambda k, q, v: k * rng.normal(size=q.shape), 0.1),
        "the random generator of numpy": noise,
        "asks for the time": lambda q, v: -v if datetime.now() else v,
        "asks for the time: wrapped": lambda q, v: 0.0 * CLOCK() * q,
        "takes from ticks, which cannot be put back": lambda q, v: -0.01 * next(ticks) * v,
        "uses slotted, which cannot be put back": lambda q, v: slotted(q, v),
        "uses DEVICE, which cannot be put back": lambda q, v: 0.0 * DEVICE.random() * v,
        "something else when it is compiled: turns": lambda q, v: len(halving(q)[1]) * -v,
        "keeps a number from an earlier call": lambda q, v: halving(q)[1][-1] - v,
        # questions that a symbol answers otherwise than a number
        "when it is compiled: float": lambda q, v: -v if isinstance(q[0, 0], float) else 0.0 * q,
        "when it is compiled: dtype": lambda q, v: -v if q.dtype == float else 0.0 * q,
        "when it is compiled": lambda q, v: 0.0 * q if q.dtype == object else 9.0 * (q < -0.06),
        # nothing: Python alone would refuse to divide, or overflow
        "compiled: 0 / 0": lambda q, v: np.nan_to_num(v / v, nan=2.0),
        "compiled: 1 / 0 of constants": lambda q, v: -v * np.tanh(1.0 / abs(q - q)),
        "compiled: a soft wall": lambda q, v: 5.0 / (1.0 + np.exp(2000.0 * (q + 0.1))),
        "compiled: dry friction": lambda q, v: -v / (1.0 + 1.0 / np.abs(v)),
        "compiled: in place": lambda q, v: halving(q)[0],
        # nothing that changes
        "compiled: pure": lambda q, v, k=(0.1, [0.2]): -k[0] * np.cross(q, v) if endless else q,
    }


FROZEN = [(name, "rk4", "none", 40) for name in forces()]
FINE = [name for name in forces() if name.startswith("compiled")]
FROZEN += [(name, "semi_implicit", "project", 200) for name in FINE]


@pytest.mark.parametrize(("name", "rule", "mode", "steps"), FROZEN)
def test_a_force_is_as_it_is_in_plain_numpy_or_it_is_told(name, rule, mode, steps, monkeypatch):
    ends = []
    for way in WAYS:
        feel(monkeypatch, forces()[name])
        ends.append(run(DOUBLE, rule, mode, 0.005, steps, way=way))
    quick, found, plain = ends
    assert np.array_equal(quick.tip, found.tip) or name not in FINE
    assert not plain.stopped and np.allclose(found.q[-1], plain.q[-1], rtol=0.0, atol=1e-12)
    assert name.split(":")[0] in found.way
    assert ("slower: it" in found.way) == (name not in FINE)


def motor(q, v):
    """It acts on single particles, and out of the plane."""
    f = 0.0 * q
    f[-1, 2] = f[-1, 2] + 3.0 * v[0, 1]
    return f


def branching(q, v):
    return motor(q, v) * (2.0 if q[0, 1] < -0.05 else 1.0)


def in_place_step(q, v, m, force, dt):
    v += dt * (force(q, v) / m)
    q += dt * v
    return q, v


@pytest.mark.parametrize("force", [motor, branching, lambda q, v: -0.1 * v])
@pytest.mark.parametrize("mode", ["none", "project"])
def test_members_of_a_crowd_are_as_if_alone_and_a_rule_may_work_in_place(mode, force, monkeypatch):
    """Also where one alone is at rest, in the plane, or below a limit."""
    feel(monkeypatch, force)
    v = np.random.default_rng(4).normal(size=(MEMBERS, 2, 3))
    v[3] = 0.0
    together = in_every_way(in_place_step, crowd_of(DOUBLE, v), mode, 0.005, 10)
    for k, x in enumerate(v):
        alone = run(DOUBLE | {"v0": x}, "semi_implicit", mode, 0.005, 10, range(11), Plain)
        assert np.abs(together.q[:, k] - alone.q).max() < 1e-12


def too_long(v, dt):
    """Over 1 where a pendulum is low and fast."""
    return dt * np.sum(v * v, axis=(-2, -1)) / 0.2


def timid(q, v, m, force, dt):
    q = repeat(lambda x: (x, too_long(v, dt)), q, 1, "too long")
    return c.semi_implicit_step(q, v, m, force, dt)


def by_hand(q, v, m, force, dt):
    try:
        return timid(q, v, m, force, dt)
    except Stop:
        return by_hand(*by_hand(q, v, m, force, 0.5 * dt), m, force, 0.5 * dt)


def test_a_step_that_is_too_long_is_taken_in_halves_of_halves():
    """By whoever of a crowd needs it; the others do not notice. Such a rule may have a budget."""
    dt, speeds = 0.04, np.linspace(0.0, 3.0, MEMBERS)[:, None, None]
    v = speeds * np.cross([0.0, 0.0, 1.0], PENDULUM["q0"])
    alone = in_every_way(timid, PENDULUM, 0.0, dt, 40)
    together = in_every_way(timid, crowd_of(PENDULUM, v), 0.0, dt, 40)
    runs = [run(PENDULUM | {"v0": x}, by_hand, 0.0, dt, 40, range(41), Plain) for x in v]
    halved = [np.sum(too_long(one.v[:-1], dt) > 1.0) for one in runs]
    assert (together.halved, alone.halved) == (sum(halved), halved[0])
    assert np.max(too_long(runs[0].v, dt)) > 2.0  # halves of halves
    assert np.abs(together.q - np.stack([one.q for one in runs], axis=1)).max() < 1e-12
    assert np.array_equal(together.q[:, 0], alone.q)
    way = once_for_all()
    again = [run(PENDULUM | {"v0": v[0]}, timid, 0.0, dt, 40, way=way).halved for _ in range(2)]
    assert again == [alone.halved] * 2
    spent = run(PENDULUM, timid, 0.0, 0.1, 50, way=partial(compiled.Compiled, tries=20))
    assert spent.kind == "budget" and 0 < len(spent.tip) < 50


@pytest.mark.parametrize("members", [(), (19,)])
def test_every_step_is_measured_and_the_edges_of_blocks_change_nothing(members, monkeypatch):
    """Whichever states are kept, and wherever machine code takes over."""
    chain, noise = c.build_system("chain", links=9), np.random.default_rng(6).normal
    crowd, runs = crowd_of(chain, noise(size=(*members, 9, 3))), []
    for block, cost in ((1 << 17, 1e9), (100, 1e9), (100, 0.0), (10, 1e9)):  # of one step, at last
        monkeypatch.setattr(compiled, "BLOCK", block * max(1, *members, 1))
        monkeypatch.setattr(crowds, "PIECE", block // 10)
        monkeypatch.setattr(compiled, "LOADING", cost)
        monkeypatch.setattr(compiled, "COMPILING", cost)
        runs.append(run(crowd, "rk4", "project", 0.005, 40, range(41)))
        assert all(map(np.array_equal, runs[-1][:6], runs[0][:6]))
    ways = ["compiled to machine code" in found.way for found in runs]
    assert ways == [False, False, native.available(), False]
    full, some, same = runs[0], [0, 7, 33, 40], np.array_equal
    few = run(crowd, "rk4", "project", 0.005, 40, some)
    assert same(few.q, full.q[some]) and same(few.v, full.v[some])
    assert same(few.violations, full.violations)
    assert same(full.kept, range(41)) and same(full.q[0], crowd["q0"])
    assert same(full.tip, full.q[..., -1, :])
    assert np.abs(full.violations - c.constraint_violation(crowd, full.q)).max() < 1e-14
    assert np.abs(full.energies - c.energy(crowd, full.q, full.v)).max() < 1e-12


CASES = [  # name, rule, mode, dt, steps, how it ends
    ("pendulum", "gauss", "none", 1e4, 2, "loop"),
    ("triple", "rk4", "project", 0.3, 9, "loop"),
    ("fourbar_coupler", "semi_implicit", "baumgarte", 0.1, 40, "diverged"),
    ("pendulum", "gauss", "none", 0.5, 12, None),
    ("braced", "semi_implicit", "none", 0.02, 90, None),
]
SHIPPED = {path.stem for path in SCENES.glob("*.json")} - {"taut_cable"}  # which is refused
SHORT = {(name, "semi_implicit", "project") for name in (*c.SYSTEMS, *SHIPPED)}
for rule, (mode, hold) in product(c.INTEGRATORS, c.hold_table().items()):
    if not misfit(hold, rule):
        SHORT |= {("double", rule, mode), ("fourbar_coupler", rule, mode)}
CASES += [(*case, 0.005, 3, None) for case in sorted(SHORT)]


@pytest.mark.parametrize(("name", "rule", "mode", "dt", "steps", "kind"), CASES)
def test_a_run_is_alike_in_every_way_alone_or_side_by_side(name, rule, mode, dt, steps, kind):
    system = c.build_system(name)
    alone = in_every_way(rule, system, mode, dt, steps)
    assert alone.kind == kind and alone.way.startswith("compiled")
    noise = np.random.default_rng(2).normal(size=(2, *system["q0"].shape))
    noise[0] = 0.0
    quick = name in c.SYSTEMS or rule in c.STABILITY_LIMIT and len(system["m"]) < 5
    if quick and dt < 0.1:  # in a crowd, who can go on no more is no Stop but NaN
        v = system["v0"] + 0.1 * noise * (system["q0"] != 0.0)  # of which the rods let pass
        q = system["q0"] + 0.0 * v
        crowd = crowd_of(system, c.project(system, q, q, v, 1.0)[1])
        together = in_every_way(rule, crowd, mode, dt, steps, (Python, Plain))
        assert together.way.startswith("compiled")
        assert all(map(np.array_equal, (together.q[:, 0], together.v[:, 0]), (alone.q, alone.v)))


@pytest.mark.parametrize("stages", [3, 4, 8, 16])
@pytest.mark.parametrize("name", ["double", "windows", "jansen_leg"])
def test_stages_side_by_side_have_the_bits_of_stages_in_turn(name, stages):
    """Where a register is full, where lanes are left over, and where it takes more than one."""
    system = c.build_system(name)
    found = in_every_way(
        make_gauss(stages, 1e-9), system, "none", 0.02, 3, (Python, Machine, Plain)
    )
    assert found.way.startswith("compiled") and not found.stopped
