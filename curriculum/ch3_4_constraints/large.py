"""Scenes of many rods, by whole arrays: the chapter's formulas again, A stored as what of it is not
zero.

Straight-line code takes its time to be made, and more the larger the scene. 4000 steps of more than
CHAIN rods in a row, or of more than LINKAGE otherwise, are done sooner like this, and so are those
of few rods that all feel each other. A chain's A has three diagonals, which are halved by cyclic
reduction; that of any other linkage goes to a dense solve up to LINKAGE rods, beyond that to
scipy's sparse LU or, without scipy, up to DENSE rods to the dense one.
"""

from functools import lru_cache
from importlib.util import find_spec
from typing import NamedTuple

from curriculum.common.arrays import leading_first
from curriculum.common.graph import elimination_order, has_loop

import numpy as np

CHAIN, LINKAGE, DENSE = 40, 64, 1000  # rods
FILL = 1000  # subtractions of entries that an elimination takes
INSTANT = 5e-4  # s, as in the chapter
SHORT = 80  # unknowns: below, walking through costs less than halving


class Structure(NamedTuple):
    """What the pairs of a scene say of A: entries (rows, columns) with the particle they are due
    to, and its sign."""

    chain: bool
    loop: bool
    i: np.ndarray
    j: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    particles: np.ndarray
    signs: np.ndarray


@lru_cache(8)
def structure(pairs, n):
    """The Structure of rods (i, j), a tuple of tuples, among n particles."""
    i, j = np.transpose(pairs)
    if len(pairs) == n and all(pair == (k, k - 1) for k, pair in enumerate(pairs)):
        return Structure(True, False, i, j, *[np.empty(0)] * 4)
    at = {}
    for k, pair in enumerate(pairs):
        for particle, sign in zip(pair, (1.0, -1.0), strict=True):
            if particle >= 0:
                at.setdefault(particle, []).append((k, sign))
    entries = [(k, o, p, s * t) for p, rods in at.items() for k, s in rods for o, t in rods]
    rows, columns, particles, signs = (np.array(column) for column in zip(*entries, strict=True))
    return Structure(False, has_loop(pairs), i, j, rows, columns, particles, signs)


def of(system, last=[None, None, None]):  # noqa: B006
    """The Structure of a system. Whether it is still the last one's costs a comparison, which sees
    every edit."""
    if system["pairs"] != last[0] or len(system["m"]) != last[1]:
        pairs, n = [tuple(pair) for pair in system["pairs"]], len(system["m"])
        last[:] = pairs, n, structure(tuple(pairs), n)
    return last[2]


@lru_cache(64)
def fill(pairs):
    """What an elimination of the rods `pairs` takes, in subtractions of entries."""
    return sum(len(rest) ** 2 for _, rest in elimination_order(pairs))


def takes(system):
    """Whether a system is for this module: many rods, or many that feel each other, or many
    particles on few rods."""
    rods, n = len(system["pairs"]), len(system["m"])
    if rods > LINKAGE or n > 2 * LINKAGE:
        return True
    return (rods > CHAIN and of(system).chain) or fill(tuple(map(tuple, system["pairs"]))) > FILL


def dense(rods):
    """Whether so many rods that are no chain go to a dense solve."""
    return rods <= LINKAGE or not find_spec("scipy")


def way(system):
    """In words, how the forces of this scene are found; None if that takes scipy, which is not
    installed."""
    rods = len(system["pairs"])
    if of(system).chain:
        return "by arrays: cyclic reduction"
    if not dense(rods):
        return "by arrays: sparse LU"
    if rods <= LINKAGE:
        return "by arrays: dense LU"
    return "by arrays: dense LU, as scipy is not installed" if rods <= DENSE else None


# Here x, y and z come first: rod vectors are (3, ..., C), particles (3, ..., N), so that every
# array is contiguous.


def components_first(x, shape=None):
    """(..., N, 3) -> (3, ..., N), contiguous; `shape`: what x is to be broadcast to."""
    first = x.transpose(-1, *range(x.ndim - 1))
    if first.flags.c_contiguous and shape is None:
        return first
    first = np.empty((3, *(shape or x.shape)[:-1]))
    first.transpose(*range(1, first.ndim), 0)[...] = x
    return first


def rod_vectors(rods, x, anchors=None):
    """x_i - x_j of every rod, of x (3, ..., N), which at the anchors is `anchors` (K, 3), or
    zero."""
    if rods.chain:
        d = np.empty_like(x)
        np.subtract(x[..., 1:], x[..., :-1], out=d[..., 1:])
        d[..., 0] = x[..., 0] - (
            0.0 if anchors is None else np.reshape(anchors[0], (3, *[1] * (x.ndim - 2)))
        )
        return d
    fixed = np.zeros((-min(-1, rods.j.min()), 3)) if anchors is None else np.asarray(anchors)
    fixed = fixed[::-1].T.reshape(3, *[1] * (x.ndim - 2), -1)
    ends = np.concatenate([x, np.broadcast_to(fixed, (*x.shape[:-1], fixed.shape[-1]))], axis=-1)
    return x[..., rods.i] - ends[..., rods.j]


def dot(a, b):
    """(3, ...), (3, ...) -> (...), added up in this order."""
    x, y, z = a * b
    return x + y + z


def multipliers(rods, m, d, along, b, turn, off, softness=0.0):
    """lambda (..., C), where (A + softness diag A) lambda = b, A = J M^-1 J_along^T, J made of d.

    turn (3, ..., C), off (..., C): by how much d changes in an instant, and the share that lengths
    are wrong by; the blur of loops, as in the chapter.
    """
    if rods.chain:
        w = 1.0 / m
        diagonal = dot(d, along)
        ends = w.copy()
        ends[1:] += w[:-1]
        diagonal *= (1.0 + softness) * ends
        upper = w[:-1] * dot(d[..., :-1], along[..., 1:])  # of -A
        lower = upper if d is along else w[:-1] * dot(d[..., 1:], along[..., :-1])
        return halve(diagonal, upper, lower, b)
    if d.ndim > 2:  # a sparse matrix has no leading axes
        members = zip(
            *(np.moveaxis(x, 1, 0) for x in (d, along)),
            b,
            np.moveaxis(turn, 1, 0),
            off,
            strict=True,
        )
        return np.stack([multipliers(rods, m, *member, softness) for member in members])
    values, blur = (
        rods.signs / m[rods.particles] * dot(x[:, rods.rows], y[:, rods.columns])
        for x, y in ((d, along), (turn, turn))
    )
    values = values + softness * np.where(rods.rows == rods.columns, values, 0.0)
    return loaded(rods, values, b, blur, 1e-12 + np.sum(off * off))


def pull(rods, along, lam, n):
    """J_along^T lambda (3, ..., N)."""
    felt = lam * along
    if rods.chain:
        felt[..., :-1] -= felt[
            ..., 1:
        ]  # a rod pulls its particle back and the one before it forward
        return felt
    if felt.ndim > 2:
        return np.stack(
            [pull(rods, a, x, n) for a, x in zip(np.moveaxis(along, 1, 0), lam, strict=True)],
            axis=1,
        )
    tied = rods.j >= 0
    return np.stack(
        [np.bincount(rods.i, x, n) - np.bincount(rods.j[tied], x[tied], n) for x in felt]
    )


def loaded(rods, values, b, blur, share):
    """lambda (C,) for the entries `values` of A, in loops by rounds that take the blur back."""
    own = np.bincount(rods.rows, np.where(rods.rows == rods.columns, values, 0.0), len(b))
    places, spread = (rods.rows, rods.columns), values
    if rods.loop:
        spread = values + blur + share * np.where(rods.rows == rods.columns, values, 0.0)
    if dense(len(b)):
        a = np.zeros((2, len(b), len(b)))
        for matrix, entries in zip(a, (values, spread), strict=True):
            np.add.at(matrix, places, entries)
        times, solve = a[0].dot, np.linalg.inv(a[1]).dot
    else:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        a, wide = (csc_array((x, places), shape=(len(b), len(b))) for x in (values, spread))
        try:
            times, solve = a.dot, splu(wide, permc_spec="MMD_AT_PLUS_A").solve
        except RuntimeError as singular:
            raise FloatingPointError(f"no finite tensions: {singular}") from None
    lam, before = solve(b), np.sum(b * b / own)
    for _ in range(100 if rods.loop else 0):
        rest = b - times(lam)
        left = np.sum(rest * rest / own)
        if before <= 4.0 * left:
            break
        lam, before = lam + solve(rest), left
    return lam


def halve(diagonal, upper, lower, b):
    """x (..., n) with diagonal_k x_k - upper_k x_k+1 - lower_k-1 x_k-1 = b_k: eliminate every other
    x, and again.

    Cyclic reduction (R. W. Hockney, J. ACM 12 (1965) 95): elementwise + - * / alone, the same on
    every processor; stable where elimination without pivots is, as for J M^-1 J^T.
    """
    n, halvings = diagonal.shape[-1], 0
    while n >> halvings > SHORT:
        halvings += 1
    if (
        more := -(n + 1) % 2**halvings
    ):  # unknowns tied to nothing, so that each odd one always has two even neighbours
        padded = np.zeros((4, *b.shape[:-1], n + more))
        padded[0, ..., n:] = 1.0
        for whole, x in zip(padded, (diagonal, upper, lower, b), strict=True):
            whole[..., : x.shape[-1]] = x
        diagonal, upper, lower, b = padded[0], padded[1, ..., :-1], padded[2, ..., :-1], padded[3]
    return halved(diagonal, upper, lower, b, halvings)[..., :n]


def halved(diagonal, upper, lower, b, times):
    """As `halve`, so many times; n + 1 is divisible by 2 to that power."""
    if times == 0:
        return sweep(
            *(
                x.tolist() if x.ndim == 1 else list(np.moveaxis(x, -1, 0))
                for x in (diagonal, upper, lower, b)
            )
        )
    even, y, down, up = diagonal[..., ::2], b[..., ::2], upper[..., ::2], lower[..., 1::2]
    left, right = lower[..., ::2] / even[..., :-1], upper[..., 1::2] / even[..., 1:]
    half = diagonal[..., 1::2] - left * down
    half -= right * up
    known = b[..., 1::2] + left * y[..., :-1]
    known += right * y[..., 1:]
    odd = halved(
        half, right[..., :-1] * down[..., 1:], left[..., 1:] * up[..., :-1], known, times - 1
    )
    x = np.empty_like(b)
    x[..., 1::2], x[..., ::2] = odd, y
    x[..., 2::2] += up * odd
    x[..., :-1:2] += down * odd
    x[..., ::2] /= even
    return x


def sweep(diagonal, upper, lower, b):
    """As `halve`, of lists of numbers or of arrays (...): one sweep out and one back."""
    d, y = diagonal[0], b[0]
    pivots, known = [d], [y]
    for low, up, own, right in zip(lower, upper, diagonal[1:], b[1:], strict=True):
        ratio = low / d
        d, y = own - ratio * up, right + ratio * y
        pivots.append(d)
        known.append(y)
    x = [y / d]
    for d, y, up in zip(pivots[-2::-1], known[-2::-1], upper[::-1], strict=True):
        x.append((y + up * x[-1]) / d)
    return leading_first(np.array(x[::-1]), 1)


def rods_answer(system, hold, f, q, v):
    """Rods, their vectors d (3, ..., C) and lambda (..., C) that answer to forces f (3, ..., N) at
    q, v (..., N, 3)."""
    rods, m, lengths = of(system), system["m"][:, 0], np.asarray(system["lengths"])
    d, rate = (
        rod_vectors(rods, components_first(q), system.get("anchors")),
        rod_vectors(rods, components_first(v)),
    )
    b = -dot(d, rod_vectors(rods, f / m)) - hold.use_jdotv * dot(rate, rate)
    dd = dot(d, d)
    off = 0.5 * (dd / (lengths * lengths) - 1.0)
    if hold.damping or hold.stiffness:
        g = dd - lengths * np.sqrt(dd) if hold.softness else 0.5 * (dd - lengths * lengths)
        b = b - hold.damping * dot(d, rate) - hold.stiffness * g
    return rods, d, multipliers(rods, m, d, d, b, INSTANT * rate, off, hold.softness)


def make_force(system, hold, external_force):
    """force(q, v) -> N (..., N, 3), the chapter's, for a Hold."""

    def force(q, v):
        f = components_first(external_force(system, q, v), q.shape)
        rods, d, lam = rods_answer(system, hold, f, q, v)
        return leading_first(f + pull(rods, d, lam, len(system["m"])), 1)

    force.dt, force.way = hold.dt, way(system)
    return force


def tensions(system, q, v, hold, f):
    """-lambda |d| (..., C) in N, the chapter's; f: the other forces (..., N, 3)."""
    _, d, lam = rods_answer(system, hold, components_first(f, q.shape), q, v)
    return -lam * np.sqrt(dot(d, d))


def project(system, q_start, q, v, dt):
    """As the chapter's: back to g = 0 and J v = 0."""
    rods, m, lengths, anchors = (
        of(system),
        system["m"][:, 0],
        np.asarray(system["lengths"]),
        system.get("anchors"),
    )
    start, free, v = (components_first(x) for x in (q_start, q, v))
    along, x = rod_vectors(rods, start, anchors), free
    far = np.mean(np.sum(np.abs(start), axis=0), axis=-1, keepdims=True)
    near = 1e-12 * lengths * lengths + 1e-15 * far * lengths

    def impulse(d, along, b, off):
        return pull(rods, along, multipliers(rods, m, d, along, b, 0.0 * d, off), len(m)) / m

    for _ in range(20):
        d = rod_vectors(rods, x, anchors)
        g = 0.5 * (dot(d, d) - lengths * lengths)
        if np.all(np.abs(g) <= near):
            v = v + (x - free) / dt
            return leading_first(x, 1), leading_first(
                v - impulse(d, d, dot(d, rod_vectors(rods, v)), 0.0 * g), 1
            )
        x = x - impulse(d, along, g, g / (lengths * lengths))
    raise FloatingPointError("no way back onto the rods")


def rod_errors(system, q):
    """|d| - L of every rod (..., C), m."""
    d = rod_vectors(of(system), components_first(q), system.get("anchors"))
    return np.sqrt(dot(d, d)) - system["lengths"]
