"""Sparse linear systems: an order of elimination, the elimination, and iterative refinement.

The unknowns belong to pairs: (i, j) ties particle i to particle j or, where j < 0, to an anchor.
Pairs that share a particle are coupled: a row of the matrix has no other entries.
"""

from functools import lru_cache, wraps
from heapq import heappop, heappush

import numpy as np

from curriculum.common.tracing import ordered, while_loop

FEW = 8  # entries of a row: more are eliminated at once, by numpy
ROUNDS = 100  # of a refinement, at most


def cached(function):
    """function(pairs), computed once for equal pairs, whether lists or tuples."""
    known = lru_cache(64)(function)
    return wraps(function)(lambda pairs: known(tuple(map(tuple, pairs))))


def neighbours(pairs):
    """For each pair the set of the others, by number, that share a particle with it."""
    at = {}  # {particle or anchor: the pairs that end there}
    for k, pair in enumerate(pairs):
        for i in pair:
            at.setdefault(i, set()).add(k)
    return [set().union(*(at[i] for i in pair if i >= 0)) - {k} for k, pair in enumerate(pairs)]


@cached
def elimination_order(pairs):
    """[(k, rest)]: pair k is next, and `rest` are the pairs after it that are coupled with it.

    They are so by themselves or through pairs before it. The next is always one with the
    fewest neighbours (minimum degree: A. George, J. W. H. Liu, SIAM Review 31 (1989) 1).
    """
    near, order, done = neighbours(pairs), [], set()
    queue = sorted((len(others), k) for k, others in enumerate(near))  # which is a heap
    while queue:
        degree, k = heappop(queue)
        if k in done or degree != len(near[k]):  # it has another one by now
            continue
        done.add(k)
        for other in near[k]:
            near[other] |= near[k]
            near[other] -= {k, other}
            heappush(queue, (len(near[other]), other))
        order.append((k, sorted(near[k])))
    return order


@cached
def components(pairs):
    """[(the numbers of pairs that are coupled, however indirectly; whether they close a loop)].

    An anchor couples nothing, but a loop may go through the ground: all anchors count as one point.
    """
    near, left, found = neighbours(pairs), set(range(len(pairs))), []
    while left:
        part, todo = set(), {min(left)}
        while todo:
            part |= todo
            todo = set().union(*(near[k] for k in todo)) - part
        left -= part
        ends = {max(i, -1) for k in part for i in pairs[k]}
        found.append((sorted(part), len(part) >= len(ends)))  # a tree has one point more than pairs
    return found


def eliminated(a, order):
    """The function b (n,) -> np.linalg.solve(a, b) of a matrix a (n, n).

    Gaussian elimination without pivoting, which J M^-1 J^T does not need, in an
    `elimination_order`: entries known to be zero are never visited.
    """
    a = np.array(a, np.result_type(a, 1.0))  # a copy, of floats or of symbols
    for k, rest in order:
        columns = [rest] if len(rest) > FEW else rest
        for i in rest:
            a[i, k] = a[i, k] / a[k, k]  # minus so much of row k, row i is free of x[k]
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


def refined(times, near, diagonal, b, failure):
    """x (n,) with A x = b, by iterative refinement.

    times(x) is A x; near(b) solves for a matrix near A (n, n), whose diagonal is given. A round
    solves for what is left of b. They end at 1e-15 of b, or with one that gains less than half.
    """

    def size(left):
        return np.sum(left * (left / diagonal))

    def going(state):
        left, before = state[n:-1], state[-1]
        now = size(left)
        return np.where(now > enough, before > 4.0 * now, 0.0)  # sizes are squares

    def another(state):
        x, left = state[:n], state[n:-1]
        more = near(left)
        return np.concatenate([x + more, left - times(more), [size(left)]])

    n, enough, x = len(b), 1e-30 * size(b), near(b)
    start = np.concatenate([x, b - times(x), [np.inf]])
    return while_loop(going, another, start, ROUNDS, failure)[:n]
