"""Exercise 4, answered: python -m curriculum.ch3_4_constraints.exercises.solutions.ex4_cliff"""

import constraints as c
from curriculum.ch3_4_constraints.exercises.solutions import run_solution

import numpy as np


def predict():
    return {"euler": "sooner", "semi_implicit": "later", "rk4": "sooner"}


def bisect(holds, low, high, width):
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def step_matrix(rule, z):
    def force(x, v):
        return -z * v - z**2 * x

    step = c.INTEGRATORS[rule]
    return np.array([step(1.0, 0.0, 1.0, force, 1.0), step(0.0, 1.0, 1.0, force, 1.0)]).T


def why():
    return "A step goes so far with the force of its start that it ends beyond zero, farther off."


if __name__ == "__main__":
    run_solution("ex4_cliff", globals())
