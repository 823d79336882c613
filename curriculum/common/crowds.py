"""Members (R, N, 3) of one system, each of which goes as if it were alone, to the last bit."""

import contextlib
import os
from functools import cache, cached_property

from curriculum.common import native
from curriculum.common.arrays import PIECE, Arrays
from curriculum.common.steps import Traced

import numpy as np


class Together:
    """A program of members side by side: by numpy calls, or in vector registers on all cores."""

    def __init__(self, program):
        self.program, self.machine = program, None

    def to_machine(self, best=True):
        self.machine = native.Native(self.program, native.LANES, best)

    @cached_property
    def arrays(self):
        return Arrays(self.program)

    def run(self, state, count, *knobs, keep=True):
        """`count` steps: state (entries, members) becomes the end; rows (count, numbers, members).

        A row is what the program makes beside the state or, if that is nothing, the state. There
        are none if they are not to `keep`.
        """
        (entries, members), made = state.shape, len(self.program.out)
        code, some, each = self.machine or self.arrays, PIECE, map
        if self.machine:  # threads run side by side: ctypes lets go of the interpreter
            some, each = -(-members // (native.CORES * code.lanes)) * code.lanes, pool().map
        filled = -(-members // code.lanes) * code.lanes
        rows = np.empty((count, made - entries or entries, filled)) if keep else None
        ends = np.empty((entries, filled))
        ends[:, :members], ends[:, members:] = state, state[:, -1:]  # copies fill the last register

        def advance(first):
            piece = slice(first, first + some)
            code(ends[:, piece], count, rows[:, :, piece] if keep else None, *knobs)

        list(each(advance, range(0, members, some)))
        state[:] = ends[:, :members]
        return rows[:, :, :members] if keep else None


class Many(Together):
    """A step of members side by side; who has trouble goes `alone`."""

    def __init__(self, alone):
        super().__init__(alone.traced.program)
        self.alone = alone

    def __call__(self, state, count, dt):
        """Rows (count, entries, members) after `state` (entries, members); NaN for who is lost."""
        rows = self.run(state.copy(), count, dt)
        for member in np.flatnonzero(~np.isfinite(rows).all(axis=(0, 1))):  # or a loop did not end
            found, _ = self.alone(state[:, member], count, dt)
            rows[: len(found), :, member], rows[len(found) :, :, member] = found, np.nan
        return rows, None


@cache
def pool():
    """Threads, a processor each."""
    from concurrent.futures import ThreadPoolExecutor  # here: it takes its time to load

    return ThreadPoolExecutor(native.CORES)


if hasattr(os, "register_at_fork"):  # a child has none of its parent's threads, and makes its own
    os.register_at_fork(after_in_child=pool.cache_clear)


class Crowd(Together):
    """Many members: `advance` them, look at their `states`, `put` others.

    One that cannot go on is NaN. `measure`: a function of one state (N, 3), (q, v) -> tuple of
    arrays, asked at every step. Raises Untraceable.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        self.traced = Traced(step_fn, m, force, dt, q, v, measure)
        self.dt, self.measured = dt, measure is not None
        super().__init__(self.traced.program)
        if native.available():
            with contextlib.suppress(native.Unavailable):  # numpy calls, then
                self.to_machine()
        self.put(q, v)

    def put(self, q, v):
        """Go on from q, v (R, N, 3)."""
        self.columns = self.traced.columns(q, v)

    def states(self):
        """q, v (R, N, 3)."""
        return tuple(x[0] for x in self.traced.states(self.columns[None], self.columns.shape[1:]))

    def advance(self, count):
        """Take `count` steps; what was measured at each: (count, numbers, R), or None."""
        return self.run(self.columns, count, self.dt, keep=self.measured)
