"""The extrapolated midpoint rule: explicit, of any even order, and without a table of numbers."""

from itertools import pairwise

import numpy as np


def make_midpoint(order):
    """The rule of an even `order`; it takes (order / 2)^2 + 1 forces a step. Energy wanders.

    The midpoint rule goes the way in 2, 4, ... `order` parts. Its error is a series in the square
    of a part (W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384); each round of Aitken's and Neville's
    scheme takes away a term of it.
    """
    parts = range(2, order + 1, 2)

    def midpoint_step(q, v, m, force, dt):
        def rate(x):
            return np.stack([x[1], force(*x) / m])

        start, row = np.stack([q, v]), []
        first = rate(start)
        for n in parts:
            before, x = start, start + (dt / n) * first
            for _ in range(n - 1):
                before, x = x, before + (2.0 * dt / n) * rate(x)
            row.append(x)
        for k in range(1, len(parts)):
            row = [
                b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0)
                for n, (a, b) in zip(parts, pairwise(row), strict=False)
            ]
        return tuple(row[0])

    return midpoint_step
