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
from curriculum.common.tracing import ordered

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


def cos_sin(angle):
    """cos and sin of an angle in rad, a few turns at most: libm's depend on the processor."""
    with localcontext(prec=50):  # for the series of exp(i angle), whose terms turn by i
        steps = (Decimal(angle) / k for k in range(1, 100))
        terms = list(accumulate(steps, mul, initial=Decimal(1)))
        cosine, sine = (sum(terms[k::4]) - sum(terms[k + 2 :: 4]) for k in (0, 1))
        return float(cosine), float(sine)


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


def tolerance(system, q, rows):
    """The |g| (rows,) in m^2 that counts as zero: 1e-12 L^2, and more far from the origin.

    There q (N, 3) is rounded more coarsely, and so is g. Rows after the rods' begin with the first.
    """
    far, lengths = np.sum(np.abs(q)) / len(q), np.resize(system["lengths"], rows)
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


def check_system(rows, pivot, *functions, fit=ROUGH, name="{}[{}]".format, bare=()):
    """A system as a run needs it: arrays of float64, pairs as a list; other keys are kept.

    `rows` is a dict of lists or arrays; `pivot` (3,) the anchor of one without. Lengths may be off
    by a share `fit`; those of the rods `bare` are measured. name(key, k) is what row k is called.
    `functions`, if given, are those of check_functions. Raises SceneError.
    """
    system = {"anchors": [pivot], **rows}
    need({*COLUMNS} <= {*system}, "a system", [*system], f"a dict with {', '.join(COLUMNS)}")
    for key, (dtype, shape, low, _, allowed) in COLUMNS.items():
        table = system[key]
        kind, kinds = (Integral, "iu") if dtype is int else (Real, "f")
        is_array = isinstance(table, np.ndarray) and table.ndim and table.dtype.kind in kinds
        fits = isinstance(table, list | tuple) or is_array
        need(fits, key, table, f"a list or an array of {dtype.__name__}s")
        for k, row in enumerate(table):
            row = np.array(row, object)  # as it stands there: true is no number
            right = all(isinstance(x, kind) and low < x < HUGE for x in row.flat)
            right = right and bool not in map(type, row.flat) and row.size == math.prod(shape)
            need(right, name(key, k), np.squeeze(row), allowed)
            need(row.shape == shape, f"the shape of {name(key, k)}", row.shape, shape)
        system[key] = np.array(table, dtype).reshape(-1, *shape)
        if key in ("q0", "v0", "m"):
            system[key] = ordered(system[key])

    def refuse(key, bad, allowed):  # for the first bad row k of system[key]; allowed(k): words
        if np.any(bad):
            k = int(np.argmax(bad))
            need(False, name(key, k), np.squeeze(system[key][k]), allowed(k))

    q0, v0, m, anchors, pairs, lengths = (system[key] for key in COLUMNS)
    n, fixed, rods = len(q0), len(anchors), len(pairs)
    need(n and rods, "the number of particles and rods", [n, rods], "at least one of each")
    for key, count in ("v0", n), ("m", n), ("lengths", rods):
        need(len(system[key]) == count, f"the number of rows of {key}", len(system[key]), count)
    refuse("m", m[:, 0] > HUGE * m.min(), lambda _: f"at most {HUGE:g} times {m.min():g} kg")
    i, j = pairs.T
    wrong = (i < 0) | (i >= n) | (j < -fixed) | (j >= n) | (i == j)
    ends = f"a particle 0..{n - 1}, then another or an anchor -1, -2, ... ({fixed} in all)"
    refuse("pairs", wrong, lambda _: ends)
    _, first, which = np.unique(np.sort(pairs), axis=0, return_index=True, return_inverse=True)
    first = first[which]  # the first rod that ties the same two
    once = "given once; rods[{}] ties the same two"
    refuse("pairs", first < np.arange(rods), lambda k: once.format(first[k]))
    shared = int((np.bincount(pairs.ravel() + fixed)[fixed:] ** 2).sum())
    what = "the number of entries of A, two for rods that meet,"
    need(shared <= FILLED, what, shared, f"{FILLED} at most")
    found = np.linalg.norm(differences(q0, anchors, pairs), axis=-1)
    refuse("pairs", found <= 1 / HUGE, lambda _: "two points apart, or it is no rod")
    lengths[[*bare]] = found[[*bare]]
    off = abs(lengths - found) > fit * found
    apart = "{:.9g} m, to {:g} %; that is how far apart its ends are"
    refuse("lengths", off, lambda k: apart.format(found[k], 100 * fit))
    system["pairs"] = list(zip(i.tolist(), j.tolist(), strict=True))
    if functions:
        check_functions(system, *functions)
    return system


def check_functions(system, external_force, constraint_violation, energy):
    """Raise SceneError where one has a wrong shape, or does not measure each of several states."""
    found = np.shape(external_force(system, system["q0"], system["v0"]))
    need(found == system["q0"].shape, "the shape of external_force", found, system["q0"].shape)
    scale = np.arange(1.0, 4.0)[:, None, None]
    q, v = scale * (system["q0"] + 1.0), scale * (system["v0"] + 1.0)
    measures = ("constraint_violation", constraint_violation, q), ("energy", energy, q, v)
    for name, measure, *states in measures:
        found = measure(system, *states)
        each = [float(measure(system, *state)) for state in zip(*states, strict=True)]
        right = np.shape(found) == (3,) and np.allclose(found, each, 1e-9, 0.0)
        allowed = "those of each: q[..., i, :] for q[i], and sums over axis=(-2, -1)"
        need(right, f"{name} of three states at once", found, allowed)


def check_steps(dt, steps):
    """Raise SceneError unless a run can take so many `steps` of `dt` s."""
    need(isinstance(dt, Real) and 1 / HUGE <= dt < HUGE, "dt", dt, POSITIVE.format("seconds"))
    need(isinstance(steps, Integral) and steps >= 1, "steps", steps, "a whole number >= 1")


def checked_step(step_fn, integrator, method):
    """step_fn, which raises SceneError where it returns anything but q and v of their shape.

    Raises SceneError if the method is made for another integrator.
    """
    fits = method.integrator in (None, integrator)
    need(fits, "the integrator", integrator, f"{method.integrator}, which the method is made for")
    who = f"{integrator} and post_step" if method.post_step else integrator

    def step(q, v, m, force, dt):
        end = step_fn(q, v, m, force, dt)
        many = isinstance(end, tuple | list)
        found = list(map(np.shape, end)) if many else np.shape(end)
        wanted = f"q and v, {q.shape} each"
        need(found == [q.shape, q.shape], f"the shape of a step's end ({who})", found, wanted)
        return end

    return step
