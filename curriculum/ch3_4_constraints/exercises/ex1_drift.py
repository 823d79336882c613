"""Exercise 1: predict, then run. What becomes of a rod whose error nothing corrects? (20 minutes)

All runs are of the method `none`: gddot = 0, and no more.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks


def guess():
    """Before the first run: a wrong guess costs nothing."""
    return {
        "rod": checks.blank("guess: over 20 s, the rod's error 'grows' or 'oscillates'?"),
        "factor": checks.blank("guess: half the step divides the error of rk4 by how much?"),
    }


def expected_g(speeds, dt):
    """g in m^2 of the pendulum after its last step, from |v| (steps,) in m/s after each: one line.

    The rod is 1 m long, the bob starts at rest, and semi_implicit moves it by dt v.
    """
    return checks.blank("g from the speeds: how far outside the circle does each step end?")


def main():
    """What the guesses were about: three Runs."""
    pendulum = c.build_system("pendulum")
    double = c.build_system("double")
    single = c.run_method(pendulum, "none", "semi_implicit", 0.005, 4000)
    print("semi_implicit, the pendulum: rod error in m")
    for seconds in 1, 5, 10, 20:
        print(f"after {seconds:2d} s: {single.violations[200 * seconds]:.4f}")
    coarse = c.run_method(double, "none", "rk4", 0.01, 1000)
    fine = c.run_method(double, "none", "rk4", 0.005, 2000)
    print("rk4, the double pendulum: worst rod error in m over 10 s")
    for run in coarse, fine:
        print(f"dt {run.dt:<5g} {run.violations.max():.2e}")
    return single, coarse, fine


if __name__ == "__main__":
    checks.judge(checks.drift)
