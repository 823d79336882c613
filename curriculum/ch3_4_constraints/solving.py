"""The linear system of the rods, solved; and what it asks that no tensions give."""

import numpy as np

from curriculum.common import elimination
from curriculum.common.tracing import ordered

# Rods in a loop may be one too many, or lose rank as they move. So something is added to their
# matrix: a share of its diagonal, well over rounding, and h^2 Jdot M^-1 Jdot^T, from what J changes
# by in a time h. That is INSTANT, in s, or the time in which a rod turns by TURN, in rad.
SLACK, INSTANT, TURN = 1e-12, 1e-4, 1e-2


def solve(system, a, b, v=None, jac=None, rough=False):
    """lambda (C,) with A lambda = b, A being `a`: np.linalg.solve's, in fewer operations.

    Only rods that share a particle are coupled: along a chain this is a sweep to the tip and one
    back, O(N), as in R. Featherstone's articulated bodies (1983). In a loop A may be singular, so
    a little is added, of SLACK and, if v (N, 3) is given, of how the rods turn. Unless `rough`,
    refinement takes that back (J. Carpentier, R. Budhiraja, N. Mansard, RSS 2021). It leaves what
    no lambda meets, and what only a huge one would, in poses that moving rods leave at once.
    """
    a, b = np.asarray(a), np.asarray(b)
    lam = np.zeros_like(b, np.result_type(b, 1.0))
    for part, has_loop in elimination.components(system["pairs"]):
        block, wanted = a[np.ix_(part, part)], ordered(b[part])
        order = elimination.elimination_order([system["pairs"][k] for k in part])
        if not has_loop:
            lam[part] = elimination.eliminated(block, order)(wanted)
            continue
        added = SLACK * (block * np.eye(len(part)))
        if v is not None:
            added = added + turned(system, v)[np.ix_(part, part)]
        near = elimination.eliminated(block + added, order)
        if rough:
            lam[part] = near(wanted)
            continue
        times = multiplication(system, block, None if jac is None else jac[part])
        diagonal = np.diagonal(block)
        lam[part] = elimination.refined(times, near, diagonal, wanted, "no finite tensions")
    return ordered(lam)


def multiplication(system, a, jac):
    """The function lambda (C,) -> A lambda of A (C, C).

    It is done by J (C, 3N), if that is given: A has the squares of J's small numbers beside large
    ones, where rods are nearly in line.
    """
    if jac is None:
        return lambda lam: ordered(a) @ lam
    m = np.repeat(system["m"], 3)
    regularization = np.diagonal(a) - np.sum((jac / m) * jac, axis=1)  # exactly 0 unless soft

    def times(lam):
        return jac @ (jac.T @ lam / m) + regularization * lam

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


def residual(system, a, b, lam, jac):
    """b - A lambda (C,) in m^2/s^2: what no lambda meets, where rods close a loop."""
    return b - multiplication(system, a, jac)(lam)
