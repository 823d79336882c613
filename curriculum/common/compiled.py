"""A step function that takes many steps a call, compiled: the same numbers, a few times sooner."""

import math
import sys
import time

from curriculum.common import native
from curriculum.common.crowds import Many
from curriculum.common.pure import Memory
from curriculum.common.steps import Plain, Single, Traced
from curriculum.common.trace import Stop

import numpy as np

BLOCK = 1 << 17  # numbers in a block of states
FIRST = 16  # steps in the first block, after which one knows what a step costs
PATIENCE = 0.2  # s: a block of slow steps ends after so long, so that progress can be told
LOADING, COMPILING = 0.06, 25e-6  # s: what llvmlite takes to load, and for each operation
CLOSE = 1e-6  # how far a compiled step may be from the plain one, as a share of what it changes


class Compiled:
    """step_fn for many steps a call: q, v (..., N, 3), or a block of them -> the next block.

    A block is q, v (count, ..., N, 3). `steps`: how many are to come. What was compiled is compared
    with the plain step (`check`), at the start and when the steps have doubled; where they differ,
    or the step cannot be traced, the steps are plain. `way` says how they are done; `source` is the
    code; `taken` steps took `seconds`, counted anew where the way changes.
    """

    def __init__(self, step_fn, steps=0, check=True, tries=math.inf):
        self.step_fn, self.check, self.tries = step_fn, check, tries
        self.plain, self.alone, self.runner, self.way = Plain(step_fn), None, None, ""
        self.machine = False
        self.start(steps)

    def start(self, steps):
        """Begin a run of so many steps, of the same system."""
        self.steps, self.taken, self.seconds, self.why = steps, 0, 0.0, None
        self.done, self.due = 0, 0

    @property
    def halved(self):
        """How many steps were taken in halves."""
        return self.plain.halved + (self.alone.halved if self.alone else 0)

    @property
    def source(self):
        """The code that a step has become."""
        return self.alone.traced.source if self.runner else f"# {self.way}"

    def trace(self, q, v, m, force, dt):
        """Trace the step; or find out why that cannot be done."""
        self.lead = q.shape[:-2]
        memory, why = Memory(self.step_fn, force), None
        if memory.asks:  # it uses what cannot be put back, so not even a trial
            self.give_up(memory.asks[0])
            return
        try:
            traced = Traced(self.step_fn, m, force, dt, q, v)
        except Exception as reason:  # the reader's mistake, or more than can be traced?
            why = str(reason) or type(reason).__name__
        why = memory.restore() or why
        if why:
            first = (x.reshape(-1, *x.shape[-2:])[0] for x in (q, v))
            Plain(self.step_fn)(*first, m, force, dt)  # a mistake shows here, in its own line
            memory.restore()
            self.give_up(why)
            return

        def plain(q, v, dt):
            return self.step_fn(q, v, m, force, dt)

        self.alone = Single(traced, plain, self.tries)
        self.runner = Many(self.alone) if self.lead else self.alone
        self.way = f"compiled to {'numpy calls' if self.lead else 'Python'}"
        if self.check:
            start = traced.columns(q, v)[:, 0]
            end, _ = Single(traced, plain, self.tries)(start, 1, dt)
            if len(end) and not self.agrees(start, end[0], dt):
                self.give_up("it does something else when it is traced")

    def give_up(self, why):
        """Go on plainly."""
        self.runner, self.way = None, f"{Plain.way}, which is slower: {why}"

    def agrees(self, start, end, dt):
        """Whether the step of columns (entries,) is the plain one, but for rounding."""
        try:
            expected = self.alone.by_plain(start, dt)
        except Stop:
            return True  # the step is tried in halves
        gap, size = np.abs(end - expected), np.max(np.abs(expected - start))
        near = gap <= CLOSE * (size + 1e-9 * np.max(np.abs(expected)))
        return bool(np.all(near | ~np.isfinite(expected)))

    def differs(self, start, rows, dt):
        """Whether the last step of a block (count, entries, members) is not the plain one."""
        before, last = (rows[-2] if len(rows) > 1 else start)[:, 0], rows[-1, :, 0]
        return self.check and np.isfinite(last).all() and not self.agrees(before, last, dt)

    def improve(self, pace):
        """Machine code, where the steps that are left are worth it."""
        size = sum(len(tape.nodes) for tape in self.alone.traced.program.tapes())
        cost = COMPILING * size + LOADING * ("llvmlite.binding" not in sys.modules)
        left = self.steps * pace
        if native.available() and left > 1.5 * cost:
            self.to_machine(left > 200.0 * cost)

    def to_machine(self, best=True):
        """Machine code from here on; the best takes a few times as long to make."""
        self.runner.to_machine(best)
        self.machine, self.way = True, "compiled to machine code"
        self.taken, self.seconds = 0, 0.0

    def __call__(self, q, v, m, force, dt):
        if not self.way:
            self.trace(q, v, m, force, dt)
        if q.ndim > 2 + len(self.lead):
            q, v = q[-1], v[-1]
        if self.why:
            raise self.why
        if not self.runner:
            return self.one_by_one(q, v, m, force, dt)
        clock = time.perf_counter()
        start = self.alone.traced.columns(q, v)
        rows, self.why = self.runner(start if self.lead else start[:, 0], self.count(start), dt)
        spent, count = time.perf_counter() - clock, len(rows)
        if self.why and not count:
            raise self.why
        rows = rows.reshape(count, len(start), -1)
        self.done += count
        if self.done >= self.due:
            self.due = 2 * self.done
            if self.differs(start, rows, dt):
                self.give_up("it does something else when it is compiled")
                return self(q, v, m, force, dt)
        self.taken, self.seconds = self.taken + count, self.seconds + spent
        self.steps -= count
        if not self.why and not self.machine:
            self.improve(spent / count)
        return self.alone.traced.states(rows, self.lead)

    def one_by_one(self, q, v, m, force, dt):
        """A block of plain steps."""
        states = []
        try:
            for _ in range(self.count(q)):
                q, v = self.plain(q, v, m, force, dt)
                states.append((q, v))
        except Stop as why:
            self.why = why
            if not states:
                raise
        self.taken, self.seconds = self.taken + len(states), self.plain.seconds
        self.steps -= len(states)
        return tuple(np.stack(x) for x in zip(*states, strict=True))

    def count(self, start):
        """How many steps the next block has."""
        most = min(BLOCK // start.size, self.steps)
        if not self.taken:
            return max(1, min(FIRST, most))
        return max(1, min(most, int(PATIENCE * self.taken / max(1e-9, self.seconds))))
