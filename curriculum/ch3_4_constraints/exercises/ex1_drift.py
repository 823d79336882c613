"""Exercise 1: predict, then run. What becomes of a rod whose error nobody takes back? (20 minutes)

    python -m curriculum.ch3_4_constraints.exercises.ex1_drift

All runs here are of the naive solve: gddot = 0, and nothing else.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises import blank, run, write_down

import numpy as np

NOTE = c.HERE / "outputs/guess_ex1_drift.json"  # yours, as it was before the first run
CHOICES = {"rod": ["stays", "grows", "oscillates"], "factor": None}
CHOICES["heavy"] = ["smaller", "the same", "larger"]


# Fill in predict() first, then run this file. A wrong guess costs nothing, and a guess made after
# the run counts nothing.
def predict():
    """What you expect, before you have seen it."""
    return {
        # A pendulum, released level, 20 s by semi_implicit: what does its rod's error do in time?
        "rod": blank("write down a guess: 'stays', 'grows' or 'oscillates'"),
        # The double pendulum, 10 s by rk4, dt 0.01 and then 0.005. The worst error is divided by?
        "factor": blank("write down a guess: half the step divides rk4's worst rod error by what?"),
        # The first pendulum again, its bob ten times as heavy. Its rod error becomes?
        "heavy": blank("write down a guess: 'smaller', 'the same' or 'larger'"),
    }


def found():
    """What the runs showed, in the same words: fill this in after the first run."""
    return {
        "rod": blank("say what the run showed: 'stays', 'grows' or 'oscillates'"),
        "factor": blank("say what the runs showed: the factor"),
        "heavy": blank("say what the runs showed: 'smaller', 'the same' or 'larger'"),
        "why": blank("one sentence: why can the error of the naive rod do nothing else?"),
    }


def expected_g(speeds, dt):
    """g in m^2 of the pendulum after its last step, from |v| (steps,) in m/s after each: one line.

    The rod is 1 m long, the bob starts at rest, and semi_implicit moves it by dt v.
    """
    return blank("g from the speeds; draw a step along the tangent: how far outside does it end?")


def naive(system, rule, dt, steps):
    """A Run that asks for gddot = 0 only, all its states kept."""
    force = c.make_force(system, 0.0)
    return c.simulate(c.INTEGRATORS[rule], system, force, dt, steps, range(steps + 1))


def main():
    """Write the guess down, then show what it was about."""
    print(f"you wrote down {write_down(NOTE, predict(), CHOICES)}\n")
    pendulum, heavy, double = (c.build_system(name) for name in ("pendulum", "pendulum", "double"))
    heavy["m"] = 10.0 * heavy["m"]
    runs = [naive(system, "semi_implicit", 0.005, 4000) for system in (pendulum, heavy)]
    print("semi_implicit, dt 0.005, rod error in m\n   after   bob of 1 kg  bob of 10 kg")
    for seconds in (1, 2, 5, 10, 15, 20):
        print(f"{seconds:6d} s" + "".join(f"{run.violations[200 * seconds]:14.6f}" for run in runs))
    print("\nrk4, the double pendulum over 10 s, worst rod error in m")
    for dt in (0.01, 0.005):
        print(f"dt {dt:<5g} {np.max(naive(double, 'rk4', dt, round(10 / dt)).violations):12.3e}")
    print("\nyou found", *(f"{key:>10}: {said}" for key, said in found().items()), sep="\n")
    g = c.constraint_terms(pendulum, runs[0].q[-1], runs[0].v[-1])[1][0]
    line = expected_g(np.sqrt(c.dot(runs[0].v, runs[0].v))[1:, 0], 0.005)
    print(f"\ng of the first run after 20 s, in m^2: {g:.9f}; by your line: {line:.9f}")


if __name__ == "__main__":
    run(main)
