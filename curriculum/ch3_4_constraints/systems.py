"""Systems, checked so that a mistake in one is answered by a sentence.

A system is a dict of arrays, as COLUMNS has them, and of what else its maker puts in.
"""

import json
from argparse import ArgumentTypeError
from collections.abc import Mapping
from decimal import Decimal, localcontext
from itertools import accumulate
from numbers import Integral
from operator import mul

from curriculum.ch3_4_constraints.statics import differences
from curriculum.common.arrays import ordered
from curriculum.common.cli import shorten

import numpy as np

FIT = 1e-6  # relative: how far a length in a file may be from the distance of the rod's ends
ROUGH = 0.1  # the same of a typed system, which may start wrong on purpose, but not by a slip
FILLED = 10_000  # entries of A that are not zero, at most: they get more in a solve
MOST = 1000  # particles, rods or anchors in a file; rods of a chain
HUGE = 1e12  # beyond (divisors: below 1 / HUGE; masses: times another) rods have no digits left

POINT = f"three finite numbers [x, y, z] under {HUGE:g}"
DIVISOR = f"a finite number of {{}} > 0 ({1 / HUGE:g} to {HUGE:g})"
COLUMNS = {  # type, shape and bound of a row; the shape of all; a row's name in a file, what it is
    "q0": (float, (3,), -HUGE, "(N, 3)", "particles[{}].position", POINT),
    "v0": (float, (3,), -HUGE, "(N, 3)", "particles[{}].velocity", POINT),
    "m": (float, (1,), 1 / HUGE, "(N, 1)", "particles[{}].mass", DIVISOR.format("kilograms")),
    "anchors": (float, (3,), -HUGE, "(K, 3)", "anchors[{}]", POINT),
    "pairs": (int, (2,), -HUGE, "(C, 2)", "rods[{}].pair", "two whole numbers [i, j]"),
    "lengths": (float, (), 1 / HUGE, "(C,)", "rods[{}].length", DIVISOR.format("metres")),
}
REPEATED = "m", "anchors", "lengths"  # which numpy would repeat: a lone [x, y, z] at (x, x, x)
ANCHORS = np.zeros((1, 3))  # of a system that names none: how many, not where


class SceneError(ArgumentTypeError, ValueError):
    """A scene that cannot be run: its sentence names field and index, and what is allowed."""


def direction(angle):
    """(cos, sin, 0) of an angle in rad, a few turns at most: libm's depend on the processor."""
    with localcontext(prec=50):  # for the series of exp(i angle), whose terms turn by i
        steps = (Decimal(angle) / k for k in range(1, 100))
        terms = list(accumulate(steps, mul, initial=Decimal(1)))
        cosine, sine = (sum(terms[k::4]) - sum(terms[k + 2 :: 4]) for k in (0, 1))
        return np.array([float(cosine), float(sine), 0.0])


def check_links(links):
    """Raise SceneError unless a chain can have so many links."""
    right = type(links) is not bool and isinstance(links, Integral) and 1 <= links <= MOST
    need(right, "links", links, f"a whole number of rods, 1 to {MOST}")


def need(test, field, found, allowed):
    """Raise SceneError unless `test`."""
    if not test:
        found = json.dumps(found, default=lambda x: getattr(x, "tolist", x.__repr__)())
        raise SceneError(f"{field} is {shorten(found)}; must be {allowed}")


def energy_scale(system, gravity):
    """m g L in J, of all masses and all rods; 1 where nothing weighs anything. gravity (3,)."""
    size = np.sqrt(np.sum(np.square(gravity)))
    scale = np.sum(system["m"]) * size * np.sum(system["lengths"])
    return scale if scale > 0.0 else 1.0


def states(system, *arrays):
    """Positions or velocities, (N, 3) each: read-only arrays whose products and sums go in order.
    Lists will do. Raises ValueError for another shape, which numpy would repeat silently."""
    need(isinstance(system, Mapping), "a system", system, "a dict, as build_system makes it")
    given = (system.get(key, ANCHORS) for key in REPEATED)
    found = m, anchors, _ = tuple(getattr(x, "shape", None) or np.shape(x) for x in given)
    count = m[0] if m else 1
    wanted = (count, 1), (*anchors[:1], 3), (len(system["pairs"]),)
    if found != wanted:  # as nearly never: else each of them would be looked at
        for key, shape, must in zip(REPEATED, found, wanted, strict=True):
            if shape != must:
                raise ValueError(f"{key} has the shape {shape}, must have {must}")
    made = []
    for x in map(ordered, arrays):
        if x.shape != (count, 3):
            must = f"must be {(count, 3)}, a row for each particle"
            if x.ndim == 3:
                must += "; mapped(function)(q, v) is for many"
            raise ValueError(f"a state is an array of shape {x.shape}; {must}")
        if x.flags.writeable:
            x = x.view()
            x.flags.writeable = False  # a force is to change no state
        made.append(x)
    return made


def check_system(system, anchors=None):
    """A typed system as a run needs it: arrays of float64, pairs as a list; other keys are kept. A
    length may be a tenth off. `anchors` (K, 3): of a system that names none. Raises SceneError."""
    allowed = f"a dict with {', '.join(COLUMNS)}"
    need(isinstance(system, Mapping), "a system", system, allowed)
    system = {"anchors": anchors, **system}
    for key in COLUMNS:
        if key not in system:
            raise SceneError(f"a system has no {key}; must be {allowed}")
    typed = {}
    for key, (dtype, row, low, shape, _, allowed) in COLUMNS.items():
        try:
            array = np.asarray(system[key])
        except ValueError:
            array = np.array(None)  # rows of several lengths
        right = array.ndim == 1 + len(row) and array.shape[1:] == row
        right = right and array.dtype.kind in ("iuf", "iu")[dtype is int]
        need(right, key, system[key], f"a list or an array {shape}, each row {allowed}")
        bad = ~((array > low) & (array < HUGE))
        for k in np.argwhere(bad)[:1, 0].tolist():  # the first bad row
            need(False, f"{key}[{k}]", array[k], allowed)
        typed[key] = array.astype(dtype)
    return system | checked(typed, ROUGH, "{}[{}]".format, [])


def checked(system, fit, name, bare):
    """The arrays of a system, checked against each other. Lengths may be off by a share `fit`, and
    those of the rods `bare` are measured; name(key, k): what row k is called."""

    def refuse(key, bad, allowed):  # for the first bad row k of system[key]; allowed(k): words
        if np.any(bad):
            k = int(np.argmax(bad))
            need(False, name(key, k), np.squeeze(system[key][k]), allowed(k))

    q0, _, m, anchors, pairs, lengths = (system[key] for key in COLUMNS)
    n, fixed, rods = len(q0), len(anchors), len(pairs)
    need(n and rods, "the number of particles and rods", [n, rods], "at least one of each")
    for key, shape in ("v0", q0.shape), ("m", (n, 1)), ("lengths", (rods,)):
        need(system[key].shape == shape, f"the shape of {key}", system[key].shape, shape)
    refuse("m", m[:, 0] > HUGE * m.min(), lambda _: f"at most {HUGE:g} times {m.min():g} kg")
    i, j = pairs.T
    wrong = (i < 0) | (i >= n) | (j < -fixed) | (j >= n) | (i == j)
    anchor = "the anchor -1" if fixed == 1 else f"an anchor -1..-{fixed}"
    ends = f" or {anchor}" if fixed else "; there are no anchors"
    refuse("pairs", wrong, lambda _: f"a particle 0..{n - 1}, and then another{ends}")
    ties, seen = (np.minimum(i, j) * (n + fixed) + np.maximum(i, j)).tolist(), {}
    again = np.array([seen.setdefault(tie, k) < k for k, tie in enumerate(ties)])
    refuse("pairs", again, lambda k: f"given once; rods[{seen[ties[k]]}] ties the same two")
    shared = int((np.bincount(pairs.ravel() + fixed)[fixed:] ** 2).sum())
    what = "the number of entries of A, two for rods that meet,"
    need(shared <= FILLED, what, shared, f"{FILLED} at most")
    found = np.linalg.norm(differences(q0, anchors, pairs), axis=-1)
    refuse("pairs", found <= 1 / HUGE, lambda _: "two points apart, or it is no rod")
    lengths[bare] = found[bare]
    off = abs(lengths - found) > fit * found
    ends = "; that is how far apart its ends are"
    refuse("lengths", off, lambda k: f"{found[k]:.9g} m, to {100 * fit:g} %{ends}")
    return system | {"pairs": list(zip(i.tolist(), j.tolist(), strict=True))}
