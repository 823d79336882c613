"""compiled: a step that runs ahead of the loop around it."""

import time
from itertools import count, takewhile

import numpy as np

from curriculum.common.tracing import llvm, python
from curriculum.common.tracing.arrays import viewed
from curriculum.common.tracing.symbols import LIBRARY
from curriculum.common.tracing.tape import StepChanged, Untraceable, current
from curriculum.common.tracing.trace import reason, several, split, trace_loop, work

BUILDS = 8  # times that a step is compiled: what changes more often may change at each step
FIRST, EVERY = 16, 2_000  # the steps that are compared: the first ones, then every so many-th
FASTER = 8  # a stretch is so many times as long as the one before, and ends at a comparison
LARGE = 1e100  # a number beyond has diverged
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
    so is all after it; and `edited`, whether a state came in that had not gone out, or new others.
    """

    def __init__(self, step, steps):
        self.step, self.steps = step, steps
        self.how, self.source, self.failure = "plain numpy", "", None
        self.seconds, self.edited = 0.0, False
        self.width, self.single = None, None  # how many arrays a state is; if it is one, by itself
        self.others, self.known = (), ()  # copies of those to compile with; their contents
        self.many, self.tail = 0, np.zeros(0)  # first arguments, compared at once; others of them
        self.look, self.rest = None, ()  # how to compare those after them, and with what
        self.run, self.compiles, self.builds = None, True, 0
        self.number, self.stretch = -1, 0  # of the last step; how many were computed at once
        self.ahead, self.expected = iter(()), None  # steps computed; the bytes to come in

    @property
    def is_compiled(self):
        return self.compiles and self.run is not None

    def __call__(self, *arguments):
        many = self.many
        try:
            goes_on = b"".join(arguments[:many]) == self.expected and not current.plain
        except TypeError:  # a float, or an array whose entries do not lie side by side
            goes_on = False
        rest = arguments[many:]
        if goes_on and self.rest == (self.look(rest) if self.look else rest):
            for number, expected, state in self.ahead:  # the next, if there is one
                self.number, self.expected = number, expected
                return state
        return self.begin(arguments)

    def begin(self, arguments):
        """Begin a stretch, and give its first step."""
        number, last, result = self.number + 1, self.steps - 1, None
        if self.width is None:
            result = self.by_its_own_lines(arguments)
        state, others = arguments[: self.width], arguments[self.width :]
        if not in_range(state):
            self.failure = self.failure or "a state that came in is not a number below 1e100"
            return self.hand_out(number, nan_like(state))
        goes_on = numbers([*state, self.tail]).tobytes() == self.expected
        changed = contents(others) != self.known
        self.edited |= number > 0 and (changed or not goes_on)
        if changed or self.run is None or not self.run.fits(state):
            self.know(others)
        compared = self.run is None or number < FIRST or number % EVERY == 0 or number == last
        ends = EVERY * (number // EVERY + 1), last, self.steps  # a comparison, or all that is asked
        end = number + 1 if number < FIRST else min(x for x in ends if x > number)
        self.stretch = min(FASTER * self.stretch if goes_on and self.run else 1, end - number)
        self.ahead = self.run_ahead(state, number)
        self.number, self.expected, ahead = next(self.ahead, (number, None, None))
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
        self.number, self.expected = number, numbers([*state, self.tail]).tobytes()
        return state[0] if self.single else state

    def know(self, others):
        """Note what to compile with. Arrays that come first are compared at once with the state."""
        first = len([*takewhile(lambda x: getattr(x, "dtype", 0) == "float64", others)])
        self.others, self.known = list(map(copied, others)), contents(others)
        self.many, self.tail = self.width + first, np.frombuffer(b"".join(self.known[:first]))
        arrays = any(isinstance(x, np.ndarray) for x in others[first:])
        self.look, self.rest, self.run = contents if arrays else None, self.known[first:], None

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
        rows = self.run.rows[1:]
        rows = np.concatenate([rows, np.tile(self.tail, (len(rows), 1))], axis=1)
        expected = rows.view(f"V{8 * rows.shape[1]}").ravel().tolist()
        return zip(count(number), expected, states)

    def by_its_own_lines(self, arguments):
        """The arrays of the next state, as numpy computes them; NaN if one has diverged."""
        current.failure = None
        with np.errstate(all="ignore"):
            result = self.step(*map(copied, arguments))
        if self.width is None:
            self.width, self.single = len(several(result)), not isinstance(result, tuple | list)
        result = tuple(np.asarray(x, float)[()] for x in several(result))
        if in_range(result):
            return result
        self.failure = self.failure or current.failure or self.why(arguments, result)
        return nan_like(result)

    def why(self, arguments, result):
        """Why its result is not a state, and where numpy first met what is not a number."""
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

    The columns hold every state, from the first on, to where a step fails or numbers get LARGE; so
    do `rows`. It is machine code if `steps` repay that, for states it `fits`. Raises Untraceable.
    """

    def __init__(self, step, state, steps, knobs=0, others=()):
        live = nonzero(state)
        self.shapes, self.mask = list(map(np.shape, state)), numbers(live) != 0.0
        program, loop = trace_loop(step, live, knobs, others)
        self.exact = program.tape.signs.isdisjoint(LIBRARY)
        self.source = python.source_of(program)
        self.how, self.write = "machine code", None
        operations = work(program.tape, steps)
        if llvm.repays(operations, self.source.count("\n")):
            self.write = llvm.written(program, operations)
        if self.write is None:
            self.how, self.write = "compiled to Python", python.written(self.source, loop.places)

    def __call__(self, state, steps, *knobs):
        rows = np.full((steps + 1, self.mask.size), 0.0)  # touched now, not while it is timed
        rows[0] = numbers(state)
        done, self.seconds = self.write(np.append(rows[0, self.mask], knobs), rows[1:])
        self.rows = rows[: done + 1]
        if not np.max(np.abs(self.rows)) < LARGE:
            self.rows = rows[: np.argmin(np.all(np.abs(self.rows) < LARGE, axis=1))]
        return split(self.rows, self.shapes)

    def fits(self, state):
        return list(map(np.shape, state)) == self.shapes and not numbers(state)[~self.mask].any()


def nonzero(state):
    """Which numbers of a state are not always zero; a coordinate that all points lack is."""
    if min(map(np.ndim, state)) < 2 or len({np.shape(x)[1:] for x in state}) > 1:
        return [np.ones(np.shape(x), bool) for x in state]
    along = np.any([np.any(x, axis=0) for x in state], axis=0)
    along = along | ~np.any(along)  # of zeros alone nothing would be left to compute
    return [np.broadcast_to(along, np.shape(x)) for x in state]


def numbers(state):
    """All numbers of a state, in a row."""
    return np.concatenate([np.ravel(x) for x in state]).astype(float)


def in_range(arrays):
    return all(np.all(np.abs(x) < LARGE) for x in arrays)


def nan_like(arrays):
    return tuple(np.full(np.shape(x), np.nan)[()] for x in arrays)


def contents(arguments):
    """What arguments are compared by: the bytes of an array; what else there is, as it is."""
    return tuple([x.tobytes() if isinstance(x, np.ndarray) else x for x in arguments])


def copied(x):
    """A copy of an array, which a step may edit, and whose sums are ordered if it is of floats."""
    return viewed(x.copy()) if isinstance(x, np.ndarray) else x
