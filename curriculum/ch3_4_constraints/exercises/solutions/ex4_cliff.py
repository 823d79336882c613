import constraints as c

import numpy as np


def answer():
    return {"euler": "sooner", "semi_implicit": "later", "rk4": "sooner"}


def bisect(holds, low, high, width):
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def step_matrix(rule, z):
    x, v = np.eye(2)  # both starts at once
    return np.array(c.INTEGRATORS[rule](x, v, 1.0, lambda x, v: -z * v - z**2 * x, 1.0))
