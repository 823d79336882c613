"""Exercise 4: find the cliff. A stronger spring mends a rod sooner, until it tears it apart.

    python -m curriculum.ch3_4_constraints.exercises.ex4_cliff        (40 minutes)

The chapter's table knows where Baumgarte's spring falls off it: gddot = -2 w gdot - w^2 g. This one
has half the damping, gddot = -w gdot - w^2 g, and no table knows its cliffs.
"""

from functools import partial

import constraints as c
from curriculum.ch3_4_constraints.exercises.checks import blank, judge

import numpy as np

DT, STEPS, OFF = 0.005, 4000, 1e-9  # s; OFF, in m: how much too long the rod is at the start
WHY = "What does a step do beyond the cliff that the spring would not?"


def answer():
    """With half the damping, when does each rule fall off the cliff? Guess, run, put it right."""
    return blank("guess: {'euler': ?, 'semi_implicit': ?, 'rk4': ?}, each sooner or later")


def bisect(holds, low, high, width):
    """x of the cliff to within `width`: holds(low) is True, holds(high) not, with one change."""
    return blank("halve the interval, by one holds(x) each, down to width")


def step_matrix(rule, z):
    """(2, 2): a step of 1 s by `rule` takes (g, gdot) to step_matrix @ (g, gdot).

    The spring is gddot = -z gdot - z^2 g. The rule is c.INTEGRATORS[rule], which takes
    (q, v, m, force, dt), numbers as well as arrays: give it g for q, gdot for v, and 1 for m.
    """
    return blank("its columns: what a step makes of (1, 0) and (0, 1)")


def mends(rule, w):
    """Experiment: a bob hangs on a rod that is OFF too long. Is that less after STEPS steps?"""
    system = c.build_system("pendulum") | {"q0": np.array([[0.0, -1.0 - OFF, 0.0]])}
    hold = c.hold_table(baumgarte=w)["baumgarte"]._replace(damping=w)
    ran = c.simulate(c.INTEGRATORS[rule], system, c.make_force(system, hold), DT, STEPS)
    return not ran.stopped and bool(ran.violations[-1] < OFF)


def decays(rule, z):
    """Theory: no eigenvalue of a step is larger than 1, but for rounding. Then no error grows."""
    return bool(np.abs(np.linalg.eigvals(step_matrix(rule, z))).max() <= 1.0 + 1e-12)


def main():
    """Both cliffs of each rule, z = dt w, and the chapter's beside them: {rule: z of theory}."""
    found = {}
    print("                 w, experiment         z, theory    full damping")
    for rule, full in c.STABILITY_LIMIT.items():
        w = bisect(partial(mends, rule), 1.0, 1000.0, 0.1)
        found[rule] = bisect(partial(decays, rule), 0.01, 5.0, 1e-9)
        print(f"{rule:<14} {w:8.1f} {DT * w:11.4f} {found[rule]:10.6f} {full:15.6f}")
    return found


if __name__ == "__main__":
    judge(main)
