"""Many steps at once are the steps of the lines as they stand, in every way that they are done."""

import ctypes
import pickle
import random as dice
import sys
import time
import weakref
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from datetime import datetime
from functools import partial, singledispatch
from itertools import product
from types import MappingProxyType, SimpleNamespace
from unittest import mock

import constraints as c
from curriculum.ch3_4_constraints.run_checks import misfit, watched
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common import compiled, crowds, llvm, native, trace, traced
from curriculum.common.bytecode import Bytecode
from curriculum.common.compiled import Compiled
from curriculum.common.crowds import mapped
from curriculum.common.gauss import make_gauss
from curriculum.common.native import Native
from curriculum.common.programs import repeat
from curriculum.common.pure import Memory
from curriculum.common.ruler import once_for_all
from curriculum.common.runs import Log
from curriculum.common.steps import Plain
from curriculum.common.tape import Stop, Untraceable
from curriculum.common.traced import Single, Traced, moves

import numpy as np
import pytest
from conftest import feel


class Python(Compiled):
    """A step that stays Python, however long it is; or another code, from the start on."""

    begin = None

    def trace(self, *state):
        super().trace(*state)
        if self.single:
            self.single.machine = None
            if self.begin and llvm.available():
                self.single.machine = self.begin(self.single.traced.program)

    def improve(self, pace, left):
        pass


class Machine(Python):
    begin = staticmethod(partial(Native, best=False))


class Rows(Python):
    begin = Bytecode


WAYS = Python, Machine, Rows, Plain
DOUBLE, PENDULUM = map(c.build_system, ("double", "pendulum"))


def alike(one, other):
    """Whether two Runs are the same, to the last bit, with the same end and halves."""
    numbers = ((*found, found.kept, found.q, found.v, found.watched) for found in (one, other))
    same = all(map(np.array_equal, *numbers))
    return same and (one.stopped, one.halved) == (other.stopped, other.halved)


def in_every_way(rule, system, hold, dt, steps):
    """The Run of a system, one and the same; how far up a particle is may be most at the start.
    Its step is traced once for all ways."""
    ways = [partial(way, watch=lambda q, v: 2.0 + q[0, 1]) for way in WAYS]
    asked = partial(run, system, rule, hold, dt, steps, range(steps + 1))
    runs = [asked(ways[0])]
    with mock.patch.object(compiled, "Traced", return_value=runs[0].stepper.single.traced):
        runs += map(asked, ways[1:])
    assert all(alike(found, runs[0]) for found in runs)
    assert all(found.how.startswith("compiled") for found in runs[:3])
    assert runs[0].watched == np.max(2.0 + runs[0].q[:, 0, 1], initial=0.0)
    return runs[0]


def side_by_side(found, system, rule, hold, dt):
    """A step of a crowd, from every state of a Run but the last: q, v (steps, N, 3)."""
    crowd = _runs.crowd(system | {"q0": found.q[:-1], "v0": found.v[:-1]}, rule, hold, dt)
    crowd.advance(1)
    return crowd.states()


def halving(q):
    """Where a loop that works in place ends, and what its turns kept."""
    kept = []

    def body(x):
        kept.append(q * x)
        x *= 0.5
        return x, np.sum(x * x) / 1e-6

    return repeat(body, q, 60, "no end"), kept


def motor(q, v):
    """It acts on single particles, and out of the plane."""
    f = 0.0 * q
    f[-1, 2] = f[-1, 2] + 3.0 * v[0, 1]
    return f


def branching(q, v):
    return motor(q, v) * (2.0 if q[0, 1] < -0.05 else 1.0)


def catching(q, v):
    try:
        return branching(q, v)
    except Exception:
        return 2.0 * q


class Controller(SimpleNamespace):
    def __call__(self, q, v):
        gain, self.hold.gain = self.hold.gain, q[0, 0]
        return -gain * v


class Turns:
    turn = 0

    def __next__(self):
        self.turn += 1
        return self.turn


class Heir(Turns):
    pass


class Shown:
    """It counts what is asked of it besides, which is no matter of its force."""

    frames = 0

    def on_frame(self):
        self.frames += 1

    def __call__(self, system, q, v):
        return system["m"] * c.GRAVITY - 0.1 * v


CALLS, CLOCK, DEVICE = 0, partial(time.perf_counter), dice.SystemRandom()


class Slow:
    gain = 0.0


SLOW = Slow()


def slower(drag):
    drag.gain += 0.01
    return drag.gain


def forces():
    """Forces, made anew for each run, that numpy takes, and most of which a trace would freeze;
    their names say, up to a colon, what the run says of them."""
    global CALLS
    CALLS = calls = SLOW.gain = 0
    faded, seen, recent = [], set(), deque(maxlen=50)
    both = ([], 1.0)
    ticks, ones, rng = iter(range(1000)), np.ones(1), np.random.default_rng(3)
    endless = {"of": Controller, "file": open, "lock": np.lib}
    endless["self"] = [endless]
    controller = Controller(hold=SimpleNamespace(gain=1.0))
    drag = SimpleNamespace(time=0.1)  # s, and not the module of that name
    heir, normal = Heir(), np.random.default_rng(3).normal
    raw, sized = bytearray(2), {SLOW: "the drag"}
    np.random.seed(3)  # noqa: NPY002
    noise = np.vectorize(lambda q, v: np.random.random())  # noqa: NPY002

    class Slot:
        __slots__, gain = ("speed",), 1.0

        def __call__(self, q, v):
            return -v

    class Fading:
        @property
        def gain(self):
            faded.append(1)
            return 0.1 * len(faded)

    slotted, fading = Slot(), Fading()

    def count(q, v):
        global CALLS
        CALLS += 1
        return np.full(q.shape, CALLS // 5 % 2)

    def counter(q, v):
        nonlocal calls
        calls += 1
        return np.full(q.shape, calls // 5 % 2)

    latest: np.ndarray  # which has no value yet

    def keeping(q, v):
        nonlocal latest
        latest = v
        return -0.1 * latest

    def reading(q, v):
        with open(__file__) as file:
            return 0.1 * (file.read(1) == "'") * v

    def lottery(q, v):
        import secrets

        return 0.0 * secrets.randbelow(2) * v

    return {
        "changes the list recent": lambda q, v: recent.append(1) or -0.1 * len(recent) * v,
        "changes the list held": lambda q, v, *, held=[]: held.append(1) or -0.1 * len(held) * v,
        "changes the list faded": lambda q, v: -fading.gain * v,
        "changes the array turns": lambda q, v, turns=ones: v * turns.__isub__(0.1),
        "changes the list both": lambda q, v: both[0].append(1) or -0.1 * len(both[0]) * v,
        "changes the set seen": lambda q, v: -v if seen.add(len(seen)) or len(seen) % 2 else v,
        "changes the global CALLS": count,
        "changes the global gain": lambda q, v: setattr(Slot, "gain", -Slot.gain) or Slot.gain * v,
        "changes the variable calls": singledispatch(counter),  # in a closure of the library
        "changes the variable latest": keeping,
        "changes the attribute gain of hold": lambda q, v: controller(q, v),
        "changes the attribute turn of heir": lambda q, v: -0.01 * next(heir) * v,
        "uses raw, which cannot be put back": lambda q, v: -0.1 * raw[0] * v,
        "changes the attribute gain": lambda q, v: -(1.0 + slower(next(iter(sized)))) * v,
        "the random generator normal": lambda q, v: normal() * q,
        "the random generator rng": partial(lambda k, q, v: k * rng.normal(size=q.shape), 0.1),
        "the random generator of numpy": noise,
        "asks for the time": lambda q, v: -v if datetime.now() else v,
        "asks for the time: wrapped": lambda q, v: 0.0 * CLOCK() * q,
        "asks for chance": lottery,
        "asks for a file": reading,
        "asks for lines of a text": lambda q, v: eval("-v", {"v": v}),
        "takes from ticks, which cannot be put back": lambda q, v: -0.01 * next(ticks) * v,
        "uses slotted, which cannot be put back": lambda q, v: slotted(q, v),
        "uses DEVICE, which cannot be put back": lambda q, v: 0.0 * DEVICE.random() * v,
        "something else when it is compiled: turns": lambda q, v: len(halving(q)[1]) * -v,
        "something else when it is compiled: no number": lambda q, v: 0.0 * np.exp(800.0 + q),
        "when it is compiled: no number, a sine": lambda q, v: np.sin(q) + 0.0 * np.exp(800.0 + q),
        "keeps a number from an earlier call": lambda q, v: halving(q)[1][-1] - v,
        # questions that a symbol answers otherwise than a number
        "when it is compiled: float": lambda q, v: -v if isinstance(q[0, 0], float) else 0.0 * q,
        "when it is compiled: a sine": lambda q, v: np.sin(q if q.dtype != float else 1.001 * q),
        "when it is compiled: dtype": lambda q, v: -v if q.dtype == float else 0.0 * q,
        "when it is compiled: its plane": lambda q, v: 0.0 * q + [0, 0, 1e-9 * (q.dtype == float)],
        "when it is compiled": lambda q, v: 0.0 * q if q.dtype == object else 9.0 * (q < -0.06),
        # and those that it does not answer
        "branches on a value: caught": catching,
        "branches on a value: any": lambda q, v: -v if np.any(q < -0.1) else v,
        "wants a plain number": lambda q, v: float(q[0, 0]) * v,
        "makes a complex number": lambda q, v: ((1.0 + 1e-9j) * q).real,
        "arcsinh": lambda q, v: np.arcsinh(q),
        "order of its own": lambda q, v: np.einsum("ij,ij->i", q, q)[:, None] * v,
        "order of its own: matmul": lambda q, v: np.matmul(v, np.full((3, 3), 0.1)),
        "order of its own: reduce": lambda q, v: -np.add.reduce(v, axis=0),
        "a product of symbols is one of": lambda q, v: (np.eye(3) @ v[:, :, None])[:, :, 0],
        "adds what comparisons made": lambda q, v: -v * ((q < -0.06) + (v < -0.1)),
        "unsupported operand type(s) for &": lambda q, v: -v * np.logical_and(q < -0.06, 2.0 + v),
        # nothing: Python alone would refuse to divide, or overflow
        "compiled: 1 / 0 of constants": lambda q, v: -v * np.tanh(1.0 / abs(q - q)),
        "compiled: a soft wall": lambda q, v: 5.0 / (1.0 + np.exp(2000.0 * (q + 0.1))),
        "compiled: constants": lambda q, v: -np.minimum(1.0 / np.maximum(q + 0.05, 0.0), 5.0),
        "compiled: dry friction": lambda q, v: -v / (1.0 + 1.0 / np.abs(v)),
        "compiled: equal": lambda q, v: np.where((q == 0.0) | ~(v != 0.0), q, 1.0),
        "compiled: between": lambda q, v: -v * np.where((q < -0.05) & (q > -0.1), 1.0, 0.1),
        "compiled: all": lambda q, v: -v * np.where(np.all(q > -0.1) | np.any(v > 1.0), 1.0, 0.1),
        "compiled: sign": lambda q, v: -0.1 * np.sign(v) - np.sign(q[0, 0] + 0.05),
        "compiled: an angle of new arrays": lambda q, v: (
            -v * np.arctan2(np.array([q[0, 1], q[1, 1]]), np.array([q[0, 0], 2.0]))[:, None]
        ),
        "compiled: of a sine": lambda q, v: np.arcsin(0.1 * q) + np.arccos(0.1 * q) - np.arctan(v),
        "compiled: not a number": lambda q, v: -v * (np.nan_to_num(np.sqrt(-0.03 - q[1, 1])) + 0.1),
        "compiled: formatted": lambda q, v: -v if f"{q[0, 0]:.3f}" else v,
        "compiled: masks": lambda q, v: -v * np.maximum(q < -0.06, True * (v < -0.1)) * abs(q < 1),
        "adds what comparisons made: if": lambda q, v: v * (np.where(q < 0, v < 0, True) + (v < 0)),
        "decided by its sign": lambda q, v: -v * np.arctan2(q[0, 2], q[0, 0]),
        "compiled: counted": lambda q, v: -0.1 * np.sum(q < -0.06) * v,
        "compiled: objects": lambda q, v: np.full(q.shape, 0.5, object) * -v,
        "compiled: in place": lambda q, v: halving(q)[0],
        # nothing that changes
        "compiled: a name of its own": lambda q, v: -drag.time * v,
        "compiled: pure": lambda q, v, k=(0.1, [0.2]): -k[0] * np.cross(q, v) if endless else q,
    }


FINE = [name for name in forces() if name.startswith("compiled")]
FROZEN = [(name, "semi_implicit" if name not in FINE else "rk4", "none") for name in forces()]
FROZEN += [(f"compiled: {name}", "semi_implicit", "project") for name in ("in place", "pure")]


@pytest.mark.parametrize(("name", "rule", "mode"), FROZEN)
def test_a_force_is_as_it_is_in_plain_numpy_or_it_is_told(name, rule, mode, monkeypatch):
    ends = []
    for way in WAYS if "compiled" in name else (Machine, Plain):  # what is not is in no other code
        feel(monkeypatch, forces()[name])
        ends.append(run(DOUBLE, rule, mode, 0.01, 20, way=way))
    *coded, plain = ends
    stop = "diverged at step 1" if "no number" in name else None
    assert {found.stopped for found in ends} == {stop}
    assert name not in FINE or all(np.array_equal(found.tip, coded[0].tip) for found in coded)
    inexact = "the array turns", "soft wall", "constants", "an angle", "of a sine"
    sines = any(words in name for words in inexact)
    same = partial(np.allclose, rtol=0.0, atol=1e-12) if sines else np.array_equal
    assert same(coded[-1].q[-1], plain.q[-1])
    assert name.split(":")[0] in coded[-1].how
    assert ("slower: " in coded[-1].how) == (name not in FINE)


def filling(system, q, v):
    f = system["m"] * c.GRAVITY
    f[-1] -= 0.5 * v[-1]
    f *= np.cbrt(system["m"][system["m"] > 0.5])[:, None]
    return f


def filing(system, q, v):
    system["asked"] = system.get("asked", 0) + 1
    return system["m"] * c.GRAVITY - 1e-3 * system["asked"] * v


@pytest.mark.parametrize(
    ("force", "way"), [(filling, "compiled"), (filing, "it changes the dict system")]
)
def test_a_force_may_fill_what_comes_of_masses_and_not_its_system(force, way, monkeypatch):
    monkeypatch.setattr(c, "external_force", force)
    found, plain = (run(dict(DOUBLE), "rk4", "none", 0.005, 40, way=x) for x in (Compiled, Plain))
    assert way in found.how and np.array_equal(found.tip, plain.tip)


def test_what_blows_up_in_a_plane_is_no_motion_out_of_it(monkeypatch):
    feel(monkeypatch, lambda q, v: q * np.exp(800.0 + np.sum(q)))  # where q is zero, 0 * inf
    found = [run(DOUBLE, "rk4", "none", 0.005, 9, way=way) for way in WAYS]
    assert {x.stopped for x in found} == {"diverged at step 1"}
    assert not any("slower" in x.how for x in found)


def making(q, v):
    global MADE
    MADE = v
    return v


def test_only_what_a_force_names_is_put_back(monkeypatch):
    """Another thread may change the rest meanwhile."""
    memory = Memory(making)
    monkeypatch.setattr(sys.modules[__name__], "CALLS", 7)
    making(0, 1)
    assert memory.restore() == "it changes the global MADE"
    assert CALLS == 7 and "MADE" not in globals()


def lists(q, v, m, force, dt):
    q, v = c.semi_implicit_step(q, v, m, force, dt)
    return list(q), v.tolist() if isinstance(v[0, 0], float) else list(v)


def test_a_step_may_return_lists_and_no_force_changes_the_state(monkeypatch):
    cases = product(("semi_implicit", lists), (Compiled, Plain))
    runs = [run(DOUBLE, rule, steps=40, way=way) for rule, way in cases]
    assert all(alike(found, runs[0]) for found in runs)
    feel(monkeypatch, lambda q, v: np.minimum(v, 0.1, out=v))
    for way in (Compiled, Plain):
        with pytest.raises(ValueError, match="read-only") as told:
            run(DOUBLE, way=way, steps=40)
        assert "none is changed in place" in told.value.__notes__[0]


def test_what_is_measured_is_measured_as_the_lines_stand(monkeypatch):
    """Though it remembers, or asks what a symbol answers otherwise than a number."""
    seen, energies = [], {}
    energies["remembers"] = lambda system, q, v: seen.append(1) or float(len(seen))
    energies["asks"] = lambda system, q, v: q[1, 1] * (1.0 if q.dtype == float else 2.0)
    for energy in energies.values():
        monkeypatch.setattr(c, "energy", energy)
        found = []
        for way in (Compiled, Plain):
            seen.clear()
            found.append(run(DOUBLE, steps=40, way=way).energies)
        assert np.array_equal(*found)


@pytest.mark.parametrize("name", ["energy", "constraint_violation"])
@pytest.mark.parametrize("way", [Compiled, Plain])
def test_who_measures_a_run_does_not_change_it(way, name, monkeypatch):
    def pushing(system, q, v=None):
        q += 1e-3
        return 1.0

    monkeypatch.setattr(c, name, pushing)
    with pytest.raises(ValueError, match="read-only"):
        run(DOUBLE, way=way, steps=9)


def test_a_run_can_be_sent_to_another_process():
    found = run(DOUBLE, steps=40)
    sent = pickle.loads(pickle.dumps(found))
    assert alike(sent, found) and sent.source == found.source and repr(sent) == repr(found)


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
    alone = in_every_way(timid, PENDULUM, 0.0, 0.04, 40)
    lengths = np.array([too_long(x, 0.04) for x in alone.v[:-1]])
    assert alone.halved == np.sum(lengths > 1.0) > 0 and max(lengths) > 2.0  # of halves
    assert np.array_equal(alone.q, run(PENDULUM, by_hand, 0.0, 0.04, 40, range(41), Plain).q)
    q, _ = side_by_side(alone, PENDULUM, timid, 0.0, 0.04)
    expected = np.where(lengths[:, None, None] > 1.0, np.nan, alone.q[1:])
    assert np.array_equal(q[..., :2], expected[..., :2], equal_nan=True)
    way = once_for_all(Compiled)
    again = [run(PENDULUM, timid, 0.0, 0.04, 40, way=way).halved for _ in range(2)]
    assert again == [alone.halved] * 2


def test_a_length_of_numpy_costs_no_more_than_one_of_python():
    """Each operation on a number of numpy's takes several times as long as on Python's own."""
    short = [run(PENDULUM, "rk4", 0.0, np.float32(0.01), 20, way=way) for way in (Plain, Compiled)]
    assert np.array_equal(*(found.tip for found in short))  # dt / 6.0 does not round to so few bits
    found = run(PENDULUM, "rk4", 0.0, np.float64(0.01), 20)
    given, step = [], found.stepper.single
    step.machine, step.traced.function = None, lambda *given_: given.extend(given_)
    step(np.ones(4), 1, found.stepper.dt)
    assert {type(x) for x in (*given[0], given[-1])} == {float}


def hidden(q, v, m, force, dt):
    """It asks of a loop, which comes to no end where the pendulum is fast, whether it is small."""
    x = repeat(lambda x: (0.5 * x, np.sum(v * v) / 9.0), 1.0 + 0.0 * q[0], 1, "too fast")
    return c.semi_implicit_step(q, v + np.where(x < 0.1, 0.0, 1e-3) * v, m, force, dt)


def ahead(q, v, m, force, dt):
    """It would go on in halves, from the step on with which the run has flown apart."""
    limit = np.where(q[0, 0] > 45.0, 150.0, 50.0)
    v = repeat(lambda v: (1.0 * v, limit * dt), v, 1, "too long")
    return q + dt * v, v


def bursting(q, v, m, force, dt):
    """Timid, until a whole step, though no half of one, goes beyond all numbers."""
    q, v = timid(q, v, m, force, dt)
    far = 1.8e155 * dt * (1.0 - q[0, 0])
    return q + 1e-310 * (far * far), v


def test_a_loop_without_an_end_and_halves_that_were_not_taken_are_seen():
    assert "too fast" in in_every_way(hidden, PENDULUM, "project", 0.005, 4000).stopped
    fast = PENDULUM | {"v0": np.full((1, 3), 1000.0)}
    found = in_every_way(ahead, fast, "none", 0.01, 100)
    assert (found.halved, found.stopped) == (0, "diverged at step 6")
    found = in_every_way(bursting, PENDULUM, 0.0, 0.04, 40)
    assert found.halved > 0 and found.stopped == f"diverged at step {len(found.tip)}"


@pytest.mark.parametrize("begin", [lambda q: q, np.zeros_like], ids=["unused", "of zeros"])
def test_a_loop_without_an_end_stops_a_run_also_where_its_end_is_not_needed(begin, monkeypatch):
    def endless(q):
        return 0.0 * repeat(lambda x: (0.5 * x, 2.0 + np.sum(q * q)), begin(q), 3, "no end")

    feel(monkeypatch, lambda q, v: endless(q) - v)
    for way in (Compiled, Plain):
        assert run(DOUBLE, steps=9, way=way).stopped == "stopped at step 1: no end"
    many, asked = np.stack([DOUBLE["q0"]] * 9), mapped(endless, uses=10**6)
    with pytest.raises(Stop, match="no end"):
        asked(many, many)


def test_where_machine_code_tells_of_a_loop_without_an_end_nothing_slower_is_asked(monkeypatch):
    pytest.importorskip("llvmlite", reason="the extra fast brings it")
    expected = run(PENDULUM, timid, dt=0.04, steps=40, way=Plain)
    monkeypatch.setattr(Single, "prepare", lambda _: None)
    monkeypatch.delattr(Traced, "function")
    for way in (Machine, Rows):
        found = run(PENDULUM, timid, dt=0.04, steps=40, way=way)
        assert found.halved == expected.halved > 0 and np.array_equal(found.tip, expected.tip)


@pytest.mark.parametrize("block", [48, compiled.BLOCK])
def test_what_is_compiled_is_compared_again_on_the_way(block, monkeypatch):
    """Where floats feel a drag that symbols do not, though neither at the start nor in the end."""
    monkeypatch.setattr(compiled, "BLOCK", block)  # of 12 steps, or all of them

    def drag(q, v):
        return -0.1 * v if isinstance(q[0, 1], float) and -0.8 < q[0, 1] < -0.05 else 0.0 * v

    feel(monkeypatch, drag)
    found = run(PENDULUM, "semi_implicit", "none", 0.005, 100, range(101))
    assert not -0.8 < found.q[1, 0, 1] < -0.05 and not -0.8 < found.q[-1, 0, 1] < -0.05
    assert "slower: it does something else" in found.how

    def left(q):
        return isinstance(q[0, 0], float) and q[0, 0] < 0.0

    feel(monkeypatch, lambda q, v: -0.1 * v if left(q) else 0.0 * v)
    found = run(PENDULUM, timid, "none", 0.04, 90, range(91))  # of halves on both ways
    lengths = np.array([too_long(x, 0.04) for x in found.v[:-1]])
    assert "slower: " in found.how and found.halved == np.sum(lengths > 1.0) > 0


def test_a_long_block_is_compared_in_its_middle_too_and_a_short_one_in_the_end():
    mapped.recent.clear()
    looks = []
    for rule, steps in (("rk4", 60), ("rk4", 12), ("gauss", 60)):  # a step of gauss takes long
        plain = mock.patch.object(Traced, "plain", autospec=True, side_effect=Traced.plain)
        with plain as asked:
            run(DOUBLE, rule, "none", 0.005, steps)
        looks.append(asked.call_count)
    # one at the first block, which is one step long; and one for what is measured of each later one
    assert looks == [1 + (1 + 1) + (2 + 1), 1 + (1 + 1), 1 + (1 + 1)]


def test_what_is_measured_of_the_same_system_is_traced_once_and_of_another_again():
    mapped.recent.clear()
    heavy = DOUBLE | {"m": DOUBLE["m"] * [[1.0], [3.0]]}
    with mock.patch.object(crowds, "Traced", side_effect=Traced) as traced:
        for system, count in ((DOUBLE, 1), (DOUBLE | {}, 1), (heavy, 2), (DOUBLE, 2)):
            runs = [run(system, "semi_implicit", "none", 0.005, 40, way=way) for way in WAYS[::3]]
            assert alike(*runs) and traced.call_count == count


def test_functions_that_are_alike_share_their_code_and_nothing_else():
    """What is changed, or set aside, is the concern of the function that it belongs to."""
    q, states = DOUBLE["q0"], np.stack([DOUBLE["q0"]] * 400)

    def asking(m, *, scale=1.0):
        def energy(q, v, *, scale=scale):
            return scale * np.sum(m * q * q)

        return mapped(energy, 400, again=True), scale * np.sum(m * q * q)

    mapped.recent.clear()
    weights = [DOUBLE["m"].copy() for _ in range(4)]
    asked = [asking(m) for m in weights[:3]] + [asking(weights[3], scale=2.0)]
    plain = mock.patch.object(Traced, "plain", autospec=True, side_effect=Traced.plain)
    with plain as lines, mock.patch.object(crowds, "Traced", side_effect=Traced) as traced:
        found = [asked[0][0](states, 0.0 * states)]
        before = lines.call_count
        found += [asked[1][0](states, 0.0 * states)]
        weights[0][0] = 7.0  # the first is done
        weights[2][0] = 9.0  # the third has not been asked yet
        found += [function(states, 0.0 * states) for function, _ in asked[2:]]
    expected = [asked[0][1], asked[1][1], np.sum(weights[2] * q * q), asked[3][1]]
    assert np.array_equal([made[-1] for made in found], expected)
    assert traced.call_count == 3  # the second is the first one's, and yet compared:
    assert lines.call_count == 4 * before

    def leading_to_itself():
        def double(q, v):
            return 2.0 * q[0, 0] if double else None

        return mapped(double, 400, again=True)

    assert all(leading_to_itself()(states, 0.0 * states)[0] == 2.0 * q[0, 0] for _ in range(2))


OTHERS = [({"a": 1.0}, {"b": 1.0}), ([1.0], [1.0, 2.0]), (1, 1.0), (np.ones(2), np.ones(2, int))]
OTHERS += [(0.0, -0.0), (np.zeros(2), -np.zeros(2))]  # whose angles are others


@pytest.mark.parametrize(("one", "other"), OTHERS)
@pytest.mark.parametrize("about", [lambda x: lambda: x, lambda x: lambda x=x: x])
def test_what_has_the_same_lines_about_something_else_is_not_alike(about, one, other):
    assert crowds.alike(about(one), about(deepcopy(one)))
    assert not crowds.alike(about(one), about(other))


WIND = 0.0  # N, or J


def begun(way, steps):
    """A Log of the double pendulum that has begun, and its start."""
    force = c.make_force(DOUBLE, "none")

    def measure(q, v):
        return c.constraint_violation(DOUBLE, q), c.energy(DOUBLE, q, v)

    stepper = way(c.semi_implicit_step, DOUBLE["m"], force, 0.005, measure, steps)
    log = Log(stepper, steps, range(steps + 1), 100.0)
    return log, *log.start(DOUBLE["q0"], DOUBLE["v0"])


def taken(way, change=lambda k, v: None, steps=60):
    """The Run of a loop that is typed by hand: after step k it goes on from what change(k, v)
    returns, unless that is None."""
    log, q, v = begun(way, steps)
    with log:
        for k in range(steps):
            q, v = log.step(q, v)
            other = change(k, v)
            v = v if other is None else other
    return log.run()


CHANGES = {  # of a loop
    "none": lambda k, v: None,
    "each": lambda k, v: 0.99 * v,
    "one in ten": lambda k, v: 0.9 * v if k % 10 == 9 else None,
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("energy", [c.energy, lambda *_: 1])
def test_a_loop_may_change_what_it_is_handed(energy, change, monkeypatch):
    """Also where all energies are equal."""
    monkeypatch.setattr(c, "energy", energy)
    quick, plain = (taken(way, change) for way in (Compiled, Plain))
    assert alike(quick, plain) and quick.how.startswith("compiled")


def test_a_loop_may_go_on_where_a_state_has_diverged():
    for way in (Compiled, Plain):
        log, q, v = begun(way, 60)
        with log:
            for _ in range(59):
                start, (q, v) = (q, v), log.step(q, v)
            with pytest.raises(Stop):
                log.step(q + [1e4, 0.0, 0.0], v)
            log.step(*start)
        assert len(log.run().tip) == 61 and not log.run().stopped


def test_a_run_has_no_more_steps_than_were_asked_for():
    for way in (Compiled, Plain):
        log, q, v = begun(way, 3)
        for _ in range(3):
            q, v = log.step(q, v)
        with log, pytest.raises(ValueError, match="the 3 steps of this run are done"):
            log.step(q, v)
        assert len(log.run().tip) == 4


def test_a_loop_may_keep_a_run_from_what_it_would_come_to(monkeypatch):
    usual = c.energy

    def lost(system, q, v):
        return usual(system, q, v) + np.where(q[1, 1] < -0.5, np.inf, 0.0)

    monkeypatch.setattr(c, "energy", lost)
    for way in (Compiled, Plain):
        last = len(taken(way, steps=200).tip) - 2
        found = taken(way, lambda k, v, last=last: -v if k == last else None, 2 * last)
        assert 16 < last < 198 and found.stopped is None and len(found.tip) == 2 * last + 1


@pytest.mark.parametrize("change", [lambda k, v: None, lambda k, v: 0.99 * v])
def test_hardly_more_is_computed_ahead_than_a_loop_takes(change, monkeypatch):
    """None at all if it goes on as it began, and where it changes each state one for each."""
    counts = []

    def counted(self, state, count, dt):
        counts.append(count)
        return ahead(self, state, count, dt)

    ahead = Single.__call__
    monkeypatch.setattr(Single, "__call__", counted)
    changed = change(0, 1.0) is not None
    assert len(taken(Compiled, change).tip) == 61
    assert sum(counts) <= (2 * 60 + 16 if changed else 60)


def test_what_the_loop_changes_the_force_feels_or_it_is_told(monkeypatch):
    """A clock is noticed at the first step; what is changed later has come too late."""
    monkeypatch.setattr(f"{__name__}.WIND", 0.0)
    feel(monkeypatch, lambda q, v: 0.0 * q + [WIND > 0.1, 0.0, 0.0])

    def ticking(begin, k, v=None):
        global WIND
        WIND = 0.01 * max(0, k - begin)

    def blown(way, begin):
        ticking(0, 0)
        return taken(way, partial(ticking, begin))

    late = pytest.raises(ValueError, match="the global WIND was changed while steps were")
    found, plain = (blown(way, -1) for way in (Compiled, Plain))
    assert "slower: the loop changes the global WIND" in found.how and found.stepper.lies
    assert np.array_equal(found.tip, plain.tip)
    for begin in (3, 30, 58):
        with late:
            blown(Compiled, begin)
    assert blown(Plain, 3).how == Plain.how
    ticking(0, 0)
    shown = Shown()
    monkeypatch.setattr(c, "external_force", shown)
    assert taken(Compiled, lambda k, v: shown.on_frame()).how.startswith("compiled")
    usual = c.energy
    monkeypatch.setattr(c, "energy", lambda *state: usual(*state) + WIND)
    with late:
        blown(Compiled, 3)
    assert np.array_equal(*(blown(way, -1).energies for way in (Compiled, Plain)))
    monkeypatch.setitem(DOUBLE, "m", DOUBLE["m"].copy())

    def lighter(k, v):
        DOUBLE["m"][:] *= 1.0 - 0.1 * (k == 30)

    with pytest.raises(ValueError, match="the array m was changed"):
        taken(Compiled, lighter)


def test_what_changed_since_it_was_traced_is_traced_again_or_told(monkeypatch):
    """Also where the last state, which is compared, feels nothing of it."""
    monkeypatch.setattr(f"{__name__}.WIND", 0.0)
    feel(monkeypatch, lambda q, v: 0.0 * q + [WIND * (q[0, 0] > 0.5), 0.0, 0.0])
    q, pulls = np.stack([DOUBLE["q0"]] * 200), mapped(partial(c.tensions, DOUBLE))
    q[-1] *= [-1.0, 1.0, 1.0]
    many = _runs.crowd(DOUBLE | {"q0": q, "v0": 0.0 * q}, "semi_implicit", "none", 0.005)
    before = pulls(q, 0.0 * q)
    monkeypatch.setattr(f"{__name__}.WIND", 50.0)
    after = pulls(q, 0.0 * q)
    assert np.array_equal(after, [c.tensions(DOUBLE, x, 0.0 * x) for x in q])
    assert np.array_equal(after[-1], before[-1]) and not np.array_equal(after, before)
    with pytest.raises(ValueError, match="the global WIND was changed: make another Crowd"):
        many.advance(1)
    with pytest.raises(ValueError, match="not zero where the first ones were: make another"):
        many.put(q, 0.0 * q + 1.0)


def test_a_crowd_is_compared_again_once_it_moves(monkeypatch):
    feel(monkeypatch, lambda q, v: -v if q.dtype == float else 0.0 * q)
    many = _runs.crowd(DOUBLE | {"q0": DOUBLE["q0"][None]}, "semi_implicit", "none", 0.005)
    many.advance(0)
    with pytest.raises(Untraceable, match="something else when it is compiled"):
        many.advance(3)


GUSTS = [0.0]


class Calm:
    speed = 0.0

    def wind(self):
        return self.speed

    def told(self):
        return getattr(self, "by_" + "wind")()

    def by_wind(self):
        return GUSTS[0]


class Stormy(Calm):
    def wind(self):
        return 9.0


def kept():
    """Where a force may have its wind from, made anew: how it asks there, and how a loop changes
    it."""
    GUSTS[:] = [0.0]
    row, number = np.zeros(1, [("speed", float)])[0], ctypes.c_double(0.0)
    fit, winds, calm, turned = np.polynomial.Polynomial([0.0]), {"now": 0.0}, Calm(), Calm()
    shown, values, far, place = MappingProxyType(winds), winds.values(), weakref.ref(calm), Calm()
    place.mill, mill = calm, "mill"

    def blow(speed=0.0):
        return speed

    return {
        "a record": (lambda: row["speed"], lambda: row.__setitem__("speed", 9.0)),
        "a number of C": (lambda: number.value, lambda: setattr(number, "value", 9.0)),
        "a polynomial": (lambda: fit(0.0), lambda: setattr(fit, "coef", np.array([9.0]))),
        "a view of a dict": (lambda x=shown: x["now"], lambda: winds.update(now=9.0)),
        "values of a dict": (lambda x=values: sum(x), lambda: winds.update(now=9.0)),
        "a weak reference": (lambda x=far: x().speed, lambda: setattr(calm, "speed", 9.0)),
        "a name in a variable": (
            lambda: getattr(place, mill).speed,
            lambda: setattr(calm, "speed", 9.0),
        ),
        "a method's name in a variable": (lambda: calm.told(), lambda: GUSTS.__setitem__(0, 9.0)),
        "a class": (lambda: turned.wind(), lambda: setattr(turned, "__class__", Stormy)),
        "a default": (lambda: blow(), lambda: setattr(blow, "__defaults__", (9.0,))),
    }


@pytest.mark.parametrize("name", kept())
def test_wherever_a_force_has_it_from_what_the_loop_changes_is_felt_or_told(name, monkeypatch):
    ask, change = kept()[name]
    feel(monkeypatch, lambda q, v: [ask(), 0.0, 0.0] + 0.0 * q)
    found = told = None
    try:
        found = taken(Compiled, lambda k, v: change() if k == 30 else None)
    except ValueError as why:
        told = str(why)
    ask, change = kept()[name]
    plain = taken(Plain, lambda k, v: change() if k == 30 else None)
    assert ask() == 9.0 and plain.tip[-1, 0] > 1.5
    assert alike(found, plain) if found else "was changed while steps were computed" in told


def splitting(q, v, m, force, dt):
    """The wind alone blows for the first half of a step."""
    global WIND
    for WIND in (10.0, 0.0):  # noqa: B007
        q, v = c.semi_implicit_step(q, v, m, force, 0.5 * dt)
    return q, v


def test_a_switch_that_a_step_throws_is_felt(monkeypatch):
    monkeypatch.setattr(f"{__name__}.WIND", 0.0)
    feel(monkeypatch, lambda q, v: [WIND, 0.0, 0.0] + 0.0 * q)
    found, plain = (run(DOUBLE, splitting, steps=40, way=way) for way in (Compiled, Plain))
    assert "it changes the global WIND" in found.how and np.array_equal(found.tip, plain.tip)


def test_an_interrupt_leaves_no_symbols_behind(monkeypatch):
    seen = []

    def interrupted(q, v):
        seen.append(q)
        raise KeyboardInterrupt

    feel(monkeypatch, interrupted)
    with pytest.raises(KeyboardInterrupt):
        run(DOUBLE, steps=40)
    assert not seen


def test_a_long_step_is_compiled_if_its_steps_repay_that(monkeypatch):
    monkeypatch.setattr(trace, "LONG", 20)  # operations
    few, many = (run(DOUBLE, steps=steps) for steps in (2, 100))
    assert "it is too long to be compiled for so few steps" in few.how
    assert many.how.startswith("compiled") and np.array_equal(many.tip[:3], few.tip)


def test_a_step_of_many_rods_is_bytecode_at_first():
    chain = c.build_system("chain", links=150)
    found, plain = (run(chain, hold="project", steps=9, way=way) for way in (Compiled, Plain))
    assert ("bytecode" in found.how) == llvm.available()
    assert alike(found, plain)


def test_a_step_in_a_plane_is_traced_once_though_a_particle_begins_at_its_origin():
    leg = c.build_system("jansen_leg")
    rule, force = _runs.case(leg, "semi_implicit", "none", 0.005)
    with mock.patch.object(traced, "Program", wraps=traced.Program) as made:
        found = Traced(rule, leg["m"], force, moves(leg["q0"], leg["v0"]))
    at_origin = (leg["q0"] == 0.0) & (leg["v0"] == 0.0)
    assert np.any(at_origin[:, :2]) and np.all(at_origin[:, 2]) and made.call_count == 1
    assert np.array_equal(found.moving[0], np.broadcast_to([True, True, False], (6, 3)))


@pytest.mark.skipif(not llvm.available(), reason="without llvmlite there is no machine code")
def test_the_best_of_machine_code_is_not_made_of_many_operations_in_a_row(monkeypatch):
    """However soon it would repay its making, nor asked for again: LLVM would take minutes."""
    monkeypatch.setattr(compiled, "BLOCK", 100)  # numbers: it is asked after every 12 steps
    monkeypatch.setattr(compiled, "LOADING", 0.0)
    monkeypatch.setattr(compiled, "COMPILING", 0.0)
    for most, best in ((native.LONG, [False, True]), (20, [False])):
        monkeypatch.setattr(native, "LONG", most)
        with mock.patch.object(native, "machine_code", wraps=native.machine_code) as made:
            assert run(DOUBLE, steps=100).how == "compiled to machine code"
            _runs.crowd(DOUBLE | {x: DOUBLE[x][None] for x in ("q0", "v0")}, "euler", "none", 0.005)
        assert [call.args[2] for call in made.call_args_list] == [*best, best[-1]]


def test_every_step_is_measured_and_the_edges_of_blocks_change_nothing(monkeypatch):
    """Whichever states are kept, and wherever machine code takes over."""
    chain, runs, same = c.build_system("chain", links=4), [], np.array_equal
    chain = chain | {"v0": np.random.default_rng(6).normal(size=(4, 3))}
    for block, cost in ((1 << 17, 1e9), (100, 1e9), (100, 0.0), (10, 1e9)):  # of one step, at last
        monkeypatch.setattr(compiled, "BLOCK", block)
        monkeypatch.setattr(compiled, "LOADING", cost)
        monkeypatch.setattr(compiled, "COMPILING", cost)
        runs.append(run(chain, "rk4", "project", 0.005, 40, range(41)))
    assert all(alike(found, runs[0]) for found in runs)
    ways = ["compiled to machine code" in found.how for found in runs]
    assert ways == [False, False, llvm.available(), False]
    full, some = runs[0], [0, 7, 33, 40]
    few = run(chain, "rk4", "project", 0.005, 40, some)
    assert same(few.q, full.q[some]) and same(few.v, full.v[some])
    assert same(few.violations, full.violations)
    assert same(full.kept, range(41)) and same(full.q[0], chain["q0"])
    assert same(full.tip, full.q[:, -1])
    assert same(full.violations, [c.constraint_violation(chain, q) for q in full.q])
    energies = [c.energy(chain, *state) for state in zip(full.q, full.v, strict=True)]
    assert same(full.energies, energies)


@pytest.mark.parametrize("rule", ["semi_implicit", "gauss"])
def test_a_loop_typed_by_hand_has_the_bits_of_simulate(rule):
    """And a run unpacks as the chapter has it."""
    system = c.build_system("triple")
    step, force = c.INTEGRATORS[rule], c.make_force(system, 20.0)
    tip, _, _ = c.simulate(step, system, force, 0.005, 9)
    q, v = system["q0"], system["v0"]
    for k in range(1, 10):
        q, v = step(q, v, system["m"], force, 0.005)
        assert np.array_equal(tip[k], q[-1])


def test_a_turn_of_the_loop_may_change_the_state_but_not_in_place():
    """What follows goes on from there."""
    out_of_its_plane = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    single = np.float32
    changes = lambda v: 0.5 * v, lambda v: v + out_of_its_plane, lambda v: 0.5 * v.astype(single)

    def once(change, k, v):
        return change(v) if k == 40 else None

    for change in changes:
        quick, plain = (taken(way, partial(once, change)) for way in (Compiled, Plain))
        assert alike(quick, plain) and quick.how.startswith("compiled")
        assert abs(quick.energies[42] - quick.energies[41]) > 0.1
    with pytest.raises(ValueError, match="read-only") as found:
        taken(Compiled, partial(once, lambda v: v.__imul__(0.9)))
    assert found.value.__notes__[0].endswith("v = 0.9 * v.")
    inside, anew = (lambda k, v: v.__imul__(0.9)), (lambda k, v: 0.9 * v)
    assert alike(*(taken(Plain, change) for change in (inside, anew)))  # of nothing that is ahead


def test_runs_in_threads_are_the_runs_in_turn():
    """While one traces, the others' plain steps are of numbers, whatever rule they are."""
    cases = [*product(("semi_implicit", "gauss:3"), ("none", "project"))] * 2

    def one(case):
        return run(DOUBLE, *case, steps=60)

    with ThreadPoolExecutor(4) as pool:
        beside = list(pool.map(one, cases))
    assert all(found.how.startswith("compiled") for found in beside)
    assert all(map(alike, beside, map(one, cases)))


def in_place_step(q, v, m, force, dt):
    v += dt * (force(q, v) / m)
    q += dt * v
    return q, v


def there_and_back(q, v, m, force, dt):
    return q + np.where(q < 500.0, 1000.0, -1000.0), v


def fast_step(q, v, m, force, dt):
    return q + dt * v, 1e200 + v  # whose rods are right for one more step


CASES = [  # name, rule, mode, dt, steps, how it ends
    ("pendulum", "gauss:3", "none", 1e4, 2, "stopped at step {}: the Gauss stages do not settle"),
    ("triple", "rk4", "project", 0.3, 9, "stopped at step {}: no way back onto the rods"),
    ("fourbar_coupler", "semi_implicit", "baumgarte", 0.1, 40, "diverged at step {}"),
    ("double", there_and_back, "none", 0.005, 40, "diverged at step 1"),
    ("pendulum", fast_step, "none", 0.005, 5, "diverged at step 1"),
    ("pendulum", "gauss", "none", 0.5, 4, None),
    ("braced", "semi_implicit", "none", 0.02, 90, None),
    ("double", in_place_step, "project", 0.005, 10, None),
]
# stages fill a register, leave lanes over, and take more than one
STAGES = [("double", 4), ("pendulum", 16), ("jansen_leg", 3)]
CASES += [(name, make_gauss(stages, 1e-9), "none", 0.02, 3, None) for name, stages in STAGES]
FITS = product(c.INTEGRATORS, c.hold_table().items())
FITS = [(rule, mode) for rule, (mode, hold) in FITS if not misfit(hold, rule)]
SCENES = "pendulum", "braced", "jansen_leg", "spin", "windows"
SHORT = {(name, "semi_implicit", "project") for name in SCENES}
SHORT |= {("double", *fit) for fit in FITS if {"semi_implicit", "none", "project"} & {*fit}}
LOOP = ("semi_implicit", "soft"), *product(("semi_implicit", "rk4", "gauss"), ["project"])
SHORT |= {("fourbar_coupler", *fit) for fit in LOOP}
CASES += [(*case, 0.005, 3, None) for case in sorted(SHORT)]


@pytest.mark.parametrize(("name", "rule", "mode", "dt", "steps", "why"), CASES)
def test_a_run_is_alike_in_every_way_alone_or_side_by_side(name, rule, mode, dt, steps, why):
    system = c.build_system(name)
    alone = in_every_way(rule, system, mode, dt, steps)
    assert alone.stopped == (why and why.format(len(alone.tip)))
    assert np.array_equal(alone.kept, range(len(alone.tip)))
    assert all(np.isfinite(x).all() for x in (*alone, alone.q, alone.v))
    names = "__", "import", name  # a scene file stays data, whatever it holds
    assert not any(x in alone.source for x in names)
    long = rule in ("midpoint", "gauss")  # four stages will do
    if name in ("double", "fourbar_coupler") and not long and not alone.stopped:
        q, v = side_by_side(alone, system, rule, mode, dt)
        assert np.array_equal(q, alone.q[1:]) and np.array_equal(v, alone.v[1:])


@pytest.mark.parametrize("way", [Compiled, Plain])
def test_where_a_force_becomes_no_number_steps_are_kept_watched_or_not(way, monkeypatch):
    system = c.build_system("fourbar_coupler")

    def lost(q, v):
        return 0.0 * v + np.sqrt(1.0 - 1e3 * np.sum(np.square(q - system["q0"])))

    feel(monkeypatch, lost)
    watch = watched(system, partial(c.unheld, system))
    ways = way, partial(way, watch=watch)
    alone, seen = (run(system, "semi_implicit", "none", steps=60, way=each) for each in ways)
    assert 5 < len(alone.tip) < 60 and alone.stopped == seen.stopped
    assert np.array_equal(seen.tip, alone.tip) and seen.watched > 0.0


@pytest.mark.parametrize("way", [Compiled, Plain])
def test_a_step_that_fills_the_same_arrays_each_time_is_noted_as_it_was(way):
    kept_q, kept_v = np.empty((2, 2, 3))

    def filling_step(q, v, m, force, dt):
        kept_q[...], kept_v[...] = c.semi_implicit_step(q, v, m, force, dt)
        return kept_q, kept_v

    found, usual = (
        run(DOUBLE, x, "none", 0.005, 9, range(10), way) for x in (filling_step, "semi_implicit")
    )
    assert alike(found, usual)


@pytest.mark.parametrize("returned", [None, 3])
@pytest.mark.parametrize("way", [Compiled, Plain])
def test_a_step_that_does_not_return_q_and_v_is_told_of_by_its_line(way, returned):
    force = c.make_force(DOUBLE, "none")

    def mine(q, v, *_):
        return None if returned is None else (q, v, 0)

    line = mine.__code__.co_firstlineno
    for rule, after in ((mine, None), (c.rk4_step, mine)):
        with pytest.raises(ValueError, match=rf"mine \(test_steps.py, line {line}\) returned"):
            c.simulate(rule, DOUBLE, force._replace(after=after), 0.1, 9, (), way)


@pytest.mark.parametrize("wrong", [None, -9.81, np.zeros((2, 2)), np.zeros(6)])
@pytest.mark.parametrize("way", [Compiled, Plain])
def test_a_force_of_ones_own_that_is_not_three_numbers_a_particle_is_told_of_by_its_line(
    way, wrong
):
    def mine(q, v):
        return wrong

    said = rf"mine \(test_steps.py, line {mine.__code__.co_firstlineno}\): .* must be"
    with pytest.raises(ValueError, match=said):
        c.simulate(c.rk4_step, DOUBLE, mine, 0.1, 9, (), way)


def test_a_rule_may_ask_its_force_for_more_than_numbers():
    def mine(q, v, m, force, dt):
        assert force.system is not None
        return c.semi_implicit_step(q, v, m, force, dt)

    force = c.make_force(DOUBLE, "none")
    found = c.simulate(mine, DOUBLE, force, 0.005, 9)
    assert np.array_equal(found.tip, run(DOUBLE, steps=9).tip)


@pytest.mark.parametrize("name", ["energy", "constraint_violation"])
def test_a_measure_that_is_no_number_is_told(name, monkeypatch):
    for wrong in (None, np.ones(1)):
        monkeypatch.setattr(c, name, lambda *_, wrong=wrong: wrong)
        with pytest.raises(ValueError, match=rf"{name} returned .*, where one number must be"):
            run(DOUBLE, steps=9)
