"""The page that lives: a scene in all its modes, in any browser, under sliders and a hand.

The page has no formula of its own: the chapter's lines run once, on symbols, with the step,
Baumgarte's w, soft's T and the hand as inputs. What they did becomes JavaScript, bit for bit.
"""

import base64
import hashlib
import html
import json
import re
from pathlib import Path

from curriculum.ch3_4_constraints.run_checks import misfit
from curriculum.ch3_4_constraints.svg import DARK, LIGHT, mode_colors
from curriculum.ch3_4_constraints.systems import check_system, energy_scale
from curriculum.common.javascript import PRELUDE, Writer
from curriculum.common.programs import Program, Routine
from curriculum.common.pure import Memory
from curriculum.common.steps import HALVINGS, followed
from curriculum.common.tape import Untraceable, current
from curriculum.common.trace import Symbol, lift

import numpy as np

TEMPLATE = Path(__file__).with_name("play.html")
MOST, LONGEST = 120, 40_000  # rods, and operations of a step: a browser is too slow for more
DAMPING = 0.1  # s: the hand's spring resists 1 m/s as it does a stretch of so many metres
STEPS = 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.02, 0.05  # s, to choose from
STIFF = 0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 120.0, 160.0, 320.0  # rad/s
TIMES = 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0  # s
SHADES = "excess", "missing", "grey", "pull", "push", "ink", "paper"
# of a step, as JavaScript has them; `whole`: the step that a Hold is for, where dt may be a half
KNOBS = {"dt": "dt", "whole": "knobs.dt", "w": "knobs.w", "T": "knobs.T"}


class Leaves(Exception):
    """A motion that was thought to stay in a plane leaves it."""


class Tracer:
    """What the chapter computes of a scene, as functions of JavaScript.

    `chapter`: the module constraints, as its reader has edited it. `axes`: 2 if all stays in the
    plane z = 0, or else it raises Leaves; or 3. `live`: which entries of (q, v) a state is made of.
    `steps`, `tensions`: {mode: the name of its function}; `measure`: that of one more. `inexact`:
    functions whose last digits may be a browser's own; `felt`: whether a force has the hand's, too.
    """

    def __init__(self, axes, chapter, system, rule, modes, impedance):
        self.axes, self.chapter, self.system = axes, chapter, system
        self.rule, self.impedance = rule, impedance
        self.writer, self.inexact, self.felt = Writer(), set(), False
        count = len(system["q0"])
        self.still = np.arange(3) >= np.full((count, 1), axes)  # (N, 3): what is always zero
        self.point = {f"hand_{k}": f"knobs.hand[{k}]" for k in range(axes)}
        self.springs = {f"pull_{k}": f"knobs.pull[{k}]" for k in range(count)}

        def measure(q, v):  # the energy in J, and the rod errors in m
            return np.array([chapter.energy(system, q, v)]), chapter.rod_errors(system, q)

        self.steps = {mode: self.step(mode) for mode in modes}
        self.measure = self.written(measure)
        self.tensions = {mode: self.tension(mode) for mode in modes}
        if not self.felt:  # applied_force is the reader's own
            raise Untraceable("it has no own_force, by which the hand pulls")

    def inputs(self, names):
        """Symbols of knobs, on the tape that is written now: they are the same everywhere."""
        return [Symbol(current.tape, name) for name in names]

    def hold(self, mode):
        """The chapter's Hold of a mode."""
        _, whole, w, time_constant = self.inputs(KNOBS)
        return self.chapter.hold_table(whole, w, time_constant, self.impedance)[mode]

    def force(self, mode):
        """The chapter's force of a mode."""
        return self.chapter.make_force(self.system, self.hold(mode))

    def written(self, function, *parameters):
        """The name of function(q, v, *knobs) as JavaScript, (state, *parameters) -> array.

        With parameters external_force has the hand's beside it: springs that pull particles to a
        point, one of stiffness 0 to each that is not pulled.
        """

        def hand(q, v):
            self.felt = True
            f = np.zeros(q.shape, object)
            for i, stiffness in enumerate(self.inputs(self.springs)):  # N/m
                for axis, x in enumerate(self.inputs(self.point)):  # m
                    f[i, axis] = stiffness * (x - q[i, axis] - DAMPING * v[i, axis])
            return f

        knobs = KNOBS | self.point | self.springs if parameters else {}
        current.hand = hand if parameters else None
        try:
            program = Program(function, self.still, self.still, knobs=knobs)
        finally:
            current.hand = None
        if program.size() > LONGEST:
            raise Untraceable(f"{program.size():,} operations a step are too slow for a browser")
        self.inexact |= program.inexact()
        self.live = program.live
        given = {x: f"state[{k}]" for k, x in enumerate(program.inputs)} | knobs
        return self.writer.program(program, ["state", *parameters], given)

    def step(self, mode):
        """The name of the function (state, dt, knobs) -> state."""
        force = Routine(lambda q, v: self.force(mode)(q, v), often=True)

        def step(q, v, dt, *_):
            ends = followed(self.rule, self.force(mode).after)(q, v, self.system["m"], force, dt)
            if any(lift(x).x != 0.0 for end in ends for x in end[self.still]):
                raise Leaves
            return tuple(end[~self.still] for end in ends)

        return self.written(step, "dt", "knobs")

    def tension(self, mode):
        """The name of the function (state, dt, knobs) -> tensions in N, under the hand."""

        def tensions(q, v, *_):
            return (self.chapter.tensions(self.system, q, v, self.hold(mode)),)

        return self.written(tensions, "dt", "knobs")


def traced(chapter, system, *how):
    """A Tracer of a scene, flat if its motion is."""
    flat = not any(np.any(system[key][:, 2]) for key in ("q0", "v0", "anchors"))
    try:
        return Tracer(2 if flat else 3, chapter, system, *how)
    except Leaves:
        return Tracer(3, chapter, system, *how)


def reach(system):
    """The corners (3,), (3,) of a box that particles on right rods hardly leave. A particle is at
    most as far from an anchor as the shortest way along rods is."""
    q0, anchors, loose = system["q0"], system["anchors"], np.sum(system["lengths"])
    count, fixed = len(q0), len(anchors)
    far = np.full((fixed, count + fixed), np.inf)  # as pairs have it, an anchor's is counted back
    far[np.arange(fixed), -1 - np.arange(fixed)] = 0.0
    for _ in range(count):
        for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
            far[:, i] = np.minimum(far[:, i], far[:, j] + length)
            far[:, j] = np.minimum(far[:, j], far[:, i] + length)
    far = far[:, :count, None]
    low = np.max(anchors[:, None] - far, axis=0, initial=-np.inf)
    high = np.min(anchors[:, None] + far, axis=0, initial=np.inf)
    low = np.where(np.isfinite(low), low, q0 - loose)  # what hangs on no anchor may go anywhere
    high = np.where(np.isfinite(high), high, q0 + loose)
    corners = np.vstack([low, high, anchors])
    low, high = corners.min(axis=0), corners.max(axis=0)
    if not np.any(system["v0"]):  # from rest, little rises far above where it was let go
        top = np.max(np.vstack([q0, anchors])[:, 1])
        high[1] = min(high[1], top + 0.5 * (top - low[1]))
    return low, high


def page(chapter, name, system, rule, step_fn, dt, knobs):
    """The text of the page: a scene of this name, moved by `step_fn`, the integrator called `rule`.

    It begins with steps of `dt` s and, as `knobs`, w in rad/s, the time constant in s, and the
    impedance. `chapter`: the module constraints, as its reader has edited it. Raises Untraceable,
    and says why. Same arguments, same bytes.
    """
    if len(system["pairs"]) > MOST:
        raise Untraceable(f"more than {MOST} rods are too slow for a browser")
    system = check_system(system)
    tracer = safely_traced(chapter, system, rule, step_fn, dt, knobs)
    data = {"name": name, "rule": rule, "modes": list(tracer.steps), "axes": tracer.axes}
    data |= {"limit": chapter.STABILITY_LIMIT.get(rule), "halvings": HALVINGS}
    data["inexact"] = sorted(tracer.inexact)
    data |= described(chapter, system, tracer)
    w, time_constant, _ = knobs
    data["knobs"] = {"dt": dt, "w": w, "T": time_constant}
    lists = {"dt": (*STEPS, 0.5 * dt, dt), "w": (*stiffnesses(data["limit"], dt), w)}
    lists["T"] = *TIMES, time_constant
    data["lists"] = {key: sorted({float(x) for x in values}) for key, values in lists.items()}
    lines = f"{PRELUDE}{tracer.writer.source()}const measure = {tracer.measure};\n"
    for key, functions in (("steps", tracer.steps), ("tensions", tracer.tensions)):
        table = ", ".join(f"{json.dumps(mode)}: {f}" for mode, f in functions.items())
        lines += f"const {key} = {{{table}}};\n"
    return filled(lines, data)


def safely_traced(chapter, system, rule, step_fn, dt, knobs):
    """The Tracer of a page, which has left all that the reader's lines keep as it was."""
    lines = chapter.make_force, chapter.hold_table, chapter.energy, chapter.rod_errors
    memory = Memory(step_fn, *lines, chapter.tensions)
    if memory.asks:
        raise Untraceable(memory.asks[0])
    holds, why = chapter.hold_table(dt, *knobs), None
    modes = [mode for mode, hold in holds.items() if not misfit(hold, rule)]
    try:
        tracer = traced(chapter, system, step_fn, modes, knobs[-1])
    except Exception as reason:  # a mistake of the reader's shows in the run itself
        why = str(reason) or type(reason).__name__
    why = memory.restore() or why
    if why:
        raise Untraceable(why)
    return tracer


def stiffnesses(limit, dt):
    """The w in rad/s to choose from; where there is a cliff, the last before it, and the next."""
    if not limit:
        return STIFF
    edge = 5.0 * np.floor(limit / dt / 5.0)
    return [x for x in STIFF if x < 0.98 * edge] + [edge, edge + 5.0, 1.2 * edge, 2.4 * edge]


def described(chapter, system, tracer):
    """What a page has to know of its scene, as JSON has it."""
    state = system["q0"], system["v0"]
    weight = np.sum(system["m"]) * np.linalg.norm(chapter.GRAVITY)
    return {
        "lengths": system["lengths"].tolist(),
        "anchors": system["anchors"].tolist(),
        "pairs": [list(map(int, pair)) for pair in system["pairs"]],
        "masses": system["m"].ravel().tolist(),
        "start": [float(state[k][at]) for k, at in tracer.live],
        "box": [corner[: tracer.axes].tolist() for corner in reach(system)],
        "mgl": float(energy_scale(system, chapter.GRAVITY)),
        "newtons": float(weight) or 1.0,
        "far": 100.0 * float(np.sum(system["lengths"])),
    }


def filled(lines, data):
    """The template with its blanks filled in, and the policy that lets only its own parts run."""
    text = TEMPLATE.read_text(encoding="utf-8")
    text = re.sub(r"(?m)^ *//.*\n", "", text)  # its comments are for the template's editor
    light = {name: LIGHT[name] for name in SHADES}
    light |= {f"mode-{k}": color for k, color in enumerate(mode_colors(data["modes"]).values())}
    dark = {name: DARK[color] for name, color in light.items()}
    themes = []
    for theme, shades in (("light", light), ("dark", dark)):
        rules = "".join(f"--{name}:{color};" for name, color in shades.items())
        themes.append(f"@media (prefers-color-scheme: {theme}) {{:root {{{rules}}}}}")
    shown = json.dumps(data, ensure_ascii=True, separators=(",", ":")).replace("<", "\\u003c")
    blanks = {
        "{{name}}": html.escape(data["name"]),
        "/* colours */": "\n".join(themes),
        "/* lines */": lines,
        "/* data */": f"const data = {shown};",
    }
    # all at once: what fills a blank may look like another
    text = re.sub("|".join(map(re.escape, blanks)), lambda blank: blanks[blank[0]], text)
    policy = "default-src 'none'"
    for tag in ("script", "style"):
        policy += f"; {tag}-src"
        for part in re.findall(f"(?s)<{tag}>(.*?)</{tag}>", text):
            made = base64.b64encode(hashlib.sha256(part.encode()).digest()).decode()
            policy += f" 'sha256-{made}'"
    return text.replace("{{policy}}", policy, 1)
