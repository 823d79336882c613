"""When errors grow under an integrator: found by taking its steps.

Its step_fn(q, v, m, force, dt) returns q and v: (N, 3) each, in m and m/s, as m is (N, 1) in kg.
"""

import numpy as np

SEARCHED = 10.0  # dt w: an integrator that is stable up to here has no limit that matters
COARSE = 40  # places that are looked at before the limit is narrowed down
ALONG_X = np.array([[1.0, 0.0, 0.0]])  # of one particle: integrators may use all three axes
GROWS = 1e-9  # an error that grows by a smaller share in a step is rounding


def stability_limit(step_fn):
    """The dt w up to which Baumgarte's error does not grow in a rod at rest; inf if always.

    There g moves like a damped spring, gddot = -2 w gdot - w^2 g, and one step multiplies (g, gdot)
    by a matrix. An error grows where that has an eigenvalue beyond the unit circle (E. Hairer, G.
    Wanner, Solving ODEs II, IV.2).
    """
    low = 0.0
    for high in np.linspace(0.0, SEARCHED, COARSE + 1)[1:]:
        if grows(step_fn, high):
            break
        low = high
    else:
        return np.inf
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if grows(step_fn, middle):
            high = middle
        else:
            low = middle
    return low


def grows(step_fn, w):
    """Whether steps of 1 s make an error grow that is critically damped at `w` rad/s.

    So do steps of dt s at w / dt.
    """

    def force(g, gdot):
        return -2.0 * w * gdot - w * w * g

    matrix = np.zeros((2, 2))
    for k, (g, gdot) in enumerate([(1.0, 0.0), (0.0, 1.0)]):
        q, v = step_fn(g * ALONG_X, gdot * ALONG_X, np.ones((1, 1)), force, 1.0)
        matrix[:, k] = q[0, 0], v[0, 0]
    if not np.all(np.isfinite(matrix)):
        return True
    return np.max(np.abs(np.linalg.eigvals(matrix))) > 1.0 + GROWS
