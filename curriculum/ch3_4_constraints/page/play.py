"""The page of a scene: what Python found, and its schemes side by side, under a hand."""

import re
from html import escape

import numpy as np

from curriculum.ch3_4_constraints.page import answer as answers
from curriculum.ch3_4_constraints.page.scene import as_script, page_file, palette_css, scene_of

MARK = '<meta name="generator" content="constraints.py">'  # of a page that a run has written


def page(asked, results, truth, answer):
    """The text of the page of a run: what was found, and its scene under each method.

    `results`: what metrics.json says of each method; `answer`: the Answer to --within, or None.
    Same arguments, same bytes. Raises NoPage.
    """
    knobs = {"dt": asked.dt, **asked.knobs}
    scene = scene_of(
        asked.chapter,
        asked.system,
        asked.integrator,
        knobs,
        conserves=all(row["conserves"] for row in results.values()),
        others=answers.others(asked, answer),
    )
    energies = [row["energy_rel_max"] or 0.0 for row in results.values()]
    found = {"energy": max(energies), **answers.played(asked, answer)}
    parts = {
        "mark": MARK,
        "name": escape(asked.name),
        "about": escape(about(asked.system)),
        "facts": escape(" ".join(facts(asked, results, scene))),
        "integrator": asked.integrator,
        "style": palette_css() + page_file("style.css"),
        "script": page_file("parts.js") + page_file("play.js"),
        "scene": as_script(scene),
        "found": as_script(found),
        **answers.of_the_run(asked, results, truth, scene),
        **answers.of_the_answer(asked, answer, scene),
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


def facts(asked, results, scene):
    """What to know about the tiles before they move, in sentences."""
    left_out = scene["made_for"].items()
    unlike = dict.fromkeys(row["unlike"] for row in results.values() if row.get("unlike"))
    return [
        f"Integrator: {asked.integrator}.",
        *(f"{name} is left out: it is made for {integrator}." for name, integrator in left_out),
        *(f"The scene is shown without what the run's loop did: {why}." for why in unlike),
    ]
