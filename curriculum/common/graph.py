"""Which rods feel each other: the order in which to eliminate them, and whether they close a
loop."""

from functools import lru_cache


@lru_cache(64)
def elimination_order(pairs):
    """[(k, rest)] for rods `pairs` (i, j), j < 0 an anchor: always the one with the fewest
    neighbours left is next.

    `rest`: the rods not yet eliminated that share a particle with rod k, or have come to through
    those before it. Minimum degree: A. George, J. W. H. Liu, SIAM Review 31 (1989) 1.
    """
    at = {}
    for k, pair in enumerate(pairs):
        for i in pair:
            at.setdefault(i, set()).add(k)
    near = [set().union(*(at[i] for i in pair if i >= 0)) - {k} for k, pair in enumerate(pairs)]
    left, order = set(range(len(pairs))), []
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
    """Whether rods close a loop, maybe through the ground: then one may be too many, or J lose rank
    in some pose."""
    leader = {}

    def find(i):
        while i in leader:
            leader[i] = leader.get(leader[i], leader[i])  # the way is shorter next time
            i = leader[i]
        return i

    for i, j in pairs:
        a, b = find(i), find(max(j, -1))
        if a == b:
            return True
        leader[max(a, b)] = min(a, b)
    return False
