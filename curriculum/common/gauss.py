"""Gauss-Legendre collocation, an integrator like the others, (q, v, m, force, dt) -> (q, v): the ruler of a chapter."""

import math

import numpy as np
from numpy.polynomial import legendre


def collocation(stages, window):
    """`window` steps of length 1 with `stages` Gauss nodes each, n = stages * window nodes in one row.

    Returns to_q and to_v (n + window, n), the weights of the accelerations at the nodes in position and velocity at
    every node and then at the end of every step; those n + window times; and `ahead` (stages, stages), which continues
    the polynomial of a step, cut to half its degree, into the next: the whole polynomial would swing wildly there.
    E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, II.1.3.
    """
    x, w = legendre.leggauss(stages)
    basis = legendre.legvander(x, stages)
    # fit, then integrate, in the Legendre basis: a Vandermonde inverse would lose the digits from six stages on
    fit = (2 * np.arange(stages)[:, None] + 1) * basis[:, :stages].T * (0.5 * w)
    integrals = (basis[:, 2:] - basis[:, :-2]) / (2 * np.arange(1, stages) + 1)
    once = 0.5 * np.column_stack([x + 1.0, integrals]) @ fit
    step, ends = np.repeat(np.arange(window), stages), np.arange(1, window + 1)
    times = np.append(step + np.tile(0.5 * (x + 1.0), window), ends)
    finished = np.append(step, ends)[:, None] > step
    to_v = finished * np.tile(0.5 * w, window)
    to_q = to_v * (times[:, None] - times[: len(step)])
    to_v[: len(step)] += np.kron(np.eye(window), once)
    to_q[: len(step)] += np.kron(np.eye(window), once @ once)
    half = max(1, stages // 2)
    return to_q, to_v, times, legendre.legvander(x + 2.0, half - 1) @ fit[:half]


def make_gauss(stages=8, window=4, tol=1e-13):
    """The rule of Gauss-Legendre collocation: order 2 * `stages`, symplectic; the ruler that measures the others.

    Its stages solve a(t_s) = force(q(t_s), v(t_s)) / m, by iterating just that (E. Hairer, C. Lubich, G. Wanner,
    Geometric Numerical Integration, VIII.6). One force call evaluates all of them, and those of the next `window` - 1
    steps besides: extra stages are nearly free in numpy, and a step whose stages were iterated before needs only two
    or three calls. A step ahead whose stages run away is guessed anew. It ends when the end of the step moves by less
    than `tol`, relatively; FloatingPointError if it does not within 50 calls. The rule remembers the stages of the run
    it was last used for: a guess only, and forgotten when force, dt or shape change.
    """
    to_q, to_v, times, ahead = collocation(stages, window)
    n, memory = stages * window, {"run": None}

    def gauss_step(q, v, m, force, dt):
        if memory["run"] != (force, dt, q.shape):  # a new run starts from constant accelerations
            q_rows = np.column_stack([dt * dt * to_q, np.ones_like(times), dt * times])
            v_rows = np.column_stack([dt * to_v, np.zeros_like(times), np.ones_like(times)])
            table = np.vstack([q_rows[:n], v_rows[:n], q_rows[n:], v_rows[n:]]).T.copy()
            memory.update(run=(force, dt, q.shape), table=table, x=np.empty((q.size, n + 2)))
            memory["x"][:, :n] = (force(q, v) / m).T.reshape(-1, 1)
        x, table, shape = memory["x"], memory["table"], q.T.shape
        a, start = x[:, :n], x[:, n:]  # of a: a row a coordinate, a column a stage
        start[:, 0], start[:, 1] = q.T.ravel(), v.T.ravel()
        size, front, ends, last = float(np.vdot(start, start)), 0.0, 0.0, math.inf
        for k in range(51):
            y = x @ table  # q at all stages, v at all stages, q and v at the ends of the steps
            before, ends = ends, y[:, 2 * n :]
            here = ends[:, ::window].ravel()  # the end of this step
            gap, front = here - front, here
            change = float(gap.dot(gap))
            if not change < math.inf:  # nothing to mend: start again from constant accelerations
                a[:], change = (force(q, v) / m).T.reshape(-1, 1), math.inf
                y = x @ table
                ends = y[:, 2 * n :]
                front = ends[:, ::window].ravel()
            # down to tol, or as far down as rounding lets
            settled = k > 0 and (change <= tol * tol * size or last <= change < 1e-18 * size)
            if settled or k % 8 == 7:
                moved = np.square(ends - before)
                if not moved.sum() < 0.1 * size:  # a step ahead has run away: guess it from the one before it
                    far = moved.sum(axis=0)
                    wild = np.flatnonzero(~(far[:window] + far[window:] < 0.1 * size))
                    for j in range(max(1, wild[0]) if len(wild) else window, window):
                        a[:, j * stages : (j + 1) * stages] = a[:, (j - 1) * stages : j * stages] @ ahead.T
                    y = x @ table
                if settled:
                    a[:, :-stages] = a[:, stages:].copy()
                    a[:, -stages:] = a[:, -stages:] @ ahead.T
                    return ends[:, 0].reshape(shape).T, ends[:, window].reshape(shape).T
            stage_q, stage_v = y[:, :n].reshape(*shape, n).T, y[:, n : 2 * n].reshape(*shape, n).T
            a[:] = (force(stage_q, stage_v) / m).T.reshape(q.size, n)
            last = change
        raise FloatingPointError(f"the Gauss stages do not settle at dt {dt:g}")

    return gauss_step
