"""compiled: a step that runs ahead of the loop around it."""

import time
from itertools import count, repeat

import numpy as np

from curriculum.common.tracing import llvm, python
from curriculum.common.tracing.arrays import viewed
from curriculum.common.tracing.symbols import LIBRARY
from curriculum.common.tracing.tape import StepChanged, Untraceable, current
from curriculum.common.tracing.trace import reason, several, split, trace_loop, work

BUILDS = 8  # times that a step is compiled: what changes more often may change at each step
Array = np.ndarray
FIRST, EVERY = 16, 2_000  # the steps that are compared: the first ones, then every so many-th
FASTER = 8  # a stretch is so many times as long as the one before, and ends at a comparison
LARGE = 1e100  # beyond, the step by its own lines shows how it diverges
SAME, ROUNDING = 1e-9, 1e-15  # of what a step changes, and of a number: as sines may differ
CHANGED = (
    "step {} gives something else than when it was compiled. What it reads beside its arguments "
    "must stay as it is, and an array of its own that it sums must be ordered(x); "
    "or run it plainly (--plain, or `with plain():`)"
)


class Step:
    """The function step(*state, *others) -> state, compiled where that can be.

    By name: `how` steps are taken and whether that `is_compiled`, in how many `seconds` in all;
    the `source` of what is compiled; the `failure`, why a step had no finite result: it is NaN, and
    so is all after it; `edited`, whether a state came in that had not gone out; and `changed`,
    whether the others did.
    """

    def __init__(self, step, steps):
        self.step, self.steps = step, steps
        self.how, self.source, self.failure = "plain numpy", "", None
        self.seconds, self.edited, self.changed = 0.0, False, False
        self.width, self.single = None, None  # how many arrays a state is; if it is one, by itself
        self.others, self.known = (), ()  # copies of those to compile with; their contents
        self.run, self.compiles, self.builds = None, True, 0
        self.number, self.stretch = -1, 0  # of the last step; how many were computed at once
        self.ahead, self.expected = iter(()), ()  # steps computed; contents of arguments to come

    @property
    def is_compiled(self):
        return self.compiles and self.run is not None

    def __call__(self, *arguments):
        came = tuple([x.tobytes() if isinstance(x, Array) else x for x in arguments])  # `contents`
        if came == self.expected and not current.plain:
            for number, expected, state in self.ahead:  # the next, if there is one
                self.number, self.expected = number, expected
                return state
        return self.begin(arguments)

    def begin(self, arguments):
        """Begin a stretch, and give its first step."""
        number, last, result = self.number + 1, self.steps - 1, None
        if self.width is None:
            result = self.by_its_own_lines(arguments)
        state, came = arguments[: self.width], contents(arguments)
        if not are_finite(state):
            self.failure = self.failure or "a state that came in is not finite"
            return self.hand_out(number, nan_like(state))
        goes_on = came[: self.width] == self.expected[: self.width]
        changed = came[self.width :] != self.known
        self.edited |= number > 0 and not goes_on
        self.changed |= number > 0 and changed
        if changed or self.run is None or not self.run.fits(state):
            self.known, self.run = came[self.width :], None
            self.others = list(map(copied, arguments[self.width :]))
        compared = self.run is None or number < FIRST or number % EVERY == 0 or number == last
        ends = EVERY * (number // EVERY + 1), last, self.steps  # a comparison, or all that is asked
        end = number + 1 if number < FIRST else min(x for x in ends if x > number)
        self.stretch = min(FASTER * self.stretch if goes_on and self.run else 1, end - number)
        self.ahead = self.run_ahead(state, number)
        self.number, self.expected, ahead = next(self.ahead, (number, (), None))
        if ahead is not None and not compared:
            return ahead
        clock = time.perf_counter()
        if result is None:
            result = self.by_its_own_lines(arguments)
        if ahead is None:  # only its own lines can tell
            self.seconds += time.perf_counter() - clock
        elif self.same(state, several(ahead), result):
            return ahead
        elif number >= FIRST:
            raise StepChanged(CHANGED.format(number))
        else:  # so far, each step was compared before it was handed out
            self.how, self.compiles = f"plain numpy: {CHANGED.format(number)}", False
            self.ahead = iter(())
        return self.hand_out(number, result)

    def hand_out(self, number, state):
        self.number, self.expected = number, contents(state) + self.known
        return state[0] if self.single else state

    def run_ahead(self, state, number):
        """Compute a stretch: of each step its number, what comes next, state; none if it cannot."""
        if current.plain or not self.compiles:
            return iter(())
        try:
            if self.run is None:
                self.builds += 1
                if self.builds > BUILDS:
                    raise Untraceable("its arguments keep changing")
                self.run = CompiledSteps(self.step, state, self.steps, others=self.others)
                self.how, self.source = self.run.how, self.run.source
        except Untraceable as why:
            self.how, self.compiles = f"plain numpy: {why}", False
            return iter(())
        columns = [x[1:] for x in self.run(state, self.stretch)]
        self.seconds += self.run.seconds
        states = columns[0] if self.single else zip(*columns, strict=True)
        seen = [x if x.ndim == 1 else map(Array.tobytes, x) for x in columns]
        return zip(count(number), zip(*seen, *map(repeat, self.known), strict=False), states)

    def by_its_own_lines(self, arguments):
        """The arrays of the next state, as numpy computes them; NaN if they are not finite."""
        current.failure = None
        with np.errstate(all="ignore"):
            result = self.step(*map(copied, arguments))
        if self.width is None:
            self.width, self.single = len(several(result)), not isinstance(result, tuple | list)
        result = tuple(np.asarray(x, float)[()] for x in several(result))
        if are_finite(result):
            return result
        self.failure = self.failure or current.failure or self.why(arguments, result)
        return nan_like(result)

    def why(self, arguments, result):
        """Why its result is not finite, and where numpy first met what is not."""
        try:
            with np.errstate(divide="raise", invalid="raise", over="raise", under="ignore"):
                self.step(*map(copied, arguments))
        except FloatingPointError as error:
            return "diverged" if "overflow" in str(error) else f"not a number: {reason(error)}"
        return "not a number" if np.isnan(numbers(result)).any() else "diverged"

    def same(self, state, ahead, result):
        """Whether the arrays that were computed ahead are right."""
        for a, b, x in zip(ahead, result, state, strict=True):
            allowed = 0.0
            if not self.run.exact and np.size(b):
                allowed = SAME * np.max(abs(b - x)) + ROUNDING * np.max(abs(b))
            if not np.all(abs(a - b) <= allowed):
                return False
        return True


def compiled(step, steps):
    """The function step(*state, *others) -> state, made fast for about so many steps: a Step.

    As many of its first arguments as it returns are the state. The others are compared at each
    call, and where one changes, the step is compiled for it. What it reads besides must stay as it
    is: steps are compared with its own lines, the first 16 before they are handed out, then every
    2,000th and the last. Raises StepChanged where one of these differs.
    """
    return Step(step, steps)


class CompiledSteps:
    """run(state, steps, *knobs) -> columns, of step(*state, *others, *knobs) -> state.

    The columns hold every state, from the first on, to where a step fails or numbers get LARGE. It
    is machine code if so many `steps` repay that, for states that it `fits`. Raises Untraceable.
    """

    def __init__(self, step, state, steps, knobs=0, others=()):
        live = nonzero(state)
        self.shapes, self.mask = list(map(np.shape, state)), numbers(live) != 0.0
        program, loop = trace_loop(step, live, knobs, others)
        self.exact = program.tape.signs.isdisjoint(LIBRARY)
        self.source = python.source_of(program)
        self.how, self.write = "machine code", None
        if llvm.repays(work(program.tape, steps), self.source.count("\n")):
            self.write = llvm.written(program)
        if self.write is None:
            self.how, self.write = "compiled to Python", python.written(self.source, loop.places)

    def __call__(self, state, steps, *knobs):
        rows = np.full((steps + 1, self.mask.size), 0.0)  # touched now, not while it is timed
        rows[0] = numbers(state)
        done, self.seconds = self.write(np.append(rows[0, self.mask], knobs), rows[1:])
        small = np.all(np.abs(rows[: done + 1]) < LARGE, axis=1)
        return split(rows[: done + 1 if small.all() else np.argmin(small)], self.shapes)

    def fits(self, state):
        return list(map(np.shape, state)) == self.shapes and not numbers(state)[~self.mask].any()


def nonzero(state):
    """Which numbers of a state are not always zero; a coordinate that all points lack is."""
    if min(map(np.ndim, state)) < 2 or len({np.shape(x)[1:] for x in state}) > 1:
        return [np.ones(np.shape(x), bool) for x in state]
    along = np.any([np.any(x, axis=0) for x in state], axis=0)
    return [np.broadcast_to(along, np.shape(x)) for x in state]


def numbers(state):
    """All numbers of a state, in a row."""
    return np.concatenate([np.ravel(x) for x in state]).astype(float)


def are_finite(arrays):
    return all(np.isfinite(x).all() for x in arrays)


def nan_like(arrays):
    return tuple(np.full(np.shape(x), np.nan)[()] for x in arrays)


def contents(arguments):
    """What arguments are compared by: the bytes of an array; what else there is, as it is."""
    return tuple([x.tobytes() if isinstance(x, Array) else x for x in arguments])


def copied(x):
    """A copy of an array, which a step may edit, and whose sums are ordered if it is of floats."""
    return viewed(x.copy()) if isinstance(x, Array) else x
