"""The linear system of the rods, solved; and how much of what it asks no tension answers."""

from curriculum.common import elimination
from curriculum.common.arrays import ordered

import numpy as np

# Rods in a loop may be one too many, or lose rank in passing. So their matrix is blurred, by a
# share of its diagonal, well over rounding, and by h^2 Jdot M^-1 Jdot^T: what J changes by in a
# time h, in s, far shorter than the chapter's steps; or in which a rod turns by TURN, in rad.
SLACK, INSTANT, TURN = 1e-12, 1e-4, 1e-2


def solve(system, a, b, v=None, jac=None, rough=False):
    """lambda (C,) with A lambda = b, A being `a`: np.linalg.solve's, for fewer operations.

    Only rods that share a particle feel each other: along a chain this is a sweep out and one back,
    O(N), as R. Featherstone's articulated bodies (1983). In a loop a rod may be too many, and `a`
    singular. There a little is added to it, of SLACK and, if the velocities v (N, 3) are given, of
    how the rods turn. Unless `rough`, rounds of refinement remove the effect (J. Carpentier, R.
    Budhiraja, N. Mansard, RSS 2021) and, if J (C, 3N) is given as `jac`, conjugate gradients take
    them further. What no lambda can meet is left, and what only a large one meets, in a pose that
    rods as fast as these pass within an instant: see `unanswered`.
    """
    a, b = np.asarray(a), np.asarray(b)
    lam = np.zeros_like(b, np.result_type(b, 1.0))
    for part, loop in elimination.parts(system["pairs"]):
        inner, wanted = (a, b) if len(part) == len(b) else (a[np.ix_(part, part)], b[part])
        order = elimination.elimination_order([system["pairs"][k] for k in part])
        if not loop:
            lam[part] = elimination.eliminated(inner, order)(wanted)
            continue
        blur = SLACK * (inner * np.eye(len(part)))
        if v is not None:
            blur = blur + turned(system, v)[np.ix_(part, part)]
        blurred = elimination.eliminated(inner + blur, order)
        if rough:
            lam[part] = blurred(wanted)
            continue
        times = applied(system, inner, None if jac is None else jac[part])
        terms = times, ordered(np.diagonal(inner)), ordered(wanted), blurred, SLACK
        problem = elimination.LinearSystem(*terms, "no finite tensions")
        x, left = elimination.refined(problem)
        lam[part] = x if jac is None else elimination.conjugated(problem, x, left)
    return ordered(lam)


def applied(system, a, jac):
    """The function lambda (C,) -> A lambda of A (C, C), by J (C, 3N) unless that is None, since
    where rods are nearly in line, A has the squares of small numbers beside large ones."""
    if jac is None:
        return lambda lam: ordered(a) @ lam
    m = np.repeat(system["m"], 3)
    gives = np.diagonal(a) - np.sum((jac / m) * jac, axis=1)  # 0 but for soft rods, exactly

    def times(lam):
        return jac @ (jac.T @ lam / m) + gives * lam

    return times


def turned(system, v):
    """h^2 Jdot M^-1 Jdot^T (C, C); Jdot has rate where J has d; h for each rod; v (N, 3) in m/s."""
    v = ordered(v)
    jdot = np.zeros_like(v, shape=(len(system["pairs"]), *v.shape))
    for k, (i, j) in enumerate(system["pairs"]):
        rate = v[i] - v[j] if j >= 0 else v[i]
        slow = INSTANT / (TURN * system["lengths"][k])  # s/m: 1 over the rate that turns by TURN
        # h is INSTANT or, where a rod turns fast, TURN L / |rate|: smoothly the smaller one
        rate = rate * (INSTANT / np.sqrt(1.0 + slow * slow * (rate @ rate)))
        jdot[k, i] = rate
        if j >= 0:
            jdot[k, j] = -rate
    jdot = jdot.reshape(len(jdot), -1)
    return (jdot / np.repeat(system["m"], 3)) @ jdot.T


def unanswered(system, jac, a, b, lam, v):
    """The largest acceleration in m/s^2 that A lambda = b asks for and that is not made: a number.

    What is left of b is one, along a rod. And where rods are nearly in line, a little along them is
    much across: so see what a tension that met it would do to the particles. Of rods that are less
    than 1e-8 of their length out of line even this tells too little: they are let go across.
    """
    left = b - applied(system, a, jac)(lam)
    along = np.max(np.abs(left) / system["lengths"])
    missing = jac.T @ solve(system, a, left, v, jac) / np.repeat(system["m"], 3)
    return np.maximum(along, np.max(np.abs(missing)))
