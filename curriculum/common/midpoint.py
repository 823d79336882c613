"""The extrapolated midpoint rule: explicit, of any even order, and without a table of numbers."""

from itertools import pairwise

from curriculum.common.trace import Routine, side_by_side

import numpy as np


def make_midpoint(order):
    """The rule of an even `order`; it takes (order / 2)^2 + 1 forces a step. Energy wanders.

    The midpoint rule goes the way in 2, 4, ... `order` parts. Its error is a series in the square
    of a part (W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384); each round of Aitken's and Neville's
    scheme takes away a term of it.
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

        leap = Routine(lambda before, x, dt: before + dt * rate(x), often=True)
        start = np.stack([q, v])
        before = np.stack([start] * len(parts))
        x = start + (dt / parts)[:, None, None, None] * rate(start)
        for k in range(1, order):
            going = slice(k // 2, None)  # ways of more than k parts
            after = side_by_side(leap, before[going], x[going], 2.0 * dt / parts[going])
            before[going], x[going] = x[going], after
        ends = x.reshape(len(parts), -1).T
        return tuple(side_by_side(extrapolated, ends).reshape(start.shape))

    return midpoint_step
