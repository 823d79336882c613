"""Systems: their geometry and scales; and checks, which answer a mistake by a sentence."""

import json
import math
from numbers import Integral, Real

import numpy as np

from curriculum.ch3_4_constraints.rods.elimination import components
from curriculum.common.errors import Refused
from curriculum.common.tracing import ordered

ROUGH = 0.1  # by this share a length may be off: on purpose, but not by a slip
FILLED = 10_000  # entries of A that are not zero, at most: a solve adds more
LOST = 1e-6  # singular values of unit_rows by the largest: below, they count as 0
HUGE = 1e12  # larger numbers, those below 1 / HUGE, and masses so far apart leave no digits

POINT = f"three finite numbers [x, y, z] under {HUGE:g}"
POSITIVE = f"a finite number of {{}} > 0 ({1 / HUGE:g} to {HUGE:g})"
COLUMNS = {  # what a row's numbers are, its shape and bound, its name in a file, and what it is
    "q0": (Real, (3,), -HUGE, "particles[{}].position", POINT),
    "v0": (Real, (3,), -HUGE, "particles[{}].velocity", POINT),
    "m": (Real, (1,), 1 / HUGE, "particles[{}].mass", POSITIVE.format("kilograms")),
    "anchors": (Real, (3,), -HUGE, "anchors[{}]", POINT),
    "pairs": (Integral, (2,), -HUGE, "rods[{}].pair", "two whole numbers [i, j]"),
    "lengths": (Real, (), 1 / HUGE, "rods[{}].length", POSITIVE.format("metres")),
    "load": (Real, (3,), -HUGE, "particles[{}].load", POINT),
}
PARTICLES = ("q0", "v0", "m", "load")  # the columns that have a row for each
OPTIONAL = ("load",)


def shorten(text):
    """The text in a line, or its beginning."""
    text = " ".join(text.split())
    return text if len(text) < 60 else text[:57] + "..."


def need(test, field, found, allowed):
    """Raise Refused unless `test`."""
    if not test:
        found = json.dumps(found, default=lambda x: getattr(x, "tolist", x.__repr__)())
        raise Refused(f"{field} is {shorten(found)}; must be {allowed}")


def has_loop(system):
    """Whether its rods close a loop, maybe through the ground."""
    return any(loop for _, loop in components(system["pairs"]))


def is_flat(system):
    """Whether all of it is, and moves, in the plane z = 0."""
    return not any(np.any(system[key][:, 2]) for key in ("q0", "v0", "anchors"))


def energy_scale(system, gravity):
    """What energies are measured by, in J: the larger of m g L and the kinetic energy at the start.

    m g L is all masses times gravity (3,), in m/s^2, times the lengths of all rods. 1 J if both are
    0.
    """
    m_g_L = np.sum(system["m"]) * np.linalg.norm(gravity) * np.sum(system["lengths"])
    kinetic = 0.5 * np.sum(system["m"] * system["v0"] * system["v0"])
    return float(max(m_g_L, kinetic) or 1.0)


def tolerance(system, q, rows):
    """The |g| (rows,) in m^2 that counts as zero: 1e-12 L^2, and more far from the origin.

    There q (N, 3) is rounded more coarsely, and so is g. Rows after the rods' begin with the first.
    """
    far = np.sum(np.abs(q)) / len(q)
    lengths = np.resize(system["lengths"], rows)
    return 1e-12 * lengths * lengths + 1e-15 * far * lengths


def nodes(x, fixed):
    """What pairs index, (..., N + K, D): x (..., N, D), then that of the anchors, `fixed` (K, D).

    The anchors are in reverse, so that -1 is the first.
    """
    fixed = np.asarray(fixed)[::-1]
    fixed = np.broadcast_to(fixed, (*x.shape[:-2], *fixed.shape))
    return np.concatenate([x, fixed], axis=-2)


def differences(x, fixed, pairs):
    """x_i - x_j (..., C, D) of rods (i, j), with x (..., N, D); of the K anchors x is fixed (K, D).

    `pairs`: C of them. In the unit of x.
    """
    i, j = np.transpose(pairs)
    ends = nodes(x, fixed)
    return ends.take(i, axis=-2) - ends.take(j, axis=-2)


def rod_vectors(system, q):
    """Rods as vectors (..., C, 3) in m, from partner to particle, at q (..., N, 3) in m."""
    return differences(q, system["anchors"], system["pairs"])


def rod_rates(system, v):
    """What rods' vectors change by, (..., C, 3), as particles do by v (..., N, 3); anchors rest.

    In the unit of v: m/s, or m/s^2 for accelerations.
    """
    return differences(v, np.zeros_like(system["anchors"]), system["pairs"])


def distances(system):
    """How far apart the ends of each rod are at the start, (C,) in m."""
    return np.linalg.norm(rod_vectors(system, system["q0"]), axis=-1)


def unit_rows(system, q):
    """J (..., C, 3N), without a unit, at q (..., N, 3) in m: each rod's row is divided by |d|."""
    n = len(system["m"])
    d = rod_vectors(system, q)
    unit = d / np.linalg.norm(d, axis=-1, keepdims=True)
    ends = differences(np.eye(n), np.zeros((len(system["anchors"]), n)), system["pairs"])
    return (ends[..., None] * unit[..., None, :]).reshape(*unit.shape[:-1], 3 * n)


def rod_parts(system, q):
    """Of rods at q (..., N, 3), in m: what is right, too much, and missing, a list of three.

    Each is (..., C, 2, 3) in m, the two ends of a piece of each rod; what is not there has none.
    """
    head, tail = np.moveaxis(nodes(q, system["anchors"])[..., system["pairs"], :], -2, 0)
    d = head - tail
    share = system["lengths"] / np.maximum(np.linalg.norm(d, axis=-1), 1 / HUGE)
    share = share[..., None]
    right = tail + np.minimum(share, 1.0) * d
    farther = tail + np.maximum(share, 1.0) * d
    return [
        np.stack([tail, right], axis=-2),
        np.stack([right, head], axis=-2),
        np.stack([head, farther], axis=-2),
    ]


def check_system(rows, pivot, fit=ROUGH, name="{}[{}]".format, bare=()):
    """A system as a run needs it: arrays of float64, pairs as a list; other keys are kept.

    `rows` is a dict of lists or arrays; `pivot` (3,) the anchor of one without. Lengths may be off
    by a share `fit`; those of the rods `bare` are measured. name(key, k) is what row k is called.
    Raises Refused.
    """
    system = {"anchors": [pivot], **rows}
    wanted = [key for key in COLUMNS if key not in OPTIONAL]
    need({*wanted} <= {*system}, "a system", [*system], f"a dict with {', '.join(wanted)}")
    for key in COLUMNS:
        if key in system:
            system[key] = checked_column(key, system[key], name)
    check_counts(system, name)
    check_pairs(system, name)
    system["lengths"][[*bare]] = distances(system)[[*bare]]
    check_lengths(system, fit, name)
    system["pairs"] = [(int(i), int(j)) for i, j in system["pairs"]]
    return system


def checked_column(key, table, name):
    """The column `key` of a system as an array; Refused if it is none."""
    kind, shape, low, _, allowed = COLUMNS[key]
    is_array = isinstance(table, np.ndarray) and table.ndim
    need(is_array or isinstance(table, list | tuple), key, table, "a list or an array")
    for k, row in enumerate(table):
        row = np.array(row, object)  # as it stands there: true is no number
        right = row.size == math.prod(shape)
        for x in row.ravel().tolist():
            right = right and isinstance(x, kind) and not isinstance(x, bool) and low < x < HUGE
        need(right, name(key, k), np.squeeze(row), allowed)
        need(row.shape == shape, f"the shape of {name(key, k)}", row.shape, shape)
    column = np.array(table, int if kind is Integral else float).reshape(-1, *shape)
    return ordered(column) if key in PARTICLES else column


def refuse_row(bad, key, system, name, allowed, beside=None):
    """Raise Refused for the first row of a column that is bad.

    `allowed`: what it must be, in words, with a blank for what `beside` has in the same row.
    """
    if np.any(bad):
        k = int(np.argmax(bad))
        allowed = allowed if beside is None else allowed.format(beside[k])
        need(False, name(key, k), np.squeeze(system[key][k]), allowed)


def check_counts(system, name):
    """Raise Refused where columns have other rows than particles or rods, or masses differ."""
    n = len(system["q0"])
    rods = len(system["pairs"])
    need(n and rods, "the number of particles and rods", [n, rods], "at least one of each")
    for key in COLUMNS:
        count = n if key in PARTICLES else rods
        if key in system and key != "anchors":
            need(len(system[key]) == count, f"the number of rows of {key}", len(system[key]), count)
    m = system["m"]
    least = m.min()
    refuse_row(m[:, 0] > HUGE * least, "m", system, name, f"at most {HUGE:g} times {least:g} kg")


def check_pairs(system, name):
    """Raise Refused unless pairs (C, 2) tie particles, or one and an anchor, once each."""
    pairs = system["pairs"]
    n = len(system["q0"])
    anchors = len(system["anchors"])
    i, j = pairs.T
    wrong = (i < 0) | (i >= n) | (j < -anchors) | (j >= n) | (i == j)
    ends = f"a particle 0..{n - 1}, then another or an anchor -1, -2, ... ({anchors} in all)"
    refuse_row(wrong, "pairs", system, name, ends)
    _, first, which = np.unique(np.sort(pairs), axis=0, return_index=True, return_inverse=True)
    first = first[which]  # the first rod that ties the same two
    again = first < np.arange(len(i))
    refuse_row(again, "pairs", system, name, "given once; rods[{}] ties the same two", first)
    meeting = np.bincount(pairs.ravel() + anchors)[anchors:]  # rods at each particle
    entries = int((meeting**2).sum())
    what = "the number of entries of A, two for rods that meet,"
    need(entries <= FILLED, what, entries, f"{FILLED} at most")


def check_lengths(system, fit, name):
    """Raise Refused where a rod has no length, or one that is off by more than a share `fit`."""
    found = distances(system)
    apart = "two points apart, or it is no rod"
    refuse_row(found <= 1 / HUGE, "pairs", system, name, apart)
    off = abs(system["lengths"] - found) > fit * found
    right = f"{{:.9g}} m, to {100 * fit:g} %; that is how far apart its ends are"
    refuse_row(off, "lengths", system, name, right, found)


def check_run(system, pivot, dt, steps, external_force):
    """The system as check_system returns it, for so many steps of dt s; raises Refused.

    external_force is the chapter's: it must have the right shape.
    """
    need(isinstance(dt, Real) and 1 / HUGE <= dt < HUGE, "dt", dt, POSITIVE.format("seconds"))
    need(isinstance(steps, Integral) and steps >= 1, "steps", steps, "a whole number >= 1")
    system = check_system(system, pivot)
    found = np.shape(external_force(system, system["q0"], system["v0"]))
    need(found == system["q0"].shape, "the shape of external_force", found, system["q0"].shape)
    return system


def check_measure(name, found):
    """Raise Refused unless what a measure has found in a state is a number."""
    need(np.shape(found) == (), f"the shape of {name}", np.shape(found), "that of a number")
