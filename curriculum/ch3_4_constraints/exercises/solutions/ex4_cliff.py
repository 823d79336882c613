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
    def step(x, v):
        return c.INTEGRATORS[rule](x, v, 1.0, lambda x, v: -z * v - z**2 * x, 1.0)

    return np.array([step(1.0, 0.0), step(0.0, 1.0)]).T


def why():
    return "A step goes so far with the force of its start that it ends beyond zero, farther off."
