"""Linear systems in which few unknowns feel each other: an order of elimination, and refinement.

The unknowns belong to pairs: (i, j) ties particle i to particle j or, where j < 0, to an anchor.
Pairs that share a particle feel each other.
"""

from collections.abc import Callable
from functools import lru_cache, wraps
from heapq import heappop, heappush
from typing import NamedTuple

from curriculum.common.arrays import ordered
from curriculum.common.programs import repeat

import numpy as np

FEW = 8  # unknowns: for more a row is eliminated at once by numpy
ROUNDS = 100  # of a refinement, at most: then it is given up
EPS = 2.0**-52  # of a matrix: less is rounding


def once(function):
    """function(pairs), which is found once for equal pairs, be they lists or tuples."""
    known = lru_cache(64)(function)
    return wraps(function)(lambda pairs: known(tuple(map(tuple, pairs))))


def neighbours(pairs):
    """[{the others that share a particle with a pair}], of pairs by number."""
    at = {}  # {particle or anchor: the pairs that end there}
    for k, pair in enumerate(pairs):
        for i in pair:
            at.setdefault(i, set()).add(k)
    return [set().union(*(at[i] for i in pair if i >= 0)) - {k} for k, pair in enumerate(pairs)]


@once
def elimination_order(pairs):
    """[(k, rest)]: always the pair with the fewest neighbours left is next.

    `rest`: the pairs still left that feel pair k, by themselves or through those before it. Minimum
    degree: A. George, J. W. H. Liu, SIAM Review 31 (1989) 1.
    """
    near, order, done = neighbours(pairs), [], set()
    queue = sorted((len(others), k) for k, others in enumerate(near))  # which is a heap
    while queue:
        many, k = heappop(queue)
        if k in done or many != len(near[k]):  # it has got fewer or more meanwhile
            continue
        done.add(k)
        for other in near[k]:
            near[other] |= near[k]
            near[other] -= {k, other}
            heappush(queue, (len(near[other]), other))
        order.append((k, sorted(near[k])))
    return order


@once
def parts(pairs):
    """[(the pairs, by number, that hang together, whether they close a loop)].

    Pairs that only share an anchor do not. A loop may go through the ground: all anchors are one.
    """
    near, left, found = neighbours(pairs), set(range(len(pairs))), []
    while left:
        part, todo = set(), {min(left)}
        while todo:
            part |= todo
            todo = set().union(*(near[k] for k in todo)) - part
        left -= part
        ends = {max(i, -1) for k in part for i in pairs[k]}
        found.append((sorted(part), len(part) >= len(ends)))  # a tree has one end more than pairs
    return found


def has_loop(pairs):
    """Whether the pairs close a loop, maybe through the ground."""
    return any(loop for _, loop in parts(pairs))


def eliminated(a, order):
    """solve(b) (n,), which gives what np.linalg.solve(a, b) gives for a (n, n).

    Gauss's elimination without pivots, for matrices like J M^-1 J^T, in an `elimination_order`:
    what is zero for certain is never visited.
    """
    a = np.array(a, np.result_type(a, 1.0))  # a copy, of floats or of symbols
    for k, rest in order:
        columns = [rest] if len(rest) > FEW else rest
        for i in rest:
            a[i, k] = a[i, k] / a[k, k]  # less so much of row k, row i is free of x[k]
            for j in columns:
                a[i, j] = a[i, j] - a[i, k] * a[k, j]

    def solve(b):
        x = np.array(b, a.dtype)
        for k, rest in order:
            for i in rest:
                x[i] = x[i] - a[i, k] * x[k]
        for k, rest in reversed(order):
            for j in rest:
                x[k] = x[k] - a[k, j] * x[j]
            x[k] = x[k] / a[k, k]
        return ordered(x)

    return solve


class LinearSystem(NamedTuple):
    """What `refined` needs to know of A x = b. `rough` solves for a matrix near A, A + slack diag A
    + T; A (n, n) and T are positive semidefinite."""

    times: Callable  # (n,) -> (n,), A x
    diagonal: np.ndarray  # (n,), of A
    b: np.ndarray  # (n,)
    rough: Callable  # (n,) -> (n,), which solves for the matrix near A
    slack: float  # a share of diag A, as above
    complaint: str  # of a Stop, if no round is the last one

    def weigh(self, left):
        """The size, squared, of what is left of b."""
        return np.sum(left * (left / self.diagonal))

    def end(self, size, before):
        """At most 1 if the size is 1e-15 of b's, or over half of what it was; all are squared."""
        enough = 1e-30 * self.weigh(self.b)
        return size * before / (4.0 * size * size + enough * before + 1e-300)


def refined(problem):
    """x (n,) with A x = b, and what is left of b, (n,), by rounds that solve for what is left.

    They go on until that is 1e-15 of b, or a round does not halve it. Raises Stop if neither comes.
    """
    b = problem.b

    def another(state):  # x, what is left, and behind it the size of that a round ago
        x, left = state[:-1].reshape(2, -1)
        size, more = problem.weigh(left), problem.rough(left)
        following = [x + more, left - problem.times(more), [size]]
        return np.concatenate(following), problem.end(size, state[-1])

    x = problem.rough(b)
    start = np.concatenate([x, b - problem.times(x), [problem.weigh(b)]])
    return repeat(another, start, ROUNDS, problem.complaint)[:-1].reshape(2, -1)


def conjugated(problem, x, left):
    """The x that refined() has found, and further, by conjugate gradients, for what is left of b.

    Rounds of refinement hardly move x along a vector p where A is far less than the matrix near it.
    These go as far as p . A p says, and nowhere where A is less than T or EPS diag A: it is noise.
    """

    def another(state):
        x, left, p = state[:-4].reshape(3, -1)
        work_before, stiff_before, before, long_before = state[-4:]
        size, new = problem.weigh(left), problem.rough(left)
        work = left @ new  # = new . (A + slack diag A + T) new
        share = work / work_before
        p = new + share * p  # so that A p is orthogonal to the p before
        image = problem.times(p)
        stiff, heavy = p @ image, new @ (problem.diagonal * new)
        rest = work - (stiff + share * share * stiff_before) - problem.slack * heavy  # new . T new
        least = np.maximum(rest, EPS * heavy) + 1e-300
        step = np.where(stiff < least, 0.0, work / np.maximum(stiff, least))
        before = np.where(stiff < least, 0.0, before)  # then this is the last round
        following = [x + step * p, left - step * image, p, [work, stiff, size, before]]
        return np.concatenate(following), problem.end(size, long_before)

    # a round may leave more, and the next one far less: two together must halve it
    much = 16.0 * problem.weigh(problem.b)
    start = np.concatenate([x, left, 0.0 * left, [1.0, 0.0, much, much]])
    return repeat(another, start, ROUNDS, problem.complaint)[: len(x)]
