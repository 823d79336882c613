"""Which steps are compared with their own lines, and how nearly they have to agree."""

import numpy as np

from curriculum.common.tracing.tape import StepChanged

PARTS = 30  # of a run: the first step of each is compared
APART = 2_000  # steps between two comparisons, at most
SAME = 1e-9  # of what a step changes: so far sines of two libraries may be apart
ROUNDING = 1e-15  # of a number, in such a step


class Comparisons:
    """Those of a run of about so many steps: one a part, the last, and some as it begins."""

    def __init__(self, steps):
        self.last = steps - 1
        self.every = min(max(1, steps // PARTS), APART)

    def is_due(self, number):
        if number < self.every:  # as it begins, 0, 1, 2, 4, 8 and so on
            return number & (number - 1) == 0
        return number % self.every == 0 or number == self.last

    def end(self, number):
        """How far a stretch may go that begins with a step: to a comparison, or to the last one."""
        power_of_two = 1 << number.bit_length()
        part = self.every * (number // self.every + 1)
        if number < self.every:
            return min(power_of_two, part)
        return min(x for x in (part, self.last, self.last + 1) if x > number)


def check(number, ahead, result, state, exact):
    """Raise StepChanged unless the arrays that were computed ahead are the step's own results."""
    for a, b, x in zip(ahead, result, state, strict=True):
        allowed = 0.0
        if not exact and np.size(b):
            allowed = SAME * np.max(abs(b - x)) + ROUNDING * np.max(abs(b))
        if not np.all(abs(a - b) <= allowed):
            raise StepChanged(
                f"step {number} gives something else than when it was compiled. What it reads "
                "beside its arguments must stay as it is, and an array of its own that it sums "
                "must be ordered(x); or run it plainly (--plain, or `with plain():`)"
            )
