"""The page of a scene: what Python found, and all methods side by side, under sliders and a hand.

The page has no formula of its own: the chapter's lines run once, on symbols, and what they did is
written as JavaScript, with the same bits. What a chapter is to have is said in results/output.py.
"""

import json
import re
from html import escape
from pathlib import Path

import numpy as np

from curriculum.ch3_4_constraints.mechanics.choice import suits
from curriculum.ch3_4_constraints.mechanics.reference import MAX_RODS
from curriculum.ch3_4_constraints.mechanics.stability import is_explicit, stability_limit
from curriculum.ch3_4_constraints.mechanics.systems import conserves, is_flat, m_g_L
from curriculum.ch3_4_constraints.pages import answer
from curriculum.ch3_4_constraints.results import palette
from curriculum.common.tracing import Untraceable
from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.javascript import javascript_of
from curriculum.common.tracing.trace import Program

HERE = Path(__file__).parent
DAMPING = 0.1  # s: the hand's spring resists 1 m/s as it does a stretch of so many metres
HARDEST = 30.0  # m/s^2: times the mass of all, it is the hand's largest force


class NoPage(ValueError):
    """A scene that no page can hold; the message says why."""


def play(chapter, args, system, results, reference, choice=None, edited=False):
    """The text of the page of a run: what was found, and its scene under each method.

    `chapter`: the script as its reader has edited it (see results/output.py). `results`: what
    metrics.json says of each method. `choice`: the Choice of --within, or None. `edited`: whether
    the run's loop changed its states, which the page does not. Same arguments, same bytes. Raises
    NoPage.
    """
    scene = scene_of(chapter, system, args.integrator, {"dt": args.dt, **args.knobs}, {})
    answers = answer.answers(args, choice, scene)
    about_edits = "The run's loop was edited; this page moves without those edits."
    energies = [row["energy_rel_max"] for row in results.values() if not row["stopped"]]
    parts = {
        "name": escape(Path(args.system).stem),
        "about": escape(about(system)),
        "edited": about_edits if edited else "",
        "integrator": args.integrator,
        "style": palette_css() + page_file("style.css"),
        "script": page_file("parts.js") + page_file("play.js"),
        "scene": as_script(scene),
        "found": as_script({"answers": answers, "energy": max(energies, default=0.0)}),
        **answer.of_the_run(args, results, reference, scene),
        **answer.at_first(args, choice, answers),
    }
    return re.sub("{{(.*?)}}", lambda blank: parts[blank[1]], page_file("play.html"))


def about(system):
    """What a scene is: what its file says first or, where there is none, what it is made of."""
    first, _, _ = system.get("about", "").strip().partition(". ")
    if first.strip("."):
        return first.rstrip(".")
    bobs = "1 bob" if len(system["m"]) == 1 else f"{len(system['m'])} bobs"
    made_of = f"{bobs}, {np.sum(system['m']):g} kg, on {np.sum(system['lengths']):g} m of rods"
    loads = np.sum(np.linalg.norm(system.get("load", [[0.0, 0.0, 0.0]]), axis=1))  # N
    return f"{made_of}, under loads of {loads:g} N" if loads > 0.0 else made_of


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


def refuse(chapter, system, integrator):
    """Raise NoPage for what no page can show."""
    if len(system["pairs"]) > MAX_RODS:
        raise NoPage(f"more than {MAX_RODS} rods are too slow for a browser")
    if not is_explicit(chapter.INTEGRATORS[integrator]):
        raise NoPage(f"{integrator} steps are too slow for a browser")
    if not is_flat(system):
        raise NoPage("a page shows scenes in the plane z = 0 only")


def scene_of(chapter, system, integrator, knobs, measures):
    """What a Motion of parts.js knows of a scene, a dict: data, and a Program for each function.

    `chapter`: the script, or its module. `knobs`: dt, then those arguments of make_methods that the
    page may change, with the values it begins with. `measures`: {name: function(system, q, v) ->
    array}, to be added to those that every page has. Raises NoPage.
    """
    refuse(chapter, system, integrator)
    every = chapter.make_methods(**knobs)
    rows = {name: row for name, row in every.items() if suits(row, integrator)}
    tracer = Tracer(chapter, system, integrator, list(knobs))
    measures = {"energy": tracer.energy, "errors": tracer.errors, **measures}
    try:
        steps = {name: tracer.step(name) for name in rows}
        posts = {name: tracer.post_step(name) for name, row in rows.items() if row.post_step}
        measures = {name: tracer.measure(function) for name, function in measures.items()}
    except Untraceable as why:
        raise NoPage(f"a step cannot be written as JavaScript: {why}") from None
    limit = stability_limit(chapter.INTEGRATORS[integrator])
    same_step = firsts(steps)
    return {
        "takes": list(knobs),
        "integrator": integrator,
        "methods": list(rows),
        "words": {name: row.words for name, row in rows.items()},
        "colors": palette.places(every),
        "made_for": {name: row.integrator for name, row in every.items() if name not in rows},
        "knobs": knobs,
        "limit": limit if np.isfinite(limit) else None,
        "start": np.ravel([system["q0"], system["v0"]]).tolist(),
        "masses": system["m"].ravel().tolist(),
        "anchors": system["anchors"][:, :2].tolist(),
        "pairs": [[int(i), int(j)] for i, j in system["pairs"]],
        "lengths": system["lengths"].tolist(),
        "conserves": conserves(system, chapter.external_force, chapter.energy),
        "same_step": same_step,
        "steps": {name: steps[name] for name in dict.fromkeys(same_step.values())},
        "posts": posts,
        "measures": measures,
    }


def firsts(steps):
    """{method: the first one whose step is the same}, of Programs {method: step}."""
    first = {}  # {source: method}
    return {name: first.setdefault(javascript_of(step), name) for name, step in steps.items()}


class Tracer:
    """The chapter's functions of a scene, each as a Program."""

    def __init__(self, chapter, system, integrator, knobs):
        self.chapter = chapter
        self.system = system
        self.step_fn = chapter.INTEGRATORS[integrator]
        self.knobs = knobs  # names: what make_methods is given
        self.live = np.broadcast_to([True, True, False], system["q0"].shape)  # z is always zero

    def method(self, name, numbers):
        """A method, made with so many knobs as there are, of all `numbers`; and the others."""
        many = len(self.knobs)
        knobs = dict(zip(self.knobs, numbers[:many], strict=True))
        return self.chapter.make_methods(**knobs)[name], knobs["dt"], numbers[many:]

    def step(self, name):
        """One step of a method, before its post_step.

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

            return in_plane(self.step_fn(q, v, m, force, dt))

        names = ["q", "v", *self.knobs, "x", "y"] + ["spring"] * len(self.live)
        return Program(step, *[self.live] * 2, knobs=len(names) - 2, names=names)

    def post_step(self, name):
        """What follows a step: of its end, its start, and the knobs."""

        def post_step(q, v, q_start, *numbers):
            method, dt, _ = self.method(name, numbers)
            return in_plane(method.post_step(self.system, q_start, q, v, dt))

        names = ["q", "v", "q_start", *self.knobs]
        return Program(post_step, *[self.live] * 3, knobs=len(self.knobs), names=names)

    def measure(self, function):
        """function(system, q, v) of a state."""
        return Program(lambda q, v: function(self.system, q, v), *[self.live] * 2)

    def energy(self, system, q, v):
        """In parts of m g L."""
        return self.chapter.energy(system, q, v) / m_g_L(system, self.chapter.GRAVITY)

    def errors(self, system, q, v):
        """By how much each rod is too long, in m."""
        return self.chapter.rod_lengths(system, q) - system["lengths"]


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
    return json.dumps(data, allow_nan=False).replace("<", "\\u003c")
