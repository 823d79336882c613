"""The extrapolated midpoint rule: explicit, of any even order, and without a table of numbers."""

from itertools import pairwise

from curriculum.common.programs import Routine, side_by_side

import numpy as np


def make_midpoint(order):
    """The rule of an even `order`; it takes (order / 2)^2 + 1 forces a step. Energy drifts.

    The midpoint rule goes the way in 2, 4, ... `order` parts. Its error is a series in the square
    of a part (W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384); each round of Aitken's and Neville's
    scheme takes away a term of it. What is added up is how far a way has gone from the start: these
    are small numbers, so that rounding is small, too.
    """
    parts = np.arange(2.0, order + 1.0, 2.0)

    def extrapolated(row):
        for k in range(1, len(parts)):
            row = [
                b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0)
                for n, (a, b) in zip(parts, pairwise(row), strict=False)
            ]
        return row[0]

    def midpoint_step(q, v, m, force, dt):
        def rate(x):
            return np.stack([x[1], force(*x) / m])

        def leap(start, before, gone, dt):
            return before + dt * rate(start + gone)

        leaping, start = Routine(leap, often=True), np.stack([q, v])
        starts = np.stack([start] * len(parts))
        before = np.zeros_like(starts)  # how far each way has gone from the start, a part ago
        gone = (dt / parts)[:, None, None, None] * rate(start)
        for k in range(1, order):
            going = slice(k // 2, None)  # ways of more than k parts
            rows = starts[going], before[going], gone[going], 2.0 * dt / parts[going]
            before[going], gone[going] = gone[going], side_by_side(leaping, *rows)
        ends = gone.reshape(len(parts), -1).T
        moved = side_by_side(extrapolated, ends).reshape(start.shape)
        return tuple(start + moved)

    return midpoint_step
