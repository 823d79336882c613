"""Exercise 3: deterministic is one word, predictable another. (20 minutes)

The double pendulum under rk4 and baumgarte, from starts that are equal, or nearly so.
"""

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks

DT = 0.005  # s
STEPS = 8000  # 40 s in all


def guess():
    """Seconds until a launch angle so many rad off has become a metre."""
    return {
        1e-12: checks.blank("guess: 1e-3 rad off takes 13.6 s, and 1e-12 rad off?"),
        1e-24: checks.blank("guess: and 1e-24 rad off, which no double can hold?"),
    }


def turned(system, angle):
    """The same system, launched `angle` rad higher."""
    cos = np.cos(angle)
    sin = np.sin(angle)
    return system | {"q0": system["q0"] @ [[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]}


def main():
    """Equal starts, two seeds, and launch angles ever nearer to each other: {rad: seconds}."""
    system = c.build_system("double")
    times = {}

    def tip(system):
        return c.run_method(system, "baumgarte", "rk4", DT, STEPS).tip

    first = tip(system)
    print(f"seed 0 twice, the same to the last bit: {np.array_equal(first, tip(system))}")
    print(f"seeds 0 and 1: {np.array_equal(first, tip(c.build_system('double', 1)))}")
    for angle in 1e-3, 1e-6, 1e-9, 1e-12:
        gap = np.linalg.norm(tip(turned(system, angle)) - first, axis=1)
        times[angle] = DT * np.argmax(gap > 1.0)
        print(f"{angle:.0e} rad higher: a metre apart after {times[angle]:.1f} s")
    return times


if __name__ == "__main__":
    checks.judge(checks.chaos)
