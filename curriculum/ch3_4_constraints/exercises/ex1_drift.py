"""Exercise 1: predict, then run. What becomes of a rod whose error nothing corrects? (20 minutes)

All runs are of the method `none`: gddot = 0, and no more.
"""

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks

DT = 0.005  # s
STEPS = 4000


def guess():
    """Before the first run: a wrong guess costs nothing."""
    return {
        "rod": checks.blank("guess: a bob hangs and is thrown. Its rod 'grows' or 'shrinks'?"),
        "factor": checks.blank("guess: half the step divides the error of rk4 by how much?"),
    }


def expected_g(speeds, dt):
    """g in m^2 of the pendulum after its last step, from |v| (steps,) in m/s after each: one line.

    The rod is 1 m long, the bob is let go level, and semi_implicit moves it by dt v.
    """
    return checks.blank("g from the speeds: how far outside the circle does each step end?")


def main():
    """What the guesses were about: four runs."""
    level = c.build_system("pendulum")
    hanging = level | {"q0": np.array([[0.0, -1.0, 0.0]]), "v0": np.array([[1.0, 0.0, 0.0]])}
    let_go = c.run_method(level, "none", "semi_implicit", DT, STEPS)
    thrown = c.run_method(hanging, "none", "semi_implicit", DT, STEPS)
    print("semi_implicit, the pendulum: how much too long its rod is, in m")
    print("            let go level   thrown")
    for seconds in 1, 5, 10, 20:
        k = round(seconds / DT)
        first = c.rod_lengths(level, let_go.q[k])[0] - 1.0
        second = c.rod_lengths(hanging, thrown.q[k])[0] - 1.0
        print(f"after {seconds:2d} s:{first:15.4f}{second:9.4f}")
    double = c.build_system("double")
    coarse = c.run_method(double, "none", "rk4", 2.0 * DT, STEPS // 4)
    fine = c.run_method(double, "none", "rk4", DT, STEPS // 2)
    print("rk4, the double pendulum: worst rod error in m over 10 s")
    for run in coarse, fine:
        print(f"dt {run.dt:<5g} {run.violations.max():.2e}")
    return let_go, thrown, coarse, fine


if __name__ == "__main__":
    checks.judge(checks.drift)
