"""Gauss-Legendre collocation, an integrator like the others, of order 2 for each stage."""

import math
from decimal import Decimal, localcontext
from functools import lru_cache

from curriculum.common.programs import repeat, side_by_side

import numpy as np

ROUGH = 0.02  # last terms as a share of all: from there on a polynomial is no picture of the motion
DIGITS = 50  # in which nodes and weights are computed, so that every machine has the same doubles
MOST = 60  # rounds


def legendre(x, degree):
    """Legendre's polynomials P_0(x), ..., P_degree(x) of an array x, by their recurrence."""
    p = [np.ones_like(x), x]
    for k in range(1, degree):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return p


@lru_cache
def collocation(stages):
    """Gauss's rule on a step of 1: nodes c (s,), weights b (s,), matrix a (s, s) and its square.

    a_ij is the integral from 0 to c_i of the polynomial that is 1 at c_j and 0 at the other nodes,
    taken in Legendre's basis (E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration,
    II.1.3). And weights (2, s) of the last two terms in that basis of what is given at the nodes.
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
        ends = [b * (2 * k + 1) * p[k] for k in n[-2:]]
        parts = (x + 1) / 2, b, a, a @ a, ends
        return tuple(np.array(part, dtype=float) for part in parts)


def total(x):
    """The sum over the first axis of x: the second half is added to the first, again and again.

    So its order is the same everywhere, and a processor adds side by side. An odd one waits.
    """
    while len(x) > 1:
        half = len(x) // 2
        x = np.concatenate([x[:half] + x[half : 2 * half], x[2 * half :]])
    return x[0]


def combined(weights, a):
    """The sum of the arrays a (s, N, 3) by weights (s,): (N, 3)."""
    return total(weights[:, None, None] * a)


def squares(x):
    """The sum of the squares of an array."""
    return total(np.square(x).ravel())


def make_gauss(stages, tol=1e-16):
    """The rule of Gauss-Legendre collocation: order 2 * `stages`, symplectic, time-reversible.

    The accelerations of the stages solve a(t_s) = force(q(t_s), v(t_s)) / m. That is iterated as it
    stands (Hairer, Lubich, Wanner, VIII.6) until a round moves the end of the step by no more than
    `tol`, relatively, or as little as rounding allows. Raises Stop after MOST rounds or, with 6
    stages or more, where the polynomial through them has no digits: a run then tries halves.
    """

    def gauss_step(q, v, m, force, dt):
        c, b, once, twice, last_terms = collocation(stages)

        def iterate(a):  # and the square of how far that moves the end of the step
            def stage(c, once, twice, before):
                x = q + dt * c * v + dt * dt * combined(twice, a)
                after = force(x, v + dt * combined(once, a)) / m
                return after, squares(after - before)

            following, moved = side_by_side(stage, c, once, twice, a)
            return following, dt4 * total(moved)

        start, dt4 = squares(q) + dt * dt * squares(v), dt * dt * dt * dt
        first, moved = iterate(np.zeros((stages, *q.shape)))  # the particles coast
        scale = tol**2 * (start + moved) + 1e-300  # the square of a move that is small enough
        nearly = 1e-18 / tol**2  # by this scale: from so small on rounding may end the fall

        def another(state):  # accelerations, the move that led to them, and the move before it
            size, last = state[-2:]
            settled = (size <= 1.0) | ((last <= size) & (size <= nearly))  # or it falls no more
            following, moved = iterate(state[:-2].reshape(first.shape))
            following = np.concatenate([following.ravel(), [moved / scale, size]])
            return following, np.where(settled, 0.0, 2.0)

        begun = np.concatenate([first.ravel(), [moved / scale, np.inf]])
        ended = repeat(another, begun, MOST, "the Gauss stages do not settle")
        a = ended[:-2].reshape(first.shape)
        ends, checked = np.stack([b, b * (1.0 - c), *last_terms]), stages > 5
        ends = ends if checked else ends[:2]
        speed, place, *terms = side_by_side(lambda weights: combined(weights, a), ends)
        if checked:
            least = 1e-14 * start / dt4  # less moves nothing: rounding errors, a narrow spike
            wild = squares(np.stack(terms)) / (ROUGH**2 * squares(a) / stages + least + 1e-300)
            end = np.stack([speed, place])
            why = "the Gauss stages do not resolve the motion"
            speed, place = repeat(lambda x: (x, wild), end, 1, why)
        return q + dt * v + dt * dt * place, v + dt * speed

    return gauss_step
