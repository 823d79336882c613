"""The extrapolated midpoint rule: explicit, of any even order, and without a table of numbers."""

from itertools import pairwise

from curriculum.common.programs import Routine, side_by_side

import numpy as np

ORDERS = range(2, 17, 2)


def make_midpoint(order):
    """The rule of an even `order`; it takes (order / 2)^2 + 1 forces a step. Energy drifts.

    The midpoint rule does a step in 2, 4, ... `order` substeps. Its error is a series in the square
    of a substep (W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384); each round of Aitken's and Neville's
    scheme takes away a term of it. What is added up are changes since the start of the step: these
    are small numbers, so that rounding is small, too. Raises ValueError for an order not in ORDERS.
    """
    if order not in ORDERS:
        raise ValueError(f"the order of a midpoint rule is {order!r}; must be even, 2 to 16")
    substeps = np.arange(2.0, order + 1.0, 2.0)

    def extrapolated(row):
        for k in range(1, len(substeps)):
            row = [
                b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0)
                for n, (a, b) in zip(substeps, pairwise(row), strict=False)
            ]
        return row[0]

    def midpoint_step(q, v, m, force, dt):
        def rate(x):
            return np.stack([x[1], force(*x) / m])

        def leap(start, before, change, dt):
            return before + dt * rate(start + change)

        leaping, start = Routine(leap, often=True), np.stack([q, v])
        starts = np.stack([start] * len(substeps))  # a row for each number of substeps
        before = np.zeros_like(starts)  # the change a substep ago
        change = (dt / substeps)[:, None, None, None] * rate(start)
        for k in range(1, order):
            left = slice(k // 2, None)  # rows of more than k substeps
            rows = starts[left], before[left], change[left], 2.0 * dt / substeps[left]
            before[left], change[left] = change[left], side_by_side(leaping, *rows)
        ends = change.reshape(len(substeps), -1).T
        changed = side_by_side(extrapolated, ends).reshape(start.shape)
        return tuple(start + changed)

    return midpoint_step
