"""Scenes, from a file or typed in, checked so that a mistake is answered by a sentence.

    {"about": "what it shows",
     "anchors": [[0, 0, 0]],                                                            m
     "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 1}],          m, m/s, kg
     "rods": [{"pair": [0, -1], "length": 1}]}                                          m

By default there are no anchors, velocities are 0, masses 1, and lengths as the positions say.
A pair [i, j] ties particle i to particle j, or to an anchor: -1 is the first, -2 the second.
"""

import json
from argparse import ArgumentTypeError
from decimal import Decimal, localcontext
from itertools import accumulate
from operator import mul
from pathlib import Path

from curriculum.ch3_4_constraints.statics import differences, refusal
from curriculum.common.cli import meant, shorten

import numpy as np

FIT = 1e-6  # relative: how far a length in a file may be from the distance of the rod's ends
ROUGH = 0.1  # the same of a typed system, which may start wrong on purpose, but not by a slip
LARGEST, MOST = 1e7, 1000  # bytes of a file; particles, rods or anchors in it
CROWD = 10_000  # pairs of rods that share a particle: entries of A, which fill up in a solve
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


class SceneError(ArgumentTypeError, ValueError):
    """A scene that cannot be run: its sentence names field and index, and what is allowed."""


def direction(angle):
    """(cos, sin, 0) of an angle in rad, a few turns at most: libm's depend on the processor."""
    with localcontext(prec=50):  # for the series of exp(i angle), whose terms turn by i
        steps = (Decimal(angle) / k for k in range(1, 100))
        terms = list(accumulate(steps, mul, initial=Decimal(1)))
        cosine, sine = (sum(terms[k::4]) - sum(terms[k + 2 :: 4]) for k in (0, 1))
        return np.array([float(cosine), float(sine), 0.0])


def load_scene(name, folder, others, gravity):
    """The system in the file `name`, or in the scene of that name in `folder`; or a SceneError.

    `others`: right names that are no files. gravity (3,), m/s^2: so that no rod must break at once.
    """
    shipped = {path.stem: path for path in folder.glob("*.json")}
    shown = repr(name if len(name) < 100 else "..." + name[-97:])
    path = shipped[name] if name in shipped and not Path(name).exists() else Path(name)
    try:
        if not name or not path.exists():
            known = [*others, *sorted(shipped)]
            end = meant(name, known, f"; scenes are {', '.join(known)}")
            raise SceneError(f"no scene and no file{end}")
        if not path.is_file() or path.stat().st_size > LARGEST:
            raise SceneError(f"must be a plain file of at most {LARGEST / 1e6:g} MB")
        system = parse_scene(json.loads(path.read_bytes()))
        if not (why := refusal(system, gravity)):
            return system
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
    except SceneError as error:
        why = str(error)
    except (ValueError, RecursionError) as error:  # not Unicode, or no end of brackets
        why = f"not JSON: {shorten(str(error))}"
    raise SceneError(f"{shown}: {why}")


def need(test, field, found, allowed):
    """Raise SceneError unless `test`."""
    if not test:
        found = json.dumps(found, default=lambda x: getattr(x, "tolist", x.__repr__)())
        raise SceneError(f"{field} is {shorten(found)}; must be {allowed}")


def only(x, field, keys):
    """Raise SceneError unless x is an object that has no keys but `keys`."""
    found = sorted(x) if isinstance(x, dict) else x
    good = isinstance(x, dict) and {*x} <= {*keys}
    need(good, field, found, f"an object with no keys but {', '.join(keys)}")


def entries(data, field, keys=()):
    """The list data[field], of objects with no keys but `keys`; without any it may be empty."""
    rows, least = data.get(field, None if keys else []), int(bool(keys))
    fits = isinstance(rows, list) and least <= len(rows) <= MOST
    need(fits, field, rows, f"a list of {least} to {MOST} entries")
    for k, row in enumerate(rows if keys else ()):
        only(row, f"{field}[{k}]", keys)
    return rows


def parse_scene(data):
    """The system that a scene's JSON describes, checked; raises SceneError."""
    only(data, "the file", ("about", "anchors", "particles", "rods"))
    particles = entries(data, "particles", ("position", "velocity", "mass"))
    rods = entries(data, "rods", ("pair", "length"))
    rows = {
        "q0": [particle.get("position") for particle in particles],
        "v0": [particle.get("velocity", [0, 0, 0]) for particle in particles],
        "m": [particle.get("mass", 1) for particle in particles],
        "anchors": entries(data, "anchors"),
        "pairs": [rod.get("pair") for rod in rods],
        "lengths": [rod.get("length", 1) for rod in rods],
    }
    system = {key: read(key, rows[key]) for key in COLUMNS}
    bare = [k for k, rod in enumerate(rods) if "length" not in rod]
    return checked(system, FIT, lambda key, k: COLUMNS[key][4].format(k), bare)


def check_system(system):
    """A typed system as a run needs it: arrays of float64, pairs as a list; other keys are kept.

    q0 and v0 (..., N, 3) may be many starts. A length may be a tenth off. Raises SceneError.
    """
    need(set(COLUMNS) <= {*system}, "a system", [*system], f"a dict with {', '.join(COLUMNS)}")
    typed = {key: column(key, system[key]) for key in COLUMNS}
    return system | checked(typed, ROUGH, "{}[{}]".format, [])


def read(key, rows):
    """The array of one of a system's keys, whose rows are JSON."""
    dtype, row, low, _, place, allowed = COLUMNS[key]
    for k, x in enumerate(rows):
        numbers = np.array(x, object)  # as they stand there: true is no number
        right = numbers.shape == (() if key == "m" else row)
        right = right and all(type(y) in (int, dtype) and low < y < HUGE for y in numbers.flat)
        need(right, place.format(k), x, allowed)
    return np.array(rows, dtype).reshape(-1, *row)


def column(key, typed):
    """The array of one of a system's keys, that was typed as an array or a list."""
    dtype, row, low, shape, _, allowed = COLUMNS[key]
    try:
        array = np.asarray(typed)
    except ValueError:
        array = np.array(None)  # rows of several lengths
    axes = array.ndim - len(row)  # one of rows; starts may have more, of members
    right = axes == 1 or (axes > 1 and key in ("q0", "v0"))
    right = right and array.shape[axes:] == row and array.dtype.kind in ("iuf", "iu")[dtype is int]
    need(right, key, typed, f"a list or an array {shape}, each row {allowed}")
    bad = ~((array > low) & (array < HUGE))
    for at in np.argwhere(bad)[:1, :axes].tolist():  # of the first bad row
        need(False, f"{key}{at}", array[tuple(at)], allowed)
    return array.astype(dtype)


def checked(system, fit, name, bare):
    """The arrays of a system, checked against each other. Lengths may be off by a share `fit`, and
    those of the rods `bare` are measured; name(key, k): what row k is called."""

    def refuse(key, bad, allowed):
        """Raise SceneError for the first bad row of system[key]; allowed(its index): words."""
        if np.any(bad):
            k = int(np.argwhere(bad)[0][-1])  # whatever start it is bad in
            need(False, name(key, k), np.squeeze(system[key][k]), allowed(k))

    q0, _, m, anchors, pairs, lengths = (system[key] for key in COLUMNS)
    n, fixed, rods = q0.shape[-2], len(anchors), len(pairs)
    need(n and rods, "the number of particles and rods", [n, rods], "at least one of each")
    for key, shape in ("v0", q0.shape), ("m", (n, 1)), ("lengths", (rods,)):
        need(system[key].shape == shape, f"the shape of {key}", system[key].shape, shape)
    refuse("m", m[:, 0] > HUGE * m.min(), lambda _: f"at most {HUGE:g} times {m.min():g} kg")
    i, j = pairs.T
    wrong = (i < 0) | (i >= n) | (j < -fixed) | (j >= n) | (i == j)
    ends = f" or to an anchor -1..-{fixed}" if fixed else "; there are no anchors"
    refuse("pairs", wrong, lambda _: f"a particle 0..{n - 1}, tied to another{ends}")
    ties, seen = (np.minimum(i, j) * (n + fixed) + np.maximum(i, j)).tolist(), {}
    again = np.array([seen.setdefault(tie, k) < k for k, tie in enumerate(ties)])
    refuse("pairs", again, lambda k: f"given once; rods[{seen[ties[k]]}] ties the same two")
    shared = int((np.bincount(pairs.ravel() + fixed)[fixed:] ** 2).sum())
    need(shared <= CROWD, "the number of pairs of rods that meet", shared, f"{CROWD} at most")
    found = np.linalg.norm(differences(q0.reshape(-1, n, 3), anchors, pairs), axis=-1)
    refuse("pairs", found <= 1 / HUGE, lambda _: "two points apart, or it is no rod")
    lengths[bare] = found[0, bare]
    off, allowed = abs(lengths - found) > fit * found, "{:.9g} m, as its ends are apart, to {:g} %"
    refuse("lengths", off, lambda k: allowed.format(found[off[:, k], k][0], 100 * fit))
    return system | {"pairs": list(zip(i.tolist(), j.tolist(), strict=True))}


def chosen(name, table):
    """The Hold of this name in a table of modes; raises ValueError if there is none."""
    if name not in table:
        end = meant(name, table, f"; modes are {', '.join(table)}")
        raise ValueError(f"{shorten(name)!r} is no mode{end}")
    return table[name]


def misfit(hold, rule):
    """Why a Hold, if it is one, is nothing for the integrator of this name; None if it fits."""
    if not hold or hold.rule in (None, rule):
        return None
    step = "which does not end a step at q + dt (v + dt a)"
    return f"does not fit {rule}, {step}; give --integrator {hold.rule}"


def check_run(system, force, dt, steps, step_fn, rules):
    """The system as check_system gives it; ValueError if something does not fit a run.

    `rules`: integrators by name. A step_fn that is none of them is the caller's own affair.
    """
    hold = getattr(force, "hold", None)
    if hold and hold.dt not in (None, dt):
        raise ValueError(f"this force is for steps of {hold.dt:g} s, not of {dt:g} s")
    for name, rule in rules.items():
        if rule is step_fn and (why := misfit(hold, name)):
            raise ValueError(f"this force {why}")
    if not (isinstance(steps, (int, np.integer)) and steps >= 0 and dt > 0.0):
        allowed = "a whole number of steps >= 0, of dt > 0 s"
        raise ValueError(f"a run takes {allowed}, not {steps!r} of {dt}")
    system = check_system(system)
    own = getattr(force, "system", system)
    if not np.array_equal(own["pairs"], system["pairs"]):
        raise ValueError("this force is for another system: its rods tie other pairs")
    return system
