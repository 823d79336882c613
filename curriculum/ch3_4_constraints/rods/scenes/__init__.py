"""Reads scenes from files; a mistake in one is answered by a sentence.

    {"about": "what it shows",
     "anchors": [[0, 0, 0]],                                                            m
     "particles": [{"position": [1, 0, 0], "velocity": [0, 0, 0],                       m, m/s
                    "mass": 1, "load": [0, 0, 0]}],                                     kg, N
     "rods": [{"pair": [0, -1], "length": 1}]}                                          m

By default there are no anchors, velocities are 0, masses 1, and lengths as the positions say. A
load, 0 by default, is a constant force beside gravity.
A pair [i, j] ties particle i to particle j, or to an anchor: -1 is the first, -2 the second.
"""

import json
import os
from pathlib import Path

from curriculum.ch3_4_constraints.rods import systems
from curriculum.ch3_4_constraints.rods.statics import refusal
from curriculum.common.errors import Refused

LARGEST = 1e7  # bytes of a file
MOST_ENTRIES = 1000  # particles, rods or anchors in it
FIT = 1e-6  # the share by which a length in it may differ from the distance of its rod's ends
SHIPPED = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.json"))}


def load_scene(name, gravity, chains):
    """The system in the file `name`, or in the shipped scene of that name.

    Under gravity (3,), in m/s^2, no rod must have to break. `chains` are names without a file.
    Raises Refused.
    """
    name = os.fspath(name)
    path = Path(name if os.path.isfile(name) else SHIPPED.get(name, name))
    try:
        if not name.isprintable():  # metrics.json, page and terminal show it
            raise Refused("must be a name in characters that can be printed")
        system = parse_scene(read_document(path))
        why = refusal(system, gravity)
    except Refused as error:
        why = str(error)
    except (FileNotFoundError, NotADirectoryError):
        from difflib import get_close_matches  # here: a run without a slip is quicker

        known = [*chains, "chain", *SHIPPED]
        near = get_close_matches(name, known, 1)
        end = f"did you mean {near[0]!r}?" if near else f"scenes are {', '.join(known)}"
        why = f"no scene and no file; {end}"
    except OSError as error:
        why = f"cannot be read: {error.strerror}"
    if why:
        raise Refused(f"{systems.shorten(repr(name))}: {why}")
    return system


def read_document(path):
    """What a scene's file holds, as JSON; raises Refused, or OSError if it cannot be read."""
    if path.stat().st_size > LARGEST or not path.is_file():
        raise Refused(f"must be a plain file of at most {LARGEST / 1e6:g} MB")
    try:
        return json.loads(path.read_bytes(), object_pairs_hook=once)
    except Refused:
        raise
    except (ValueError, RecursionError) as error:  # not Unicode, or no end of brackets
        raise Refused(f"not JSON: {systems.shorten(str(error))}") from None


def once(pairs):
    """The dict of [(key, value)]; Refused if a key is there twice."""
    found = {}
    for key, value in pairs:
        systems.need(key not in found, "a key", key, "given once")
        found[key] = value
    return found


def only(x, field, keys):
    """Raise Refused unless x is an object that has no keys but `keys`."""
    systems.need(isinstance(x, dict), field, x, f"an object with no keys but {', '.join(keys)}")
    for key in x:
        systems.need(key in keys, f"a key of {field}", key, f"one of {', '.join(keys)}")


def entries(data, field, *keys):
    """The list data[field], of objects with no keys but `keys`; without any it may be empty."""
    rows = data.get(field, None if keys else [])
    least = 1 if keys else 0
    fits = isinstance(rows, list) and least <= len(rows) <= MOST_ENTRIES
    systems.need(fits, field, rows, f"a list of {least} to {MOST_ENTRIES} entries")
    if keys:
        for k, row in enumerate(rows):
            only(row, f"{field}[{k}]", keys)
    return rows


def parse_scene(data):
    """The system that a scene's JSON describes, checked; raises Refused."""
    only(data, "the file", ("about", "anchors", "particles", "rods"))
    particles = entries(data, "particles", "position", "velocity", "mass", "load")
    rods = entries(data, "rods", "pair", "length")
    rows = {
        "q0": [particle.get("position") for particle in particles],
        "v0": [particle.get("velocity", [0, 0, 0]) for particle in particles],
        "m": [[particle.get("mass", 1)] for particle in particles],
        "anchors": entries(data, "anchors"),
        "pairs": [rod.get("pair") for rod in rods],
        "lengths": [rod.get("length", 1) for rod in rods],
    }
    if "about" in data:
        about = data["about"]
        shown = isinstance(about, str) and "".join(about.split()).isprintable()
        systems.need(shown, "about", about, "text in characters that can be printed")
        if about.strip():
            rows["about"] = about
    if any("load" in particle for particle in particles):
        rows["load"] = [particle.get("load", [0, 0, 0]) for particle in particles]
    bare = [k for k, rod in enumerate(rods) if "length" not in rod]
    return systems.check_system(
        rows, None, fit=FIT, name=lambda key, k: systems.COLUMNS[key][3].format(k), bare=bare
    )
