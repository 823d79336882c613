"""The method that games use: move first, then push the particles back onto their rods."""

import numpy as np

import constraints as c
from curriculum.common.tracing import fori_loop


def xpbd_step(system, q, v, dt, substeps=1):
    """q, v (N, 3) in m and m/s after dt s in so many `substeps`: XPBD, with no system to solve.

    Each sub-step flies free, corrects one rod after the other (a round of Gauss and Seidel), and
    takes the velocity from the move. Rods are rigid: their compliance is zero. M. Macklin, M.
    Mueller, N. Chentanez, XPBD (MIG 2016); in sub-steps: M. Macklin et al., Small Steps (SCA 2019).
    """
    m = system["m"]
    h = dt / substeps

    def substep(q, v):
        start = q
        v = v + h * c.external_force(system, q, v) / m
        q = q + h * v
        for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
            w_i = 1.0 / m[i]  # 1/kg
            if j < 0:
                d = q[i] - c.anchor(system, j)
                w_j = 0.0  # an anchor does not move
            else:
                d = q[i] - q[j]
                w_j = 1.0 / m[j]
            now = np.sqrt(d @ d)
            move = (now - length) / (w_i + w_j) * d / now  # kg m
            q[i] = q[i] - w_i * move
            if j >= 0:
                q[j] = q[j] + w_j * move
        return q, (q - start) / h

    return fori_loop(substeps, substep, q, v)
