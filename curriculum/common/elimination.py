"""Linear systems in which few unknowns feel each other: elimination in a given order, refined."""

from curriculum.common.trace import repeat

import numpy as np


def eliminated(a, order):
    """solve(b) (..., n), which gives what np.linalg.solve(a, b) gives for a (..., n, n).

    Gauss's elimination without pivots, for matrices like J M^-1 J^T. `order`: [(k, the others still
    left that k feels)], of graph.elimination_order; what is zero for certain is never visited.
    """
    a = np.moveaxis(a, (-2, -1), (0, 1)).astype(np.result_type(a, 1.0))  # a copy, of floats
    for k, rest in order:
        for i in rest:
            a[i, k] = a[i, k] / a[k, k]  # less so much of row k, row i is free of x[k]
            for j in rest:
                a[i, j] = a[i, j] - a[i, k] * a[k, j]

    def solve(b):
        x = np.moveaxis(b, -1, 0).astype(a.dtype)
        for k, rest in order:
            for i in rest:
                x[i] = x[i] - a[i, k] * x[k]
        for k, rest in reversed(order):
            for j in rest:
                x[k] = x[k] - a[k, j] * x[j]
            x[k] = x[k] / a[k, k]
        return np.moveaxis(x, 0, -1)

    return solve


def refined(rough, a, b, complaint):
    """x (..., n) with a x = b, by rough(b) (..., n), which solves for a matrix near a (..., n, n).

    Rounds solve for what is left of b, weighed by a's diagonal, until that is 1e-15 of b or a round
    does not halve it: the residual ends them, not a count. Raises Stop(complaint) if nothing does.
    """
    own = np.diagonal(a, axis1=-2, axis2=-1)

    def weigh(x):
        return np.sum(x * (x / own), axis=-1, keepdims=True)

    enough = 1e-30 * weigh(b)[..., 0]  # 1e-15 of b, squared

    def another(state):  # x, and behind it what was left before the last round
        x, before = state[..., :-1], state[..., -1]
        residual = b - np.sum(a * x[..., None, :], axis=-1)
        left = weigh(residual)
        now = left[..., 0]  # the size is at most 1 if that is enough, or more than before / 4
        size = now * before / (4.0 * now * now + enough * before + 1e-300)
        return np.concatenate([x + rough(residual), left], axis=-1), size

    start = np.concatenate([rough(b), weigh(b)], axis=-1)
    return repeat(another, start, 100, complaint)[..., :-1]
