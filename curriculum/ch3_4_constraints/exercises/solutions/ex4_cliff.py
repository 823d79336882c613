"""Exercise 4: find the cliff. A stronger spring mends a rod sooner, until it tears it apart.

    python -m curriculum.ch3_4_constraints.exercises.solutions.ex4_cliff

For each rule, the largest w of Baumgarte's spring: by experiment, and by theory, both with your
bisection.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises import run

import numpy as np

DT, STEPS, OFF = 0.005, 4000, 1e-9  # s; OFF, in m: how much too long the rod is at the start


def bisect(holds, low, high, width):
    """x of the cliff, to within `width`: holds(low) is True, holds(high) is not, and it changes
    once in between."""
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def step_matrix(rule, z):
    """(2, 2): what one step of `rule`, 1 s long, makes of (x, v) where x'' = -2 z v - z^2 x.

    The rule is c.INTEGRATORS[rule], which takes (x, v, m, force, dt), numbers as well as arrays.
    """

    def force(x, v):
        return -2.0 * z * v - z**2 * x

    step = c.INTEGRATORS[rule]
    return np.array([step(1.0, 0.0, 1.0, force, 1.0), step(0.0, 1.0, 1.0, force, 1.0)]).T


def mends(rule, w):
    """Experiment: a bob hangs still on a rod that is OFF too long. Is the error smaller after STEPS
    steps?"""
    system = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.0 - OFF, 0.0]])}
    ran = c.simulate(c.INTEGRATORS[rule], system, c.make_force(system, w), DT, STEPS)
    return not ran.stopped and bool(ran.violations[-1] < OFF)


def decays(rule, z):
    """Theory: no eigenvalue of a step is larger than 1. Then errors do not grow."""
    return bool(np.abs(np.linalg.eigvals(step_matrix(rule, z))).max() <= 1.0)


def main():
    """The cliff of each rule as z = dt w: experiment, theory, and what the engine's table says."""
    lines = []
    for rule, limit in c.STABILITY_LIMIT.items():
        w = bisect(lambda w, rule=rule: mends(rule, w), 1.0, 1000.0, 0.1)
        z = bisect(lambda z, rule=rule: decays(rule, z), 0.01, 5.0, 1e-9)
        lines.append(f"{rule:<14} {w:8.1f} {DT * w:11.4f} {z:10.6f} {limit:17.6f}")
    print("                 w, experiment         z, theory   STABILITY_LIMIT", *lines, sep="\n")


if __name__ == "__main__":
    run(main)
