"""Gauss-Legendre collocation, an integrator like the others, of order 2 for each stage."""

import math
from decimal import Decimal, localcontext
from functools import lru_cache, partial

import numpy as np

from curriculum.common.tracing import vmap, while_loop

DIGITS = 50  # in which nodes and weights are computed, so that the doubles are the same everywhere
ROUNDS = 60  # of the iteration of the stages, at most
TOL = 2e-16  # of the end of a step: what another round of the iteration may still change
PARTS = 256 + 8  # of a step, at most, and failed attempts: the shortest is 1/256 of it


def legendre(x, degree):
    """Legendre's polynomials P_0(x), ..., P_degree(x) of an array x, by their recurrence."""
    p = [np.ones_like(x), x]
    for k in range(1, degree):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return p


@lru_cache
def collocation(stages):
    """Gauss's rule on a step of 1: nodes c (s,), weights b (s,), matrix a (s, s) and its square.

    Source: E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, II.1.3.
    """
    n = range(stages)
    with localcontext(prec=DIGITS):
        x = np.array([Decimal(-math.cos(math.pi * (k + 0.75) / (stages + 0.5))) for k in n])
        for _ in range(6):  # Newton's method doubles the digits
            p = legendre(x, stages)
            slope = stages * (x * p[stages] - p[stages - 1]) / (x * x - 1)
            x = x - p[stages] / slope
        b = 1 / ((1 - x * x) * slope * slope)
        p = legendre(x, stages)
        terms = sum(np.outer(p[k + 1] - p[k - 1], p[k]) for k in n[1:])
        a = b / 2 * (x[:, None] + 1 + terms)
        parts = (x + 1) / 2, b, a, a @ a
        return tuple(np.array(part, dtype=float) for part in parts)


def pairwise_sum(x):
    """The sum of x over its first axis, halves of which are added side by side."""
    while len(x) > 1:
        half = len(x) // 2
        x = np.concatenate([x[:half] + x[half : 2 * half], x[2 * half :]])
    return x[0]


def combined(weights, a):
    return pairwise_sum(weights[:, None, None] * a)


def sum_of_squares(x):
    return pairwise_sum(np.square(x).ravel())


def attempt(stages, q, v, m, force, dt):
    """q and v (N, 3) after dt s, and whether the stages have converged: 1.0 or 0.0.

    A round computes each stage's acceleration a_s = force(q_s, v_s) / m, (stages, N, 3) in all, at
    the place and speed that those of the round before give it (Hairer, Lubich, Wanner, VIII.6).
    """
    c, b, once, twice = collocation(stages)
    dt4 = dt * dt * dt * dt

    def next_round(a, move, before, count):  # (move of this round)^2, that of the last, in m^2
        def stage(c, once, twice, before):
            x = q + dt * c * v + dt * dt * combined(twice, a)
            after = force(x, v + dt * combined(once, a)) / m
            return after, sum_of_squares(after - before)

        after, moved = vmap(stage)(c, once, twice, a)
        return after, dt4 * pairwise_sum(moved), move, count + 1.0

    def has_converged(move, before):
        limit = np.where(before <= move, rounding, enough)  # what no longer falls is rounding
        return np.where(move <= limit, 1.0, 0.0)

    def is_going(a, move, before, count):
        going = np.where(count < ROUNDS, 1.0 - has_converged(move, before), 0.0)
        return np.where(move < np.inf, going, 0.0)  # it may be NaN

    # as if the particles coasted before
    a, move, _, _ = next_round(np.zeros((stages, *q.shape)), 0.0, 0.0, 0.0)
    # how wide the points are and how far they go: wherever the origin is, and at rest, too
    wide = sum_of_squares(q - pairwise_sum(q) / len(q))
    size = wide + dt * dt * sum_of_squares(v) + move
    enough = TOL * TOL * size + 1e-300
    # A move that no longer falls is taken for rounding if it is small. All of these are squares. A
    # force may magnify rounding, so 1e-9 of the size will do. A bob at rest may have no size: dt4
    # is what 1 m/s^2 moves in dt. Far from the origin q is rounded to 1e-16 of its distance.
    rounding = 1e-18 * (size + dt4) + 1e-30 * sum_of_squares(q)
    rounding = np.maximum(enough, rounding)
    first = a, move, np.inf, 1.0
    a, move, before, _ = while_loop(is_going, next_round, *first, most=ROUNDS, failure="")
    q = q + dt * v + dt * dt * combined(b * (1.0 - c), a)
    return q, v + dt * combined(b, a), has_converged(move, before)


def step_in_parts(stages, parts, q, v, m, force, dt):
    """The step in one part or, where its stages do not converge, in shorter ones."""

    def next_part(q, v, left, part):  # what is left of the step, and how long the next part is
        q_next, v_next, converged = attempt(stages, q, v, m, force, part * dt)
        q = np.where(converged, q_next, q)
        v = np.where(converged, v_next, v)
        left = np.where(converged, left - part, left)
        part = np.where(converged, part, 0.5 * part)
        return q, v, left, part

    def is_left(q, v, left, part):
        return left > 0.0

    failure = "the Gauss stages do not converge"
    return while_loop(is_left, next_part, q, v, 1.0, 1.0, most=parts, failure=failure)[:2]


def make_gauss(stages, parts=PARTS):
    """A step(q, v, m, force, dt) of Gauss-Legendre collocation: symplectic, of order 2 * `stages`.

    It takes q and v (N, 3) in m and m/s, m (N, 1) in kg, force(q, v) -> (N, 3) in N, and dt in s,
    and returns q and v. Its stages are iterated until a round moves the end by a share of TOL, or
    as rounding allows. Where they do not converge, the step is taken in halves, in so many `parts`
    at most, failed ones among them; then it is NaN.
    """
    return partial(step_in_parts, stages, parts)
