"""The linear system of rods that close loops, where it may be singular."""

import numpy as np

from curriculum.common import elimination
from curriculum.common.tracing import ordered
from curriculum.common.tracing.arrays import eliminated, nonzero

# Rods in a loop may be one too many, or lose rank as they move. So something is added to their
# matrix: a share of its diagonal, well over rounding, and h^2 Jdot M^-1 Jdot^T, from what J changes
# by in a time h. That is INSTANT, in s, or the time in which a rod turns by TURN, in rad.
SLACK, INSTANT, TURN = 1e-12, 1e-4, 1e-2


def solve_loops(system, A, b, v=None, jac=None):
    """lambda (C,) with A lambda = b, where A (C, C) may be singular.

    A little is added to A, of SLACK and, if v (N, 3) is given, of how the rods turn. Refinement, by
    J (C, 3N) if `jac` is given, takes that back (J. Carpentier, R. Budhiraja, N. Mansard, RSS 2021)
    and leaves what no lambda meets, or only a huge one in a pose that moving rods leave at once.
    """
    A, b, pairs, parts = ordered(A), ordered(b), system["pairs"], []
    rods = len(pairs)
    for rows, _ in elimination.components(pairs):
        parts.append((rows, elimination.elimination_order([pairs[k] for k in rows])))
    if len(A) > rods or nonzero(A)[elimination.uncoupled(pairs)].any():  # a row that is no rod's
        parts = [(list(range(len(A))), None)]
    added = SLACK * (A * np.eye(len(b)))
    if v is not None:
        added[:rods, :rods] = added[:rods, :rods] + turned(system, v)
    lam = np.zeros_like(b, np.result_type(b, 1.0))
    for rows, order in parts:
        block = A[np.ix_(rows, rows)]
        near = eliminated(block + added[np.ix_(rows, rows)], order)
        times = multiplication(system, block, None if jac is None else jac[rows])
        diagonal = np.diagonal(block)
        lam[rows] = elimination.refined(times, near, diagonal, b[rows], "no finite tensions")
    return ordered(lam)


def multiplication(system, A, jac):
    """The function lambda (C,) -> A lambda of A (C, C), done by J (C, 3N) if that is given.

    Where rods are nearly in line A has the squares of J's small numbers beside large ones.
    """
    if jac is None:
        return lambda lam: A @ lam
    m = np.repeat(system["m"], 3)
    rest = A - (jac / m) @ jac.T  # exactly 0, but for what a method adds

    def times(lam):
        return jac @ (jac.T @ lam / m) + rest @ lam

    return times


def turned(system, v):
    """h^2 Jdot M^-1 Jdot^T (C, C) with h of each rod; Jdot has d_dot where J has d; v in m/s."""
    v = ordered(v)
    jdot = np.zeros((len(system["pairs"]), *v.shape), like=v)
    for k, (i, j) in enumerate(system["pairs"]):
        d_dot = v[i] - v[j] if j >= 0 else v[i]
        slow = INSTANT / (TURN * system["lengths"][k])  # s/m: 1 over the speed that turns by TURN
        # times h, which is INSTANT or TURN L / |d_dot|: a smooth minimum of the two
        d_dot = d_dot * (INSTANT / np.sqrt(1.0 + slow * slow * (d_dot @ d_dot)))
        jdot[k, i] = d_dot
        if j >= 0:
            jdot[k, j] = -d_dot
    jdot = jdot.reshape(len(jdot), -1)
    return (jdot / np.repeat(system["m"], 3)) @ jdot.T
