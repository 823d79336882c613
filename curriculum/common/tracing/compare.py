"""Which steps are compared with their own lines, and how nearly they have to agree."""

import numpy as np

from curriculum.common.tracing.tape import StepChanged

PARTS = 25  # of a run: the first step of each is compared
EARLY = 0, 1, 4, 16, 64, 256, 1024  # and of the first part these
APART = 2_000  # steps between two comparisons, at most
SAME = 1e-9  # of what a step changes: so far sines of two libraries may be apart
ROUNDING = 1e-15  # of a number, in such a step


class Comparisons:
    """Those of a run of about so many steps: one a part, the last, and some as it begins."""

    def __init__(self, steps):
        self.every = min(max(1, steps // PARTS), APART)
        self.others = [x for x in EARLY if x < self.every] + [steps - 1]

    def is_due(self, number):
        """Whether the step of that number is to be compared."""
        return number % self.every == 0 or number in self.others

    def are_due(self, first, many):
        """The same of so many steps in a row, a list: sooner."""
        numbers = np.arange(first, first + many)
        return ((numbers % self.every == 0) | np.isin(numbers, self.others)).tolist()


def same(found, result, state, exact):
    """Whether the arrays that were found after a state are the step's own results.

    Where it is not `exact`, they may differ by what the sines of two libraries are apart.
    """
    for a, b, x in zip(found, result, state, strict=True):
        if np.array_equal(a, b, equal_nan=True):
            continue
        allowed = SAME * np.max(abs(b - x)) + ROUNDING * np.max(abs(b))
        if exact or not np.all(abs(a - b) <= allowed):
            return False
    return True


def changed(what):
    """The StepChanged for what differs from its own lines."""
    return StepChanged(
        f"{what} gives something else than when it was compiled. What it reads beside its "
        "arguments must stay as it is, and an array of its own that it sums must be ordered(x); or "
        "run it plainly (--plain, or `with plain():`)"
    )
