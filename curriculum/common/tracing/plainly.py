"""A step by its own lines; and what is known of how steps were taken."""

import math
import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from curriculum.common.tracing.python import source_of
from curriculum.common.tracing.symbols import viewed
from curriculum.common.tracing.tape import NotAState, current
from curriculum.common.tracing.trace import Program, reason, several

LARGE = 1e100  # a number beyond has diverged


@dataclass
class Report:
    """How the steps of a loop were taken. It can be pickled, and needs nothing else.

    `timed` of them took so many `seconds`, all of one kind: of a compiled step those that were
    computed ahead, in `stretches` of (steps, seconds). In `compared` steps it was held against its
    own lines.
    """

    how: str = "not compiled"  # in words
    is_compiled: bool = False
    program: Program | None = field(default=None, compare=False)  # what it became
    steps: int = 0  # that were asked for
    change: tuple | None = None  # (number, name): the first step with an argument of another's
    failure: str | None = None  # why a step is not finite: it is NaN, and so are all after it
    compared: int = 0
    timed: int = 0
    seconds: float = 0.0
    stretches: list = field(default_factory=list)

    def time(self, steps, seconds):
        """Note that so many steps, of one stretch, took so many seconds."""
        self.timed += steps
        self.seconds += seconds
        if steps > 1:
            self.stretches.append((steps, seconds))

    def go_plain(self, why):
        """Note why steps are no longer compiled, in words."""
        self.how = f"not compiled: {why}; to try it, what counts or draws was called once more"
        self.is_compiled = False
        self.program = None
        self.timed = 0
        self.seconds = 0.0
        self.stretches = []

    def fail(self, why):
        """Note why a step is not finite, if it is the first one."""
        self.failure = self.failure or why

    @property
    def source(self):
        """What it became, as Python."""
        return source_of(self.program) if self.program else ""

    @property
    def pace(self):
        """Microseconds a step, on average; NaN if there was none.

        Of long stretches it is the median: if something else ran meanwhile, some took longer.
        """
        longest = max((steps for steps, _ in self.stretches), default=0)
        long = [seconds / steps for steps, seconds in self.stretches if 2 * steps > longest]
        if long:
            return 1e6 * float(np.median(long))
        return 1e6 * self.seconds / self.timed if self.timed else math.nan


class OwnStep:
    """A step by its own lines, which are run when its `result` is first asked for."""

    def __init__(self, step, arguments):
        self.step = step
        self.arguments = arguments
        self.single = False  # whether it returns one array, by itself
        self.failure = None  # why its result is NaN
        self.seconds = 0.0

    @cached_property
    def result(self):
        """The tuple of the arrays that it returns."""
        current.failure = None
        clock = time.thread_time()
        with np.errstate(all="ignore"):
            result = self.step(*map(copied, self.arguments))
        self.seconds = time.thread_time() - clock
        self.single = not isinstance(result, tuple | list)
        self.check_shapes(several(result))
        result = tuple(np.asarray(x, float)[()] for x in several(result))
        if in_range(numbers(result)):
            return result
        self.failure = current.failure or self.why(result)
        return nan_like(result)

    def check_shapes(self, result):
        """Raise NotAState unless its arrays have the shapes of the first arguments, as many."""
        found = list(map(np.shape, result))
        wanted = list(map(np.shape, self.arguments[: len(found)]))
        if found != wanted:
            raise NotAState(f"a step must return arrays of the shapes {wanted}, and not {found}")
        for x in self.arguments[: len(found)]:
            kind = getattr(x, "dtype", type(x).__name__)
            if kind not in ("float64", "float"):
                raise NotAState(f"a state must be of arrays of float64, and not of {kind}")

    def why(self, result):
        """Why its result is not a state, and where numpy first met what is not a number."""
        try:
            with np.errstate(divide="raise", invalid="raise", over="raise", under="ignore"):
                self.step(*map(copied, self.arguments))
        except FloatingPointError as error:
            return "diverged" if "overflow" in str(error) else f"not a number: {reason(error)}"
        return "not a number" if np.isnan(numbers(result)).any() else "diverged"


def result_now(function, state):
    """What a function(*state), which may edit it, gives now: an array."""
    with np.errstate(all="ignore"):
        return np.array(function(*map(copied, state)))


def spread(many, most):
    """The places, at most so many, of `many` in a row: the first, the last, and between them."""
    return sorted({*np.linspace(0, many - 1, min(many, most)).astype(int).tolist()})


def copied(x):
    """A copy of an array, which a step may edit, and whose sums are ordered if it is of floats."""
    return viewed(x.copy()) if isinstance(x, np.ndarray) else x


def numbers(state):
    """All numbers of a state, in a row."""
    return np.concatenate([np.asarray(x, float).ravel() for x in state])


def in_range(row):
    """Whether all numbers of an array are finite, and below LARGE."""
    return np.abs(row).max(initial=0.0) < LARGE  # which NaN is not


def nan_like(arrays):
    """Arrays of the same shapes, of NaN."""
    return tuple(np.full(np.shape(x), np.nan)[()] for x in arrays)
