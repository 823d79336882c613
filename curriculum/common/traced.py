"""A step traced, as a Program, and what that becomes: steps of Python's floats, or machine code."""

import contextlib
import math
from functools import cached_property
from itertools import chain

from curriculum.common.arrays import ordered
from curriculum.common.callbacks import as_state, explained
from curriculum.common.programs import Program
from curriculum.common.pure import Memory
from curriculum.common.python import NUMBERS, function_of, source_of
from curriculum.common.sharing import Shared
from curriculum.common.steps import HALVINGS, tried
from curriculum.common.tape import Stop, Tape, Untraceable, effort, uncollected

import numpy as np

# so far sines may be off: as a share of what a step changes, and of what is measured
CLOSE, ALIKE = 1e-6, 1e-9
PIECE = 256  # steps of Python's floats at a time: what they take stays near the processor


def moves(q, v):
    """What of q, v (..., N, 3) need not stay zero: (2, N, 3) truths, the same for all particles.

    Where one of them is not at zero, others soon leave it: a plane is what motions stay in.
    """
    along = [np.any(q[..., k]) or np.any(v[..., k]) for k in range(3)]
    return np.broadcast_to(along, (2, *q.shape[-2:]))


class Traced:
    """A step as a Program of what does not stay zero: where `moving` (2, N, 3) says so of q and v.

    It begins as what may move, and less and less of it does. Behind the state the program makes
    what `measure`, a function (q, v) -> tuple of arrays, says of a step's end. `uses`: how many
    steps are to come; `numpy_calls`: of one. Raises Untraceable, and then what step_fn and force
    keep is as it was.
    """

    def __init__(self, step_fn, m, force, moving, measure=None, uses=math.inf):
        with Tape.lock, uncollected():
            effort.uses = uses
            memory = self.memory = Memory(step_fn, force, measure, m=m)
            why = next(iter(memory.asks), None)  # what cannot be put back is not even tried
            if not why:
                try:
                    self.trace(step_fn, m, force, moving, measure)
                except Exception as reason:  # a mistake of the reader's shows in the plain step
                    why = explained(reason)
                finally:
                    why = memory.restore() or why
            effort.uses = math.inf
            if why:
                raise Untraceable(why)
            self.routine.keep()  # while no other thread looks

    def trace(self, step_fn, m, force, moving, measure):
        """Trace the step, as if it kept nothing."""
        self.shape, still = moving.shape[1:], list(~moving)
        self.routine = routine = Shared(force, self.memory)
        self.as_it_stands = lambda q, v, dt: as_state(step_fn(q, v, m, force, dt), step_fn)
        self.measure = measure or (lambda q, v: ())

        def asked(q, v):  # the same force each time, so no switch may have been thrown
            changed = self.memory.changed()
            if changed:
                raise Untraceable(f"it changes {changed}")
            return routine(q, v)

        def step(q, v, dt):
            end = as_state(step_fn(q, v, m, asked, dt), step_fn)
            return *end, *self.measure(*end)

        while True:  # suppose that zeros stay zero; trace; drop those that do not; again
            program = Program(step, *still, knobs=["dt"])
            if [x.shape for x in program.results[:2]] != [self.shape] * 2:
                raise Untraceable(f"a step must return q and v of shape {self.shape}")
            zero = [np.array([s.x == 0.0 for s in x.flat]) for x in program.results[:2]]
            stays = [mask & z.reshape(self.shape) for mask, z in zip(still, zero, strict=True)]
            if all(map(np.array_equal, still, stays)):
                break
            still = stays
        end = np.array([program.results[k][at] for k, at in program.live])
        program.results = [end, *program.results[2:]]
        self.program, self.moving = program, ~np.array(still)
        self.numpy_calls = effort.numpy_calls

    @cached_property
    def source(self):
        """The program in Python."""
        return source_of(self.program)

    @cached_property
    def function(self):
        """The function that this is, of floats."""
        return function_of(self.source, NUMBERS)

    @cached_property
    def exact(self):
        """Whether the same bits are promised of it as of the lines as they stand."""
        return not self.program.inexact()

    def changed(self):
        """What has changed since, of what the step depends on, in words; or None."""
        with Tape.lock:  # while others trace, nothing is as it is
            return self.memory.changed()

    def columns(self, q, v):
        """What does not stay zero of (..., N, 3): (entries, members)."""
        rows = [x.reshape(-1, moving.size)[:, moving] for x, moving in self.each(q, v)]
        return np.concatenate(rows, axis=1).T

    def each(self, q, v):
        """q and v, and which of their entries (3N,) move."""
        return zip((q, v), self.moving.reshape(2, -1), strict=True)

    def fits(self, q, v):
        """Whether q, v (..., N, 3) are zero in all that is taken to stay zero."""
        both = zip((q, v), ~self.moving, strict=True)
        return not any(np.any(x[..., still]) for x, still in both)

    def states(self, rows):
        """q, v (count, N, 3) of rows (count, entries), stored components first."""
        whole = np.zeros((2, *self.shape, len(rows)))
        whole[self.moving] = rows.T
        return tuple(x.transpose(2, 0, 1) for x in whole)

    def plain(self, state, dt):
        """The step as it stands, of columns (entries,), and what is measured: a row."""
        q, v = (ordered(x[0]) for x in self.states(state[None]))
        q, v = self.as_it_stands(q, v, dt)
        end = np.array([q, v], float)
        moved = end[self.moving]
        if np.isfinite(moved).all() and np.any(end[~self.moving]):  # 0 * inf is no motion
            raise Untraceable("it moves what stays where it is when it is compiled")
        return np.concatenate([moved, *map(np.ravel, self.measure(q, v))]).astype(float, copy=False)

    def differs(self, before, end, dt, halved=False):
        """Whether the lines as they stand take a state (entries,) elsewhere than to `end`.

        Behind both ends is what is measured there. A step that was `halved` must want that as it
        stands, too. Sums and products are the same to the last bit; a sine need not be.
        """
        try:
            expected = self.plain(before, dt)
        except Stop:
            return not halved and bool(np.isfinite(end).all())  # as if nothing stopped
        except Untraceable:
            return True
        if self.exact:
            return not np.array_equal(end, expected, equal_nan=True)
        known = np.isfinite(expected)
        if np.isfinite(end).all() and not known.all():  # 0 * exp(1000): the lines have no number
            return True
        state, measured = slice(len(before)), slice(len(before), None)
        for part, start, close in ((state, before, CLOSE), (measured, 0.0, ALIKE)):
            wanted, off = expected[part], abs(end[part] - expected[part])
            size = np.maximum(abs(wanted - start), 1e-9 * abs(wanted))[known[part]]
            if not np.all(off[known[part]] <= close * np.max(size, initial=0.0)):
                return True
        return False


class Single:
    """Steps of a state, by Python's floats or by `machine` code."""

    def __init__(self, traced, halvings=HALVINGS):
        self.traced, self.machine, self.halvings = traced, None, halvings
        self.size = max(1, traced.program.size())

    def prepare(self):
        """Make the code that steps need, unless there is some: not while they are timed."""
        return self.machine or self.traced.function

    def __call__(self, state, count, dt):
        """Rows (count, entries) after `state` (entries,), or fewer; the Stop that is why; and the
        numbers of those that were reached in halves."""
        rows, done, self.least = np.empty((count, len(state))), 0, dt / 2**self.halvings
        numbers = []
        while done < count:
            taken, _ = self.easy(state, rows[done:], dt)
            if not taken:
                try:  # a step that has trouble: by itself, or in halves
                    rows[done], halved = tried(self.one, state, dt, self.halvings)
                except Stop as why:
                    return rows[:done], why, numbers
                taken = 1
                numbers += [done] * halved
            done += taken
            state = rows[done - 1]
            if not math.isfinite(state.sum()):  # what measures it will say so
                break
        return rows[:done], None, numbers

    def easy(self, state, rows, dt):
        """Fill rows with steps as far as they go without trouble: (how many, unsettled).

        `unsettled`: whether a loop that came to no end is the trouble, as machine code can tell.
        """
        if self.machine:
            return self.machine(np.array(state)[:, None], len(rows), rows, dt)
        done, entries = 0, rows.shape[1]
        while done < len(rows):
            states, count = [], min(PIECE, len(rows) - done)
            with contextlib.suppress(ArithmeticError, ValueError):  # taken alone it names its error
                self.traced.function(tuple(state.tolist()), count, states.append, dt)
            flat = np.fromiter(chain.from_iterable(states), float, len(states) * entries)
            rows[done : done + len(states)] = flat.reshape(-1, entries)
            done += len(states)
            if len(states) < count:
                break
            state = rows[done - 1]
        return done, False

    def one(self, state, dt):
        """A step by machine code, or on Python's floats; or the plain step."""
        found = []
        if self.machine:
            row = np.empty((1, len(state)))
            taken, unsettled = self.easy(state, row, dt)
            if taken:
                return row[0]
            if unsettled and dt > self.least:  # its halves are next: no need for the words
                raise Stop("a loop came to no end")
        try:
            self.traced.function(tuple(state.tolist()), 1, found.append, dt)
        except Stop:
            raise
        except (ArithmeticError, ValueError):  # where numpy's floats go on
            pass
        whole = found and np.isfinite(found).all()
        return np.array(found[0]) if whole else self.traced.plain(state, dt)
