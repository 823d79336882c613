"""compiled: a step that runs ahead of the loop around it."""

import math
import time
from contextlib import suppress

import numpy as np

from curriculum.common.tracing import llvm, python
from curriculum.common.tracing.arrays import ordered
from curriculum.common.tracing.symbols import FUNCTIONS
from curriculum.common.tracing.tape import StepFailed, Untraceable, current
from curriculum.common.tracing.trace import several, trace_loop, work

FIRST, EVERY = 16, 500  # which steps are compared
FASTER, FAR = 8, 10_000  # a stretch is so much longer than the one before, up to so many steps
LARGE = 1e100  # beyond, the step as it stands shows how it diverges
SAME, ROUNDING = 1e-9, 1e-15  # of what a step changes, and of a number: as sines may differ
DIFFERS = (
    "plain numpy from step {} on: compiled, it gives something else. "
    "What a step reads, beside its arguments, must stay as it is"
)


class Step:
    """step(*arrays) -> arrays as a function of its arguments alone, compiled where that can be.

    It runs ahead of its caller: while each state that comes in is the one that went out, the next
    has been computed. The first steps, every 500th and the last are compared with the step as it
    stands when they are handed out, and where one differs, that is taken from there on. `how` steps
    are taken, in how many `seconds`, and the `source` of what is compiled are attributes. Raises
    StepFailed.
    """

    def __init__(self, step, steps):
        self.step, self.steps = step, steps
        self.how, self.seconds, self.source = "plain numpy", 0.0, ""
        self.run, self.compiles = None, True
        self.number, self.stretch = 0, 1  # of the next step; how many to compute at once
        self.ahead, self.expected = iter(()), None  # (bytes, state) computed; bytes of the last out

    def __call__(self, *state):
        if current.plain or as_bytes(state) != self.expected:
            self.ahead, self.stretch = iter(()), 1
        row = next(self.ahead, None) or self.run_ahead(state)
        number, self.number = self.number, self.number + 1
        if row is None:  # only the step as it stands can tell
            self.expected, clock = None, time.perf_counter()
            made = self.as_it_stands(state)
            self.seconds += time.perf_counter() - clock
            return made
        self.expected, made = row
        if number < FIRST or number % EVERY == 0 or number == self.steps - 1:
            right = self.as_it_stands(state)
            if not self.same(state, several(made), several(right)):
                self.how, self.compiles = DIFFERS.format(number), False
                self.expected, made = None, right
        return made

    def run_ahead(self, state):
        """Compute what follows a state, and give the first of it; None if that cannot be done."""
        if current.plain or not self.compiles:
            return None
        try:
            if self.run is None or not self.run.fits(state):
                self.run = CompiledSteps(self.step, state, self.steps)
                self.how, self.source = self.run.how, self.run.source
        except Untraceable as why:
            self.how, self.compiles = f"plain numpy: {why}", False
            return None
        rows, seconds = self.run.rows(state, max(1, min(self.stretch, self.steps - self.number)))
        self.seconds += seconds
        self.stretch = min(FASTER * self.stretch, FAR)
        columns = self.run.columns(rows[1:])
        made = columns[0] if self.run.single else zip(*columns, strict=True)
        self.ahead = zip(map(np.ndarray.tobytes, rows[1:]), made, strict=True)
        return next(self.ahead, None)

    def as_it_stands(self, state):
        with np.errstate(all="ignore"):
            made = self.step(*(ordered(np.array(x, float))[()] for x in state))
            numbers = [x for x in several(made) if isinstance(x, np.ndarray | float)]
            if not all(np.isfinite(x).all() for x in numbers):
                raise StepFailed("diverged")
        return made

    def same(self, state, made, right):
        """Whether the arrays that are made are the right ones."""
        same, rounding = (0.0, 0.0) if self.run.exact else (SAME, ROUNDING)
        return list(map(np.shape, made)) == list(map(np.shape, right)) and all(
            np.max(abs(a - b)) <= same * np.max(abs(b - x)) + rounding * np.max(abs(b))
            for a, b, x in zip(made, right, state, strict=True)
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
        live = moving(state)
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
        return [x.reshape(-1, *shape) for x, shape in zip(parts, self.shapes, strict=True)]


def moving(state):
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
