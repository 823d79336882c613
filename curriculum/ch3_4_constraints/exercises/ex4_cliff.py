"""Exercise 4: find the cliff. Stiffer springs hold rods better, then tear them. (30 minutes)

The chapter knows where Baumgarte's spring falls off it: gddot = -2 w gdot - w^2 g. This one has
half the damping, gddot = -w gdot - w^2 g, and no table knows its cliffs.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.mechanics.stability import is_explicit, stability_limit
from curriculum.common.tracing import compiled

DT = 0.005  # s
STEPS = 4000
OFF = 1e-9  # m: how much too long the rod is at the start
EXPLICIT = {  # gauss iterates, and is slow to ask
    name: step_fn for name, step_fn in c.INTEGRATORS.items() if is_explicit(step_fn)
}


def guess():
    """Which integrators fall off the cliff later with half the damping than with all of it?"""
    return checks.blank("guess: their names in a list; [] if none does")


def bisect(holds, low, high, width):
    """x of the cliff to within `width`: holds(low) is True, holds(high) is not."""
    while high - low > width:
        middle = 0.5 * (low + high)
        if holds(middle):
            low = middle
        else:
            high = middle
    return low


def step_matrix(step_fn, z):
    """(2, 2): a step of 1 s takes (g, gdot) to step_matrix @ (g, gdot).

    The spring is gddot = -z gdot - z^2 g. An integrator's step_fn takes (q, v, m, force, dt), and
    numbers as well as arrays: give it g for q, gdot for v, and 1 for m.
    """
    return checks.blank("its columns: what a step makes of (1, 0) and of (0, 1)")


def survives(step_fn, w):
    """Experiment: a bob hangs on a rod that is OFF too long. Is that less after STEPS steps?"""
    system = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.0 - OFF, 0.0]])}
    # this spring; that Jdot v is left out does not matter where the rod does not turn
    force = c.make_engine_force(system, damping=w, stiffness=w * w)
    run = c.simulate(compiled(step_fn, STEPS), system, force, DT, STEPS)
    return run.violations[-1] < OFF  # also False where it is NaN


def decays(step_fn, z):
    """Theory: no eigenvalue of a step is larger than 1, but for rounding. Then no error grows."""
    return np.abs(np.linalg.eigvals(step_matrix(step_fn, z))).max() <= 1.0 + 1e-12


def main():
    """Both cliffs of each integrator, z = dt w, and the chapter's: {name: (theory, chapter)}."""
    cliffs = {}
    print("                  experiment    theory  full damping")
    for name, step_fn in EXPLICIT.items():
        w = bisect(partial(survives, step_fn), 1.0, 1000.0, 0.1)
        theory = bisect(partial(decays, step_fn), 0.01, 5.0, 1e-9)
        full = stability_limit(step_fn)
        print(f"{name:<14} dt w = {DT * w:7.4f} {theory:9.6f} {full:13.6f}")
        cliffs[name] = theory, full
    return cliffs


if __name__ == "__main__":
    checks.judge(checks.cliff)
