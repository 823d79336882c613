import numpy as np


def guess():
    return {"euler": "earlier", "semi_implicit": "later", "rk4": "earlier"}


def step_matrix(step_fn, z):
    g, gdot = np.eye(2)  # both starts at once
    return np.array(step_fn(g, gdot, 1.0, lambda g, gdot: -z * gdot - z**2 * g, 1.0))
