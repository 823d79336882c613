"""Until constraints.py offers it: the extrapolated midpoint rule of any even order."""

from itertools import pairwise

import numpy as np


def make_midpoint(order):
    """W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384: 2, 4, ... `order` parts, Neville's scheme."""
    parts = range(2, order + 1, 2)

    def step(q, v, m, force, dt):
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
            terms = zip(parts, pairwise(row), strict=False)
            row = [b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0) for n, (a, b) in terms]
        return tuple(row[0])

    return step
