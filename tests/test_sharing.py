"""Forces that differ by numbers are traced once, and each is what its own lines say."""

from collections import Counter
from typing import NamedTuple
from unittest import mock

import constraints as c
from curriculum.common import sharing
from curriculum.common.sharing import Shared
from curriculum.common.steps import followed
from curriculum.common.tape import effort
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


def exact(found):
    """Whether a Traced step of its system has the bits of the lines as they stand."""
    state = found.columns(SYSTEM["q0"], SYSTEM["v0"])[:, 0]
    step = []
    found.function(tuple(state.tolist()), 1, step.append, DT)
    return not found.differs(state, np.array(step[0]), DT)


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


class Labelled(NamedTuple):
    """A force that asks its hold for more than numbers, or itself for more than a hold."""

    system: dict
    hold: c.Hold
    how: str
    drag: float = 0.1

    def __call__(self, q, v):
        hold = self.hold
        if self.how == "label":
            damped = 2.0 if hold.rule else 1.0
        elif self.how == "place":
            damped = hold[1] + 0.5
        elif self.how == "names":
            use_jdotv, damped, *_ = hold
        elif self.how == "own":
            damped = self.drag
        elif self.how == "branch":
            damped = 2.0 if hold.damping - 3.0 else 1.0
        elif self.how == "sign":
            damped = 2.0 if hold.damping > 0.0 and not hold.damping <= 0.0 else 1.0
        elif self.how == "kind":
            damped = 2.0 if isinstance(hold, c.Hold) else 1.0
        elif self.how == "number":
            damped = float(hold.damping)
        elif self.how == "zero":
            damped = 2.0 if hold.damping else 1.0
        return -0.01 * damped * v + self.system["m"] * c.GRAVITY


HOW = "label", "place", "names", "own", "branch", "sign", "kind", "number", "zero"


@pytest.mark.parametrize("how", HOW)
def test_whatever_a_force_asks_for_it_is_as_its_own_lines_are(how):
    for mode in c.hold_table(DT):
        assert exact(traced(Labelled(SYSTEM, c.hold_table(DT)[mode], how)))


def test_a_number_a_rod_is_not_shared():
    hold = c.Hold(1.0, np.full(len(SYSTEM["pairs"]), 3.0), 0.0, 0.0)
    assert exact(traced(c.make_force(SYSTEM, hold))) and not Shared.recent
