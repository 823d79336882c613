"""A scene as JavaScript: the chapter's own lines, run once on symbols, with the same bits.

No page has a formula of its own.
"""

import json
from pathlib import Path

import numpy as np

from curriculum.ch3_4_constraints.rods.run import FAR
from curriculum.ch3_4_constraints.rods.stability import stability_limit
from curriculum.ch3_4_constraints.rods.systems import energy_scale, is_flat
from curriculum.common import palette
from curriculum.common.tracing import Untraceable
from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.trace import Program

HERE = Path(__file__).parent
MAX_RODS = 40  # more are too slow for a browser
DAMPING = 0.1  # s: the hand's spring resists 1 m/s as it does a stretch of so many metres
HARDEST = 30.0  # m/s^2: times the mass of all, it is the hand's largest force


class NoPage(ValueError):
    """A scene that no page can hold; the message says why."""


def page_file(name):
    """The text of a file in this folder."""
    return (HERE / name).read_text(encoding="utf-8")


def palette_css():
    """The palette as CSS: variables, m0, m1 ... of the methods, and classes that are called so."""
    colors = {f"m{k}": pair for k, pair in enumerate(palette.METHODS)}
    colors |= {"reference": palette.REFERENCE, "ink": palette.INK, "paper": palette.PAPER}
    colors |= {"long": palette.TOO_LONG, "short": palette.TOO_SHORT}
    light = "".join(f"--{name}: {color}; " for name, (color, _) in colors.items())
    dark = "".join(f"--{name}: {color}; " for name, (_, color) in colors.items())
    at_night = f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}"
    classes = [f".m{k} {{ color: var(--m{k}); }}" for k in range(len(palette.METHODS))]
    return "\n".join([f":root {{ {light}}}", at_night, *classes, ""])


def scene_of(chapter, system, integrator, knobs, conserves=True, measures=None, others=()):
    """What a Motion of parts.js knows of a scene, a dict: data, and a Program for each function.

    `knobs`: dt, then those arguments of make_methods that the page may change, with the values it
    begins with. `conserves`: whether energy should stay. `measures`: {name: function(system, q, v)
    -> array}, to be added to those that every page has. `others`: Schemes of other integrators,
    which it can step, too, by their names. Raises NoPage.
    """
    if len(system["pairs"]) > MAX_RODS:
        raise NoPage(f"more than {MAX_RODS} rods are too slow for a browser")
    if not is_flat(system):
        raise NoPage("a page shows scenes in the plane z = 0 only")
    every = chapter.make_methods(**knobs)
    methods = {name: row for name, row in every.items() if row.fits(integrator)}
    pairs = {name: (integrator, name) for name in methods}
    pairs |= {str(scheme): (scheme.integrator, scheme.method) for scheme in others}
    tracer = Tracer(chapter, system, list(knobs))
    scale = energy_scale(system, chapter.gravity)
    measures = {
        "energy": lambda system, q, v: chapter.energy(system, q, v) / scale,
        "errors": lambda system, q, v: chapter.rod_lengths(system, q) - system["lengths"],  # m
        **(measures or {}),
    }
    used = {method for _, method in pairs.values()}
    try:
        steps = {name: tracer.step(*pair) for name, pair in pairs.items()}
        posts = {
            name: tracer.post_step(name)
            for name, method in every.items()
            if name in used and method.post_step
        }
        measures = {name: tracer.measure(function) for name, function in measures.items()}
    except Untraceable as why:
        raise NoPage(f"a step cannot be written as JavaScript: {why}") from None
    limit = stability_limit(chapter.integrators[integrator])
    same_step = firsts(steps)
    return {
        "takes": list(knobs),
        "integrator": integrator,
        "methods": list(methods),
        "method_of": {name: method for name, (_, method) in pairs.items()},
        "words": {name: row.words for name, row in every.items()},
        "colors": palette.places(every),
        "made_for": {name: row.integrator for name, row in every.items() if name not in methods},
        "knobs": knobs,
        "limit": limit if np.isfinite(limit) else None,
        "start": np.ravel([system["q0"], system["v0"]]).tolist(),
        "masses": system["m"].ravel().tolist(),
        "anchors": system["anchors"][:, :2].tolist(),
        "pairs": [[int(i), int(j)] for i, j in system["pairs"]],
        "lengths": system["lengths"].tolist(),
        "far": FAR * float(np.sum(system["lengths"])),
        "conserves": conserves,
        "same_step": same_step,
        "steps": {name: steps[name] for name in dict.fromkeys(same_step.values())},
        "posts": posts,
        "measures": measures,
    }


def firsts(steps):
    """{name: the first one whose step is the same}, of Programs {name: step}."""
    first = {}  # {source: name}
    return {name: first.setdefault(javascript_of(step), name) for name, step in steps.items()}


class Tracer:
    """The chapter's functions of a scene, each as a Program."""

    def __init__(self, chapter, system, knobs):
        self.chapter = chapter
        self.system = system
        self.knobs = knobs  # names: what make_methods is given
        self.live = np.broadcast_to([True, True, False], system["q0"].shape)  # z is always zero

    def method(self, name, numbers):
        """A method, made with so many knobs as there are, of all `numbers`; and the others."""
        many = len(self.knobs)
        knobs = dict(zip(self.knobs, numbers[:many], strict=True))
        return self.chapter.make_methods(**knobs)[name], knobs["dt"], numbers[many:]

    def step(self, integrator, name):
        """One step of an integrator with a method, before its post_step.

        Inputs: the state; the knobs; and a hand, which is at x, y in m and pulls each particle by a
        spring in N/m, though never too hard.
        """

        def step(q, v, *numbers):
            method, dt, (x, y, *springs) = self.method(name, numbers)
            hand = np.array([x, y, 0.0], object)
            m = self.system["m"]

            def force(q, v):
                pull = np.array(springs, object)[:, None] * (hand - q - DAMPING * v)
                total = np.sum(pull, axis=0)  # the hand holds one particle, or none
                pull = pull / np.maximum(1.0, np.sqrt(total @ total) / (HARDEST * np.sum(m)))
                pulled = {**self.system, "load": self.system.get("load", 0.0) + pull}
                return method.make_force(pulled)(q, v)

            return in_plane(self.chapter.integrators[integrator](q, v, m, force, dt))

        names = ["q", "v", *self.knobs, "x", "y"] + ["spring"] * len(self.live)
        return Program(step, *[self.live] * 2, scalars=len(names) - 2, names=names)

    def post_step(self, name):
        """What follows a step: of its end, its start, and the knobs."""

        def post_step(q, v, q_start, *numbers):
            method, dt, _ = self.method(name, numbers)
            return in_plane(method.post_step(self.system, q_start, q, v, dt))

        names = ["q", "v", "q_start", *self.knobs]
        return Program(post_step, *[self.live] * 3, scalars=len(self.knobs), names=names)

    def measure(self, function):
        """function(system, q, v) of a state."""
        return Program(lambda q, v: function(self.system, q, v), *[self.live] * 2)


def in_plane(state):
    """q, v as they are, if their z is zero for certain."""
    for x in state:
        if not all(zero(z) for z in x[:, 2]):
            raise ValueError("it leaves the plane z = 0")
    return state


def as_script(data):
    """Data as source of JavaScript, in which no tag can end; a Program becomes a function."""
    if isinstance(data, Program):
        return javascript_of(data)
    if isinstance(data, dict):
        return "{" + ",\n".join(f"{as_script(x)}: {as_script(y)}" for x, y in data.items()) + "}"
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")
