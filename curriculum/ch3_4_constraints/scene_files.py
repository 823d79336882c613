"""Reads scenes from files; a mistake in one is answered by a sentence.

    {"about": "what it shows",
     "anchors": [[0, 0, 0]],                                                            m
     "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0], "mass": 1}],          m, m/s, kg
     "rods": [{"pair": [0, -1], "length": 1}]}                                          m

By default there are no anchors, velocities are 0, masses 1, and lengths as the positions say.
A pair [i, j] ties particle i to particle j, or to an anchor: -1 is the first, -2 the second.
"""

import json
import os
from pathlib import Path

from curriculum.ch3_4_constraints.statics import refusal
from curriculum.ch3_4_constraints.systems import COLUMNS, FIT, HUGE, MOST, SceneError, checked, need
from curriculum.common.cli import meant, shorten

import numpy as np

LARGEST = 1e7  # bytes of a file


def shipped(chapter):
    """{name: path} of the scenes that come with a chapter, in order."""
    return {path.stem: path for path in sorted(chapter.glob("scenes/*.json"))}


def about(counts, chapter):
    """{name: a sentence} of all systems: {name: how many rods} of those made, and the scenes."""
    told = {name: f"let go level, rods: {count}" for name, count in counts.items()}
    told["chain"] = "let go level, rods: 10, or as --links says"
    for name, path in shipped(chapter).items():
        told[name] = read_document(path)["about"]
    return told


def load_scene(name, chapter, others, gravity):
    """The system in the file `name`, or in the `chapter`'s scene of that name; or a SceneError.

    `others`: right names that are no files. gravity (3,), m/s^2: so that no rod must break at once.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise SceneError(f"{shorten(repr(name))} is neither the name of a scene nor a path")
    name, scenes = os.fspath(name), shipped(chapter)
    shown = repr(name if len(name) < 100 else "..." + name[-97:])
    path = name if os.path.lexists(name) else scenes.get(name, name)
    try:
        os.lstat(path)  # be it a link that leads nowhere
        system = parse_scene(read_document(Path(path)))
        why = refusal(system, gravity)
        if why is None:
            return system
    except SceneError as error:
        why = str(error)
    except (FileNotFoundError, NotADirectoryError, ValueError):  # of no character that names have
        known = [*others, *scenes]
        why = "no scene and no file" + meant(name, known, f"; scenes are {', '.join(known)}")
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
    raise SceneError(f"{shown}: {why}")


def read_document(path):
    """What a scene's file holds, as JSON; raises SceneError, or OSError if it cannot be read."""
    if not path.exists():
        raise SceneError("a link that leads to no file")
    if not path.is_file() or path.stat().st_size > LARGEST:
        raise SceneError(f"must be a plain file of at most {LARGEST / 1e6:g} MB")
    try:
        return json.loads(path.read_bytes(), object_pairs_hook=once_each)
    except SceneError:
        raise
    except (ValueError, RecursionError) as error:  # not Unicode, or no end of brackets
        raise SceneError(f"not JSON: {shorten(str(error))}") from None


def once_each(pairs):
    """The object of these (key, value) pairs; raises SceneError if a key is given twice."""
    found = {}
    for key, value in pairs:
        if key in found:
            both = shorten(f"{json.dumps(found[key])} and {json.dumps(value)}")
            raise SceneError(f"{json.dumps(key)} is given twice in one object: {both}")
        found[key] = value
    return found


def only(x, field, keys):
    """Raise SceneError unless x is an object that has no keys but `keys`."""
    allowed = f"an object with no keys but {', '.join(keys)}"
    need(isinstance(x, dict), field, x, allowed)
    unknown = sorted({*x} - {*keys})
    if unknown:
        raise SceneError(f"{field} has a key {shorten(json.dumps(unknown[0]))}; must be {allowed}")


def entries(data, field, *keys):
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
    particles = entries(data, "particles", "position", "velocity", "mass")
    rods = entries(data, "rods", "pair", "length")
    rows = {
        "q0": [particle.get("position") for particle in particles],
        "v0": [particle.get("velocity", [0, 0, 0]) for particle in particles],
        "m": [particle.get("mass", 1) for particle in particles],
        "anchors": entries(data, "anchors"),
        "pairs": [rod.get("pair") for rod in rods],
        "lengths": [rod.get("length", 1) for rod in rods],
    }
    system, places = {}, {}
    for key, (dtype, row, low, _, place, allowed) in COLUMNS.items():
        for k, x in enumerate(rows[key]):
            numbers = np.array(x, object)  # as they stand there: true is no number
            right = numbers.shape == (() if key == "m" else row)
            right = right and all(type(y) in (int, dtype) and low < y < HUGE for y in numbers.flat)
            need(right, place.format(k), x, allowed)
        system[key], places[key] = np.array(rows[key], dtype).reshape(-1, *row), place
    bare = [k for k, rod in enumerate(rods) if "length" not in rod]
    return checked(system, FIT, lambda key, k: places[key].format(k), bare)
