import numpy as np

import constraints as c


def substep(system, q, v, h):
    start, m = q, system["m"]
    v = v + h * c.external_force(system, q, v) / m
    q = q + h * v
    for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
        d, w_i, w_j = q[i], 1.0 / m[i], 0.0
        if j >= 0:
            d, w_j = q[i] - q[j], 1.0 / m[j]
        move = (1.0 - length / np.linalg.norm(d)) / (w_i + w_j) * d
        q[i] -= w_i * move
        if j >= 0:
            q[j] += w_j * move
    return q, (q - start) / h
