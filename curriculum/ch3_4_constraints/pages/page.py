"""The page of a scene: all methods side by side, in any browser, under sliders and a hand.

The page has no formula of its own: the chapter's lines run once, on symbols, and what they did is
written as JavaScript, with the same bits. What an editor knows stands beside this file.
"""

import json
import re
from html import escape
from pathlib import Path

import numpy as np

from curriculum.ch3_4_constraints.mechanics.stability import stability_limit
from curriculum.ch3_4_constraints.mechanics.systems import conserves, m_g_L
from curriculum.ch3_4_constraints.results import palette
from curriculum.common.tracing import Untraceable
from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.trace import Program, work

HERE = Path(__file__).parent
MOST = 40  # rods: more are too slow for a browser
DAMPING = 0.1  # s: the hand's spring resists 1 m/s as it does a stretch of so many metres
HARDEST = 30.0  # m/s^2: times the mass of all, it is the hand's largest force
KNOBS = ("dt", "baumgarte", "time_constant")  # what steps take after their arrays


class NoPage(ValueError):
    """A scene that no page can hold; the message says why."""


def play(chapter, args, system, edited=False):
    """The text of the page of a run: its scene under each method. Same arguments, same bytes.

    `chapter`: the module constraints, as its reader has edited it. `edited`: whether the run's loop
    changed its states, which the page does not. Raises NoPage.
    """
    scene = scene_of(chapter, system, args.integrator, {"dt": args.dt, **args.knobs}, {})
    script = page_file("parts.js") + page_file("play.js")
    parts = {
        "name": escape(Path(args.system).stem),
        "about": escape(about(system)),
        "edited": "The run's loop was edited; this page moves without those edits." * edited,
        "integrator": args.integrator,
        "style": palette_css() + page_file("style.css"),
        "script": f"const scene = {as_script(scene)};\n{script}",
    }
    return re.sub("{{(.*?)}}", lambda blank: parts[blank[1]], page_file("play.html"))


def about(system):
    """What a scene is: what its file says first or, where there is none, what it is made of."""
    if "about" in system:
        first, _, _ = system["about"].partition(". ")
        return first.rstrip(".")
    bobs, mass, length = len(system["m"]), np.sum(system["m"]), np.sum(system["lengths"])
    return f"{bobs} bob{'s' * (bobs > 1)}, {mass:g} kg, on {length:g} m of rods"


def page_file(name):
    """The text of a file in this folder."""
    return (HERE / name).read_text(encoding="utf-8")


def palette_css():
    """The palette as variables of CSS: m0, m1 ... of the methods, and those of what is shown."""
    colors = {f"m{k}": pair for k, pair in enumerate(palette.METHODS)}
    colors |= {"reference": palette.REFERENCE, "ink": palette.INK, "paper": palette.PAPER}
    colors |= {"long": palette.TOO_LONG, "short": palette.TOO_SHORT}
    light, dark = ("".join(f"--{x}: {colors[x][k]}; " for x in colors) for k in (0, 1))
    return f":root {{ {light}}}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}\n"


def scene_of(chapter, system, integrator, knobs, measures):
    """What a Motion of parts.js knows of a scene, a dict: data, and a Program for each function.

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
    every = chapter.make_methods(**knobs)
    rows = {name: row for name, row in every.items() if row.integrator in (None, integrator)}
    tracer = Tracer(chapter, system, integrator)
    measures = {"energy": tracer.energy, "errors": tracer.errors, **measures}
    try:
        steps = {name: tracer.step(name) for name in rows}
        posts = {name: tracer.post_step(name) for name, row in rows.items() if row.post_step}
        measures = {name: tracer.measure(function) for name, function in measures.items()}
        conserves = tracer.conserves()
    except Untraceable as why:
        raise NoPage(f"a step cannot be written as JavaScript: {why}") from None
    operations = {name: work(step.tape, 1) for name, step in steps.items()}
    for name, post in posts.items():  # in which a loop takes as many turns as it needs
        operations[name] += work(post.tape, 1)
    limit = stability_limit(chapter.INTEGRATORS[integrator])
    first, same_step = {}, {}  # of methods whose steps are the same, the first one has it
    for name, step in steps.items():
        same_step[name] = first.setdefault(javascript_of(step), name)
    return {
        "takes": KNOBS,
        "integrator": integrator,
        "methods": list(rows),
        "colors": {name: k % len(palette.METHODS) for k, name in enumerate(every)},
        "made_for": {name: row.integrator for name, row in every.items() if name not in rows},
        "knobs": {key: knobs[key] for key in KNOBS},
        "limit": limit if np.isfinite(limit) else None,
        "start": np.ravel([system["q0"], system["v0"]]).tolist(),
        "masses": system["m"].ravel().tolist(),
        "anchors": system["anchors"][:, :2].tolist(),
        "pairs": [[int(i), int(j)] for i, j in system["pairs"]],
        "lengths": system["lengths"].tolist(),
        "conserves": conserves,
        "operations": operations,
        "same_step": same_step,
        "steps": {name: steps[name] for name in first.values()},
        "posts": posts,
        "measures": measures,
    }


class Tracer:
    """The chapter's functions of a scene, each as a Program."""

    def __init__(self, chapter, system, integrator):
        self.chapter, self.system = chapter, system
        self.step_fn = chapter.INTEGRATORS[integrator]
        self.live = np.broadcast_to([True, True, False], system["q0"].shape)  # z is always zero

    def step(self, name):
        """One step of a method, before its post_step.

        Inputs: the state; KNOBS; and a hand, which is at x, y in m and pulls each particle by a
        spring in N/m, though never too hard.
        """

        def step(q, v, dt, baumgarte, time_constant, x, y, *springs):
            method = self.chapter.make_methods(dt, baumgarte, time_constant)[name]
            hand, m = np.array([x, y, 0.0], object), self.system["m"]

            def force(q, v):
                pull = np.array(springs, object)[:, None] * (hand - q - DAMPING * v)
                total = np.sum(pull, axis=0)  # the hand holds one particle, or none
                pull = pull / np.maximum(1.0, np.sqrt(total @ total) / (HARDEST * np.sum(m)))
                pulled = {**self.system, "load": self.system.get("load", 0.0) + pull}
                return method.make_force(pulled)(q, v)

            return in_plane(self.step_fn(q, v, m, force, dt))

        return Program(step, *[self.live] * 2, knobs=len(KNOBS) + 2 + len(self.live))

    def post_step(self, name):
        """What follows a step: of its end, its start, and KNOBS."""

        def post_step(q, v, q_start, dt, baumgarte, time_constant):
            method = self.chapter.make_methods(dt, baumgarte, time_constant)[name]
            return in_plane(method.post_step(self.system, q_start, q, v, dt))

        return Program(post_step, *[self.live] * 3, knobs=len(KNOBS))

    def measure(self, function):
        """function(system, q, v) of a state."""
        return Program(lambda q, v: function(self.system, q, v), *[self.live] * 2)

    def conserves(self):
        """Whether energy should stay as it is."""
        return conserves(self.system, self.chapter.external_force, self.chapter.energy)

    def energy(self, system, q, v):
        """In parts of m g L."""
        return self.chapter.energy(system, q, v) / m_g_L(system, self.chapter.GRAVITY)

    def errors(self, system, q, v):
        return self.chapter.rod_lengths(system, q) - system["lengths"]


def in_plane(state):
    """q, v as they are, if their z is zero for certain."""
    if any(not zero(z) for x in state for z in x[:, 2]):
        raise ValueError("it leaves the plane z = 0")
    return state


def as_script(data):
    """Data as source of JavaScript, in which no tag can end; a Program becomes a function."""
    if isinstance(data, Program):
        return javascript_of(data)
    if isinstance(data, dict):
        return "{" + ",\n".join(f"{as_script(x)}: {as_script(y)}" for x, y in data.items()) + "}"
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
