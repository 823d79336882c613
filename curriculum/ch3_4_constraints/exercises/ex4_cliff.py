"""Exercise 4: find the cliff. Stiffer springs hold rods better, then tear them. (30 minutes)

The chapter knows where Baumgarte's spring falls off it: gddot = -2 w gdot - w^2 g. This one has
half the damping, gddot = -w gdot - w^2 g, and no table knows its cliffs.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks

DT, STEPS, OFF = 0.005, 4000, 1e-9  # s; OFF, in m: how much too long the rod is at the start


def guess():
    """With half the damping, does each integrator fall off the cliff 'sooner' or 'later'?"""
    return checks.blank("guess: {'euler': ?, 'semi_implicit': ?, 'rk4': ?}, 'sooner' or 'later'")


def bisect(holds, low, high, width):
    """x of the cliff to within `width`: holds(low) is True, holds(high) is not."""
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def step_matrix(integrator, z):
    """(2, 2): a step of 1 s takes (g, gdot) to step_matrix @ (g, gdot).

    The spring is gddot = -z gdot - z^2 g. c.INTEGRATORS[integrator] takes (q, v, m, force, dt), and
    numbers as well as arrays: give it g for q, gdot for v, and 1 for m.
    """
    return checks.blank("its columns: what a step makes of (1, 0) and of (0, 1)")


def survives(integrator, w):
    """Experiment: a bob hangs on a rod that is OFF too long. Is that less after STEPS steps?"""
    system = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.0 - OFF, 0.0]])}
    # Baumgarte's spring takes 2 w gdot from b: half of that is given back
    force = c.make_force(system, w, lambda A, b, g, gdot, jdotv: (A, b + w * gdot))
    run = c.simulate(c.INTEGRATORS[integrator], system, force, DT, STEPS)
    return not run.stopped and run.violations[-1] < OFF


def decays(integrator, z):
    """Theory: no eigenvalue of a step is larger than 1, but for rounding. Then no error grows."""
    return np.abs(np.linalg.eigvals(step_matrix(integrator, z))).max() <= 1.0 + 1e-12


def main():
    """Both cliffs of each integrator, z = dt w, and the chapter's: {integrator: z of theory}."""
    found = {}
    print("                  experiment    theory  full damping")
    for name, full in c.STABILITY_LIMIT.items():
        w = bisect(partial(survives, name), 1.0, 1000.0, 0.1)
        found[name] = bisect(partial(decays, name), 0.01, 5.0, 1e-9)
        print(f"{name:<14} dt w = {DT * w:7.4f} {found[name]:9.6f} {full:13.6f}")
    return found


if __name__ == "__main__":
    checks.judge(checks.cliff)
