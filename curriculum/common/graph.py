"""Pairs that share an end feel each other: orders to eliminate them in, and whether they loop.

A pair (i, j) ties particle i to particle j or, where j < 0, to an anchor.
"""

from functools import lru_cache


@lru_cache(64)
def tied(pairs):
    """{particle or anchor: the pairs that end there, by number, in order}."""
    found = {}
    for k, pair in enumerate(pairs):
        for i in pair:
            found.setdefault(i, []).append(k)
    return found


def neighbours(pairs):
    """For each of `pairs`, the set of those (by number) that share a particle with it."""
    at = tied(pairs)
    return [set().union(*(at[i] for i in pair if i >= 0)) - {k} for k, pair in enumerate(pairs)]


@lru_cache(64)
def elimination_order(pairs):
    """[(k, rest)]: always the pair with the fewest neighbours left is next.

    `rest`: the pairs not yet eliminated that share a particle with pair k, or have come to through
    those before it. Minimum degree: A. George, J. W. H. Liu, SIAM Review 31 (1989) 1.
    """
    near, left, order = neighbours(pairs), set(range(len(pairs))), []
    while left:
        k = min(left, key=lambda k: (len(near[k]), k))
        left.remove(k)
        for other in near[k]:
            near[other] |= near[k]
            near[other] -= {k, other}
        order.append((k, sorted(near[k])))
    return order


@lru_cache(64)
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
