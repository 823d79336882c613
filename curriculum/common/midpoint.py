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
    parts = range(2, order + 1, 2)

    def extrapolated(row):
        for k in range(1, len(parts)):
            row = [
                b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0)
                for n, (a, b) in zip(parts, pairwise(row), strict=False)
            ]
        return row

    def midpoint_step(q, v, m, force, dt):
        def rate(x):
            return np.stack([x[1], force(*x) / m])

        leap = Routine(lambda before, x, h: before + h * rate(x), often=True)
        start = np.stack([q, v])
        first = rate(start)
        ways = [(start, start + (dt / n) * first) for n in parts]
        for k in range(1, order):  # by turns: a processor works at one while another waits
            ways = [
                (x, leap(before, x, 2.0 * dt / n)) if k < n else (before, x)
                for n, (before, x) in zip(parts, ways, strict=True)
            ]
        ends = np.stack([x.ravel() for _, x in ways], axis=1)
        made = side_by_side(lambda row: extrapolated(row)[0], ends)
        return tuple(made.reshape(start.shape))

    return midpoint_step
