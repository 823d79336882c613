"""Scene files: particles, rods and anchors in JSON, checked so that a mistake is answered by a
sentence.

    {"about": "what it shows",
     "anchors":   [[0, 0, 0]],                                                        metres
     "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 1}],        m, m/s
     (default 0), kg (default 1) "rods":      [{"pair": [0, -1], "length": 1}]}
                  m (default: as the positions say)

A pair [i, j] ties particle i to particle j, or to an anchor: -1 is the first, -2 the second.
"""

import json
import math
from collections import Counter
from decimal import Decimal, localcontext
from difflib import get_close_matches
from pathlib import Path

from curriculum.ch3_4_constraints import large
from curriculum.common.graph import has_loop

import numpy as np

FIT = 1e-6  # relative: how far a stated length may be from the distance between the positions
SINGULAR = 1e-9  # relative to the largest eigenvalue of J J^T: below, J has lost rank
TAUT = 1e-4  # relative: how far the terms of a self-stress may be from cancelling
LARGEST, MOST = 1e7, 20_000  # bytes of a file; particles, rods or anchors
CROWD = 400_000  # pairs of rods that share a particle: the entries of A
HUGE = 1e30  # what is larger, or smaller than 1 / HUGE and divides, may overflow once squared and multiplied
UNLIKE = (
    1e12  # the heaviest mass over the lightest: beyond, the heavy one's share of A is rounded away
)
GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2, y is up
CHAPTER = ["pendulum", "double", "triple", "chain"]


def direction(angle):
    """The unit vector (cos, sin, 0) of an angle in rad (a few turns at most): libm's sine depends
    on the processor."""
    with localcontext() as context:
        context.prec = 50
        term, sums, k = Decimal(1), [Decimal(0), Decimal(0)], 0
        while abs(term) > Decimal("1e-40"):  # the series of exp(i angle): 1, i, -1, -i in turn
            sums[k % 2] += term * (1, 1, -1, -1)[k % 4]
            k += 1
            term *= Decimal(angle) / k
        return np.array([float(sums[0]), float(sums[1]), 0.0])


class SceneError(ValueError):
    """A scene that cannot be run; the message names the file, the field, the index and what is
    allowed."""


def load_scene(name, folder):
    """The system in the file `name`, or in the scene of that name in `folder`: a dict as
    build_system has it.

    Raises SceneError for a missing or malformed file, and for a scene that no rod tensions can
    hold.
    """
    shipped = {path.stem: path for path in folder.glob("*.json")}
    path, shown = Path(name), repr(name if len(name) < 100 else "..." + name[-97:])
    if name in shipped and not path.exists():
        path = shipped[name]
    try:
        if not name or not path.exists():
            near = get_close_matches(name.lower(), CHAPTER + list(shipped), 1)
            hint = (
                f"; did you mean {near[0]!r}?"
                if near
                else f"; scenes are {', '.join(CHAPTER + sorted(shipped))}"
            )
            raise SceneError(f"{shown} is no scene and no file{hint}")
        if not path.is_file() or path.stat().st_size > LARGEST:
            raise SceneError(f"{shown} must be a plain file of at most {LARGEST / 1e6:g} MB")
        content = path.read_bytes()
    except OSError as error:
        raise SceneError(f"{shown} cannot be read: {error.strerror}") from None
    try:
        scene = parse_scene(json.loads(content, object_pairs_hook=no_key_twice))
        check_start(scene)
    except SceneError as error:
        raise SceneError(f"{shown}: {error}") from None
    except (
        ValueError,
        RecursionError,
    ) as error:  # not Unicode, not JSON, or a bottomless pit of brackets
        raise SceneError(f"{shown} is not JSON: {shorten(str(error))}") from None
    scene = {key: x if key == "pairs" else np.array(x, dtype=float) for key, x in scene.items()}
    return scene | {"m": scene["m"][:, None]}


def shorten(text):
    """The text, or its beginning."""
    return text if len(text) < 60 else text[:57] + "..."


def no_key_twice(items):
    """The dict of JSON's `items`; raises SceneError for a key that is there twice."""
    found = dict(items)
    if len(found) < len(items):
        ((twice, _),) = Counter(key for key, _ in items).most_common(1)
        raise SceneError(
            f"the key {json.dumps(shorten(twice))} stands twice in one object; must stand once"
        )
    return found


def in_line(constraint_terms, system, run):
    """A hint for a run that could not go on: whether J (C, 3N) of constraint_terms loses rank where
    it stopped."""
    if not (run.stopped or "").startswith("stopped") or len(system["pairs"]) > large.LINKAGE:
        return ""
    ends = (system["q0"], system["v0"]), (run.q[-1], run.v[-1])
    rows = (constraint_terms(system, *end)[0] for end in ends)
    units = (jac / np.linalg.norm(jac, axis=1, keepdims=True) for jac in rows)
    (_, before, _), (left, sizes, _) = (np.linalg.svd(unit, full_matrices=False) for unit in units)
    last = (
        int(np.sum(before > 1e-6)) - 1
    )  # the weakest combination of rods; those after it were lost all along
    if sizes[last] >= 0.2 * before[last]:
        return ""
    around = f"the rods around rods[{np.argmax(np.abs(left[:, last]))}] are nearly in line there"
    return f"; {around}: no finite tension turns them; another --dt may step over that pose"


def need(test, field, found, allowed):
    """Raise SceneError unless `test`."""
    if not test:
        raise SceneError(f"{field} is {shorten(json.dumps(found))}; must be {allowed}")


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
    need(
        is_number(x) and x > 1.0 / HUGE,
        field,
        x,
        f"a finite number of {unit} > 0 ({1.0 / HUGE:g} to {HUGE:g})",
    )
    return float(x)


def entries(data, field, keys):
    """The list data[field] of objects that have no keys but `keys`; at least one."""
    rows = data.get(field)
    need(
        isinstance(rows, list) and 0 < len(rows) <= MOST,
        field,
        rows,
        f"a list of 1 to {MOST} entries",
    )
    for k, row in enumerate(rows):
        need(isinstance(row, dict), f"{field}[{k}]", row, f"an object with {', '.join(keys)}")
        need(
            set(row) <= set(keys),
            f"{field}[{k}]",
            sorted(row),
            f"an object with no keys but {', '.join(keys)}",
        )
    return rows


def parse_scene(data):
    """Shapes, types and ranges of a scene's JSON; a dict of lists q0, v0, m, pairs, lengths,
    anchors."""
    need(isinstance(data, dict), "the file", data, "an object with particles, rods and anchors")
    known = ("about", "anchors", "particles", "rods")
    need(
        set(data) <= set(known),
        "the file",
        sorted(data),
        f"an object with no keys but {', '.join(known)}",
    )
    need(isinstance(data.get("about", ""), str), "about", data.get("about"), "text")
    particles = entries(data, "particles", ("position", "velocity", "mass"))
    anchors = data.get("anchors", [])
    few = isinstance(anchors, list) and len(anchors) <= MOST
    need(few, "anchors", anchors, f"a list of points [x, y, z], {MOST} at most")
    anchors = [vector(a, f"anchors[{k}]") for k, a in enumerate(anchors)]
    q0 = [vector(p.get("position"), f"particles[{k}].position") for k, p in enumerate(particles)]
    v0 = [
        vector(p.get("velocity", [0, 0, 0]), f"particles[{k}].velocity")
        for k, p in enumerate(particles)
    ]
    m = [
        positive(p.get("mass", 1), f"particles[{k}].mass", "kilograms")
        for k, p in enumerate(particles)
    ]
    heavy, allowed = m.index(max(m)), f"at most {UNLIKE:g} times the lightest, {min(m):g} kg"
    need(m[heavy] <= UNLIKE * min(m), f"particles[{heavy}].mass", m[heavy], allowed)
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
        need(
            found > 1.0 / HUGE,
            field,
            pair,
            "two points apart: a rod of length zero has no direction",
        )
        length = positive(rod.get("length", found), f"rods[{k}].length", "metres")
        fits = abs(length - found) <= FIT * found
        need(
            fits,
            f"rods[{k}].length",
            length,
            f"the distance of its ends in the positions, {found:.9g} m",
        )
        pairs.append((i, j))
        lengths.append(length)
    return {
        "q0": q0,
        "v0": v0,
        "m": m,
        "pairs": pairs,
        "lengths": lengths,
        "anchors": anchors or [[0, 0, 0]],
    }


def check_start(scene):
    """Raise SceneError if the start cannot move without breaking a rod.

    The velocities must satisfy J v = 0. Where J has lost rank, a self-stress u (J^T u = 0) carries
    no force, so nothing can keep u . gddot at zero but the motion itself: u . Jdot v = 0 is needed,
    and where its rods are at rest, two derivatives on, sum_k u_k |a_k|^2 = 0 with a_k the
    acceleration of rod k. A taut level cable fails that: only an infinite tension would carry its
    weight.
    """
    q, v, anchors, lengths = (
        np.array(scene[key], dtype=float) for key in ("q0", "v0", "anchors", "lengths")
    )
    i, j = np.transpose(scene["pairs"])
    shared = sum(
        count * count
        for count in Counter(x for pair in scene["pairs"] for x in pair if x >= 0).values()
    )
    if shared > CROWD:
        raise SceneError(
            f"{shared} pairs of rods meet in a particle; at most {CROWD} can be solved for"
        )

    def along(x, fixed):
        return x[i] - np.concatenate([x, fixed[::-1]])[j]  # a negative j counts from the end

    d, rate = along(q, anchors), along(v, 0.0 * anchors)
    unit = d / lengths[:, None]
    stretch = np.sum(unit * rate, axis=1)
    k = int(np.argmax(np.abs(stretch)))
    if abs(stretch[k]) > FIT * (1.0 + np.abs(rate).max()):
        raise SceneError(
            f"rods[{k}] is stretched at {stretch[k]:.3g} m/s; must be 0: velocities keep every length"
        )
    if large.takes(scene) and not large.way(scene):
        raise SceneError(f"{len(i)} rods that are no chain need scipy: pip install -e '.[large]'")
    if len(i) > large.DENSE or not has_loop(tuple(scene["pairs"])):
        return
    tied = np.unique(np.append(i, j[j >= 0]))  # others fall freely
    column = np.full(len(q) + 1, len(tied))  # the last is of what stands still
    column[tied] = np.arange(len(tied))
    jac, rods = np.zeros((len(i), len(tied) + 1, 3)), np.arange(len(i))
    jac[rods, column[i]] = unit
    jac[rods, column[np.maximum(j, -1)]] -= unit
    jac = jac[:, :-1].reshape(len(i), -1)
    values, vectors = np.linalg.eigh(jac @ jac.T)
    lost = values <= SINGULAR * values[-1]
    stress, basis = vectors.T[lost], vectors.T[~lost]
    curl = np.sum(rate**2, axis=1) / lengths
    if lost.any() and np.abs(rate[np.abs(stress).max(axis=0) > FIT]).max() < FIT:
        root, fall = np.sqrt(np.repeat(np.array(scene["m"])[tied], 3)), np.tile(GRAVITY, len(tied))
        rows, accel = basis @ jac / root, np.zeros_like(q)
        held = fall - rows.T @ np.linalg.lstsq(rows.T, root * fall, rcond=None)[0] / root
        accel[tied] = held.reshape(-1, 3)
        curl = np.sum(along(accel, 0.0 * anchors) ** 2, axis=1) / lengths
    floor = (
        FIT * GRAVITY[1]
    ) ** 2 / lengths  # lest rounding errors of a structure at rest look like motion
    for row in stress:
        if abs(row @ curl) > TAUT * (np.abs(row) @ (curl + floor)):
            raise SceneError(
                f"the rods around rods[{int(np.argmax(np.abs(row)))}] are taut: in this pose no finite tension can "
                "hold them; give the loop some slack, or leave a rod out"
            )
