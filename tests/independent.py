"""Rods by another formulation than the chapter's: least squares, and scipy's integrator."""

import numpy as np
import pytest

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2


def incidence_and_rods(system):
    """What makes differences of all points, (C, N + K), and these: the rods as vectors, (C, 3)."""
    points = np.concatenate([system["q0"], system["anchors"][::-1]])  # where -1 is the first anchor
    i, j = np.transpose(system["pairs"])
    incidence = np.eye(len(points))[i] - np.eye(len(points))[j]
    return incidence, incidence @ points


def weight(system):
    """Gravity and load, (N, 3) in N."""
    return system["m"] * GRAVITY + system.get("load", 0.0)


def energy_off(system, q, v):
    """The largest change of energy in states q, v (T, N, 3), as a share of its scale."""
    kinetic = np.sum(0.5 * system["m"] * v * v, axis=(1, 2))
    energy = kinetic - np.sum(weight(system) * q, axis=(1, 2))
    m_g_L = np.sum(system["m"]) * 9.81 * np.sum(system["lengths"])
    return np.max(np.abs(energy - energy[0])) / max(m_g_L, kinetic[0])


def acceleration(system, f, use_jdotv=1.0, damping=0.0, stiffness=0.0, regularization=0.0):
    """a (N, 3) that meets what is asked and is nearest, weighed with masses, to the free f / m.

    By an SVD of J M^-1/2, its rows of length 1: A has the squares of its singular values.
    """
    n = len(system["q0"])
    incidence, d = incidence_and_rods(system)
    d_dot = incidence[:, :n] @ system["v0"]
    root = np.sqrt(system["m"])
    g = 0.5 * (np.sum(d**2, axis=1) - system["lengths"] ** 2)
    gdot = np.sum(d * d_dot, axis=1)
    asked = -use_jdotv * np.sum(d_dot**2, axis=1) - damping * gdot - stiffness * g
    jac = np.einsum("kn,kx->knx", incidence[:, :n] / root.T, d).reshape(len(d), -1)
    size = np.linalg.norm(jac, axis=1)
    whole = np.hstack([jac / size[:, None], np.sqrt(regularization) * np.eye(len(d))])
    left = (asked - jac @ (f / root).ravel()) / size
    held = np.linalg.lstsq(whole, left, rcond=1e-11)[0][: 3 * n]
    return f / system["m"] + held.reshape(n, 3) / root


def smallest_pulls(system, force):
    """The pulls (C,) in N of rods whose force is (N, 3).

    Of those that fit, the ones whose forces on particles, squared and summed, are least.
    """
    incidence, d = incidence_and_rods(system)
    d = d / np.linalg.norm(d, axis=1)[:, None]
    rows = np.einsum("kn,kx->knx", incidence[:, : len(force)], d).reshape(len(d), -1)
    ends = np.linalg.norm(rows, axis=1)  # the root of how many particles it pulls at: 1 or 2
    return -np.linalg.lstsq((rows / ends[:, None]).T, np.ravel(force), rcond=1e-6)[0] / ends


def motion(system, times, others=lambda q, v: 0.0):
    """Where the particles are at these times in s, (T, N, 3), as others(q, v) in N acts, too."""
    integrate = pytest.importorskip("scipy.integrate", reason="scipy is not installed")
    shape = (2, *system["q0"].shape)

    def rate(t, y):
        q, v = y.reshape(shape)
        return np.ravel(
            [v, acceleration(system | {"q0": q, "v0": v}, weight(system) + others(q, v))]
        )

    start = np.ravel([system["q0"], system["v0"]])
    settings = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15, "t_eval": times}
    found = integrate.solve_ivp(rate, (0.0, times[-1]), start, **settings)
    return found.y.T.reshape(-1, *shape)[:, 0]
