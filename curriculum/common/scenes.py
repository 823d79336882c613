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

FIT = 1e-6  # how far, relative, a stated length may be from the distance between the positions
SINGULAR = 1e-9  # relative, of the largest singular value: below, J has lost rank


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
    except ValueError as error:  # not UTF-8, or not JSON
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
    """A finite JSON number (true and false are not)."""
    return isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x)


def vector(x, field):
    """Three finite numbers as a list."""
    need(isinstance(x, list) and len(x) == 3 and all(map(is_number, x)), field, x, "three finite numbers [x, y, z]")
    return x


def entries(data, key, field, keys):
    """The list data[key] of objects that have no keys but `keys`; at least one."""
    rows = data.get(key)
    need(isinstance(rows, list) and rows, field, rows, "a list with at least one entry")
    for k, row in enumerate(rows):
        need(isinstance(row, dict), f"{field}[{k}]", row, f"an object with {', '.join(keys)}")
        need(set(row) <= set(keys), f"{field}[{k}]", sorted(row), f"an object with no keys but {', '.join(keys)}")
    return rows


def parse_scene(data):
    """Shapes, types and ranges of a scene's JSON; the arguments for make_system."""
    need(isinstance(data, dict), "the file", data, "an object with particles, rods and anchors")
    unknown = sorted(set(data) - {"about", "anchors", "particles", "rods"})
    need(not unknown, "the scene's keys", unknown, "about, anchors, particles, rods")
    particles = entries(data, "particles", "particles", ("position", "velocity", "mass"))
    anchors = data.get("anchors", [])
    need(isinstance(anchors, list), "anchors", anchors, "a list of points")
    anchors = [vector(a, f"anchors[{k}]") for k, a in enumerate(anchors)]
    q0 = np.array([vector(p.get("position"), f"particles[{k}].position") for k, p in enumerate(particles)], dtype=float)
    v0 = [vector(p.get("velocity", [0, 0, 0]), f"particles[{k}].velocity") for k, p in enumerate(particles)]
    m = [p.get("mass", 1.0) for p in particles]
    for k, mass in enumerate(m):
        need(is_number(mass) and mass > 0, f"particles[{k}].mass", mass, "a finite number of kilograms > 0")
    pairs, lengths, seen = [], [], {}
    points = np.concatenate([q0, np.array(anchors, dtype=float).reshape(-1, 3)[::-1]])  # index -1: the first anchor
    for k, rod in enumerate(entries(data, "rods", "rods", ("pair", "length"))):
        pair, field = rod.get("pair"), f"rods[{k}].pair"
        whole = isinstance(pair, list) and len(pair) == 2 and all(type(i) is int for i in pair)
        need(whole, field, pair, "two whole numbers [i, j]")
        i, j = pair
        allowed = f"a particle 0..{len(q0) - 1}, tied to another or to an anchor -1..-{len(anchors)}"
        need(0 <= i < len(q0) and -len(anchors) <= j < len(q0) and i != j, field, pair, allowed)
        first = seen.setdefault((i, j) if j < 0 else (min(i, j), max(i, j)), k)
        need(first == k, field, pair, f"given once; rods[{first}] ties the same two")
        found = math.dist(points[i], points[j])
        need(found > 0, field, pair, "two points apart: a rod of length zero has no direction")
        length = rod.get("length", found)
        need(is_number(length) and length > 0, f"rods[{k}].length", length, "a finite number of metres > 0")
        fits = abs(length - found) <= FIT * found
        need(fits, f"rods[{k}].length", length, f"the distance of its ends in the positions, {found:.9g} m")
        pairs.append((i, j))
        lengths.append(float(length))
    return {"q0": q0, "v0": v0, "m": m, "pairs": pairs, "lengths": lengths, "anchors": anchors or [[0.0, 0.0, 0.0]]}


def check_start(scene):
    """Raise SceneError if the start cannot move without breaking a rod.

    The velocities must satisfy J v = 0. Where J has lost rank, a self-stress u (J^T u = 0) carries no force, so nothing
    can keep u . gddot at zero but the motion itself: u . Jdot v = 0 is needed, and for a start at rest, two derivatives
    on, sum_k u_k |a_k|^2 = 0 with a_k the acceleration of rod k. A taut level cable fails that: only an infinite
    tension would carry its weight.
    """
    pairs, n = scene["pairs"], len(scene["q0"])
    ground = np.array(scene["anchors"], dtype=float)
    inc = np.zeros((len(pairs), n))
    for k, (i, j) in enumerate(pairs):
        inc[k, i] += 1.0
        if j >= 0:
            inc[k, j] -= 1.0
    fixed = np.array([ground[-1 - j] if j < 0 else np.zeros(3) for _, j in pairs])
    d, rate = inc @ scene["q0"] - fixed, inc @ np.array(scene["v0"], dtype=float)
    unit = d / np.linalg.norm(d, axis=1)[:, None]
    stretch = np.sum(unit * rate, axis=1)
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > FIT * (1.0 + np.abs(rate).max()):
        raise SceneError(f"rods[{k}] is being stretched at {stretch[k]:.3g} m/s; velocities must keep every length")
    w = 1.0 / np.repeat(np.array(scene["m"], dtype=float), 3)
    jac = (inc[:, :, None] * unit[:, None, :]).reshape(len(pairs), -1) * np.sqrt(w)
    left, values, _ = np.linalg.svd(jac)
    rank = int(np.sum(values > math.sqrt(SINGULAR) * values[0]))
    stress = left[:, rank:].T  # one row a self-stress
    curl = np.sum(rate**2, axis=1) / np.linalg.norm(d, axis=1)
    if not rate.any() and len(stress):
        fall = np.tile([0.0, -9.81, 0.0], n)
        lam = np.linalg.lstsq(jac.T, fall / np.sqrt(w), rcond=math.sqrt(SINGULAR))[0]
        accel = (fall - np.sqrt(w) * (jac.T @ lam)).reshape(n, 3)
        curl = np.sum((inc @ accel) ** 2, axis=1) / np.linalg.norm(d, axis=1)
    for row in stress:
        if abs(row @ curl) > FIT * (np.abs(row) @ curl):
            k = int(np.argmax(np.abs(row)))
            raise SceneError(
                f"the rods around rods[{k}] are taut: in this pose no finite tension can hold them; "
                "give the loop some slack, or leave a rod out"
            )
