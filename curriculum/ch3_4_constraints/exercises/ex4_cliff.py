"""Exercise 4: find the cliff. Stiffer springs hold rods better, then tear them. (30 minutes)

The chapter knows where Baumgarte's spring falls off it: gddot = -2 w gdot - w^2 g. This one has
half the damping, gddot = -w gdot - w^2 g, and no table knows its cliffs.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.rods.stability import stability_limit
from curriculum.common.tracing import compiled

DT = 0.005  # s
STEPS = 4000
OFF = 1e-9  # m: how much too long the rod is at the start
NAMES = "euler", "semi_implicit", "rk4"


def guess():
    """Where an integrator's cliff moves with half the damping."""
    return {
        "euler": checks.blank("guess: euler's cliff comes 'earlier', or 'later'?"),
        "semi_implicit": checks.blank("guess: and semi_implicit's?"),
        "rk4": checks.blank("guess: and rk4's?"),
    }


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
    _, violations, _ = c.simulate(compiled(step_fn, STEPS), system, force, DT, STEPS)
    return violations[-1] < OFF  # also False where it is NaN


def decays(step_fn, z):
    """Theory: no eigenvalue of a step is larger than 1, but for rounding. Then no error grows."""
    return np.abs(np.linalg.eigvals(step_matrix(step_fn, z))).max() <= 1.0 + 1e-12


def main():
    """The cliffs, as dt w: {integrator: (experiment, theory, the chapter's with full damping)}."""
    cliffs = {}
    print("                  experiment    theory  full damping")
    for name in NAMES:
        step_fn = c.INTEGRATORS[name]
        experiment = DT * bisect(partial(survives, step_fn), 1.0, 1000.0, 0.1)
        theory = bisect(partial(decays, step_fn), 0.01, 5.0, 1e-9)
        full = stability_limit(step_fn)
        print(f"{name:<14} dt w = {experiment:7.4f} {theory:9.6f} {full:13.6f}")
        cliffs[name] = experiment, theory, full
    return cliffs


if __name__ == "__main__":
    checks.judge(checks.cliff)
