"""Forces that differ by numbers are traced once, and each is what its own lines say."""

from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple
from unittest import mock

import constraints as c
from curriculum.common import llvm, sharing
from curriculum.common.bytecode import Bytecode
from curriculum.common.sharing import Shared
from curriculum.common.steps import followed
from curriculum.common.tape import Tape, Untraceable, effort
from curriculum.common.traced import Traced, moves

import numpy as np
import pytest

DT = 0.01


@pytest.fixture(autouse=True)
def nothing_kept():
    Shared.recent.clear()
    yield
    Shared.recent.clear()


def hanging(links=170):
    """A chain whose state is long, and which swings."""
    system = c.build_system("chain", links=links)
    system["v0"] = np.cross([0.0, 0.0, 1.0], system["q0"])
    return system


def traced(force, rule=c.semi_implicit_step):
    system = force.system
    step = followed(rule, getattr(force, "after", None))
    return Traced(step, system["m"], force, moves(system["q0"], system["v0"]))


def exact(found, system=None):
    """Whether a Traced step of its system, also as bytecode, has the bits of the lines as they
    stand."""
    system = system or SYSTEM
    state = found.columns(system["q0"], system["v0"])[:, 0]
    step, end = [], state[:, None].copy()
    found.function(tuple(state.tolist()), 1, step.append, DT)
    if llvm.available():
        Bytecode(found.program)(end, 1, np.empty((1, len(end))), DT)
        step.append(end[:, 0])
    return not any(found.differs(state, np.array(end), DT) for end in step)


SYSTEM = hanging()


def operations(found):
    """How many operations of each kind the routine of a Traced step does. Where a sign is turned
    round, a sum is a difference."""
    program = next(iter(found.program.tape.parts.values())).program
    signs = (program.tape.nodes[name][0] for name in program.tape.needed(program.computed))
    return Counter(sign.replace("-", "+") for sign in signs)


@pytest.mark.parametrize("rule", [c.semi_implicit_step, c.rk4_step])
def test_a_force_that_is_shared_does_what_its_own_lines_do_and_no_more(rule):
    holds = c.hold_table(DT, 7.0)
    forces = {mode: c.make_force(SYSTEM, holds[mode]) for mode in holds}
    shared = {mode: traced(forces[mode], rule) for mode in holds}
    with mock.patch.object(sharing, "LENGTHY", np.inf):
        for mode, force in forces.items():
            assert operations(traced(force, rule)) == operations(shared[mode]), mode
    assert all(map(exact, shared.values()))


@pytest.mark.parametrize("mode", c.hold_table())
def test_a_force_that_is_the_first_does_what_its_own_lines_do(mode):
    """Though some numbers of soft are numpy's."""
    assert exact(traced(c.make_force(SYSTEM, c.hold_table(DT, 7.0)[mode]))) and Shared.recent


def test_modes_that_differ_by_numbers_are_traced_once():
    noted = {}
    for mode in c.hold_table():
        traced(c.make_force(SYSTEM, mode))
        noted[mode] = effort.noted
    assert max(noted["baumgarte"], noted["impulse"]) < 0.3 * noted["none"]
    assert len(Shared.recent) == 1  # soft, which branches otherwise, is by itself


def test_a_force_whose_state_is_short_is_traced_by_itself():
    traced(c.make_force(c.build_system("chain", links=100), "none"))
    assert not Shared.recent


def drag(system, q, v=None):
    return system["m"] * c.GRAVITY - 0.1 * v


@pytest.mark.parametrize(
    "change",
    [
        lambda monkeypatch, system: system["m"].__imul__(2.0),
        lambda monkeypatch, system: system["lengths"].__imul__(1.01),
        lambda monkeypatch, system: system["pairs"].reverse(),
        lambda monkeypatch, system: monkeypatch.setattr(c, "external_force", drag),
        lambda monkeypatch, system: monkeypatch.setattr(c, "PIVOT", c.PIVOT + [[1.0, 0.0, 0.0]]),
        lambda monkeypatch, system: monkeypatch.setattr(c.Force, "__call__", twice),
    ],
)
def test_what_has_changed_since_is_not_shared(change, monkeypatch):
    system = {**hanging(), "m": SYSTEM["m"].copy()}
    del system["anchors"]
    traced(c.make_force(system, "none"))
    assert len(Shared.recent) == 1
    change(monkeypatch, system)
    found = traced(c.make_force(system, "baumgarte"))
    assert len(Shared.recent) > 1 and exact(found)


CALL = c.Force.__call__


def twice(self, q, v):
    return 2.0 * CALL(self, q, v)


def caught(force):
    try:
        return 3.0 if force.hold.rule else 4.0
    except Exception:
        return 5.0


def unpacked(force):
    use_jdotv, damping, *_ = force.hold
    return damping + 0.5 * use_jdotv


ASKED = {  # of a force, for a number: more of its hold than numbers, or more than its hold
    "label": lambda force: 2.0 if force.hold.rule else 1.0,
    "label, if it has one": lambda force: 2.0 if getattr(force.hold, "rule", None) else 1.0,
    "label, or an error": caught,
    "place": lambda force: force.hold[1] + 0.5,
    "all in a row": unpacked,
    "own": lambda force: force.drag,
    "own, if it has one": lambda force: getattr(force, "drag", 7.0),
    "own, or none": lambda force: 2.0 if hasattr(force, "drag") else 1.0,
    "equal": lambda force: 2.0 if force.hold == c.hold_table(DT)["impulse"] else 1.0,
    "shown": lambda force: 2.0 if "semi" in str(force.hold) else 1.0,
    "branch": lambda force: 2.0 if force.hold.damping - 3.0 else 1.0,
    "number": lambda force: float(force.hold.damping),
    "zero": lambda force: 2.0 if force.hold.damping else 1.0,
    "sign": lambda force: 2.0 if force.hold.damping > 0.0 else 1.0,
    "kind": lambda force: 2.0 if isinstance(force.hold, c.Hold) else 1.0,
}


def asking(how):
    """The class of forces that ask for this."""
    asked = ASKED[how]

    class Asking(NamedTuple):
        system: dict
        hold: c.Hold
        drag: float = 0.1

        def __call__(self, q, v):
            return -0.01 * asked(self) * v + self.system["m"] * c.GRAVITY

    return Asking


@pytest.mark.parametrize("how", ASKED)
def test_whatever_a_force_asks_for_it_is_as_its_own_lines_are(how):
    """And it is shared if it only asks for its kind, or what decides between two numbers."""
    force, shared = asking(how), {"branch", "sign", "kind"}
    for hold in c.hold_table(DT).values():
        assert exact(traced(force(SYSTEM, hold)))
    assert bool(Shared.recent) == (how in shared)


def test_a_number_a_rod_is_not_shared():
    hold = c.Hold(1.0, np.full(len(SYSTEM["pairs"]), 3.0), 0.0, 0.0)
    assert exact(traced(c.make_force(SYSTEM, hold))) and not Shared.recent


class Damper(NamedTuple):
    damping: float
    stiffness: float


class Spring(NamedTuple):
    stiffness: float
    damping: float


class Stiff(NamedTuple):
    stiffness: float


class Pulling(NamedTuple):
    """A force that takes any hold with these numbers, and arrays of any shape."""

    system: dict
    hold: NamedTuple

    def __call__(self, q, v):
        return -0.1 * self.hold.stiffness * q - 0.01 * v


class Pushing(Pulling):
    def __call__(self, q, v):
        return -Pulling.__call__(self, q, v)


class Limited(Pulling):
    def __call__(self, q, v):
        return np.minimum(-self.hold.stiffness, np.maximum(self.hold.damping, v))


def test_holds_of_other_classes_are_not_shared_though_they_have_as_many_numbers():
    for hold in (Damper(2.0, 3.0), Spring(2.0, 3.0), Stiff(5.0)):
        assert exact(traced(Pulling(SYSTEM, hold)))


def test_forces_of_other_classes_are_not_shared_nor_are_those_of_other_systems():
    heavy = SYSTEM | {"m": 2.0 * SYSTEM["m"]}
    for force in (c.make_force(SYSTEM, "none"), c.make_force(heavy, "none")):
        assert exact(traced(force), force.system)
    for kind in (Pulling, Pushing):
        assert exact(traced(kind(SYSTEM, Stiff(5.0))))


def half_by_half(q, v, m, force, dt):
    half, more = 0.5 * dt, 0.25 * dt  # which have names before the force has
    v = v + half * (force(q, v) / m)
    return q + dt * v, v + half * (force(q, v) / m) - more * v


@pytest.mark.parametrize("numbers", [(-3.0, 2.0), (3.0, -2.0), (-0.0, 1.0), (1e300, -1e-300)])
def test_numbers_of_any_sign_are_put_in(numbers):
    own = c.make_force(SYSTEM, c.Hold(-1.0, *numbers, 0.0))
    for force in (own, Limited(SYSTEM, Damper(*numbers))):
        assert exact(traced(force, half_by_half)) and Shared.recent


class Twice(Pulling):
    def __call__(self, q, v):
        return -(self.hold.damping * q + v) - 0.5 * (self.hold.stiffness * q + v)


def test_what_is_alike_once_numbers_are_put_in_is_done_once():
    assert exact(traced(Twice(SYSTEM, Damper(1.0, 1.0)))) and Shared.recent


def test_a_hold_may_lack_a_number_that_it_declares():
    class Lacking:
        damping: float
        stiffness = 2.0

    assert exact(traced(Pulling(SYSTEM, Lacking()))) and not Shared.recent


def test_what_a_force_makes_of_another_shape_or_of_other_zeros_is_not_shared():
    def turned(q, v, m, force, dt):
        v = v + dt * force(q.T, v.T).T / m
        return q + dt * v, v

    solid = SYSTEM | {"q0": SYSTEM["q0"] + 0.1, "v0": SYSTEM["v0"] + 0.1}
    for system, rule in ((SYSTEM, c.semi_implicit_step), (solid, turned), (solid, c.rk4_step)):
        force = Pulling(SYSTEM, Stiff(5.0))  # it asks nothing of its system
        found = Traced(followed(rule, None), system["m"], force, moves(system["q0"], system["v0"]))
        assert exact(found, system)


def test_a_step_may_ask_for_what_is_shared_in_several_ways():
    """Of particles at rest, too, of which more is zero."""

    def resting(q, v, m, force, dt):
        v = v + dt * (force(q, 0.0 * v) + 0.5 * force(q, v)) / m
        return q + dt * v, v

    for mode in ("baumgarte", "impulse"):
        assert exact(traced(c.make_force(SYSTEM, mode), resting))
    assert len(Shared.recent) == 2


@pytest.mark.parametrize("rule", ["semi_implicit", "rk4", "gauss"])
def test_a_force_that_is_shared_counts_as_much_work_as_one_by_itself(rule):
    system = c.build_system("triple")
    found = []
    for least in (np.inf, 0, 0):
        with mock.patch.object(sharing, "LENGTHY", least):
            found.append(traced(c.make_force(system, 7.0), c.INTEGRATORS[rule]).numpy_calls)
    assert Shared.recent and np.allclose(found, found[0], rtol=0.1)


def test_a_force_with_a_loop_in_it_is_traced_by_itself(monkeypatch):
    monkeypatch.setattr(sharing, "LENGTHY", 0)
    net = c.build_system("jansen_leg")
    for mode in ("none", "baumgarte"):
        assert exact(traced(c.make_force(net, mode)), net) and not Shared.recent


@dataclass
class Noting:
    """A force that only writes what it notes."""

    system: dict
    hold: c.Hold
    latest: float = 0.0

    def __call__(self, q, v):
        self.latest = 1.0
        return -0.01 * self.hold.damping * v


class Switching(Noting):
    """One that does otherwise each time, and wants to know whether it has a rule."""

    on = False

    def __call__(self, q, v):
        Switching.on = not Switching.on
        return (-0.01 if Switching.on else -0.02) * v * (1.0 if self.hold.rule else 2.0)


@pytest.mark.parametrize(("kind", "what"), [(Noting, "attribute latest"), (Switching, "global on")])
def test_a_force_that_notes_something_is_refused_also_where_it_would_be_shared(kind, what):
    """Or where two traces would put it back."""
    with pytest.raises(Untraceable, match=f"it changes the {what}"):
        traced(kind(SYSTEM, c.hold_table(DT)["baumgarte"]))
    assert not Switching.on and not Shared.recent


def test_no_other_thread_traces_while_a_trace_is_kept():
    kept = []
    with mock.patch.object(Shared, "keep", lambda _: kept.append(Tape.lock._is_owned())):
        traced(c.make_force(SYSTEM, "none"))
    assert kept == [True]
