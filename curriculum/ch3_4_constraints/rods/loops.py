"""The linear system of rods that close loops, where it may be singular."""

import numpy as np

from curriculum.ch3_4_constraints.rods.elimination import components, elimination_order, uncoupled
from curriculum.common.tracing import ordered, while_loop
from curriculum.common.tracing.arrays import eliminated, nonzero

# Rods in a loop may be one too many, or lose rank as they move. So something is added to their
# matrix: a share of its diagonal, well over rounding, and h^2 Jdot M^-1 Jdot^T, from what J changes
# by in a time h. That is LOOKAHEAD, in s, or the time in which a rod turns by TURN, in rad.
SLACK = 1e-12
LOOKAHEAD = 1e-4
TURN = 1e-2
ROUNDS = 100  # of refinement, at most, in which both are taken back
RIDGE = 1e-9  # of the diagonal, in least squares: what is much smaller counts as lost
RIDGE_ROUNDS = 40  # of refinement, at most, in which it is taken back
LAST = 1e-14  # of y, and of the parts M_k x_k: what rounding leaves
UNSURE = 3e-3  # of x: where it lacks more, it is not known
LOST = 1e-11  # of M: a direction as small is one that it has lost for good,
NOISE = 1e-9  # of y: and what is left in it is rounding, if it is no more


def solve_loops(system, A, b, v=None):
    """lambda (C,) with A lambda = b, where A (C, C) may be singular.

    A loop may have a rod too many. Then if one lambda fits, many do, all with one force J^T lambda.
    A little is added to A, of SLACK and, if v (N, 3) is given, of how the rods turn. Refinement
    takes that back (J. Carpentier, R. Budhiraja, N. Mansard, RSS 2021) and leaves what no lambda
    meets, or only a huge one in a pose that moving rods leave at once.
    """
    A = ordered(A)
    b = ordered(b)
    pairs = system["pairs"]
    rods = len(pairs)
    parts = []
    for rows, _ in components(pairs):
        parts.append((rows, elimination_order([pairs[k] for k in rows])))
    if len(A) > rods or nonzero(A)[uncoupled(pairs)].any():  # a row that is no rod's
        parts = [(list(range(len(A))), None)]
    added = SLACK * (A * np.eye(len(b)))
    if v is not None:
        added[:rods, :rods] = added[:rods, :rods] + turned(system, v)
    lam = np.zeros_like(b, np.result_type(b, 1.0))
    for rows, order in parts:
        block = A[np.ix_(rows, rows)]
        near = eliminated(block + added[np.ix_(rows, rows)], order)
        lam[rows] = refined(block, near, b[rows])
    return ordered(lam)


def refined(A, near, b):
    """x (n,) with A x = b, by iterative refinement.

    near(b) solves for a matrix near A (n, n). A round solves for what is left of b. They end at
    1e-15 of b, or with one that gains less than half.
    """

    def size(left):
        return np.sum(left * (left / np.diagonal(A)))

    def is_going(x, left, before):
        now = size(left)
        return np.where(now > enough, before > 4.0 * now, 0.0)  # sizes are squares

    def another(x, left, before):
        more = near(left)
        return x + more, left - A @ more, size(left)

    enough = 1e-30 * size(b)
    x = near(b)
    first = x, b - A @ x, np.inf
    x, _, _ = while_loop(is_going, another, *first, most=ROUNDS, failure="no finite tensions")
    return x


def least_squares(M, everything, others):
    """x (n,) with M x = y, M (k, n), in least squares; the smallest where M has lost rank.

    y is what `everything` (k,) has more than `others` (k,), whose rounding counts as nothing.

    That is the one whose parts M_k x_k, squared and summed, are least: of a rod's lambda the force
    on each particle counts. M^T M has a share RIDGE of its diagonal added, and rounds of refinement
    take back what that kept away (J. Riley, Math. Tables Aids Comput. 9 (1955) 96). Where
    RIDGE_ROUNDS do not, y lies along directions that M has nearly lost. If much of x does, it is
    not known: NaN.
    """
    y = everything - others
    A = M.T @ M
    b = M.T @ y
    size = np.diag(A)
    near = eliminated(A + RIDGE * np.diag(size))

    def left_of(x):
        left = y - M @ x
        more = near(M.T @ left)
        return np.sum(left * left), more

    def is_off(x, count):
        left, _ = left_of(x)
        enough = LAST * LAST * (np.sum(y * y) + np.sum(others * others) + np.sum(size * x * x))
        return np.where(count < RIDGE_ROUNDS, np.where(left > enough, 1.0, 0.0), 0.0) > 0.0

    def another(x, count):
        _, more = left_of(x)
        return x + more, count + 1.0

    first = near(b)
    x = first + near(b - A @ first)
    x, count = while_loop(is_off, another, x, 0.0, most=RIDGE_ROUNDS, failure="")
    # In a direction of M of size s a round takes back s / RIDGE of what is left of y: so s is
    # RIDGE times that ratio, and x still lacks what is left over s. Of a direction that M has lost
    # for good, rounding is left.
    left, more = left_of(x)
    taken = RIDGE * RIDGE * np.sum(size * more * more)  # (s times what is left)^2
    lacks = left * left > UNSURE * UNSURE * taken * np.sum(size * x * x)
    much = np.where(left > NOISE * NOISE * np.sum(y * y), 1.0, 0.0)
    counts = np.where(taken > LOST * LOST * left, 1.0, much)
    is_unsure = np.where(count < RIDGE_ROUNDS, 0.0, np.where(lacks, counts, 0.0)) > 0.0
    with np.errstate(invalid="ignore"):  # of NaN as it is traced
        return np.where(is_unsure, np.nan, x)


def turned(system, v):
    """h^2 Jdot M^-1 Jdot^T (C, C) with h of each rod; Jdot has d_dot where J has d; v in m/s."""
    v = ordered(v)
    jdot = np.zeros((len(system["pairs"]), *v.shape), like=v)
    for k, (i, j) in enumerate(system["pairs"]):
        d_dot = v[i] - v[j] if j >= 0 else v[i]
        slow = LOOKAHEAD / (TURN * system["lengths"][k])  # s/m: 1 over the speed that turns by TURN
        # times h, which is LOOKAHEAD or TURN L / |d_dot|: a smooth minimum of the two
        d_dot = d_dot * (LOOKAHEAD / np.sqrt(1.0 + slow * slow * (d_dot @ d_dot)))
        jdot[k, i] = d_dot
        if j >= 0:
            jdot[k, j] = -d_dot
    jdot = jdot.reshape(len(jdot), -1)
    return (jdot / np.repeat(system["m"], 3)) @ jdot.T
