"""Exercise 3: deterministic is one word, predictable another. (20 minutes)

    python -m curriculum.ch3_4_constraints.exercises.ex3_chaos

The double pendulum, by rk4 with Baumgarte's spring, from starts that are equal, or a hair apart.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises.checks import blank, judge

import numpy as np

DT, STEPS = 0.005, 8000  # s; 40 s in all
WHY = "Why does a thousand times the precision buy so little?"


def answer():
    """Seconds until a launch angle so many rad off has become a metre: guess, run, put it right."""
    return {
        "1e-12": blank("guess: 1e-3 rad off takes 13.6 s, and 1e-12 rad off?"),
        "1e-24": blank("guess: and 1e-24 rad off? What does each digit buy?"),
    }


def same(a, b):
    """Whether arrays a and b are equal to the last bit."""
    return blank("True only if no bit differs: allow no tolerance here")


def parted(gap, dt):
    """The time in s when a gap (steps + 1,) in m first passes a metre; np.inf if it never is."""
    return blank("the first time the gap is over a metre; if it never is?")


def turned(system, angle):
    """The same system, launched `angle` rad higher."""
    x, y, z = system["q0"].T
    cos, sin = np.cos(angle), np.sin(angle)
    return system | {"q0": np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)}


def tip(system):
    """Where the tip is (STEPS + 1, 3), in m."""
    return c.simulate(c.rk4_step, system, c.make_force(system, 20.0), DT, STEPS).tip


def main():
    """Equal starts, two seeds, and launch angles ever nearer to each other: {start: seconds}."""
    first, again, other = (tip(c.build_system("double", seed)) for seed in (0, 0, 1))
    print(f"seed 0, twice: the same to the last bit: {same(first, again)}")
    print(f"seeds 0 and 1: the same to the last bit: {same(first, other)}")
    starts = {"another seed": other}
    for angle in (1e-3, 1e-6, 1e-9, 1e-12):
        starts[f"{angle:.0e} rad higher"] = tip(turned(c.build_system("double"), angle))
    print("\nbeside seed 0       a metre apart after")
    found = {name: parted(np.linalg.norm(first - x, axis=1), DT) for name, x in starts.items()}
    for name, seconds in found.items():
        print(f"{name:<18} {seconds:18.1f} s")
    return found


if __name__ == "__main__":
    judge(main)
