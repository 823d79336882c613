"""The page of a scene: all methods side by side, in any browser, under sliders and a hand.

The page has no formula of its own: the chapter's lines run once, on symbols, and what they did is
written as JavaScript, with the same bits. What an editor knows stands in page/.
"""

import json
import os
import re
from html import escape
from pathlib import Path
from unittest.mock import patch

import numpy as np

from curriculum.ch3_4_constraints import palette
from curriculum.ch3_4_constraints.systems import m_g_L
from curriculum.common.tracing import Untraceable
from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.trace import Program

HERE = Path(__file__).parent
MOST = 40  # rods: more are too slow for a browser
DAMPING = 0.1  # s: the hand's spring resists 1 m/s as it does a stretch of so many metres


class NoPage(ValueError):
    """A scene that no page can hold; the message says why."""


def play(chapter, args, system):
    """The text of the page of a run: its scene under each method. Same arguments, same bytes.

    `chapter`: the module constraints, as its reader has edited it. Raises NoPage.
    """
    name, rods = Path(args.system).stem, len(system["pairs"])
    chain = "A bob of 1 kg on a rod of 1 m" if rods == 1 else f"{rods} bobs of 1 kg on rods of 1 m"
    about, _, _ = system.get("about", f"{chain}, let go nearly level").partition(". ")
    scene = scene_script(chapter, system, args.integrator, {"dt": args.dt, **args.knobs}, {})
    parts = {
        "name": escape(name),
        "about": escape(about),
        "folder": escape(Path(os.path.relpath(HERE, args.out)).as_posix()),
        "style": palette_css() + page_file("style.css"),
        "script": f"const scene = {scene};\n" + page_file("parts.js") + page_file("play.js"),
    }
    return re.sub("{{(.*?)}}", lambda blank: parts[blank[1]], page_file("play.html"))


def page_file(name):
    """The text of a file in page/."""
    return (HERE / "page" / name).read_text(encoding="utf-8")


def palette_css():
    """The palette as variables of CSS: m0, m1 ... of the methods, and those of what is shown."""
    colors = {f"m{k}": pair for k, pair in enumerate(palette.METHODS)}
    colors |= {"reference": palette.REFERENCE, "ink": palette.INK, "paper": palette.PAPER}
    colors |= {"long": palette.TOO_LONG, "short": palette.TOO_SHORT}
    light, dark = ("".join(f"--{x}: {colors[x][k]}; " for x in colors) for k in (0, 1))
    return f":root {{ {light}}}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}\n"


def scene_script(chapter, system, integrator, knobs, measures):
    """A scene as an object of JavaScript, for a Motion of parts.js.

    `chapter`: the module constraints. `knobs`: dt, baumgarte and time_constant, with which the page
    begins, and impedance, which stays. `measures`: {name: function(system, q, v) -> array}, to be
    added to those that every page has. Raises NoPage.
    """
    if len(system["pairs"]) > MOST:
        raise NoPage(f"more than {MOST} rods are too slow for a browser")
    if integrator == "gauss":
        raise NoPage("gauss steps are too slow for a browser")
    if any(np.any(system[key][:, 2]) for key in ("q0", "v0", "anchors")):
        raise NoPage("a page shows scenes in the plane z = 0 only")
    rows = chapter.stabilizations(**knobs)
    rows = {name: row for name, row in rows.items() if row.integrator in (None, integrator)}
    # rows that differ by three numbers only share a traced step, which is given those
    given = {"use_jdotv": 0, "damping": 0, "stiffness": 0, "post_step": None, "integrator": None}
    kinds = {name: row._replace(**given) for name, row in rows.items()}
    every = list(dict.fromkeys(kinds.values()))
    data = {
        "methods": list(rows),
        "kinds": {name: every.index(kind) for name, kind in kinds.items()},
        "knobs": {key: knobs[key] for key in ("dt", "baumgarte", "time_constant")},
        "limit": chapter.STABILITY_LIMIT.get(integrator),
        "start": np.ravel([system["q0"], system["v0"]]).tolist(),
        "masses": system["m"].ravel().tolist(),
        "anchors": system["anchors"][:, :2].tolist(),
        "pairs": [[int(i), int(j)] for i, j in system["pairs"]],
        "lengths": system["lengths"].tolist(),
    }
    tracer = Tracer(chapter, system, integrator, knobs["impedance"])
    measures = {"energy": tracer.energy, "errors": tracer.errors, **measures}
    try:
        functions = {
            "settings": tracer.settings(rows),
            "steps": list(map(tracer.step, every)),
            "posts": {name: tracer.post_step(name) for name, row in rows.items() if row.post_step},
            "measures": {name: tracer.measure(each) for name, each in measures.items()},
        }
    except Untraceable as why:
        raise NoPage(f"a step cannot be written as JavaScript: {why}") from None
    return written({key: as_script(x) for key, x in data.items()} | functions)


class Tracer:
    """The chapter's functions of a scene, each as the source of a function of JavaScript."""

    def __init__(self, chapter, system, integrator, impedance):
        self.chapter, self.system, self.impedance = chapter, system, impedance
        self.step_fn = chapter.INTEGRATORS[integrator]
        self.live = np.broadcast_to([True, True, False], system["q0"].shape)  # z is always zero

    def settings(self, names):
        """Of dt, w and the time constant: use_jdotv, damping, stiffness, of each method in turn."""

        def settings(*given):
            methods = self.chapter.stabilizations(*given, self.impedance)
            return np.array([methods[name][:3] for name in names], object)

        return javascript(settings, [], 3)

    def step(self, kind):
        """Of a state, dt, these three numbers, a factor on the last mass, and a hand, which is at
        x, y in m and pulls each particle by a spring in N/m: the next."""
        own = self.chapter.external_force

        def step(q, v, dt, use_jdotv, damping, stiffness, mass, x, y, *pulls):
            hand, springs = np.array([x, y, 0.0], object), np.array(pulls, object)[:, None]

            def pulled(system, q, v):
                return own(system, q, v) + springs * (hand - q - DAMPING * v)

            three = {"use_jdotv": use_jdotv, "damping": damping, "stiffness": stiffness}
            method = kind._replace(**three)
            system = self.with_mass(mass)
            with patch.object(self.chapter, "external_force", pulled):
                force = self.chapter.make_force(system, method)
                return in_plane(self.step_fn(q, v, system["m"], force, dt))

        return javascript(step, [self.live] * 2, 7 + len(self.live))

    def post_step(self, name):
        """Of a step's end and its start, dt, w, the time constant and the factor: what follows."""

        def post_step(q, v, q_start, dt, w, time_constant, mass):
            method = self.chapter.stabilizations(dt, w, time_constant, self.impedance)[name]
            return in_plane(method.post_step(self.with_mass(mass), q_start, q, v, dt))

        return javascript(post_step, [self.live] * 3, 4)

    def measure(self, function):
        """Of a state and the factor: what function(system, q, v) makes of them."""

        def measure(q, v, mass):
            return function(self.with_mass(mass), q, v)

        return javascript(measure, [self.live] * 2, 1)

    def with_mass(self, factor):
        """The system, with a factor on its last particle's mass."""
        m = np.array(self.system["m"], object)
        m[-1] = m[-1] * factor
        return self.system | {"m": m}

    def energy(self, system, q, v):
        """In parts of m g L."""
        return self.chapter.energy(system, q, v) / m_g_L(system, self.chapter.GRAVITY)

    def errors(self, system, q, v):
        return self.chapter.rod_errors(system, q)


def in_plane(state):
    """q, v as they are, if their z is zero for certain."""
    if any(not zero(z) for x in state for z in x[:, 2]):
        raise ValueError("it leaves the plane z = 0")
    return state


def javascript(function, arrays, knobs):
    """The source of a function of arrays, whose masks these are, and of so many knobs."""
    source = re.sub("(?m)^ +", "", javascript_of(Program(function, *arrays, knobs=knobs)))
    return re.sub(r"(const .*;\n)+", lambda lines: lines[0].replace(";\nconst ", ",\n"), source)


def written(parts):
    """Sources of JavaScript in lists and dicts, as one of arrays and objects."""
    if isinstance(parts, dict):
        return "{" + ",\n".join(f"{as_script(x)}: {written(y)}" for x, y in parts.items()) + "}"
    return f"[{', '.join(map(written, parts))}]" if isinstance(parts, list) else parts


def as_script(data):
    """Data as source, in which no tag can end."""
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
