"""Gauss-Legendre collocation, an integrator like the others, (q, v, m, force, dt) -> (q, v): the
ruler of a chapter."""

import math
from decimal import Decimal, localcontext
from functools import lru_cache

from curriculum.common.motion import by_rows
from curriculum.common.trace import Untraceable

import numpy as np

ROUGH = 0.02  # the last terms of a polynomial as a share of its values: from there on it is no picture of the motion
DIGITS = 50  # in which nodes and weights are computed, so that every machine rounds them to the same doubles


def legendre(x, degree):
    """Legendre's polynomials P_0(x), ..., P_degree(x), by their recurrence."""
    p = [Decimal(1), x]
    for k in range(1, degree):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return p


@lru_cache
def collocation(stages):
    """Gauss's rule on a step of length 1: nodes c (s,), weights b (s,), matrix a (s, s) and its
    square.

    a_ij is the integral from 0 to c_i of the polynomial that is 1 at c_j and 0 at the other nodes,
    taken in Legendre's basis (E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration,
    II.1.3). And weights (s, 2) of the last two terms in that basis of what is given at the nodes.
    """
    n = range(stages)
    with localcontext() as context:
        context.prec = DIGITS
        x = [Decimal(-math.cos(math.pi * (k + 0.75) / (stages + 0.5))) for k in n]
        for _ in range(6):  # Newton's method doubles the digits
            p = [legendre(y, stages) for y in x]
            slope = [
                stages * (y * r[stages] - r[stages - 1]) / (y * y - 1)
                for y, r in zip(x, p, strict=True)
            ]
            x = [y - r[stages] / d for y, r, d in zip(x, p, slope, strict=True)]
        b = [1 / ((1 - y * y) * d * d) for y, d in zip(x, slope, strict=True)]
        p = [legendre(y, stages) for y in x]
        a = [
            [
                b[j] / 2 * (x[i] + 1 + sum(p[j][k] * (p[i][k + 1] - p[i][k - 1]) for k in n[1:]))
                for j in n
            ]
            for i in n
        ]
        square = [[sum(a[i][k] * a[k][j] for k in n) for j in n] for i in n]
        ends = [[b[j] * (2 * k + 1) * p[j][k] for k in n[-2:]] for j in n]
        return tuple(
            np.array(part, dtype=float) for part in ([(y + 1) / 2 for y in x], b, a, square, ends)
        )


def make_gauss(stages=8, window=4, tol=1e-13, most=50):
    """The rule of Gauss-Legendre collocation: order 2 * `stages`, symplectic; the ruler that
    measures the others.

    Its stages solve a(t_s) = force(q(t_s), v(t_s)) / m, by iterating just that (Hairer, Lubich,
    Wanner, VIII.6). One force call evaluates all of them, and those of the next `window` - 1 steps
    besides, each from where the one before it ended in the last round: more stages cost an array
    little, and a step whose stages were iterated before needs only two or three calls. It ends when
    the end of the step moves by less than `tol`, relatively, or raises FloatingPointError after
    `most` calls, or where the stages turn out too few for the motion. What it knows of the steps
    ahead it leaves with the force of the run, if that has a `memory`: a first guess, nothing else.
    Sums are numpy's elementwise ones, no BLAS: the same on every processor.
    """
    c, b, once, twice, last_terms = collocation(stages)
    last_terms = last_terms[..., None]
    late, n = b * (1.0 - c), stages * window

    def begin(q, m, force, dt):
        """What lasts for a run: who makes accelerations, of which coordinates, and the arrays they
        go through.

        x (stages + 2, 1, lanes): accelerations of each step ahead, and q, v where it starts; times
        the weights, added up along the first axis, they make y (2 stages + 2, lanes): q, v at its
        stages and at its end. A lane is a coordinate of a step, the steps together.
        """
        places, rows = by_rows(force, m, q.shape)
        members, one, zero = math.prod(q.shape[:-2]), np.ones((stages, 1)), np.zeros((stages, 1))
        at_q, at_v = [dt * dt * twice, one, dt * c[:, None]], [dt * once, zero, one]
        end_q, end_v = (
            [dt * dt * late[None], one[:1], dt * one[:1]],
            [dt * b[None], zero[:1], one[:1]],
        )
        weights = np.block([at_q, at_v, end_q, end_v]).T[:, :, None].copy()
        x = np.empty((stages + 2, 1, window * len(places) * members))
        products, y = (
            np.empty((*weights.shape[:2], x.shape[2])),
            np.empty((2 * stages + 2, x.shape[2])),
        )
        shape = (n, len(places), *[members][: members - 1])
        by_stage = [
            part.reshape(shape).swapaxes(0, 1) for part in (y[:stages], y[stages:-2], x[:-2])
        ]
        by_place = np.empty((3, *by_stage[0].shape))  # contiguous, as the force likes them
        rows_in, rows_out = (
            list(part.reshape(-1, n * members)) for part in (by_place[:2], by_place[2:])
        )

        def integrate():
            np.multiply(x, weights, out=products)
            np.add.reduce(products, axis=0, out=y)

        def accelerate():
            by_place[0], by_place[1] = by_stage[:2]
            rows(rows_in, rows_out)
            by_stage[2][...] = by_place[2]

        a, starts, ends = (
            part.reshape(len(part), window, -1) for part in (x[:stages], x[stages:], y[-2:])
        )
        return places, rows, a, starts, ends, integrate, accelerate

    def gauss_step(q, v, m, force, dt):
        if q.dtype == object:
            raise Untraceable("")  # stages are iterated until they settle
        memory, key = getattr(force, "memory", {}), (gauss_step, dt, q.shape)
        new = memory.get("gauss") != key
        if new:
            memory["gauss"], memory["run"] = key, begin(q, m, force, dt)
        places, rows, a, starts, ends, integrate, accelerate = memory["run"]
        size = q.shape[-2] * q.shape[-1]
        starts[0, 0] = q.reshape(-1, size).T[places].ravel()
        starts[1, 0] = v.reshape(-1, size).T[places].ravel()

        def begin_again():
            """Constant accelerations, and every step ahead from where this one starts."""
            at = starts[:, 0].reshape(2 * len(places), -1)
            constant = np.empty((len(places), at.shape[1]))
            rows(list(at), list(constant))
            a[:], starts[:] = constant.ravel(), starts[:, :1]

        if new:
            begin_again()
        scale, before, last = total(starts[:, 0]), 0.0, math.inf
        for k in range(most + 1):
            integrate()
            moved, before = ends - before, ends.copy()
            change = total(moved[:, 0])  # of the end of this step
            if not change < math.inf:  # nothing to mend
                begin_again()
                before, last = 0.0, math.inf
                continue
            # down to tol, or as far down as rounding lets
            settled = k > 0 and (change <= tol * tol * scale or last <= change < 1e-18 * scale)
            if k > 2 and (
                settled or k % 8 == 7
            ):  # a step ahead may have run away: then it is guessed anew
                wild = ~(np.square(moved) < 0.1 * scale).all(axis=(0, 2))
                for j in np.flatnonzero(wild):
                    a[:, j], ends[:, j] = a[-1, j - 1], ends[:, j - 1]
            if settled:
                if k > 3 and stages > 5:  # slow: has the polynomial through the stages any digits?
                    rough = np.add.reduce(a[:, None, 0] * last_terms, axis=0)
                    if not np.max(np.abs(rough)) <= ROUGH * np.max(np.abs(a[:, 0])):
                        raise FloatingPointError(
                            f"the Gauss stages do not resolve the motion at dt {dt:g}"
                        )
                a[:, :-1] = a[:, 1:]
                a[:, -1] = a[-1, -1]
                starts[:] = ends
                state = np.zeros((2, starts.shape[2] // len(places), size))
                state[:, :, places] = ends[:, 0].reshape(2, len(places), -1).swapaxes(1, 2)
                return tuple(state.reshape(2, *q.shape))
            starts[:, 1:] = ends[:, :-1]
            accelerate()
            last = change
        raise FloatingPointError(f"the Gauss stages do not settle at dt {dt:g}")

    gauss_step.halves = (
        True  # where its stages do not settle, or what follows fails, the step is tried in halves
    )
    return gauss_step


def total(a):
    """The sum of the squares, in order."""
    return sum(x * x for x in a.ravel().tolist())
