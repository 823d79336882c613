"""A Memory tells which functions do something else each time, and puts back what a trace did."""

import functools
import random as dice
import time
from datetime import datetime
from types import SimpleNamespace

import constraints as c
from curriculum.common.pure import Memory
from curriculum.common.trace import Symbol, Tape

import numpy as np
import pytest

Q = np.full((2, 3), Symbol(Tape(), "x"))  # it refuses every ==
START, CALLS, CACHE, NOISE, RATE = [], 0, {}, [0.0, 1.0], np.ones(3)
DEVICE, RNG, TICKS = dice.SystemRandom(), np.random.default_rng(1), iter(range(9))


class Controller(SimpleNamespace):
    def __call__(self, q, v):
        self.hold.gain = q[0, 0]


CONTROLLER = Controller(hold=SimpleNamespace(gain=1.0))


def drag(q, v, k=(0.1, [0.2]), n=np.pi):
    return np.sin(n) - k[0] * v + np.array(CONTROLLER.hold.gain) * np.cross(q, RATE)


def count(q, v):
    global CALLS
    CALLS += 1


def counter(calls=0):
    def force(q, v):
        nonlocal calls
        calls += 1

    return force


MEMORIES = {  # what is said of it, and what keeps state, or asks what is never the same
    "the list START": lambda q, v: START or START.append(q.copy()),
    "the dict CACHE": lambda q, v: CACHE.setdefault(id(q), q),
    "the global CALLS": count,
    "the list noise": lambda q, v, noise=NOISE: noise.reverse(),
    "the variable calls": functools.singledispatch(counter()),  # a closure of the library
    "the attribute last of drag": lambda q, v: setattr(drag, "last", q),
    "the attribute gain of CONTROLLER": lambda q, v: CONTROLLER(q, v),
    "the random generator RNG": functools.partial(lambda g, q, v: RNG.random() < 1e-3, 1.0),
    "the random generator of numpy": np.vectorize(lambda q, v: np.random.random()),  # noqa: NPY002
    "for the time ": lambda q, v: [datetime.now() for _ in q],
    "for the time": functools.partial(time.perf_counter),
    "TICKS, which cannot be put back": lambda q, v: next(TICKS),
    "DEVICE, which cannot be put back": lambda q, v: DEVICE.random(),
}


def state():
    """What the functions above change, but for what hides in closures and partials."""
    drawn = RNG.bit_generator.state, np.random.get_state()[1:]  # noqa: NPY002
    return repr((START, CALLS, CACHE, NOISE, CONTROLLER.hold, vars(drag), drawn))


@pytest.mark.parametrize("said", MEMORIES)
def test_what_a_function_keeps_is_told_and_put_back(said):
    """Clocks and iterators are told of before anything is run."""
    function, before = MEMORIES[said], state()
    for _ in range(2):  # put back, all is as before
        memory = Memory(function)
        words = memory.changed()
        assert (words is None) == said.startswith("the ")
        if words is None:
            function(Q, Q)
            words = memory.changed()
            memory.restore()
            assert memory.changed() is None
        assert words.endswith(f" {said.strip()}") and state() == before


@pytest.mark.parametrize("mode", c.hold_table())
def test_pure_functions_are_not_accused_and_cheap_to_look_at(mode):
    """Some tens of dicts, arrays and cells, for the chapter's own functions and drag."""
    system = c.build_system("double")
    force = c.make_force(system, mode)
    endless = {"of": Memory, "file": open, "lock": np.lib}
    endless["self"] = [endless]
    memory = Memory(c.rk4_step, force, force.after, drag, lambda q, v: endless)
    q, v = c.rk4_step(system["q0"], system["v0"], system["m"], force, 0.005)
    drag(*(force.after(system["q0"], q, v, 0.005) if force.after else (q, v)))
    assert memory.changed() is None and len(memory.parts) < 80
