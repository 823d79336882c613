"""Systems: what their arrays must be, checked so that a mistake is answered by a sentence."""

import json
import math
from argparse import ArgumentTypeError
from decimal import Decimal, localcontext
from itertools import accumulate
from numbers import Integral, Real
from operator import mul

import numpy as np

from curriculum.common.elimination import components

ROUGH = 0.1  # by this share a length may be off: on purpose, but not by a slip
FILLED = 10_000  # entries of A that are not zero, at most: a solve adds more
HUGE = 1e12  # larger numbers, those below 1 / HUGE, and masses so far apart leave no digits

POINT = f"three finite numbers [x, y, z] under {HUGE:g}"
POSITIVE = f"a finite number of {{}} > 0 ({1 / HUGE:g} to {HUGE:g})"
COLUMNS = {  # a row's type, shape and bound, its name in a file, and what it is
    "q0": (float, (3,), -HUGE, "particles[{}].position", POINT),
    "v0": (float, (3,), -HUGE, "particles[{}].velocity", POINT),
    "m": (float, (1,), 1 / HUGE, "particles[{}].mass", POSITIVE.format("kilograms")),
    "anchors": (float, (3,), -HUGE, "anchors[{}]", POINT),
    "pairs": (int, (2,), -HUGE, "rods[{}].pair", "two whole numbers [i, j]"),
    "lengths": (float, (), 1 / HUGE, "rods[{}].length", POSITIVE.format("metres")),
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
    return any(loop for _, loop in components(system["pairs"]))


def m_g_L(system, gravity):
    """All masses times gravity times the length of all rods, in J; gravity counts as 1 at least."""
    return np.sum(system["m"]) * max(1.0, np.linalg.norm(gravity)) * np.sum(system["lengths"])


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


def rod_parts(system, q):
    """Of rods at q (..., N, 3), (..., C, 2, 3) each: what is right, too much, and missing."""
    head, tail = np.moveaxis(nodes(q, system["anchors"])[..., system["pairs"], :], -2, 0)
    d = head - tail
    share = system["lengths"] / np.maximum(np.linalg.norm(d, axis=-1), 1 / HUGE)
    right, farther = (tail + x[..., None] * d for x in (np.minimum(share, 1), np.maximum(share, 1)))
    return [np.stack(x, axis=-2) for x in ((tail, right), (right, head), (head, farther))]


def check_system(system, pivot):
    """A typed system as a run needs it: arrays of float64, pairs as a list; other keys are kept.

    A length may be a tenth off. `pivot` (3,) is the anchor of one without. Raises SceneError.
    """
    system = {"anchors": [pivot], **system}
    need({*COLUMNS} <= {*system}, "a system", [*system], f"a dict with {', '.join(COLUMNS)}")
    return system | checked(system, ROUGH, "{}[{}]".format, [])


def checked(rows, fit, name, bare):
    """The arrays of a system of these rows {key: list or array}, each checked, and all together.

    Lengths may be off by a share `fit`; those of the rods `bare` are measured. name(key, k) is what
    row k is called. Raises SceneError.
    """
    system = {}
    for key, (dtype, shape, low, _, allowed) in COLUMNS.items():
        kind = Integral if dtype is int else Real
        need(isinstance(rows[key], list | tuple | np.ndarray), key, rows[key], "a list or an array")
        for k, row in enumerate(rows[key]):
            row = np.array(row, object)  # as it stands there: true is no number
            right = all(isinstance(x, kind) and low < x < HUGE for x in row.flat)
            right = right and bool not in map(type, row.flat) and row.size == math.prod(shape)
            need(right, name(key, k), np.squeeze(row), allowed)
        system[key] = np.array(rows[key], dtype).reshape(-1, *shape)

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
