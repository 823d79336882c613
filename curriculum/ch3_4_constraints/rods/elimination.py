"""The sparse matrix A of rods: which parts it has, and an order of elimination.

A pair (i, j) is a rod, which ties particle i to particle j or, where j < 0, to an anchor. Rods that
share a particle are coupled: a row of A has no other entries.
"""

from functools import lru_cache, wraps
from heapq import heappop, heappush

import numpy as np


def cached(function):
    """A function of pairs, which need not be hashable, that remembers what it has found."""
    known = lru_cache(64)(function)
    return wraps(function)(lambda pairs: known(tuple(map(tuple, pairs))))


def neighbours(pairs):
    """For each pair the set of the others that share a particle with it."""
    at = {}  # {particle or anchor: the pairs that end there}
    for k, pair in enumerate(pairs):
        for i in pair:
            at.setdefault(i, set()).add(k)
    near = []
    for k, pair in enumerate(pairs):
        others = set()
        for i in pair:
            if i >= 0:
                others |= at[i]
        near.append(others - {k})
    return near


@cached
def uncoupled(pairs):
    """The mask (C, C) of the entries that are zero, since their pairs share no particle."""
    mask = np.ones((len(pairs), len(pairs)), bool)
    for k, others in enumerate(neighbours(pairs)):
        mask[k, [k, *others]] = False
    return mask


@cached
def elimination_order(pairs):
    """The pairs' numbers by minimum degree (A. George, J. Liu, SIAM Review 31 (1989) 1)."""
    near = neighbours(pairs)
    order = []
    queue = sorted((len(others), k) for k, others in enumerate(near))  # which is a heap
    while queue:
        degree, k = heappop(queue)
        if k in order or degree != len(near[k]):  # it has another one by now
            continue
        order.append(k)
        for other in near[k]:  # which are coupled from now on, through this one
            near[other] |= near[k]
            near[other] -= {k, other}
            heappush(queue, (len(near[other]), other))
    return order


@cached
def components(pairs):
    """[(the numbers of pairs that are coupled, however indirectly; whether they close a loop)]."""
    near = neighbours(pairs)
    left = set(range(len(pairs)))
    found = []
    while left:
        part = set()
        todo = {min(left)}
        while todo:
            part |= todo
            todo = set().union(*(near[k] for k in todo)) - part
        left -= part
        ends = set()
        for k in part:
            ends |= {max(i, -1) for i in pairs[k]}  # all anchors are one: the ground
        found.append((sorted(part), len(part) >= len(ends)))  # a tree has one point more than pairs
    return found
