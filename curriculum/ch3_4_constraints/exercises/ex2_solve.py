"""Exercise 2: complete the solve. Two blanks, and the force of the rods is yours. (30 minutes)

On paper: differentiate g = (d . d - L^2) / 2 twice, and mark the terms without an acceleration.
"""

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.exercises import checks


def jdotv(d, d_dot):
    """Jdot v of a rod in m^2/s^2, one number, from d (3,) in m and d_dot (3,) in m/s."""
    return checks.blank("Jdot v: what in gddot has no acceleration")


def target(g, gdot, w):
    """What gddot is to be, in m^2/s^2, so that g dies like e^(-w t) and does not oscillate."""
    return checks.blank("Baumgarte's gddot; at w = 0 it is zero")


def rod_force(system, q, v, f, w):
    """The rods' force (N, 3) in N beside all other forces f (N, 3); w in rad/s."""
    jac, g, gdot, _ = c.constraint_terms(system, q, v)
    jdot_v = np.zeros(len(system["pairs"]), like=q)
    for k, (i, j) in enumerate(system["pairs"]):
        if j < 0:  # the pivot, which stands still at the origin
            d = q[i]
            d_dot = v[i]
        else:
            d = q[i] - q[j]
            d_dot = v[i] - v[j]
        jdot_v[k] = jdotv(d, d_dot)
    m = np.repeat(system["m"], 3)
    A = (jac / m) @ jac.T
    b = target(g, gdot, w) - (jac @ (f.ravel() / m) + jdot_v)
    return (jac.T @ np.linalg.solve(A, b)).reshape(q.shape)


def main():
    """Your force drives rk4. Guess first: with drag, do the rods still hold? And the energy?"""
    system = c.build_system("double")

    def force(q, v):
        f = system["m"] * c.GRAVITY - 0.2 * v  # a drag of 0.2 N s/m
        return f + rod_force(system, q, v, f, 20.0)

    _, violations, energies = c.simulate(c.rk4_step, system, force, 0.005, 1000)
    gained = energies[-1] - energies[0]
    print(f"5 s with drag: rods {violations.max():.0e} m off, energy {gained:+.2f} J")


if __name__ == "__main__":
    checks.judge(checks.solve)
