"""compiled: a step that runs ahead of the loop around it."""

import math
import time
from contextlib import suppress
from itertools import count

import numpy as np

from curriculum.common.tracing import llvm, python
from curriculum.common.tracing.arrays import ordered
from curriculum.common.tracing.symbols import FUNCTIONS
from curriculum.common.tracing.tape import StepFailed, Untraceable, current
from curriculum.common.tracing.trace import several, trace_loop, work

FIRST, EVERY = 16, 2_000  # the steps that are compared: the first ones, then every so many-th
FASTER = 8  # a stretch is so many times as long as the one before, and ends at a comparison
LARGE = 1e100  # beyond, the step as it stands shows how it diverges
SAME, ROUNDING = 1e-9, 1e-15  # of what a step changes, and of a number: as sines may differ
DIFFERS = (
    "plain numpy from step {} on: compiled, it gives something else. What a step reads, beside its "
    "arguments, must stay as it is, and an array of its own that it sums must be ordered(x)"
)


class Step:
    """step(*arrays) -> arrays as a function of its arguments alone, compiled where that can be.

    It runs ahead of its caller: while each state that comes in is the one that went out, the next
    has been computed. Some steps are compared with the step as it stands, and where one differs,
    that is taken from there on. `how` steps are taken, in how many `seconds`, and the `source` of
    what is compiled are attributes. Raises StepFailed.
    """

    def __init__(self, step, steps):
        self.step, self.steps = step, steps
        self.how, self.seconds, self.source = "plain numpy", 0.0, ""
        self.run, self.compiles = None, True
        self.number, self.stretch = -1, 0  # of the last step; how many were computed at once
        self.ahead, self.expected = iter(()), None  # steps computed; the last state's bytes

    def __call__(self, *state):
        goes_on = as_bytes(state) == self.expected and not current.plain
        row = next(self.ahead, None) if goes_on else None
        self.number, self.expected, made = row or self.begin(state)
        return made

    def begin(self, state):
        """Begin a stretch, and give its first step: its number, bytes and state."""
        number, last = self.number + 1, self.steps - 1
        compared = number < FIRST or number % EVERY == 0 or number == last
        ends = EVERY * (number // EVERY + 1), last, self.steps  # a comparison, or all that is asked
        end = number + 1 if number < FIRST else min(x for x in ends if x > number)
        grown = FASTER * self.stretch if as_bytes(state) == self.expected else 1
        self.stretch = min(grown, end - number)
        self.ahead = self.run_ahead(state, number)
        row = next(self.ahead, None)
        if row and not compared:
            return row
        clock = time.perf_counter()
        right = self.as_it_stands(state)
        if row is None:  # only the step as it stands can tell
            self.seconds += time.perf_counter() - clock
        elif self.same(state, several(row[-1]), several(right)):
            return row
        else:
            self.how, self.compiles = DIFFERS.format(number), False
        return number, None, right

    def run_ahead(self, state, number):
        """Compute a stretch of steps: of each its number, bytes and state; none if it cannot be."""
        if current.plain or not self.compiles:
            return iter(())
        try:
            if self.run is None or not self.run.fits(state):
                self.run = CompiledSteps(self.step, state, self.steps)
                self.how, self.source = self.run.how, self.run.source
        except Untraceable as why:
            self.how, self.compiles = f"plain numpy: {why}", False
            return iter(())
        rows, seconds = self.run.rows(state, self.stretch)
        self.seconds += seconds
        columns = self.run.columns(rows[1:])
        made = columns[0] if self.run.single else zip(*columns, strict=True)
        return zip(count(number), map(np.ndarray.tobytes, rows[1:]), made)

    def as_it_stands(self, state):
        with np.errstate(all="ignore"):
            made = self.step(*(ordered(np.array(x, float, order="C"))[()] for x in state))
            numbers = [x for x in several(made) if isinstance(x, np.ndarray | float)]
            if not all(np.isfinite(x).all() for x in numbers):
                raise StepFailed("diverged")
        plain = [np.asarray(x)[()] for x in several(made)]
        return tuple(plain) if isinstance(made, tuple | list) else plain[0]

    def same(self, state, made, right):
        """Whether the arrays that are made are the right ones."""
        same, rounding = (0.0, 0.0) if self.run.exact else (SAME, ROUNDING)
        return list(map(np.shape, made)) == list(map(np.shape, right)) and all(
            np.max(abs(a - b)) <= same * np.max(abs(b - x)) + rounding * np.max(abs(b))
            for a, b, x in zip(made, right, state, strict=True)
            if np.size(b)
        )


def compiled(step, steps):
    """A function like step(*arrays) -> arrays, to be called about so many times: a Step."""
    return Step(step, steps)


class CompiledSteps:
    """run(state, steps, *knobs) -> columns, of step(*state, *knobs) -> state.

    The columns hold every state, from the first on, to where a step fails or numbers get LARGE. It
    is machine code if so many `steps`, in all, repay that, and it is only for states that it
    `fits`. Raises Untraceable.
    """

    def __init__(self, step, state, steps, knobs=0):
        live = nonzero(state)
        self.shapes, self.mask = list(map(np.shape, state)), numbers(live) != 0.0
        program, loop = trace_loop(step, live, knobs)
        self.single, self.source = loop.single, python.source_of(program)
        self.exact = not any(f"{x}(" in self.source for x in FUNCTIONS if x != "sqrt")
        self.how, self.prepared = "compiled to Python", None
        if llvm.repays(work(program.tape, steps), self.source.count("\n")):
            with suppress(llvm.Unavailable):
                self.how, self.prepared = "machine code", llvm.single(program)
        if self.prepared is None:
            self.prepared = python.single(self.source, loop.places)

    def __call__(self, state, steps, *knobs):
        return self.columns(self.rows(state, steps, *knobs)[0])

    def fits(self, state):
        return list(map(np.shape, state)) == self.shapes and not numbers(state)[~self.mask].any()

    def rows(self, state, steps, *knobs):
        """The numbers of every state (steps + 1, size), and the seconds that they took."""
        rows = np.empty((steps + 1, self.mask.size))
        rows.fill(0.0)  # touched now, not while it is timed
        rows[0] = numbers(state)
        call = self.prepared(np.append(rows[0, self.mask], knobs), rows[1:])
        clock = time.perf_counter()
        done = 1 + call()
        seconds = time.perf_counter() - clock
        small = np.all(np.abs(rows[:done]) < LARGE, axis=1)
        return rows[: done if small.all() else np.argmin(small)], seconds

    def columns(self, rows):
        """Rows as arrays of states, one more axis in front."""
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        parts = np.split(rows, ends[:-1], axis=1)
        return [x.reshape(len(rows), *shape) for x, shape in zip(parts, self.shapes, strict=True)]


def nonzero(state):
    """Which numbers of a state are not always zero; a coordinate that all points lack is."""
    if min(map(np.ndim, state)) < 2 or len({np.shape(x)[1:] for x in state}) > 1:
        return [np.ones(np.shape(x), bool) for x in state]
    along = np.any([np.any(x, axis=0) for x in state], axis=0)
    return [np.broadcast_to(along, np.shape(x)) for x in state]


def numbers(state):
    """All numbers of a state, in a row."""
    return np.concatenate([np.ravel(x) for x in state]).astype(float)


def as_bytes(state):
    try:
        return b"".join(map(np.ndarray.tobytes, state))
    except TypeError:  # numbers beside arrays
        return numbers(state).tobytes()
