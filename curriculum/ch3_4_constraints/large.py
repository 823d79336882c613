"""Scenes of many rods: the chapter's equation once more, on whole arrays.

Straight-line code takes its time to be made. Beyond CHAIN rods in a row, or LINKAGE others, arrays
are done sooner, and so are few rods that all feel each other. A = J M^-1 J^T of a chain has three
diagonals: cyclic reduction. Any other linkage's stands near the diagonal once its rods are well
ordered: elimination by blocks. What a Hold asks for, and when a rod is right, is the chapter's to
say: it hands these in.
"""

from collections import defaultdict
from itertools import product

from curriculum.ch3_4_constraints.statics import INSTANT, differences, near, unanswered
from curriculum.common.graph import band_order, elimination_order, has_loop
from curriculum.common.trace import Stop, repeat

import numpy as np

CHAIN, LINKAGE = 40, 64  # rods
FILL = 1000  # subtractions of entries that an elimination takes
SWEEP = 80  # unknowns of a chain: so few are walked through sooner than reduced
BLOCK = 24  # rods of a block, at least: below, calls of numpy cost more than what they do
BLUR = 1e-9  # of A's diagonal, in a loop: enough for what inverses of blocks lose
EXACT = 1e-15  # a solve is done when it leaves this of A's diagonal times lambda


def takes(system):
    """Whether a system is for this module: many rods or particles, or many that feel each other."""
    pairs, n = tuple(map(tuple, system["pairs"])), len(system["m"])
    if len(pairs) > LINKAGE or n > 2 * LINKAGE:
        return True
    fill = sum(len(rest) ** 2 for _, rest in elimination_order(pairs))
    return fill > FILL or (len(pairs) > CHAIN and in_a_row(pairs, n))


def in_a_row(pairs, n):
    """Whether rods (i, j), a tuple of tuples, make a chain of all n particles."""
    return pairs == tuple((k, k - 1) for k in range(n))


def dot(a, b):
    """a . b (...) of vectors (..., 3), added up in this order: twice as fast as np.sum."""
    x = a * b
    return x[..., 0] + x[..., 1] + x[..., 2]


class Chain:
    """Rods in a row, each tied to the one before it, the first to the first anchor."""

    order, way = slice(None), "by arrays: cyclic reduction"

    def __init__(self, _, m, lengths):
        self.lengths, self.between = lengths, 1.0 / m[:-1]
        self.own = 1.0 / m + np.append(0.0, self.between)  # A's diagonal, of unit vectors

    def vectors(self, x, anchors):
        """x_i - x_j of every rod (..., C, 3), of x (..., N, 3), which at the anchors is (K, 3)."""
        d = x.copy()
        d[..., 0, :] -= anchors[0]
        d[..., 1:, :] -= x[..., :-1, :]
        return d

    def pull(self, along, lam):
        """J^T lambda (..., N, 3), J made of `along`."""
        felt = lam[..., None] * along
        felt[..., :-1, :] -= felt[..., 1:, :]  # a rod pulls its particle, and back the one before
        return felt

    def multipliers(self, d, along, b, turn, softness=0.0):
        """lambda (..., C) with (A + softness diag A) lambda = b, A = J(d) M^-1 J(along)^T."""
        diagonal = dot(d, along) * ((1.0 + softness) * self.own)
        upper = self.between * dot(d[..., :-1, :], along[..., 1:, :])  # of -A
        lower = upper if d is along else self.between * dot(d[..., 1:, :], along[..., :-1, :])
        return cyclic_reduction(diagonal, upper, lower, b)


class Linkage:
    """Any other rods, in an order in which those that feel each other stand near one another.

    `rows`, `columns`: where A has entries, ordered; `shares`: what they are of unit vectors, a sum
    over the particles that both rods are tied to. `places`: the entries' in the blocks
    (3, count, size, size), which stand on A's diagonal, right of it and, at -1, below it.
    """

    def __init__(self, pairs, m, lengths):
        self.order, self.n, self.loop = band_order(pairs), len(m), has_loop(pairs)
        self.lengths, self.pairs = lengths[self.order], np.array(pairs)[self.order]
        tied, shares = defaultdict(list), defaultdict(float)
        for k, (i, j) in enumerate(self.pairs):
            tied[i].append((k, 1.0))
            tied[j].append((k, -1.0))
        for p in range(self.n):
            for (k, sign), (other, its) in product(tied[p], repeat=2):
                shares[k, other] += sign * its / m[p]
        places, self.shares = map(np.array, zip(*sorted(shares.items()), strict=True))
        self.rows, self.columns = places.T
        self.diagonal = np.flatnonzero(self.rows == self.columns)
        self.own = self.shares[self.diagonal]
        _, self.first_column = np.unique(self.rows, return_index=True)
        self.size = min(len(pairs), max(BLOCK, int(np.max(self.columns - self.rows))))
        self.count = -(-len(pairs) // self.size)
        (k, row), (o, column) = (np.divmod(x, self.size) for x in (self.rows, self.columns))
        self.places = np.sign(o - k), np.minimum(k, o), row, column
        self.way = f"by arrays: blocks of {self.size} rods"

    def vectors(self, x, anchors):
        """As a Chain's."""
        return differences(x, anchors, self.pairs)

    def pull(self, along, lam):
        """As a Chain's."""
        (i, j), felt = self.pairs.T, lam[..., None] * along
        force = np.zeros((*lam.shape[:-1], self.n + max(0, -np.min(j)), 3))  # anchors come last
        np.add.at(force, (..., i, slice(None)), felt)
        np.subtract.at(force, (..., j, slice(None)), felt)
        return force[..., : self.n, :]

    def multipliers(self, d, along, b, turn, softness=0.0):
        """As a Chain's. In a loop a rod may be too many, or J lose rank: there A gets what `turn`
        (..., C, 3) makes of it, and rounds take that back for as long as they help. What is left
        of b then, `unheld` tells. Raises Stop where lambda is no number.
        """
        if b.ndim > 1:  # one after the other: the blocks of all at once would fill the memory
            lam = np.empty_like(b)
            for at in np.ndindex(b.shape[:-1]):
                lam[at] = self.multipliers(d[at], along[at], b[at], turn[at], softness)
            return lam
        values = self.shares * dot(d[self.rows], along[self.columns])
        values[self.diagonal] *= 1.0 + softness
        own, spread = values[self.diagonal], values.copy()
        if self.loop:
            spread[self.diagonal] *= 1.0 + BLUR
            spread += self.shares * dot(turn[self.rows], turn[self.columns])
        solve = self.eliminated(spread)
        lam, last = solve(b), np.inf
        while True:
            left = b - np.add.reduceat(values * lam[self.columns], self.first_column)
            size = np.max(np.abs(left))
            if size <= EXACT * np.max(np.abs(own * lam)) or not size < 0.5 * last:
                break
            lam, last = lam + solve(left), size
        if not np.isfinite(size):
            raise Stop("no finite tensions")
        return lam

    def eliminated(self, values):
        """x(b) with A x = b, A of `values`: Gauss's elimination, its pivots blocks."""
        blocks = np.zeros((3, self.count, self.size, self.size))
        blocks[0] = np.eye(self.size)  # what is no rod stays alone
        blocks[self.places] = values
        own, right, below = blocks
        try:
            inverses, ratios = [np.linalg.inv(own[0])], []
            for k in range(1, self.count):
                ratios.append(below[k - 1] @ inverses[-1])
                inverses.append(np.linalg.inv(own[k] - ratios[-1] @ right[k - 1]))
        except np.linalg.LinAlgError:
            raise Stop("no finite tensions") from None

        def solve(b):
            x = np.append(b, np.zeros(own[:, 0].size - len(b))).reshape(own[:, 0].shape)
            for k, ratio in enumerate(ratios):
                x[k + 1] -= ratio @ x[k]
            x[-1] = inverses[-1] @ x[-1]
            for k in reversed(range(len(ratios))):
                x[k] = inverses[k] @ (x[k] - right[k] @ x[k + 1])
            return x.ravel()[: len(b)]

        return solve


def cyclic_reduction(diagonal, upper, lower, b):
    """x (..., n) with diagonal_k x_k - upper_k x_k+1 - lower_k-1 x_k-1 = b_k.

    Every other x is eliminated, and again: R. W. Hockney, J. ACM 12 (1965) 95. By + - * / alone:
    the same on every processor.
    """
    n = b.shape[-1]
    if n <= SWEEP:
        return swept(diagonal, upper, lower, b)
    even, y, down, up = diagonal[..., ::2], b[..., ::2], upper[..., ::2], lower[..., 1::2]
    left, right = lower[..., ::2] / even[..., : n // 2], upper[..., 1::2] / even[..., 1:]
    half, known = diagonal[..., 1::2] - left * down, b[..., 1::2] + left * y[..., : n // 2]
    both = slice((n - 1) // 2)  # of the odd ones: the last has no right neighbour if n is even
    half[..., both] -= right * up
    known[..., both] += right * y[..., 1:]
    inner = slice(n // 2 - 1)
    to_right, to_left = right[..., inner] * down[..., 1:], left[..., 1:] * up[..., inner]
    x = np.empty_like(b)
    x[..., ::2], x[..., 1::2] = y, (odd := cyclic_reduction(half, to_right, to_left, known))
    x[..., 2::2] += up * odd[..., both]
    x[..., :-1:2] += down * odd
    x[..., ::2] /= even
    return x


def swept(*arrays):
    """As cyclic_reduction: one sweep out and one back, of numbers or arrays (...)."""
    lists = (x.tolist() if x.ndim == 1 else list(np.moveaxis(x, -1, 0)) for x in arrays)
    diagonal, upper, lower, x = lists
    for k, (up, low) in enumerate(zip(upper, lower, strict=True)):
        ratio = low / diagonal[k]
        diagonal[k + 1] = diagonal[k + 1] - ratio * up
        x[k + 1] = x[k + 1] + ratio * x[k]
    x[-1] = x[-1] / diagonal[-1]
    for k in reversed(range(len(upper))):
        x[k] = (x[k] + upper[k] * x[k + 1]) / diagonal[k]
    return np.moveaxis(np.array(x), 0, -1)


class LargeForce:
    """force(q, v) -> N (..., N, 3), rods and all, as the chapter's make_force gives it.

    right_side(hold, lengths, J M^-1 f, g, gdot, jdotv) is b (..., C) in A lambda = b.
    `after`: (q_start, q, v, dt) -> (q, v), what ends a step, or None. `way`: how, in words.
    """

    def __init__(self, system, hold, external_force, right_side):
        self.system, self.hold = system, hold
        self.external_force, self.right_side = external_force, right_side
        pairs, m = tuple(map(tuple, system["pairs"])), np.ravel(system["m"])
        kind = Chain if in_a_row(pairs, len(m)) else Linkage
        self.rods = kind(pairs, m, np.asarray(system["lengths"]))
        self.anchors = np.asarray(system["anchors"])
        self.way, self.after = self.rods.way, self.project if hold.after else None

    def errors(self, q):
        """Rods d (..., C, 3) of particles q (..., N, 3), and their g (..., C)."""
        d = self.rods.vectors(q, self.anchors)
        return d, 0.5 * (dot(d, d) - self.rods.lengths * self.rods.lengths)

    def rates(self, v):
        """The difference (..., C, 3) over each rod of velocities or accelerations (..., N, 3)."""
        return self.rods.vectors(v, 0.0 * self.anchors)

    def answer(self, q, v):
        """f (..., N, 3), rods d (..., C, 3), lambda and b (..., C), at q, v (..., N, 3)."""
        f = np.broadcast_to(self.external_force(self.system, q, v), q.shape)  # it may be a list
        (d, g), rate, a = self.errors(q), self.rates(v), f / self.system["m"]
        terms = dot(d, self.rates(a)), g, dot(d, rate), dot(rate, rate)
        b = self.right_side(self.hold, self.rods.lengths, *terms)
        return f, d, self.rods.multipliers(d, d, b, INSTANT * rate, self.hold.softness), b

    def __call__(self, q, v):
        f, d, lam, _ = self.answer(q, v)
        return f + self.rods.pull(d, lam)

    def tensions(self, q, v):
        """Newtons (..., C) with which the rods pull; below zero they push."""
        _, d, lam, _ = self.answer(q, v)
        pulls = np.empty_like(lam)
        pulls[..., self.rods.order] = -lam * np.sqrt(dot(d, d))
        return pulls

    def unheld(self, q, v):
        """How much of what b asks for is left unanswered (...)."""
        _, d, lam, b = self.answer(q, v)
        given = self.hold.softness * self.rods.own * dot(d, d) * lam
        left = b - given - dot(d, self.rates(self.rods.pull(d, lam) / self.system["m"]))
        return unanswered(left, b, self.rods.lengths)

    def project(self, q_start, q, v, dt):
        """The chapter's: a step from q_start that ended at q, v, put back to g = 0 and J v = 0."""
        along = self.rods.vectors(q_start, self.anchors)
        close = near(self.rods.lengths, q_start)

        def correction(d, along, b):
            lam = self.rods.multipliers(d, along, b, 0.0 * d)
            return self.rods.pull(along, lam) / self.system["m"]

        def newton(q):
            d, g = self.errors(q)
            return q - correction(d, along, g), np.max(np.abs(g) / close)

        end = repeat(newton, q, 20, "no way back onto the rods")
        v, (d, _) = v + (end - q) / dt, self.errors(end)
        return end, v - correction(d, d, dot(d, self.rates(v)))
