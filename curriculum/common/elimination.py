"""Linear systems in which few unknowns feel each other: an order of elimination, and refinement.

The unknowns belong to pairs: (i, j) ties particle i to particle j or, where j < 0, to an anchor.
Pairs that share a particle feel each other.
"""

from functools import lru_cache, wraps
from heapq import heapify, heappop, heappush

from curriculum.common.arrays import ordered
from curriculum.common.trace import repeat

import numpy as np

FEW = 8  # unknowns


def once(function):
    """function(pairs), which is found once for equal pairs, be they lists or tuples."""
    known = lru_cache(64)(function)
    return wraps(function)(lambda pairs: known(tuple(map(tuple, pairs))))


@once
def tied(pairs):
    """{particle or anchor: the pairs that end there, by number, in order}."""
    found = {}
    for k, pair in enumerate(pairs):
        for i in pair:
            found.setdefault(i, []).append(k)
    return found


@once
def elimination_order(pairs):
    """[(k, rest)]: always the pair with the fewest neighbours left is next.

    `rest`: the pairs not yet eliminated that share a particle with pair k, or have come to through
    those before it. Minimum degree: A. George, J. W. H. Liu, SIAM Review 31 (1989) 1.
    """
    at, order = tied(pairs), []
    near = [set().union(*(at[i] for i in pair if i >= 0)) - {k} for k, pair in enumerate(pairs)]
    queue, done = [(len(others), k) for k, others in enumerate(near)], set()
    heapify(queue)
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
def has_loop(pairs):
    """Whether the pairs close a loop, maybe through the ground: all anchors are one."""
    trees = {}  # {particle: the set of all that it is tied to}
    for i, j in pairs:
        less, more = sorted((trees.setdefault(x, {x}) for x in (i, max(j, -1))), key=len)
        if less is more:
            return True
        more |= less
        trees |= dict.fromkeys(less, more)
    return False


@once
def parts(pairs):
    """[(the pairs, by number, that hang together, whether they close a loop)].

    Pairs that only share an anchor do not feel each other. A loop may go through the ground: all
    anchors are one.
    """
    at, left, found = tied(pairs), set(range(len(pairs))), []
    while left:
        part, todo = set(), {min(left)}
        while todo:
            part |= todo
            ends = {i for k in todo for i in pairs[k] if i >= 0}
            todo = set().union(*(at[i] for i in ends)) - part
        left -= part
        part = sorted(part)
        found.append((part, has_loop([pairs[k] for k in part])))
    return found


def eliminated(a, order):
    """solve(b) (n,), which gives what np.linalg.solve(a, b) gives for a (n, n).

    Gauss's elimination without pivots, for matrices like J M^-1 J^T. `order`: [(k, the others still
    left that k feels)], of `elimination_order`; what is zero for certain is never visited.
    """
    a = np.array(a, np.result_type(a, 1.0))  # a copy, of floats or of symbols
    for k, rest in order:
        for i in rest:
            a[i, k] = a[i, k] / a[k, k]  # less so much of row k, row i is free of x[k]
            if len(rest) > FEW:  # for so many numpy is quicker than a loop, and does the same
                a[i, rest] = a[i, rest] - a[i, k] * a[k, rest]
                continue
            for j in rest:
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


def refined(rough, a, b, complaint):
    """x (n,) with a x = b, by rough(b) (n,), which solves for a matrix near a (n, n).

    Rounds solve for what is left of b, weighed by a's diagonal, until that is 1e-15 of b or a round
    does not halve it: the residual ends them, not a count. Raises Stop(complaint) if nothing does.
    """
    a, b = ordered(a), ordered(b)
    own = ordered(np.diagonal(a))

    def weigh(x):
        return np.sum(x * (x / own))

    enough = 1e-30 * weigh(b)  # 1e-15 of b, squared

    def another(state):  # x, and behind it what was left before the last round
        x, before = state[:-1], state[-1]
        residual = b - a @ x
        left = weigh(residual)
        # the size is at most 1 if that is enough, or more than before / 4
        size = left * before / (4.0 * left * left + enough * before + 1e-300)
        return np.append(x + rough(residual), left), size

    start = np.append(rough(b), weigh(b))
    return repeat(another, start, 100, complaint)[:-1]
