"""A step of arrays (N, 3), as it stands: what is tried in halves, measured, and handed out.

A step is a function (q, v, m, force, dt) -> (q, v). One that raises Stop is tried in halves.
"""

import time
from operator import length_hint
from types import FunctionType

from curriculum.common.arrays import ordered
from curriculum.common.callbacks import as_state, shaped
from curriculum.common.tape import Stop

import numpy as np

HALVINGS = 8  # of a step that fails, at most


def followed(rule, after):
    """The step `rule`, which may work in place, and then after(q_start, q, v, dt) -> (q, v)."""

    def step(q, v, m, force, dt):
        def asked(q, v):
            return shaped(force(q, v), np.shape(q), force)

        # a rule of the reader's may want more of an object than to call it
        given = asked if isinstance(force, FunctionType) else force
        end = as_state(rule(q.copy(), v.copy(), m, given, dt), rule)
        return as_state(after(q, *end, dt), after) if after else end

    return step


def tried(step, state, dt, halvings):
    """step(state, dt) or, if that raises Stop, two of dt/2, each tried so; and whether it did."""
    try:
        return step(state, dt), False
    except Stop:
        if not halvings:
            raise
    for _ in range(2):
        state, _ = tried(step, state, 0.5 * dt, halvings - 1)
    return state, True


class Block:
    """States one after another: q, v (count, N, 3), and what was measured of each, (count,) each.

    To iterate is to hand them out. `halved`: which of them, by number, were reached in halves.
    `given`: instead of the only state, the arrays that a step has made, which a loop may change.
    """

    def __init__(self, q, v, measured, halved=(), given=None):
        self.q, self.v, self.measured, self.halved = q, v, measured, np.array(halved)
        self.given, self.left = given, iter(v)
        for x in (q, v):
            x.flags.writeable = False  # what follows is known already: v *= 0.9 would be lost

    def __iter__(self):
        if self.given is not None:
            return (self.given for _ in self.left)
        return zip(self.q, self.left, strict=True)

    def cut(self, many):
        """Keep so many states, before they are handed out."""
        self.q, self.v = self.q[:many], self.v[:many]
        self.measured, self.left = [x[:many] for x in self.measured], iter(self.v)

    def handed(self):
        """How many of its states were handed out."""
        return len(self.v) - length_hint(self.left)


class Plain:
    """Takes steps by step_fn as it stands, in numpy, and asks `measure` of each state.

    `watch`: what else is asked, a function (q, v) -> number; here it becomes one of many states.
    """

    how = source = "in plain numpy: the lines as they stand"
    lies, halvings = None, HALVINGS

    def __init__(self, step_fn, m, force, dt, measure, steps=0, watch=None):
        self.lines = lambda state, dt: as_state(step_fn(*state, m, force, dt), step_fn)
        self.dt, self.measure = float(dt), measure  # numpy's short numbers would round
        self.watch = (lambda q, v: list(map(watch, q, v))) if watch else None
        self.taken, self.seconds = 0, 0.0

    def confirm(self):
        """Nothing was computed ahead."""

    def ahead(self, q, v):
        """The Block of states that follow q, v: here it is one."""
        clock = time.perf_counter()
        try:
            state = ordered(q), ordered(v)
            (q, v), halved = tried(self.lines, state, self.dt, self.halvings)
        finally:
            self.seconds += time.perf_counter() - clock
        self.taken += 1
        return Block(*alone(q, v), [[x] for x in self.measure(q, v)], [0] * halved, (q, v))


def alone(q, v):
    """Copies (1, N, 3) of one state: a step may fill the same arrays again."""
    return q[None].copy(), v[None].copy()
