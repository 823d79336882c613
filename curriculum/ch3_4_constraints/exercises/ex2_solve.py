"""Exercise 2: complete the solve. Three blanks, and the force of the rods is yours. (30 minutes)

    python -m curriculum.ch3_4_constraints.exercises.ex2_solve

Find them on paper: differentiate g = (d . d - L^2) / 2 twice, and mark what holds no acceleration.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises.checks import blank, judge

import numpy as np

WHY = "How do the rods know of a drag that no line of the solve mentions?"


def turning(d, rate):
    """Jdot v of a rod, one number in m^2/s^2; of d (3,) in m and its rate (3,) in m/s."""
    return blank("Jdot v of a rod: the part of gddot without acceleration")


def mobility(jac, inverse_m):
    """A (C, C), for J (C, 3N) in m and 1/m (3N,) in 1/kg: how each gddot answers to each lambda."""
    return blank("A = J M^-1 J^T; inverse_m lists the diagonal of M^-1")


def wanted(g, gdot, w):
    """What gddot is to be, in m^2/s^2, so that an error in g dies like e^(-wt) without swinging."""
    return blank("what Baumgarte asks gddot to be; at w = 0 it is zero")


def rod_force(system, q, v, f, w):
    """The rods' force (N, 3) in N at q, v (N, 3), beside all other forces f; w in rad/s."""
    jac, g, gdot, _ = c.constraint_terms(system, q, v)
    jdotv = np.zeros(len(g))
    inverse_m = np.repeat(1.0 / system["m"], 3)
    for k, (i, j) in enumerate(system["pairs"]):
        d = jac[k, 3 * i : 3 * i + 3]
        jdotv[k] = turning(d, v[i] - (v[j] if j >= 0 else 0.0))
    A = mobility(jac, inverse_m)
    b = wanted(g, gdot, w) - (jac @ (inverse_m * f.ravel()) + jdotv)
    return (jac.T @ np.linalg.solve(A, b)).reshape(q.shape)


def main():
    """Your force in the engine's integrator. Guess: with drag, do rods still hold? The energy?"""
    system = c.build_system("double")
    for name, drag in (("weight", 0.0), ("weight and drag", 0.2)):  # N s/m

        def force(q, v, drag=drag):
            f = system["m"] * c.GRAVITY - drag * v
            return f + rod_force(system, q, v, f, 20.0)

        ran = c.simulate(c.rk4_step, system, force, 0.005, 1000)
        end, lost = ran.violations.max(), ran.energies[-1] - ran.energies[0]
        print(f"5 s with {name:<16} worst rod error {end:.0e} m, energy {lost:+.3f} J")


if __name__ == "__main__":
    judge(main)
