"""A step, of arrays (N, 3), and what it becomes: steps of floats, or of machine code.

A step is a function (q, v, m, force, dt) -> (q, v). One that raises Stop is tried in halves.
"""

import contextlib
import math
import time
from itertools import chain

from curriculum.common import native
from curriculum.common.pure import Memory
from curriculum.common.python import careful, number_function
from curriculum.common.trace import Program, Routine, Stop, Untraceable

import numpy as np

HALVINGS = 8  # of a step that fails, at most
PIECE = 256  # steps of Python's floats at a time: what they take stays near the processor


def followed(rule, after):
    """The step `rule`, which may work in place, and then after(q_start, q, v, dt) -> (q, v)."""

    def step(q, v, m, force, dt):
        end = rule(q.copy(), v.copy(), m, force, dt)
        return after(q, *end, dt) if after else end

    return step


def tried(step, state, dt, level=0):
    """step(state, dt) or, if that raises Stop, two of dt/2, each tried so; and whether it did."""
    try:
        return step(state, dt), False
    except Stop as why:
        if level == HALVINGS or why.kind != "loop":
            raise
    for _ in range(2):
        state, _ = tried(step, state, 0.5 * dt, level + 1)
    return state, True


class Plain:
    """step_fn as it stands, in numpy, one state at a time: q, v (..., N, 3) -> q, v."""

    way = source = "in plain numpy: the lines as they stand"

    def __init__(self, step_fn, steps=0):
        self.step_fn, self.halved, self.taken, self.seconds = step_fn, 0, 0, 0.0

    def __call__(self, q, v, m, force, dt):
        if q.ndim > 2:
            both = [self(*member, m, force, dt) for member in zip(q, v, strict=True)]
            return tuple(np.stack(x) for x in zip(*both, strict=True))
        clock, self.taken = time.perf_counter(), self.taken + 1
        try:
            state, halved = tried(lambda x, dt: self.step_fn(*x, m, force, dt), (q, v), dt)
        finally:
            self.seconds += time.perf_counter() - clock
        self.halved += halved
        return state


class Traced:
    """A step as a Program of what does not stay zero, at `live` places in (q, v).

    Raises Untraceable, and then what step_fn and force keep is as it was.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        memory = Memory(step_fn, force)
        why = next(iter(memory.asks), None)  # it uses what cannot be put back, so not even a trial
        if not why:
            try:
                self.trace(step_fn, m, force, dt, q, v, measure)
            except Exception as reason:  # a mistake of the reader's will show in the plain step
                why = str(reason) or type(reason).__name__
            why = memory.restore() or why
        if why:
            raise Untraceable(why)

    def trace(self, step_fn, m, force, dt, q, v, measure):
        """Trace the step, as if it kept nothing."""
        zero = [np.all(a == 0.0, axis=tuple(range(a.ndim - 2))) for a in (q, v)]
        still, routine = [zero[0] & zero[1]] * 2, Routine(force)
        self.shape, self.as_it_stands = q.shape[-2:], lambda q, v, dt: step_fn(q, v, m, force, dt)

        def step(q, v, dt):
            end = step_fn(q, v, m, routine, dt)
            return (*end, *measure(*end)) if measure else end

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
        self.program, self.live = program, program.live
        if not measure:
            self.function, self.source = number_function(program)

    def columns(self, q, v):
        """What does not stay zero of (..., N, 3): (entries, members)."""
        return np.array([(q, v)[k][(..., *at)].ravel() for k, at in self.live])

    def states(self, rows, lead=()):
        """q, v (count, *lead, N, 3) of rows (count, entries, members), stored components first."""
        whole = np.zeros((2, *self.shape, len(rows), *lead))
        for k, (which, at) in enumerate(self.live):
            whole[(which, *at)] = rows[:, k].reshape(len(rows), *lead)
        return tuple(a.transpose(*range(2, a.ndim), 0, 1) for a in whole)

    def plain(self, state, dt):
        """The step as it stands, of columns (entries,)."""
        q, v = (x[0] for x in self.states(state[None, :, None]))
        return self.columns(*self.as_it_stands(q, v, dt))[:, 0]


class Single:
    """One member, by Python's floats or by `machine` code. `tries`: how many steps may be hard."""

    def __init__(self, traced, tries):
        self.traced, self.tries, self.machine, self.halved = traced, tries, None, 0
        self.unsettled = False  # whether machine code ended at a loop that came to no end

    def to_machine(self, best=True):
        self.machine = native.Native(self.traced.program, best=best)

    def __call__(self, state, count, dt):
        """Rows (count, entries) after `state` (entries,), or fewer; and the Stop that is why."""
        rows, done, self.least = np.empty((count, len(state))), 0, dt / 2**HALVINGS
        while done < count:
            taken = self.easy(state, rows[done:], dt)
            if not taken:
                try:  # a step that has trouble: by itself, or in halves
                    rows[done], halved = tried(self.one, state, dt)
                except Stop as why:
                    return rows[:done], why
                taken, self.halved = 1, self.halved + halved
            done += taken
            state = rows[done - 1]
            if not math.isfinite(state.sum()):  # that is for those to say who measure it
                break
        return rows[:done], None

    def easy(self, state, rows, dt):
        """Fill rows with steps as far as they go without trouble; their number."""
        if self.machine:
            done = self.machine(np.array(state)[:, None], len(rows), rows[:, :, None], dt)
            self.unsettled = done < 0  # ~done says that a loop came to no end
            return ~done if self.unsettled else done
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
        return done

    def one(self, state, dt):
        """A step by machine code, or on Python's floats; where they raise an error, on numpy's; or
        the plain step."""
        found, self.tries = [], self.tries - 1
        if self.tries < 0:
            raise Stop("the steps that may be tried in halves are spent", "budget")
        if self.machine:
            row = np.empty((1, len(state)))
            if self.easy(state, row, dt):
                return row[0]
            if self.unsettled and dt > self.least:  # its halves are next: no need for the words
                raise Stop("a loop came to no end")
        try:
            self.traced.function(tuple(state.tolist()), 1, found.append, dt)
        except Stop:
            raise
        except (ArithmeticError, ValueError):
            with contextlib.suppress(Stop):
                careful(self.traced.source)(tuple(state), 1, found.append, dt)
        whole = found and np.isfinite(found).all()
        return np.array(found[0]) if whole else self.traced.plain(state, dt)
