"""Poses in which J loses rank while a system moves: there more than one motion may go on.

A four-bar whose cranks are equal is a parallelogram. Where it lies flat it may go on as one, or
with its cranks against each other. Which of these it does hangs on its numbers: if they are those
of a parallelogram to the last digit it goes straight on, and otherwise nobody can tell.
"""

from fractions import Fraction

import numpy as np

from curriculum.ch3_4_constraints.rods.systems import has_loop, rod_vectors, unit_rows

ZERO = 1e-10  # of the largest singular value: what is less is rounding, of rods too many
NEAR = 0.02  # of the squares beside it: a least singular value as small may pass through 0
LEVELS = 3  # times that a pose is looked for, each time in shorter steps
PARTS = 16  # of a step, in which a pose is looked for the next time
FLAT = 1e-2  # rad: rods within it are in line


def is_undecided(system, true_steps, seconds, count):
    """Whether the motion goes through a pose in which J loses rank, and numbers do not say how.

    `true_steps`: TrueSteps of the system, of which so many seconds take `count`.
    """
    if not has_loop(system):
        return False
    poses = singular_poses(system, true_steps, seconds, count)
    return not all(closes_exactly(system, q) for q in poses)


def singular_poses(system, true_steps, seconds, count):
    """Poses (N, 3) in m, a list, close to which J loses rank between two steps.

    `true_steps`: TrueSteps of the system, of which so many seconds take `count`.
    """
    states = [true_steps.start]  # from which so many steps of dt s pass one
    dt = seconds / count
    for _ in range(LEVELS):
        closer = []
        for state in states:
            q, v = true_steps.run(state, count, dt)
            found = np.flatnonzero(passes_zero(least_sizes(system, q)))
            closer += [[q[k], v[k]] for k in found]
        states = closer
        dt = dt / PARTS
        count = 2 * PARTS
    return [q for q, _ in states]


def passes_zero(least):
    """Where a least singular value (T,) may be 0 between an entry and the next but one, a mask.

    Beside a zero it is linear in time, and its square a parabola.
    """
    before, here, after = (least[k : len(least) - 2 + k] ** 2 for k in range(3))
    bend = before - 2.0 * here + after
    lowest = here - (after - before) ** 2 / np.maximum(8.0 * bend, 1e-300)
    is_least = (here <= before) & (here <= after) & (bend > 0.0)
    return is_least & (lowest < NEAR * (before + after))


def least_sizes(system, q):
    """The least singular value (T,), of those that are not always 0, of J's unit rows.

    q (T, N, 3), in m: places at T times.
    """
    sizes = np.linalg.svd(unit_rows(system, q), compute_uv=False)
    rank = int(np.median(np.sum(sizes > ZERO * sizes[:, :1], axis=1)))
    return sizes[:, rank - 1]


def closes_exactly(system, q):
    """Whether rods along an axis in a pose q (N, 3), in m, close their loops to the last digit."""
    d = rod_vectors(system, q)
    along = d / np.linalg.norm(d, axis=1, keepdims=True)
    axis = int(np.argmax(np.abs(along[0])))
    signs = np.sign(along[:, axis])
    if np.max(np.abs(along - signs[:, None] * np.eye(3)[axis])) > FLAT:
        return False
    if np.any(np.delete(system["anchors"] - system["anchors"][0], axis, axis=1)):
        return False  # anchors that are not in line to the last digit
    reaches = [int(sign) * Fraction(x) for sign, x in zip(signs, system["lengths"], strict=True)]
    rods = list(zip(system["pairs"], reaches, strict=True))
    places = {-1 - k: Fraction(x[axis]) for k, x in enumerate(system["anchors"])}
    for _ in system["m"]:  # each time at least one more place, of those tied to what stands still
        for (i, j), reach in rods:
            if j in places:
                places.setdefault(i, places[j] + reach)
            elif i in places:
                places[j] = places[i] - reach
    tied = [(i, j, reach) for (i, j), reach in rods if i in places]
    return all(places[i] - places[j] == reach for i, j, reach in tied)
