"""Many steps at once: a step is traced, written as Python, numpy calls or machine code, and run.

A step is a function (q, v, m, force, dt) -> (q, v) of arrays (N, 3). `Compiled` makes of it one
that takes a block of steps a call, and `Plain` runs it as it stands. Arrays (..., N, 3) are members
that go in step, each as if it were alone. A step that raises Stop is tried in halves.
"""

import contextlib
import math
import sys
import time
from functools import cache
from itertools import chain

from curriculum.common import native
from curriculum.common.arrays import ArrayFunction
from curriculum.common.pure import Memory
from curriculum.common.python import number_function
from curriculum.common.trace import Program, Routine, Stop, Untraceable

import numpy as np

BLOCK = 1 << 17  # numbers in a block of states
FIRST = 16  # steps in the first block, after which one knows what a step costs
HALVINGS = 8  # of a step that fails, at most
PATIENCE = 0.2  # s: a block of slow steps ends after so long, so that progress can be told
# s: what llvmlite takes to load, and for each operation; of LARGE it is twice that, and grows
LOADING, COMPILING, LARGE = 0.06, 30e-6, 8000
CLOSE = 1e-6  # how far a compiled step may be from the plain one, as a share of what it changes


def followed(rule, after):
    """The step `rule` and then after(q_start, q, v, dt) -> (q, v): a step like any other."""
    if after is None:
        return rule

    def step(q, v, m, force, dt):
        return after(q, *rule(q, v, m, force, dt), dt)

    return step


def in_halves(step, state, dt, level=1):
    """Two steps of dt/2, step(state, dt/2) -> state, each in halves again where it raises Stop."""
    for _ in range(2):
        try:
            state = step(state, 0.5 * dt)
        except Stop as why:
            if level == HALVINGS or why.kind != "loop":
                raise
            state = in_halves(step, state, 0.5 * dt, level + 1)
    return state


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
            with np.errstate(all="ignore"):  # a run that blows up is told of once, and in words
                return self.one(q, v, m, force, dt)
        finally:
            self.seconds += time.perf_counter() - clock

    def one(self, q, v, m, force, dt):
        try:
            return self.step_fn(q, v, m, force, dt)
        except Stop as why:
            if why.kind != "loop":
                raise
        self.halved += 1
        return in_halves(lambda state, dt: self.step_fn(*state, m, force, dt), (q, v), dt)


class Traced:
    """A step as a Program of what does not stay zero, at `live` places in (q, v)."""

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        zero = [np.all(a == 0.0, axis=tuple(range(a.ndim - 2))) for a in (q, v)]
        still, routine, knobs = [zero[0] & zero[1]] * 2, Routine(force), ["dt"]
        self.shape, self.dt = q.shape[-2:], dt

        def step(q, v, dt=dt):
            end = step_fn(q, v, m, routine, dt)
            return (*end, *measure(*end)) if measure else end

        while True:
            try:
                program = Program(step, *still, knobs=knobs)
            except Untraceable:
                if not knobs:
                    raise
                knobs = []  # perhaps it asks how long the step is
                continue
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
            self.function, self.source = number_function(program, again)

    def knobs(self, dt):
        """What the function takes for a step of length dt; Untraceable if it is for one only."""
        if dt != self.dt and not self.program.knobs:
            raise Untraceable("a step of another length is another function")
        return [dt] * len(self.program.knobs)

    def columns(self, q, v):
        """What does not stay zero of (..., N, 3): (entries, members)."""
        return np.array([(q, v)[k][(..., *at)].ravel() for k, at in self.live])

    def states(self, rows, lead=()):
        """q, v (count, *lead, N, 3) of rows (count, entries, members), stored components first."""
        whole = np.zeros((2, *self.shape, len(rows), *lead))
        for k, (which, at) in enumerate(self.live):
            whole[(which, *at)] = rows[:, k].reshape(len(rows), *lead)
        return tuple(a.transpose(*range(2, a.ndim), 0, 1) for a in whole)


def again(inputs, knobs, first, lines, results):
    """A function that puts the results in place of the inputs `count` times, and keeps them."""
    names, made = ", ".join(inputs), ", ".join(results)
    lines = [*lines, f"state = ({made},)", "keep(state)", f"{names}, = state"]
    body = "".join(f"        {line}\n" for line in lines)
    head = "".join(f"    {line}\n" for line in [*first, f"{names}, = state"])
    given = ", ".join(["state", "count", "keep", *knobs])
    return f"def f({given}):\n{head}    for _ in range(count):\n{body}"


class Single:
    """One member, by Python's floats or by `machine` code. `tries`: how many hard steps may be."""

    def __init__(self, traced, plain, tries):
        self.traced, self.plain, self.tries = traced, plain, tries
        self.machine, self.halved = None, 0

    def __call__(self, state, count, dt):
        """Rows (count, entries) after `state` (entries,), or fewer; and the Stop that is why."""
        rows, done = np.empty((count, len(state))), 0
        while done < count:
            taken = self.easy(state, rows[done:], dt)
            if not taken:
                try:
                    rows[done], taken = self.hard(state, dt), 1
                except Stop as why:
                    return rows[:done], why
            done += taken
            state = rows[done - 1]
            if not np.isfinite(state).all():  # that is for those to say who measure it
                break
        return rows[:done], None

    def easy(self, state, rows, dt):
        """Fill rows with steps as far as they go without trouble; their number."""
        if self.machine:
            begin = np.array(state)[:, None]
            return self.machine(begin, len(rows), rows[:, :, None], *self.traced.knobs(dt))
        states = []
        try:
            knobs = self.traced.knobs(dt)
            self.traced.function(tuple(state.tolist()), len(rows), states.append, *knobs)
        except (ArithmeticError, ValueError):
            pass  # the step by itself will find the words
        flat = np.fromiter(chain.from_iterable(states), float, len(states) * rows.shape[1])
        rows[: len(states)] = flat.reshape(-1, rows.shape[1])
        return len(states)

    def hard(self, state, dt):
        """One step that has trouble: by itself, or in halves."""
        try:
            return self.one(state, dt)
        except Stop as why:
            if why.kind != "loop":
                raise
        self.halved += 1
        return in_halves(self.one, state, dt)

    def one(self, state, dt):
        """A step on Python's floats; or in numpy, which goes on where they raise an error."""
        found, self.tries = [], self.tries - 1
        if self.tries < 0:
            raise Stop("the steps that may be tried in halves are spent", "budget")
        try:
            self.traced.function(tuple(state.tolist()), 1, found.append, *self.traced.knobs(dt))
            return np.array(found[0])
        except Stop:
            raise
        except (ArithmeticError, ValueError, Untraceable):
            return self.by_plain(state, dt)

    def by_plain(self, state, dt):
        """The plain step of columns (entries,)."""
        q, v = (x[0] for x in self.traced.states(state[None, :, None]))
        with np.errstate(all="ignore"):
            return self.traced.columns(*self.plain(q, v, dt))[:, 0]


class Many:
    """Members side by side, by numpy calls or in vector registers; who has trouble goes alone."""

    def __init__(self, alone):
        self.alone, self.machine, self.function = alone, None, None

    def __call__(self, state, count, dt):
        """Rows (count, entries, members) after `state` (entries, members); NaN for who is lost."""
        rows = np.empty((count, *state.shape))
        knobs = self.alone.traced.knobs(dt)
        if self.machine:
            in_threads(self.machine, state.copy(), count, knobs, rows)
        else:
            self.by_arrays(state, rows, knobs)
        for member in np.flatnonzero(~np.isfinite(rows).all(axis=(0, 1))):
            found, _ = self.alone(state[:, member], count, dt)
            rows[: len(found), :, member], rows[len(found) :, :, member] = found, np.nan
        return rows, None

    def by_arrays(self, state, rows, knobs):
        """By numpy calls, so many members at once that what they need stays in the cache."""
        self.function = self.function or ArrayFunction(self.alone.traced.program)
        size = self.function.members()
        for first in range(0, state.shape[1], size):
            piece = slice(first, first + size)
            before = list(state[:, piece])
            with np.errstate(all="ignore"):
                for row in rows[:, :, piece]:
                    self.function(before, list(row), *knobs)
                    before = list(row)


def in_threads(machine, state, count, knobs, rows=None):
    """Members on all processors: machine code lets go of the interpreter. state becomes the end."""
    many = -(-state.shape[1] // machine.lanes)
    cut = -(-many // native.CORES) * machine.lanes

    def some(first):
        piece = slice(first, first + cut)
        machine(state[:, piece], count, None if rows is None else rows[:, :, piece], *knobs)

    list(pool().map(some, range(0, state.shape[1], cut)))


@cache
def pool():
    """Threads, a processor each."""
    from concurrent.futures import ThreadPoolExecutor  # here: it takes its time to load

    return ThreadPoolExecutor(native.CORES)


def each_state(function, q, v):
    """function(q, v) (N, 3), which is of one state, of each of q, v (..., N, 3).

    It is traced and done to all at once; if that gives something else, it is asked one by one.
    """
    if q.ndim == 2:
        return function(q, v)
    shape = q.shape[-2:]
    states = [x.reshape(-1, *shape) for x in (q, v)]
    given = list(zip(*states, strict=True))
    try:
        free = np.zeros(shape, dtype=bool)
        program = Program(lambda q, v: (np.broadcast_to(function(q, v), shape),), free, free)
        rows = np.empty((free.size, len(given)))
        inputs = np.concatenate([x.reshape(-1, free.size) for x in states], axis=1).T
        ArrayFunction(program)(list(np.ascontiguousarray(inputs)), list(rows))
        found = rows.T.reshape(-1, *shape)
        if all(np.allclose(found[k], function(*given[k]), 1e-9, 1e-12) for k in (0, -1)):
            return found.reshape(q.shape)
    except Exception:  # what is wrong with it shows below
        pass
    return np.reshape([np.broadcast_to(function(*state), shape) for state in given], q.shape)


class Crowd:
    """Many members (R, N, 3) of one system: `advance` them, look at their `states`, `put` others.

    Each is, to the last bit, where it would be alone; one that cannot go on is NaN. `measure`: a
    function of one state (N, 3), (q, v) -> tuple of arrays, asked at every step. A step that cannot
    be traced is taken plainly, member by member.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        self.dt, self.given, self.measure = dt, (m, force, dt), measure
        self.plain, self.traced, self.machine = Plain(step_fn), None, None
        with contextlib.suppress(Untraceable):
            self.traced = Traced(step_fn, m, force, dt, q, v, measure)
        if self.traced and native.available():
            self.machine = native.Native(self.traced.program, native.LANES)
        elif self.traced:
            self.function = ArrayFunction(self.traced.program)
        self.put(q, v)

    def put(self, q, v):
        """Go on from q, v (R, N, 3)."""
        self.columns = self.traced.columns(q, v) if self.traced else (q, v)

    def states(self):
        """q, v (R, N, 3)."""
        if not self.traced:
            return self.columns
        return tuple(x[0] for x in self.traced.states(self.columns[None], self.columns.shape[1:]))

    def advance(self, count):
        """Take `count` steps; what was measured at each: (count, numbers, R), or None."""
        if not self.traced:
            return self.by_plain(count)
        knobs, entries = self.traced.knobs(self.dt), len(self.columns)
        made, members = len(self.traced.program.out), self.columns.shape[1]
        if self.machine:
            rows = np.empty((count, made - entries, members)) if self.measure else None
            in_threads(self.machine, self.columns, count, knobs, rows)
            return rows
        rows, before = np.empty((count, made, members)), list(self.columns)
        with np.errstate(all="ignore"):
            for row in rows:
                self.function(before, list(row), *knobs)
                before = list(row[:entries])
        self.columns = rows[-1, :entries].copy()
        return rows[:, entries:] if self.measure else None

    def by_plain(self, count):
        """Steps of one member after the other."""
        rows = []
        for _ in range(count):
            self.columns = self.plain(*self.columns, *self.given)
            if self.measure:
                both = zip(*self.columns, strict=True)
                rows.append([np.concatenate([*map(np.ravel, self.measure(*x))]) for x in both])
        return np.swapaxes(rows, 1, 2) if self.measure else None


class Compiled:
    """step_fn for many steps a call: q, v (..., N, 3), or a block of them -> the next block.

    A block is q, v (count, ..., N, 3). `steps`: how many are to come. What was compiled is compared
    with the plain step (`check`), at the start and at the edges of blocks; where they differ, or
    the step cannot be traced, the steps are plain. `way` says how they are done; `source` is the
    code; `taken` steps took `seconds`, counted anew where the way changes.
    """

    def __init__(self, step_fn, steps=0, check=True, tries=math.inf):
        self.step_fn, self.check, self.tries = step_fn, check, tries
        self.plain, self.alone, self.runner, self.way = Plain(step_fn), None, None, ""
        self.start(steps)

    def start(self, steps):
        """Begin a run of so many steps, of the same system."""
        self.steps, self.taken, self.seconds, self.why = steps, 0, 0.0, None

    @property
    def halved(self):
        """How many steps were taken in halves."""
        return self.plain.halved + (self.alone.halved if self.alone else 0)

    @property
    def source(self):
        """The code that a step has become."""
        return self.alone.traced.source if self.runner else f"# {self.way}"

    def trace(self, q, v, m, force, dt):
        """Trace the step; or find out why that cannot be done. A force may know a better `way`."""
        self.lead, self.way = q.shape[:-2], getattr(force, "way", "")
        if self.way:
            return
        memory = Memory(self.step_fn, force)
        why = memory.changed()  # it uses what cannot be put back
        try:
            traced = None if why else Traced(self.step_fn, m, force, dt, q, v)
        except Exception as reason:  # the reader's mistake, or more than can be traced?
            why = str(reason) or type(reason).__name__
        why = memory.changed() or why
        memory.restore()
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

    def improve(self, pace):
        """Machine code, where the steps that are left are worth it."""
        size = sum(len(tape.nodes) for tape in self.alone.traced.program.tapes())
        cost = COMPILING * size * (1.0 + (size / LARGE) ** 2)
        cost += LOADING * ("llvmlite.binding" not in sys.modules)
        if native.available() and self.steps * pace > 1.5 * cost:
            self.to_machine(self.steps * pace > 50.0 * cost)

    def to_machine(self, best=True):
        """Machine code from here on; the best takes a few times as long to make."""
        lanes = native.LANES if self.lead else 1
        self.runner.machine = native.Native(self.alone.traced.program, lanes, best)
        self.taken, self.seconds, self.way = 0, 0.0, "compiled to machine code"

    def __call__(self, q, v, m, force, dt):
        if not self.way:
            self.trace(q, v, m, force, dt)
        if q.ndim > 2 + len(self.lead):
            q, v = q[-1], v[-1]
        if self.why:
            raise self.why
        clock = time.perf_counter()
        if not self.runner:
            return self.one_by_one(q, v, m, force, dt)
        start = self.alone.traced.columns(q, v)
        rows, self.why = self.runner(start if self.lead else start[:, 0], self.count(start), dt)
        spent, count = time.perf_counter() - clock, len(rows)
        if self.why and not count:
            raise self.why
        rows = rows.reshape(count, len(start), -1)
        before = rows[-2] if count > 1 else start
        sane = np.isfinite(rows[-1, :, 0]).all()
        known = not self.taken and not self.runner.machine  # the start has been compared
        same = known or not (self.check and sane) or self.agrees(before[:, 0], rows[-1, :, 0], dt)
        if not same:
            self.give_up("it does something else when it is compiled")
            return self(q, v, m, force, dt)
        self.taken, self.seconds = self.taken + count, self.seconds + spent
        self.steps -= count
        if not self.why and not self.runner.machine:
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
