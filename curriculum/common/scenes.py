"""Scene files: particles, rods and anchors in JSON, checked so that a mistake is answered by a sentence.

    {"about": "what it shows",
     "anchors":   [[0, 0, 0]],                                                        metres
     "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 1}],        m, m/s (default 0), kg (default 1)
     "rods":      [{"pair": [0, -1], "length": 1}]}                                   m (default: as the positions say)

A pair [i, j] ties particle i to particle j, or to an anchor: -1 is the first, -2 the second.
"""

import json
import math
from pathlib import Path

import numpy as np

FIT = 1e-6  # relative: how far a stated length may be from the distance between the positions
SINGULAR = 1e-9  # relative to the largest eigenvalue of J J^T: below, J has lost rank
TAUT = 1e-4  # relative: how far the terms of a self-stress may be from cancelling
HUGE = 1e30  # what is larger, or smaller than 1 / HUGE and divides, may overflow once squared and multiplied
GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2, y is up


def incidence(pairs, n, anchors):
    """Signed incidence B (C, n) of rods on particles, +1 at i and -1 at j, and the anchors' part of d = B q + fixed."""
    eye, (i, j) = np.eye(n + len(anchors)), np.array(pairs).T
    full = eye[i] - eye[j]  # a negative j counts from the end, where the anchors stand in reverse
    return full[:, :n], full[:, n:] @ anchors[::-1]


class SceneError(ValueError):
    """A scene that cannot be run; the message names the file, the field, the index and what is allowed."""


def load_scene(path):
    """Arguments for make_system: q0, v0 (N, 3), m (N,), pairs, lengths (C,), anchors (K, 3), from the file at `path`.

    Raises SceneError for a missing or malformed file, and for a scene that no rod tensions can hold.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise SceneError(f"{str(path)!r} is no chapter scene (pendulum, double, triple, chain) and no file") from None
    except OSError as error:
        raise SceneError(f"{str(path)!r} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # not UTF-8, not JSON, or a bottomless pit of brackets
        raise SceneError(f"{str(path)!r} is not JSON: {error}") from None
    try:
        scene = parse_scene(data)
        check_start(scene)
    except SceneError as error:
        raise SceneError(f"{str(path)!r}: {error}") from None
    return scene


def need(test, field, found, allowed):
    """Raise SceneError unless `test`."""
    if not test:
        text = json.dumps(found)
        raise SceneError(f"{field} is {text if len(text) < 60 else text[:57] + '...'}; must be {allowed}")


def is_number(x):
    """A finite JSON number under HUGE (true and false are none; NaN is under nothing)."""
    return isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) < HUGE


def vector(x, field):
    """Three finite numbers as a list."""
    good = isinstance(x, list) and len(x) == 3 and all(map(is_number, x))
    need(good, field, x, f"three finite numbers [x, y, z] under {HUGE:g}")
    return x


def positive(x, field, unit):
    """A number that can be divided by, as a float."""
    need(is_number(x) and x > 1.0 / HUGE, field, x, f"a finite number of {unit} > 0 ({1.0 / HUGE:g} to {HUGE:g})")
    return float(x)


def entries(data, field, keys):
    """The list data[field] of objects that have no keys but `keys`; at least one."""
    rows = data.get(field)
    need(isinstance(rows, list) and rows, field, rows, "a list with at least one entry")
    for k, row in enumerate(rows):
        need(isinstance(row, dict), f"{field}[{k}]", row, f"an object with {', '.join(keys)}")
        need(set(row) <= set(keys), f"{field}[{k}]", sorted(row), f"an object with no keys but {', '.join(keys)}")
    return rows


def parse_scene(data):
    """Shapes, types and ranges of a scene's JSON; the arguments for make_system."""
    need(isinstance(data, dict), "the file", data, "an object with particles, rods and anchors")
    known = ("about", "anchors", "particles", "rods")
    need(set(data) <= set(known), "the file", sorted(data), f"an object with no keys but {', '.join(known)}")
    particles = entries(data, "particles", ("position", "velocity", "mass"))
    anchors = data.get("anchors", [])
    need(isinstance(anchors, list), "anchors", anchors, "a list of points [x, y, z]")
    anchors = [vector(a, f"anchors[{k}]") for k, a in enumerate(anchors)]
    q0 = [vector(p.get("position"), f"particles[{k}].position") for k, p in enumerate(particles)]
    v0 = [vector(p.get("velocity", [0, 0, 0]), f"particles[{k}].velocity") for k, p in enumerate(particles)]
    m = [positive(p.get("mass", 1), f"particles[{k}].mass", "kilograms") for k, p in enumerate(particles)]
    points = q0 + anchors[::-1]  # index -1: the first anchor
    allowed = f"a particle 0..{len(q0) - 1}, tied to another"
    allowed += f" or to an anchor -1..-{len(anchors)}" if anchors else "; there are no anchors"
    pairs, lengths, seen = [], [], {}
    for k, rod in enumerate(entries(data, "rods", ("pair", "length"))):
        pair, field = rod.get("pair"), f"rods[{k}].pair"
        whole = isinstance(pair, list) and len(pair) == 2 and all(type(i) is int for i in pair)
        need(whole, field, pair, "two whole numbers [i, j]")
        i, j = pair
        need(0 <= i < len(q0) and -len(anchors) <= j < len(q0) and i != j, field, pair, allowed)
        first = seen.setdefault(frozenset(pair), k)
        need(first == k, field, pair, f"given once; rods[{first}] ties the same two")
        found = math.dist(points[i], points[j])
        need(found > 1.0 / HUGE, field, pair, "two points apart: a rod of length zero has no direction")
        length = positive(rod.get("length", found), f"rods[{k}].length", "metres")
        fits = abs(length - found) <= FIT * found
        need(fits, f"rods[{k}].length", length, f"the distance of its ends in the positions, {found:.9g} m")
        pairs.append((i, j))
        lengths.append(length)
    return {"q0": q0, "v0": v0, "m": m, "pairs": pairs, "lengths": lengths, "anchors": anchors or [[0, 0, 0]]}


def check_start(scene):
    """Raise SceneError if the start cannot move without breaking a rod.

    The velocities must satisfy J v = 0. Where J has lost rank, a self-stress u (J^T u = 0) carries no force, so nothing
    can keep u . gddot at zero but the motion itself: u . Jdot v = 0 is needed, and where its rods are at rest, two
    derivatives on, sum_k u_k |a_k|^2 = 0 with a_k the acceleration of rod k. A taut level cable fails that: only an
    infinite tension would carry its weight.
    """
    q, n, m = np.array(scene["q0"], dtype=float), len(scene["q0"]), np.repeat(scene["m"], 3)
    inc, fixed = incidence(scene["pairs"], n, np.array(scene["anchors"], dtype=float))
    d = inc @ q + fixed
    rate, length = inc @ np.array(scene["v0"], dtype=float), np.linalg.norm(d, axis=1)
    unit = d / length[:, None]
    stretch = np.sum(unit * rate, axis=1)
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > FIT * (1.0 + np.abs(rate).max()):
        raise SceneError(f"rods[{k}] is stretched at {stretch[k]:.3g} m/s; must be 0: velocities keep every length")
    jac = (inc[:, :, None] * unit[:, None, :]).reshape(len(d), -1)
    values, vectors = np.linalg.eigh(jac @ jac.T)
    lost = values <= SINGULAR * values[-1]
    stress, basis = vectors.T[lost], vectors.T[~lost]
    curl = np.sum(rate**2, axis=1) / length
    if lost.any() and np.abs(rate[np.abs(stress).max(axis=0) > FIT]).max() < FIT:
        root, fall = np.sqrt(m), np.tile(GRAVITY, n)
        rows = basis @ jac / root
        accel = fall - rows.T @ np.linalg.lstsq(rows.T, root * fall, rcond=None)[0] / root
        curl = np.sum((inc @ accel.reshape(n, 3)) ** 2, axis=1) / length
    floor = (FIT * GRAVITY[1]) ** 2 / length  # lest rounding errors of a structure at rest look like motion
    for row in stress:
        if abs(row @ curl) > TAUT * (np.abs(row) @ (curl + floor)):
            raise SceneError(
                f"the rods around rods[{int(np.argmax(np.abs(row)))}] are taut: in this pose no finite tension can "
                "hold them; give the loop some slack, or leave a rod out"
            )
