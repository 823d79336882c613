"""Exercise 1: predict, then run. What becomes of a rod whose error nothing corrects? (20 minutes)

    python -m curriculum.ch3_4_constraints.exercises.ex1_drift

All runs here are of the naive solve: gddot = 0, and nothing else.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises.checks import blank, judge
from curriculum.ch3_4_constraints.studies import _runs

import numpy as np

WHY = "Why can the error of the naive rod do nothing else?"


def answer():
    """Guess before the first run: it is noted, and costs nothing. Then put right what was wrong."""
    return {
        "rod": blank("guess: the rod's error 'stays', 'grows' or 'oscillates'?"),
        "factor": blank("guess: half the step divides the error of rk4 by what?"),
        "heavy": blank("guess: a bob of 10 kg: 'smaller', 'the same', 'larger'?"),
    }


def expected_g(speeds, dt):
    """g in m^2 of the pendulum after its last step, from |v| (steps,) in m/s after each: one line.

    The rod is 1 m long, the bob starts at rest, and semi_implicit moves it by dt v.
    """
    return blank("g from the speeds: how far outside does a tangent end?")


def naive(system, rule, dt, seconds):
    """A Run that asks for gddot = 0 only, all its states kept."""
    steps = round(seconds / dt)
    return _runs.run(system, rule, "none", dt, steps, range(steps + 1))


def main():
    """What the guess was about. Returns g in m^2, as it is and by your line."""
    pendulum, heavy, double = (c.build_system(name) for name in ("pendulum", "pendulum", "double"))
    heavy["m"] = 10.0 * heavy["m"]
    runs = [naive(system, "semi_implicit", 0.005, 20) for system in (pendulum, heavy)]
    print("semi_implicit, dt 0.005, rod error in m\n   after   bob of 1 kg  bob of 10 kg")
    for seconds in (1, 2, 5, 10, 15, 20):
        print(f"{seconds:6d} s" + "".join(f"{run.violations[200 * seconds]:14.6f}" for run in runs))
    print("\nrk4, the double pendulum over 10 s, worst rod error in m")
    for dt in (0.01, 0.005):
        print(f"dt {dt:<5g} {naive(double, 'rk4', dt, 10).violations.max():12.3e}")
    g = c.constraint_terms(pendulum, runs[0].q[-1], runs[0].v[-1])[1][0]
    line = expected_g(np.linalg.norm(runs[0].v[1:, 0], axis=1), 0.005)
    print(f"\ng of the first run after 20 s, in m^2: {g:.9f}; by your line: {line!s:.11}")
    return g, line


if __name__ == "__main__":
    judge(main)
