"""Whether finite tensions can hold the rods of a system at its start."""

import numpy as np

from curriculum.ch3_4_constraints.rods.systems import (
    LOST,
    has_loop,
    rod_rates,
    rod_vectors,
    unit_rows,
)

STILL = 1e-6  # relative: how exactly velocities must keep the lengths; below, a rod is at rest
TAUT = 1e-4  # relative: how far the terms of a self-stress may be from cancelling


def refusal(system, gravity):
    """Why a start cannot move without breaking a rod, in a sentence; None if nothing proves that.

    gravity (3,) in m/s^2 and the system's load are all that pulls beside the rods.
    """
    unit = rod_vectors(system, system["q0"]) / system["lengths"][:, None]
    rate = rod_rates(system, system["v0"])
    slow = STILL * (1.0 + np.abs(rate).max())
    stretch = np.sum(unit * rate, axis=1)
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > slow:
        found = f"the velocities stretch rods[{k}] at {stretch[k]:.3g} m/s"
        return f"{found}; must be 0: take that off along the rod, which can only turn"
    if not has_loop(system):
        return None
    pull = system["m"] * gravity + system.get("load", 0.0)
    stress = impossible_stress(system, pull, rate, slow)
    if stress is None:
        return None
    k = int(np.argmax(np.abs(stress)))
    pose = f"the rods around rods[{k}] are taut: in this pose no finite tension can hold them"
    remedies = "give the loop some slack, leave a rod out, or brace a straight bar from the side"
    return f"{pose}; {remedies}"


def impossible_stress(system, pull, rate, slow):
    """A self-stress (C,) that shows that no finite tensions hold the rods; None if there is none.

    `pull` (N, 3) in N: what acts beside the rods. `rate` (C, 3) in m/s: their change; under `slow`,
    they are at rest.

    A self-stress u is of tensions that cancel at every particle: J^T u = 0. Rods that move from
    d to d + e and keep their lengths have d . e + e . e / 2 = 0. Summed up with u the first terms
    cancel, so that sum_k u_k |e_k|^2 = 0 for every motion whatever. With e = rate t + o(t) that
    asks for sum_k u_k |rate_k|^2 = 0: else J a + Jdot v = 0 has no solution. If the rods of u are
    at rest, finite and continuous tensions make e = a_k t^2 / 2 + o(t^2), and sum_k u_k |a_k|^2 = 0
    is left, though the linear system then has a solution: a level cable falls, which no rigid one
    can. One that sags by over LOST of its span has no self-stress, but a large tension. (A has the
    squares of singular values, and SLACK would hide them.)
    """
    lengths = system["lengths"]
    m = system["m"]
    rows = unit_rows(system, system["q0"])
    bend = np.sum(rate**2, axis=1) / lengths
    still = 3.0 * len(bend) * slow * slow / lengths.min()  # more than rods at rest make of it
    stress = stress_along(rows, bend, 1e-12 * bend.max() + still)
    rest = np.abs(rate).max(axis=1) < slow
    if stress is not None or not rest.any():
        return stress
    root = np.sqrt(np.repeat(m, 3))
    scaled = rows / root  # J M^-1/2
    free = np.ravel(pull) / root  # M^-1/2 f
    size = np.linalg.norm(scaled, axis=1)
    wanted = -(bend + scaled @ free) / size  # what the rods add to f makes J a = -Jdot v
    held = np.linalg.lstsq(scaled / size[:, None], wanted, rcond=LOST)[0]
    accel = rod_rates(system, ((free + held) / root).reshape(-1, 3))
    floor = 1e-12 * (np.abs(pull / m).max() + bend.max()) ** 2 + still * still  # of rounding
    bend = np.sum(accel**2, axis=1) / lengths
    return stress_along(rows * rest[:, None], bend * rest, floor / lengths.min())


def stress_along(rows, bend, floor):
    """The self-stress (C,) of the rod where most of bend (C,) lies along self-stresses.

    None if all of it is rounding. Of rods within 1 % the first is taken.
    """
    _, sizes, right = np.linalg.svd(np.linalg.qr(rows.T, mode="r"))
    null = right[np.sum(sizes > LOST * sizes[0]) :]
    stresses = null.T @ null  # the projection onto all self-stresses, J^T u = 0
    part = np.abs(stresses @ bend)
    part[part <= TAUT * (np.abs(stresses) @ bend) + floor] = 0.0
    return stresses[np.argmax(part > 0.99 * part.max())] if part.any() else None
