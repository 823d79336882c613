"""A step function for many steps a call, compiled: the same numbers, hundreds of times sooner."""

import contextlib
import math
import sys
import time

from curriculum.common import native
from curriculum.common.crowds import Many
from curriculum.common.steps import Plain, Single, Traced
from curriculum.common.trace import Stop, Untraceable

import numpy as np

BLOCK = 1 << 17  # numbers in a block of states
FIRST = 16  # steps of the first block, which tells what a step costs
# characters of code in all steps of the first block, and of a later one; loops count once
SHORT, LONG = 1_000_000, 10_000_000
LOADING, COMPILING = 0.06, 1.8e-6  # s: to load llvmlite, and for each character of Python
CLOSE = 1e-6  # how far a compiled step may be from the plain one, as a share of what it changes


class Compiled:
    """step_fn for many steps a call: q, v (..., N, 3), or a block of them -> the next block.

    A block is q, v (count, ..., N, 3). `steps`: how many are to come. What was compiled is compared
    with the plain step (`check`) in the first block, and whenever the steps have doubled. Where
    they differ, or the step cannot be traced, a call is one plain step. `way` says how steps are
    done; `source` is the code; `taken` steps took `seconds`, counted anew where the way changes.
    """

    def __init__(self, step_fn, steps=0, check=True, tries=math.inf):
        self.step_fn, self.check, self.tries = step_fn, check, tries
        self.plain, self.alone, self.runner, self.way = Plain(step_fn), None, None, ""
        self.start(steps)

    def start(self, steps):
        """Begin a run of so many steps, of the same system."""
        self.steps, self.taken, self.seconds, self.done, self.due = steps, 0, 0.0, 0, 0
        for way in filter(None, (self.plain, self.alone)):
            way.halved = 0

    @property
    def halved(self):
        """How many steps of this run were taken in halves."""
        return self.plain.halved + (self.alone.halved if self.alone else 0)

    @property
    def source(self):
        """The code that a step has become."""
        return self.alone.traced.source if self.runner else f"# {self.way}"

    def trace(self, q, v, m, force, dt):
        """Trace the step; or find out why that cannot be done."""
        self.lead = q.shape[:-2]
        try:
            self.alone = Single(Traced(self.step_fn, m, force, dt, q, v), self.tries)
        except Untraceable as why:
            self.give_up(why)
            return
        self.runner = Many(self.alone) if self.lead else self.alone
        self.way = f"compiled to {'numpy calls' if self.lead else 'Python'}"

    def give_up(self, why):
        """Go on plainly."""
        self.runner, self.way = None, f"{Plain.way}, which is slower: {why}"

    def differs(self, start, rows, dt):
        """Whether one step of a block (count, entries, members) differs from the plain one by more
        than rounding. It is the first member's last, or its first if the last is not finite."""
        path = np.concatenate([start[None, :, 0], rows[:, :, 0]])
        before, end = path[-2:] if np.isfinite(path[-1]).all() else path[:2]
        try:
            expected = self.alone.traced.plain(before, dt)
        except Stop:
            return False  # the step is taken in halves
        known = np.isfinite(expected)
        before, end, expected = before[known], end[known], expected[known]
        size = np.max(np.abs([expected - before, 1e-9 * expected]), initial=0.0)
        return not np.all(np.abs(end - expected) <= CLOSE * size)

    def improve(self, pace):
        """Machine code, where the steps that are left are worth it."""
        cost = COMPILING * len(self.source) + LOADING * ("llvmlite.binding" not in sys.modules)
        left = self.steps * pace
        if native.available() and left > 1.5 * cost:
            with contextlib.suppress(native.Unavailable):  # it goes on as it is
                self.to_machine(left > 200.0 * cost)
        if native.failure() and not self.runner.machine:
            self.way = f"{self.way.partition(';')[0]}; {native.failure()}"

    def to_machine(self, best=True):
        """Machine code from here on; the best takes a few times as long to make."""
        self.runner.to_machine(best)
        self.way, self.taken, self.seconds = "compiled to machine code", 0, 0.0

    def __call__(self, q, v, m, force, dt):
        if not self.way:
            self.trace(q, v, m, force, dt)
        if q.ndim > 2 + len(self.lead):
            q, v = q[-1], v[-1]
        if not self.runner:
            state = self.plain(q, v, m, force, dt)
            self.taken, self.seconds = self.plain.taken, self.plain.seconds
            return state
        clock = time.perf_counter()
        start = self.alone.traced.columns(q, v)
        rows, why = self.runner(start if self.lead else start[:, 0], self.count(start), dt)
        spent, count = time.perf_counter() - clock, len(rows)
        if why and not count:
            raise why
        rows = rows.reshape(count, len(start), -1)
        self.done += count
        if self.done >= self.due:
            self.due = 2 * self.done
            if self.check and self.differs(start, rows, dt):
                self.give_up("it does something else when it is compiled")
                return self(q, v, m, force, dt)
        self.taken, self.seconds = self.taken + count, self.seconds + spent
        self.steps -= count
        if not (why or self.runner.machine):  # with the Stop that is why, the next block begins
            self.improve(spent / count)
        return self.alone.traced.states(rows, self.lead)

    def count(self, start):
        """How many steps the next block has; never by the clock, so that runs are alike."""
        most, code = (self.steps, LONG) if self.done else (min(FIRST, self.steps), SHORT)
        return max(1, min(most, BLOCK // start.size, code // len(self.source)))
