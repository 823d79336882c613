"""Systems: what their arrays must be, checked so that a mistake is answered by a sentence."""

import json
from argparse import ArgumentTypeError
from collections.abc import Mapping
from decimal import Decimal, localcontext
from itertools import accumulate
from operator import mul

import numpy as np

from curriculum.common.elimination import parts

FIT = 1e-6  # the share by which a length in a file may differ from the distance of its rod's ends
ROUGH = 0.1  # the same in a typed system, which may be wrong on purpose, but not by a slip
FILLED = 10_000  # entries of A that are not zero, at most: a solve adds more
MOST = 1000  # particles, rods or anchors in a file
HUGE = 1e12  # larger numbers, positive ones below 1 / HUGE, and masses as unlike have no digits

POINT = f"three finite numbers [x, y, z] under {HUGE:g}"
POSITIVE = f"a finite number of {{}} > 0 ({1 / HUGE:g} to {HUGE:g})"
COLUMNS = {  # a row's type, shape and bound; the shape of all; a row's name in a file, what it is
    "q0": (float, (3,), -HUGE, "(N, 3)", "particles[{}].position", POINT),
    "v0": (float, (3,), -HUGE, "(N, 3)", "particles[{}].velocity", POINT),
    "m": (float, (1,), 1 / HUGE, "(N, 1)", "particles[{}].mass", POSITIVE.format("kilograms")),
    "anchors": (float, (3,), -HUGE, "(K, 3)", "anchors[{}]", POINT),
    "pairs": (int, (2,), -HUGE, "(C, 2)", "rods[{}].pair", "two whole numbers [i, j]"),
    "lengths": (float, (), 1 / HUGE, "(C,)", "rods[{}].length", POSITIVE.format("metres")),
}


class SceneError(ArgumentTypeError, ValueError):
    """A scene that cannot be run: its sentence names field and index, and what is allowed."""


def direction(angle):
    """(cos, sin, 0) of an angle in rad, a few turns at most: libm's depend on the processor."""
    with localcontext(prec=50):  # for the series of exp(i angle), whose terms turn by i
        steps = (Decimal(angle) / k for k in range(1, 100))
        terms = list(accumulate(steps, mul, initial=Decimal(1)))
        cosine, sine = (sum(terms[k::4]) - sum(terms[k + 2 :: 4]) for k in (0, 1))
        return np.array([float(cosine), float(sine), 0.0])


def shorten(text):
    """The text in a line, or its beginning."""
    text = " ".join(text.split())
    return text if len(text) < 60 else text[:57] + "..."


def need(test, field, found, allowed):
    """Raise SceneError unless `test`."""
    if not test:
        found = json.dumps(found, default=lambda x: getattr(x, "tolist", x.__repr__)())
        raise SceneError(f"{field} is {shorten(found)}; must be {allowed}")


def has_loop(system):
    """Whether its rods close a loop, maybe through the ground."""
    return any(loop for _, loop in parts(system["pairs"]))


def tolerance(lengths, q):
    """The |g| (C,) in m^2 that counts as zero: 1e-12 L^2, and more far from the origin.

    There q (N, 3) is rounded more coarsely, and so is g.
    """
    far, lengths = np.sum(np.abs(q)) / len(q), np.asarray(lengths)
    return 1e-12 * lengths * lengths + 1e-15 * far * lengths


def nodes(x, fixed):
    """What pairs index: x (..., N, 3) and, from the end on, that of the anchors, `fixed` (K, 3)."""
    fixed = np.asarray(fixed)[::-1]
    fixed = np.broadcast_to(fixed, (*x.shape[:-2], *fixed.shape))
    return np.concatenate([x, fixed], axis=-2)


def differences(x, fixed, pairs):
    """x_i - x_j (..., C, D) of rods (i, j), with x (..., N, D); at anchors it is fixed (K, D)."""
    i, j = np.transpose(pairs)
    ends = nodes(x, fixed)
    return ends.take(i, axis=-2) - ends.take(j, axis=-2)


def check_system(system, pivot):
    """A typed system as a run needs it: arrays of float64, pairs as a list; other keys are kept.

    A length may be a tenth off. `pivot` (3,) is the anchor of one without. Raises SceneError.
    """
    allowed = f"a dict with {', '.join(COLUMNS)}"
    need(isinstance(system, Mapping), "a system", system, allowed)
    system = {"anchors": [pivot], **system}
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
    """The arrays of a system, checked against each other.

    Lengths may be off by a share `fit`; those of the rods `bare` are measured. name(key, k) is what
    row k is called. Raises SceneError.
    """

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
