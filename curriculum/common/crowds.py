"""Members (R, N, 3) of one system, each of which goes as if it were alone, to the last bit."""

from functools import cache, cached_property

from curriculum.common import native
from curriculum.common.arrays import PIECE, array_function
from curriculum.common.steps import Plain, Traced
from curriculum.common.trace import Untraceable

import numpy as np


class Together:
    """A program of members side by side: in vector registers, or by numpy calls."""

    def __init__(self, program):
        self.program, self.machine = program, None

    def to_machine(self, best=True):
        self.machine = native.Native(self.program, native.LANES, best)

    @cached_property
    def function(self):
        return array_function(self.program)

    def run(self, state, count, *knobs, keep=True):
        """`count` steps: state (entries, members) becomes the end; rows (count, numbers, members).

        A row is what the program makes beside the state or, if that is nothing, the state. There
        are none if they are not to `keep`.
        """
        (entries, members), made = state.shape, len(self.program.out)
        lanes = native.LANES if self.machine else 1
        filled = -(-members // lanes) * lanes  # the last member fills up the last register
        rows = np.empty((count, made - entries or entries, filled)) if keep else None
        if self.machine:
            ends = np.take(state, np.minimum(np.arange(filled), members - 1), axis=1)
            in_threads(self.machine, ends, count, knobs, rows)
            state[:] = ends[:, :members]
            return rows[:, :, :members] if keep else None
        for first in range(0, members, PIECE):
            piece = slice(first, first + PIECE)
            values = list(state[:, piece])
            for k in range(count):
                with np.errstate(all="ignore"):
                    values = self.function(*values[:entries], *knobs)
                if keep:
                    put(rows[k, :, piece], values[entries:] or values)
            put(state[:, piece], values[:entries])
        return rows


def put(places, values):
    """Put arrays, or numbers, into the rows of an array."""
    for place, value in zip(places, values, strict=True):
        place[:] = value


class Many(Together):
    """A step of members side by side; who has trouble goes `alone`."""

    def __init__(self, alone):
        super().__init__(alone.traced.program)
        self.alone = alone

    def __call__(self, state, count, dt):
        """Rows (count, entries, members) after `state` (entries, members); NaN for who is lost."""
        rows = self.run(state.copy(), count, dt)
        for member in np.flatnonzero(~np.isfinite(rows).all(axis=(0, 1))):
            found, _ = self.alone(state[:, member], count, dt)
            rows[: len(found), :, member], rows[len(found) :, :, member] = found, np.nan
        return rows, None


def in_threads(machine, state, count, knobs, rows):
    """Members on all processors: machine code lets go of the interpreter. state becomes the end."""
    registers = -(-state.shape[1] // machine.lanes)
    cut = -(-registers // native.CORES) * machine.lanes

    def some(first):
        piece = slice(first, first + cut)
        machine(state[:, piece], count, None if rows is None else rows[:, :, piece], *knobs)

    list(pool().map(some, range(0, state.shape[1], cut)))


@cache
def pool():
    """Threads, a processor each."""
    from concurrent.futures import ThreadPoolExecutor  # here: it takes its time to load

    return ThreadPoolExecutor(native.CORES)


class Crowd:
    """Many members: `advance` them, look at their `states`, `put` others.

    One that cannot go on is NaN. `measure`: a function of one state (N, 3), (q, v) -> tuple of
    arrays, asked at every step. A step that cannot be traced is taken plainly, one by one.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        self.given, self.measure, self.plain, self.traced = (m, force, dt), measure, None, None
        try:
            self.traced = Traced(step_fn, m, force, dt, q, v, measure)
            self.together = Together(self.traced.program)
            if native.available():
                self.together.to_machine()
        except Untraceable:
            self.plain = Plain(step_fn)
        self.put(q, v)

    def put(self, q, v):
        """Go on from q, v (R, N, 3)."""
        self.columns = self.traced.columns(q, v) if self.traced else (q, v)

    def states(self):
        """q, v (R, N, 3)."""
        if self.plain:
            return self.columns
        return tuple(x[0] for x in self.traced.states(self.columns[None], self.columns.shape[1:]))

    def advance(self, count):
        """Take `count` steps; what was measured at each: (count, numbers, R), or None."""
        if self.traced:
            return self.together.run(self.columns, count, self.given[-1], keep=bool(self.measure))
        rows = []
        for _ in range(count):
            self.columns = self.plain(*self.columns, *self.given)
            if self.measure:
                both = zip(*self.columns, strict=True)
                rows.append([np.concatenate([*map(np.ravel, self.measure(*x))]) for x in both])
        return np.swapaxes(rows, 1, 2) if self.measure else None
