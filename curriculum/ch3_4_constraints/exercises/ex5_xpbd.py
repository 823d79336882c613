"""Exercise 5: write the method that games use. It has no force and no system to solve. (30 minutes)

XPBD takes a step in short sub-steps. In each, particles fly as if there were no rods; then each rod
in turn pulls its ends to its length; then a velocity is a particle's move divided by the time.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.common.tracing import compiled

DT = 0.005  # s
STEPS = 4000


def substep(system, q, v, h):
    """q, v (N, 3) after h s. c.external_force(system, q, v) is in N.

    A rod (i, j) is too long by |d| - L. Both ends move along d until it is not, each by its share
    w / (w_i + w_j) of that, w = 1/m. With j < 0 it ends at the pivot, the origin, whose w is 0.
    """
    return checks.blank("fly, correct the rods in order, and see how far each particle has moved")


def main():
    """What sub-steps buy in 20 s. Guess first: is energy lost or gained, and how much?"""
    system = c.build_system("double")
    for count in 1, 4, 20:

        def step(q, v, m, force, dt, count=count):
            for _ in range(count):
                q, v = substep(system, q, v, dt / count)
            return q, v

        step_fn = compiled(step, STEPS)  # print() in substep wants step_fn = step
        _, violations, energies = c.simulate(step_fn, system, None, DT, STEPS)
        gained = (energies[-1] - energies[0]) / energy_scale(system, c.GRAVITY)
        rods = f"rods {1e3 * violations.max():.3f} mm off"
        print(f"{count:2} sub-steps: {rods}, energy {100.0 * gained:+.0f} % of m g L")


if __name__ == "__main__":
    checks.judge(checks.xpbd)
