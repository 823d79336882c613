"""Whether finite tensions can hold a scene: at its start, and where a run could not go on."""

from curriculum.common.graph import has_loop

import numpy as np

FIT = 1e-6  # relative: how exactly velocities must keep the lengths; below, a rod is at rest
LOST = 1.5e-8  # singular values of J by the largest: A squares them, and then they are rounding
TAUT = 1e-4  # relative: how far the terms of a self-stress may be from cancelling
MOST = 1000  # rods: beyond, a start with loops is not looked at
FEW = 64  # rods: beyond, the place where a run stopped is not looked at

INSTANT = 5e-4  # s: what is over in such a time no step of the chapter can follow


def blur(lengths, g, jdotv):
    """The share (...) of A's diagonal that an eigenvalue needs to mean anything, in a loop.

    Its root is an angle, from the pose where rods lose rank. It has to be larger than those by
    which rods turn in an INSTANT, and than the shares by which their lengths are wrong.
    """
    square = np.square(lengths)
    return np.sum(np.square(g / square) + INSTANT**2 * (jdotv / square), axis=-1)


def near(lengths, q):
    """The g (..., C) at which rods are right: 1e-12 of L^2, and as g is rounded far away."""
    far = np.mean(np.sum(np.abs(q), axis=-1), axis=-1, keepdims=True)
    return 1e-12 * np.square(lengths) + 1e-15 * far * lengths


def refusal(system, gravity):
    """Why a start cannot move without breaking a rod, in a sentence; None if nothing proves that.

    Two things are proof, gravity (3,) in m/s^2 being all that pulls beside the rods. First, J v
    must be zero. Second, let u be a self-stress: tensions that cancel at every particle, J^T u = 0.
    Where rods move from d to d + e and keep their lengths, d . e + e . e / 2 = 0 for each. Add that
    up with u: the first terms are (J^T u) . (what the particles move) = 0, so that

        sum_k u_k |e_k|^2 = 0

    holds for every motion whatever. With e = rate t + o(t) that asks for sum_k u_k |rate_k|^2 = 0,
    which says that Jdot v lies in the range of J: else J a + Jdot v = 0 has no solution. If the
    rods of u are at rest, finite and continuous tensions make e = a_k t^2 / 2 + o(t^2), a_k the
    rod's acceleration, and sum_k u_k |a_k|^2 = 0 is left. J M^-1 f lies in A's range whatever f is,
    so the linear system has a solution even then, lambda = 0 for a level cable: what it says is
    that the cable falls, and no rigid one can. Both conditions are linear in u: they say that a
    vector has no part along the self-stresses.

    A cable that sags ever so little has no self-stress, and a tension that is large, but finite. It
    is let through until A, whose eigenvalues are squares of J's singular values, cannot be told
    from a singular matrix: at 1e-8 of the span, with tensions of some 1e8 times the weight.
    """
    pairs, lengths = system["pairs"], system["lengths"]
    i, j = np.transpose(pairs)

    def along(x, fixed):
        return x[i] - np.concatenate([x, fixed[::-1]])[j]  # a negative j counts from the end

    still = np.zeros_like(system["anchors"])
    rate, unit = along(system["v0"], still), along(system["q0"], system["anchors"])
    unit = unit / lengths[:, None]
    stretch, fast = np.sum(unit * rate, axis=1), np.abs(rate).max()
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > FIT * (1.0 + fast):
        found = f"rods[{k}] is stretched at {stretch[k]:.3g} m/s"
        return f"{found}; must be 0: velocities keep every length"
    if len(i) > MOST or not has_loop(tuple(pairs)):
        return None
    tied = np.unique(np.append(i, j[j >= 0]))  # others fall freely
    place = np.full(len(system["m"]) + 1, len(tied))  # the last is of what stands still
    place[tied] = np.arange(len(tied))
    rows, rods = np.zeros((len(i), len(tied) + 1, 3)), np.arange(len(i))
    rows[rods, place[i]] = unit
    rows[rods, place[np.maximum(j, -1)]] -= unit
    rows = rows[:, :-1].reshape(len(i), -1)  # J, each row divided by its length
    stresses = self_stresses(rows)
    if stresses is None:
        return None
    curl = np.sum(rate**2, axis=1) / lengths
    floor = 1e-12 * (np.abs(gravity).max() + curl.max()) ** 2 / lengths.min()  # of rounding errors
    k = worked_on(stresses, curl, 1e-12 * curl.max())
    rest = np.abs(rate).max(axis=1) < FIT * (1.0 + fast)
    if k is None and rest.any():
        stresses = stresses if rest.all() else self_stresses(rows[rest])
        root = np.sqrt(np.repeat(system["m"][tied, 0], 3))
        scaled = rows / root
        size = np.linalg.norm(scaled, axis=1)
        free = root * np.tile(gravity, len(tied))  # M^-1/2 f, of which J M^-1/2 a = -Jdot v takes
        away = np.linalg.lstsq(scaled / size[:, None], -(curl + scaled @ free) / size, rcond=LOST)[
            0
        ]
        accel = np.zeros_like(system["q0"])
        accel[tied] = ((free + away) / root).reshape(-1, 3)
        if stresses is not None:
            curl = np.sum(along(accel, still) ** 2, axis=1) / lengths
            k = worked_on(stresses, curl[rest], floor)
            k = k if k is None else int(np.flatnonzero(rest)[k])
    if k is None:
        return None
    return (
        f"the rods around rods[{k}] are taut: in this pose no finite tension can hold them; "
        "give the loop some slack, or leave a rod out"
    )


def self_stresses(rows):
    """The projection (C, C) onto tensions u with rows^T u = 0; None if there are none but zero.

    Eigenvalues are squares, and exact to 1e-16 of the largest: those that are small pick few
    vectors, and singular values of these, exact to 1e-16 themselves, decide.
    """
    values, vectors = np.linalg.eigh(rows @ rows.T)
    weak = vectors[:, values < 1e-8 * values[-1]]
    left, sizes, _ = np.linalg.svd(weak.T @ rows, full_matrices=False)
    held = left[:, sizes > LOST * np.sqrt(values[-1])]
    if held.shape[1] == weak.shape[1]:
        return None
    return weak @ (np.eye(weak.shape[1]) - held @ held.T) @ weak.T


def worked_on(stresses, curl, floor):
    """The first rod where the part of curl (C,) along self-stresses is not rounding, or None."""
    part = np.abs(stresses @ curl)
    part[part <= TAUT * (np.abs(stresses) @ curl) + floor] = 0.0
    return int(np.argmax(part > 0.99 * part.max())) if part.any() else None


def in_line(constraint_terms, system, run):
    """A hint for a run that could not go on: whether J (C, 3N) of constraint_terms loses rank where
    it stopped."""
    if run.kind not in ("loop", "domain") or len(system["pairs"]) > FEW:
        return ""
    ends = (system["q0"], system["v0"]), (run.q[-1], run.v[-1])
    rows = (constraint_terms(system, *end)[0] for end in ends)
    units = (jac / np.linalg.norm(jac, axis=1, keepdims=True) for jac in rows)
    (_, before, _), (left, sizes, _) = (np.linalg.svd(unit, full_matrices=False) for unit in units)
    last = int(np.sum(before > 1e-6)) - 1  # the weakest combination that held at the start
    if sizes[last] >= 0.2 * before[last]:
        return ""
    around = f"the rods around rods[{np.argmax(np.abs(left[:, last]))}] are nearly in line there"
    return f"; {around}: no finite tension turns them; another --dt may step over that pose"
