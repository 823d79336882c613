"""Rods as vectors, and whether finite tensions can hold them at a start."""

from itertools import chain

from curriculum.common.elimination import has_loop

import numpy as np

STILL = 1e-6  # relative: how exactly velocities must keep the lengths; below, a rod is at rest
LOST = 1.5e-8  # singular values of J by the largest: A squares them, and then they are rounding
TAUT = 1e-4  # relative: how far the terms of a self-stress may be from cancelling


def near(lengths, q):
    """The |g| (C,) in m^2 that counts as zero: 1e-12 L^2, and the rounding of g, which grows with
    how far q (N, 3) is from the origin."""
    far, lengths = np.sum(np.abs(q)) / len(q), np.asarray(lengths)
    return 1e-12 * lengths * lengths + 1e-15 * far * lengths


def nodes(x, fixed):
    """What pairs index: x (..., N, 3), and behind it, in reverse, the anchors' `fixed` (K, 3)."""
    fixed = np.broadcast_to(fixed[::-1], (*x.shape[:-2], *fixed.shape))
    return np.concatenate([x, fixed], axis=-2)


def differences(x, fixed, pairs):
    """x_i - x_j (..., C, D) of rods (i, j), of x (..., N, D); at the anchors x is fixed (K, D)."""
    i, j = np.fromiter(chain.from_iterable(pairs), int).reshape(-1, 2).T
    ends = nodes(x, fixed)
    return ends.take(i, axis=-2) - ends.take(j, axis=-2)


def refusal(system, gravity):
    """Why a start cannot move without breaking a rod, in a sentence; None if nothing proves that.
    gravity (3,) in m/s^2 is all that pulls beside the rods."""
    pairs, lengths = system["pairs"], system["lengths"]
    unit = differences(system["q0"], system["anchors"], pairs) / lengths[:, None]
    rate = differences(system["v0"], np.zeros_like(system["anchors"]), pairs)
    slow = STILL * (1.0 + np.abs(rate).max())
    stretch = np.sum(unit * rate, axis=1)
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > slow:
        found = f"the velocities stretch rods[{k}] at {stretch[k]:.3g} m/s"
        return f"{found}; must be 0, for a rod can only turn"
    k = torn(system, gravity, unit, rate, slow) if has_loop(pairs) else None
    pose = f"the rods around rods[{k}] are taut: in this pose no finite tension can hold them"
    return None if k is None else f"{pose}; give the loop some slack, or leave a rod out"


def torn(system, gravity, unit, rate, slow):
    """A rod that no finite tension can hold, by its index; None if nothing proves there is one.

    `unit` (C, 3): rods as vectors, 1 long. `rate` (C, 3) in m/s: their change; under `slow`, rest.

    Let u be a self-stress: tensions that cancel at every particle, J^T u = 0. Rods that move from
    d to d + e and keep their lengths have d . e + e . e / 2 = 0. Summed up with u the first terms
    cancel, so that sum_k u_k |e_k|^2 = 0 for every motion whatever. With e = rate t + o(t) that
    asks for sum_k u_k |rate_k|^2 = 0: else J a + Jdot v = 0 has no solution. If the rods of u are
    at rest, finite and continuous tensions make e = a_k t^2 / 2 + o(t^2), and sum_k u_k |a_k|^2 = 0
    is left, though the linear system then has a solution: a level cable falls, which no rigid one
    can. One that sags ever so little has no self-stress, but a large tension: it is let through
    until A cannot be told from a singular matrix, at 1e-8 of the span.
    """
    lengths, pairs, fixed = (system[key] for key in ("lengths", "pairs", "anchors"))
    ends = differences(np.eye(len(system["m"])), np.zeros((len(fixed), len(system["m"]))), pairs)
    rows = (ends[..., None] * unit[:, None]).reshape(len(unit), -1)  # J of unit vectors
    bend = np.sum(rate**2, axis=1) / lengths
    still = 3.0 * len(bend) * slow * slow / lengths.min()  # more than rods at rest make of it
    k = strained(rows, bend, 1e-12 * bend.max() + still)
    rest = np.flatnonzero(np.abs(rate).max(axis=1) < slow)
    if k is not None or not len(rest):
        return k
    root = np.sqrt(np.repeat(system["m"], 3))
    scaled, free = rows / root, root * np.tile(gravity, len(system["m"]))  # J M^-1/2, M^-1/2 f
    size = np.linalg.norm(scaled, axis=1)
    wanted = -(bend + scaled @ free) / size  # what the rods add to f makes J a = -Jdot v
    held = np.linalg.lstsq(scaled / size[:, None], wanted, rcond=LOST)[0]
    accel = differences(((free + held) / root).reshape(-1, 3), np.zeros_like(fixed), pairs)
    floor = 1e-12 * (np.abs(gravity).max() + bend.max()) ** 2 + still * still  # of rounding
    bend = np.sum(accel**2, axis=1) / lengths
    k = strained(rows[rest], bend[rest], floor / lengths.min())
    return None if k is None else rest[k]


def strained(rows, bend, floor):
    """The rod where the part of bend (C,) along self-stresses, which are tensions u with rows^T u
    = 0, is largest: the first of those within 1 %. None if all of it is rounding."""
    _, sizes, right = np.linalg.svd(np.linalg.qr(rows.T, mode="r"))
    null = right[np.sum(sizes > LOST * sizes[0]) :]
    stresses = null.T @ null  # the projection onto all self-stresses
    part = np.abs(stresses @ bend)
    part[part <= TAUT * (np.abs(stresses) @ bend) + floor] = 0.0
    return int(np.argmax(part > 0.99 * part.max())) if part.any() else None
