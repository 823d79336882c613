"""Exercise 2: complete the solve. Two blanks, and the force of the rods is yours.

    python -m curriculum.ch3_4_constraints.exercises.solutions.ex2_solve

Find both on paper: differentiate g = (d . d - L^2) / 2 twice, and mark what holds no acceleration.
"""

import constraints as c
from curriculum.ch3_4_constraints.exercises import run

import numpy as np


def rod_force(system, q, v, f, w):
    """The rods' force (N, 3) in N at q, v (N, 3), beside all other forces f (N, 3); w: Baumgarte's,
    in rad/s."""
    anchors = system.get("anchors", [c.PIVOT])
    rods, n = len(system["pairs"]), len(q)
    jac = np.zeros((rods, n, 3))
    g, gdot, jdotv = np.zeros(rods), np.zeros(rods), np.zeros(rods)
    for k, (i, j) in enumerate(system["pairs"]):
        d, rate = q[i], v[i]  # the vector along the rod, and its rate
        if j >= 0:
            d, rate = d - q[j], rate - v[j]
            jac[k, j] = -d
        else:
            d = d - anchors[-1 - j]
        jac[k, i] = d
        g[k] = 0.5 * (d @ d - system["lengths"][k] ** 2)
        gdot[k] = d @ rate
        jdotv[k] = rate @ rate
    jac = jac.reshape(rods, 3 * n)
    share = 1.0 / np.repeat(system["m"], 3)  # the diagonal of M^-1
    a = (jac * share) @ jac.T  # J M^-1 J^T
    spring = -2.0 * w * gdot - w**2 * g
    lam = np.linalg.solve(a, spring - (jac @ (share * f.ravel()) + jdotv))
    return (jac.T @ lam).reshape(n, 3)


# Nothing below is blank. Once the force is yours, guess before you look: with drag, do the rods
# still hold? The energy?
def weight_and_drag(system, q, v):
    """N (N, 3): the weight, and a drag of 0.2 N s/m."""
    return system["m"] * c.GRAVITY - 0.2 * v


def main():
    """Your force beside the engine's at one state, then in the integrators that the engine's goes
    into."""
    system = c.build_system("double")
    q, v = system["q0"], np.array([[0.0, 1.0, 0.0], [0.0, -2.0, 0.0]])
    mine = rod_force(system, q, v, c.external_force(system, q, v), 20.0)
    theirs = c.constraint_force(system, q, v, 20.0)
    agree = np.abs(mine - theirs).max() <= 1e-12 * np.abs(theirs).max()
    print(f"at one state yours is the engine's, to 1e-12: {agree}")
    for name, applied in (("weight", c.external_force), ("weight and drag", weight_and_drag)):

        def force(q, v, applied=applied):
            f = applied(system, q, v)
            return f + rod_force(system, q, v, f, 20.0)

        ran = c.simulate(c.rk4_step, system, force, 0.005, 1000)
        lost = ran.energies[-1] - ran.energies[0]
        print(
            f"5 s with {name:<16} worst rod error {ran.violations.max():.0e} m, energy {lost:+.3f} J"
        )


if __name__ == "__main__":
    run(main)
