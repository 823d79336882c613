"""Many steps at once are the steps of the lines as they stand, in every way that they are done."""

import random as dice
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from functools import partial, singledispatch
from itertools import product
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.run_checks import misfit
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._runs import SHIPPED, run
from curriculum.common import compiled, native
from curriculum.common.gauss import make_gauss
from curriculum.common.programs import repeat
from curriculum.common.ruler import once_for_all
from curriculum.common.runs import Log
from curriculum.common.steps import Plain
from curriculum.common.trace import Stop

import numpy as np
import pytest
from conftest import feel


class Python(compiled.Compiled):
    """A step that stays Python, however long it is."""

    def trace(self, *state):
        super().trace(*state)
        if self.alone:
            self.alone.machine = None

    def improve(self, pace):
        pass


class Machine(compiled.Compiled):
    """A step that is machine code from the start on."""

    def trace(self, *state):
        super().trace(*state)
        if self.alone and native.available():
            self.to_machine(0)


class Rows(Python):
    """A step that is bytecode, however short it is."""

    def trace(self, *state):
        super().trace(*state)
        if self.alone and native.available():
            self.alone.to_bytecode()


WAYS = Python, Machine, Rows, Plain
DOUBLE, PENDULUM = map(c.build_system, ("double", "pendulum"))
MEMBERS = native.LANES + 3  # more than go in step


def numbers(found):
    """All that a Run has measured and kept."""
    return *found, found.kept, found.q, found.v


def in_every_way(rule, system, hold, dt, steps, same=np.array_equal):
    """The Run of a system, one and the same, to the last bit; with the same end and halves."""
    runs = [run(system, rule, hold, dt, steps, range(steps + 1), way) for way in WAYS]
    first = runs[0]
    for found in runs[1:]:
        assert (found.stopped, found.halved) == (first.stopped, first.halved)
        assert all(map(same, numbers(found), numbers(first)))
    assert first.way.startswith("compiled") == runs[1].way.startswith("compiled")
    return first


def crowd_of(system, v):
    return system | {"q0": system["q0"] + 0.0 * v, "v0": v}


def together(rule, crowd, hold, dt, steps):
    """q, v (steps + 1, R, N, 3) of the members of a crowd."""
    many = _runs.crowd(crowd, rule, hold, dt)
    path = [(crowd["q0"], crowd["v0"])]
    for _ in range(steps):
        many.advance(1)
        path.append(many.states())
    return tuple(map(np.array, zip(*path, strict=True)))


def halving(q):
    """Where a loop that works in place ends, and what its turns kept."""
    kept = []

    def body(x):
        kept.append(q * x)
        x *= 0.5
        return x, np.sum(x * x) / 1e-6

    return repeat(body, q, 60, "no end"), kept


def test_what_has_no_number_in_the_lines_has_none_compiled(monkeypatch):
    feel(monkeypatch, lambda q, v: 0.0 * np.exp(800.0 + q))
    for way in WAYS:
        found = run(DOUBLE, steps=20, way=way)
        assert found.stopped == "diverged at step 1"


def motor(q, v):
    """It acts on single particles, and out of the plane."""
    f = 0.0 * q
    f[-1, 2] = f[-1, 2] + 3.0 * v[0, 1]
    return f


def branching(q, v):
    return motor(q, v) * (2.0 if q[0, 1] < -0.05 else 1.0)


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

    recent, faded = deque(maxlen=50), []

    class Fading:
        @property
        def gain(self):
            faded.append(1)
            return 0.1 * len(faded)

    slotted, fading, ones = Slot(), Fading(), np.ones(1)
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

    drag = SimpleNamespace(time=0.1)  # s, and not the module of that name

    def lottery(q, v):
        import secrets

        return 0.0 * secrets.randbelow(2) * v

    return {
        "changes the list start": lambda q, v: start.append(q.copy()) or 40.0 * (start[0] - q),
        "changes the list recent": lambda q, v: recent.append(1) or -0.1 * len(recent) * v,
        "changes the list held": lambda q, v, *, held=[]: held.append(1) or -0.1 * len(held) * v,
        "changes the list faded": lambda q, v: -fading.gain * v,
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
        "asks for chance": lottery,
        "takes from ticks, which cannot be put back": lambda q, v: -0.01 * next(ticks) * v,
        "uses slotted, which cannot be put back": lambda q, v: slotted(q, v),
        "uses DEVICE, which cannot be put back": lambda q, v: 0.0 * DEVICE.random() * v,
        "something else when it is compiled: turns": lambda q, v: len(halving(q)[1]) * -v,
        "keeps a number from an earlier call": lambda q, v: halving(q)[1][-1] - v,
        # questions that a symbol answers otherwise than a number
        "when it is compiled: float": lambda q, v: -v if isinstance(q[0, 0], float) else 0.0 * q,
        "when it is compiled: a thousandth": lambda q, v: (
            np.sin(q) * (1.0 + 1e-3 * isinstance(q[0, 0], float))
        ),
        "when it is compiled: dtype": lambda q, v: -v if q.dtype == float else 0.0 * q,
        "when it is compiled": lambda q, v: 0.0 * q if q.dtype == object else 9.0 * (q < -0.06),
        "branches on a value": branching,
        # nothing: Python alone would refuse to divide, or overflow
        "compiled: 0 / 0": lambda q, v: np.nan_to_num(v / v, nan=2.0),
        "compiled: 1 / 0 of constants": lambda q, v: -v * np.tanh(1.0 / abs(q - q)),
        "compiled: a soft wall": lambda q, v: 5.0 / (1.0 + np.exp(2000.0 * (q + 0.1))),
        "compiled: dry friction": lambda q, v: -v / (1.0 + 1.0 / np.abs(v)),
        "compiled: in place": lambda q, v: halving(q)[0],
        # nothing that changes
        "compiled: a name of its own": lambda q, v: -drag.time * v,
        "compiled: pure": lambda q, v, k=(0.1, [0.2]): -k[0] * np.cross(q, v) if endless else q,
    }


FROZEN = [(name, "rk4", "none", 40) for name in forces()]
FINE = [name for name in forces() if name.startswith("compiled")]
FROZEN += [(name, "semi_implicit", "project", 60) for name in FINE]


@pytest.mark.parametrize(("name", "rule", "mode", "steps"), FROZEN)
def test_a_force_is_as_it_is_in_plain_numpy_or_it_is_told(name, rule, mode, steps, monkeypatch):
    ends = []
    for way in WAYS:
        feel(monkeypatch, forces()[name])
        ends.append(run(DOUBLE, rule, mode, 0.005, steps, way=way))
    quick, found, rows, plain = ends
    alike = np.array_equal(quick.tip, found.tip) and np.array_equal(rows.tip, found.tip)
    assert alike or name not in FINE
    assert not plain.stopped
    sines = name in ("changes the array turns",) or "soft wall" in name or "constants" in name
    same = partial(np.allclose, rtol=0.0, atol=1e-12) if sines else np.array_equal
    assert same(found.q[-1], plain.q[-1])
    assert name.split(":")[0] in found.way
    assert ("slower: it" in found.way) == (name not in FINE)


def too_long(v, dt):
    """Over 1 where a pendulum is low and fast."""
    return dt * np.sum(v * v) / 0.2


def timid(q, v, m, force, dt):
    q = repeat(lambda x: (x, too_long(v, dt)), q, 1, "too long")
    return c.semi_implicit_step(q, v, m, force, dt)


def by_hand(q, v, m, force, dt):
    try:
        return timid(q, v, m, force, dt)
    except Stop:
        return by_hand(*by_hand(q, v, m, force, 0.5 * dt), m, force, 0.5 * dt)


def test_a_step_that_is_too_long_is_taken_in_halves_of_halves():
    """A member of a crowd that needs it is NaN; the others do not notice."""
    dt, speeds = 0.04, np.linspace(0.0, 3.0, MEMBERS)[:, None, None]
    v = speeds * np.cross([0.0, 0.0, 1.0], PENDULUM["q0"])
    alone = in_every_way(timid, PENDULUM, 0.0, dt, 40)
    same = run(PENDULUM, by_hand, 0.0, dt, 40, range(41), Plain)
    lengths = [too_long(x, dt) for x in same.v[:-1]]
    assert alone.halved == np.sum(np.greater(lengths, 1.0)) > 0 and max(lengths) > 2.0  # of halves
    assert np.array_equal(alone.q, same.q)
    q, _ = together(timid, crowd_of(PENDULUM, v), 0.0, dt, 2)
    whole = [run(PENDULUM | {"v0": x}, timid, 0.0, dt, 2, range(3)) for x in v]
    lost = np.array([found.halved > 0 for found in whole])
    assert 0 < lost.sum() < MEMBERS and np.isnan(q[-1, lost][..., :2]).all()
    kept = np.flatnonzero(~lost)
    assert np.array_equal(q[:, kept], np.stack([whole[k].q for k in kept], axis=1))
    way = once_for_all()
    again = [run(PENDULUM, timid, 0.0, dt, 40, way=way).halved for _ in range(2)]
    assert again == [alone.halved] * 2


def test_what_is_compiled_is_compared_again_on_the_way(monkeypatch):
    """Where floats feel a drag that symbols do not, though neither at the start nor in the end."""
    monkeypatch.setattr(compiled, "BLOCK", 48)  # 12 steps

    def drag(q, v):
        return -0.1 * v if isinstance(q[0, 1], float) and -0.5 < q[0, 1] < -0.2 else 0.0 * v

    feel(monkeypatch, drag)
    found = run(PENDULUM, "semi_implicit", "none", 0.005, 100, range(101))
    assert not -0.5 < found.q[12, 0, 1] < -0.2 and not -0.5 < found.q[-1, 0, 1] < -0.2
    assert "slower: it does something else" in found.way


@pytest.mark.parametrize("way", WAYS)
def test_a_run_that_flies_apart_is_lost_though_it_came_back(way):
    """Nothing after the first state that is wild is kept."""

    def there_and_back(q, v, m, force, dt):
        return q + np.where(q < 500.0, 1000.0, -1000.0), v

    found = run(DOUBLE, there_and_back, "none", 0.005, 40, way=way)
    assert found.stopped == "diverged at step 1" and len(found.tip) == 1


def test_a_step_of_many_rods_is_bytecode_at_first():
    found, plain = (
        run(c.build_system("chain", links=150), "semi_implicit", "project", 0.005, 9, way=way)
        for way in (compiled.Compiled, Plain)
    )
    assert ("bytecode" in found.way) == native.available()
    assert np.array_equal(found.tip, plain.tip)


def test_every_step_is_measured_and_the_edges_of_blocks_change_nothing(monkeypatch):
    """Whichever states are kept, and wherever machine code takes over."""
    chain, runs, same = c.build_system("chain", links=9), [], np.array_equal
    chain = chain | {"v0": np.random.default_rng(6).normal(size=(9, 3))}
    for block, cost in ((1 << 17, 1e9), (100, 1e9), (100, 0.0), (10, 1e9)):  # of one step, at last
        monkeypatch.setattr(compiled, "BLOCK", block)
        monkeypatch.setattr(compiled, "LOADING", cost)
        monkeypatch.setattr(compiled, "COMPILING", cost)
        runs.append(run(chain, "rk4", "project", 0.005, 40, range(41)))
        assert all(map(same, numbers(runs[-1]), numbers(runs[0])))
    ways = ["compiled to machine code" in found.way for found in runs]
    assert ways == [False, False, native.available(), False]
    full, some = runs[0], [0, 7, 33, 40]
    few = run(chain, "rk4", "project", 0.005, 40, some)
    assert same(few.q, full.q[some]) and same(few.v, full.v[some])
    assert same(few.violations, full.violations)
    assert same(full.kept, range(41)) and same(full.q[0], chain["q0"])
    assert same(full.tip, full.q[:, -1])
    assert same(full.violations, [c.constraint_violation(chain, q) for q in full.q])
    energies = [c.energy(chain, *state) for state in zip(full.q, full.v, strict=True)]
    assert same(full.energies, energies)


@pytest.mark.parametrize("rule", ["semi_implicit", "rk4", "gauss"])
def test_a_loop_typed_by_hand_has_the_bits_of_simulate(rule):
    """And a run unpacks as the chapter has it."""
    system, dt, steps = c.build_system("triple"), 0.005, 30
    step, force = c.INTEGRATORS[rule], c.make_force(system, 20.0)
    tip, violations, energies = c.simulate(step, system, force, dt, steps)
    q, v = system["q0"], system["v0"]
    for k in range(1, steps + 1):
        q, v = step(q, v, system["m"], force, dt)
        assert np.array_equal(tip[k], q[-1])
    assert violations[-1] == c.constraint_violation(system, q)
    assert energies[-1] == c.energy(system, q, v)


def test_a_turn_of_the_loop_may_change_the_state():
    """What follows goes on from there, and what was changed is what is measured."""

    def measure(q, v):
        return c.constraint_violation(DOUBLE, q), c.energy(DOUBLE, q, v)

    def loop(way):
        step = way(c.rk4_step, DOUBLE["m"], c.make_force(DOUBLE, "none"), 0.005, measure, 100)
        log = Log(step, 100, range(101), 1e9)
        q, v = DOUBLE["q0"], DOUBLE["v0"]
        log.note(q, v, *measure(q, v))
        with log:
            for k in range(100):
                q, v, worst, joules = step(q, v)
                if k == 40:
                    v = 0.5 * v
                    worst, joules = measure(q, v)
                log.note(q, v, worst, joules)
        return log.run()

    quick, plain = loop(compiled.Compiled), loop(Plain)
    assert all(map(np.array_equal, numbers(quick), numbers(plain)))
    assert quick.energies[41] < quick.energies[40] - 0.1


def test_a_state_changed_in_place_is_told_how_to_be_changed():
    def zero(q, v):
        return 0.0 * q[0, 0], 0.0 * q[0, 0]

    step = compiled.Compiled(c.rk4_step, DOUBLE["m"], c.make_force(DOUBLE, "none"), 0.005, zero, 9)
    log = Log(step, 9, (), 1e9)
    with pytest.raises(ValueError, match="read-only") as found, log:
        _, v, _, _ = step(DOUBLE["q0"], DOUBLE["v0"])
        v *= 0.9
    assert found.value.__notes__[0].endswith("v = 0.9 * v.")


def test_runs_in_threads_are_the_runs_in_turn():
    """While one traces, the others' plain steps are of numbers, whatever rule they are."""
    cases = [*product(("semi_implicit", "rk4", "gauss"), ("none", "project"))] * 2

    def one(case):
        return run(DOUBLE, *case, steps=300)

    with ThreadPoolExecutor(4) as pool:
        beside = list(pool.map(one, cases))
    for case, found in zip(cases, beside, strict=True):
        assert found.way.startswith("compiled")
        assert np.array_equal(found.tip, one(case).tip)


def in_place_step(q, v, m, force, dt):
    v += dt * (force(q, v) / m)
    q += dt * v
    return q, v


CASES = [  # name, rule, mode, dt, steps, how it ends
    ("pendulum", "gauss", "none", 1e4, 2, "settle"),
    ("triple", "rk4", "project", 0.3, 9, "no way back"),
    ("fourbar_coupler", "semi_implicit", "baumgarte", 0.1, 40, "diverged"),
    ("pendulum", "gauss", "none", 0.5, 12, None),
    ("braced", "semi_implicit", "none", 0.02, 90, None),
    ("double", in_place_step, "project", 0.005, 10, None),
]
SHORT = {(name, "semi_implicit", "project") for name in {*c.SYSTEMS, *SHIPPED} - {"long_chain"}}
for rule, (mode, hold) in product(c.INTEGRATORS, c.hold_table().items()):
    if not misfit(hold, rule):
        SHORT |= {("double", rule, mode), ("fourbar_coupler", rule, "project")}
        SHORT |= {("fourbar_coupler", rule, mode)} if rule == "semi_implicit" else set()
CASES += [(*case, 0.005, 3, None) for case in sorted(SHORT)]


@pytest.mark.parametrize(("name", "rule", "mode", "dt", "steps", "why"), CASES)
def test_a_run_is_alike_in_every_way_alone_or_side_by_side(name, rule, mode, dt, steps, why):
    system = c.build_system(name)
    alone = in_every_way(rule, system, mode, dt, steps)
    assert alone.way.startswith("compiled")
    assert alone.stopped is why or why in alone.stopped
    quick = len(system["m"]) < 5 and (rule not in ("midpoint", "gauss") or mode == "none")
    if quick and dt < 0.1 and not alone.halved:
        noise = 0.1 * np.random.default_rng(2).normal(size=system["q0"].shape)
        moved = system["v0"] + noise * (system["q0"] != 0.0)  # of which the rods let pass
        _, moved = c.project(system, system["q0"], system["q0"], moved, 1.0)
        q, v = together(rule, crowd_of(system, np.stack([system["v0"], moved])), mode, dt, steps)
        assert np.array_equal(q[:, 0], alone.q) and np.array_equal(v[:, 0], alone.v)


STAGES = [("double", 4), ("double", 8), ("double", 16), ("windows", 4), ("jansen_leg", 3)]


@pytest.mark.parametrize(("name", "stages"), STAGES)
def test_stages_side_by_side_have_the_bits_of_stages_in_turn(name, stages):
    """Where a register is full, where lanes are left over, and where it takes more than one."""
    found = in_every_way(make_gauss(stages, 1e-9), c.build_system(name), "none", 0.02, 3)
    assert found.way.startswith("compiled") and not found.stopped


@pytest.mark.parametrize("way", WAYS)
def test_the_start_is_watched_like_what_follows(way):
    """What is asked for and not made may be most at the start; here it is how far up a bob is."""
    start = c.build_system("pendulum")
    found = run(start, steps=20, way=partial(way, watch=lambda q, v: 2.0 + q[0, 1]))
    assert found.watched == 2.0 + start["q0"][0, 1] > 2.0 + found.tip[1, 1]
