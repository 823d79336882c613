"""What studies and tests do again and again: systems, runs, crowds, and a command line."""

import argparse
import json
import sys
import textwrap
from collections import namedtuple
from functools import partial

import constraints as c
from curriculum.ch3_4_constraints import systems
from curriculum.ch3_4_constraints.statics import differences
from curriculum.ch3_4_constraints.tables import say
from curriculum.common import llvm, rules
from curriculum.common.banner import processor
from curriculum.common.cli import Parser, missing
from curriculum.common.compiled import Compiled
from curriculum.common.crowds import Crowd
from curriculum.common.runs import distance
from curriculum.common.steps import followed
from curriculum.common.tape import Untraceable

import numpy as np

NATIVE = llvm.available()  # whether steps are compiled to machine code, and not to Python only
G = float(-c.GRAVITY[1])  # m/s^2
SCENES = c.HERE / c.CHAPTER / "scenes"
SHIPPED = sorted({path.stem for path in SCENES.glob("*.json")} - {"taut_cable"})  # it is refused
REFERENCE = c.HERE / c.CHAPTER / "studies/reference.json"

# A system from its start to time samples * every (s), and error(positions (samples, N, 2)).
Task = namedtuple("Task", "system samples every error")


def make_system(q0, v0, m, pairs, lengths=None, anchors=((0.0, 0.0, 0.0),)):
    """A system dict; masses m (N,) kg, lengths (C,) m by default as in q0."""
    q0, v0, anchors = (np.asarray(x, dtype=float) for x in (q0, v0, anchors))
    if lengths is None:
        lengths = np.linalg.norm(differences(q0, anchors, pairs), axis=-1)
    system = {"q0": q0, "v0": v0, "m": np.reshape(m, (-1, 1)).astype(float), "anchors": anchors}
    return system | {"pairs": list(pairs), "lengths": np.array(lengths, float)}


def case(system, rule, hold, dt):
    """(rule, force) of a rule (or its name) with a Hold, the name of one, or Baumgarte's w."""
    hold = c.hold_table(dt)[hold] if isinstance(hold, str) else hold
    rule = rules.named(rule, c.INTEGRATORS) if isinstance(rule, str) else rule
    return rule, c.make_force(system, hold)


def run(system, rule="semi_implicit", hold="none", dt=0.005, steps=4000, keep=(), way=Compiled):
    """The Run of a case."""
    rule, force = case(system, rule, hold, dt)
    return c.simulate(rule, system, force, dt, steps, keep, way)


def crowd(system, rule, hold, dt, measure=None):
    """A Crowd of the members of a system with q0, v0 (R, N, 3)."""
    rule, force = case(system, rule, hold, dt)
    step = followed(rule, force.after)
    try:
        return Crowd(step, system["m"], force, dt, system["q0"], system["v0"], measure)
    except Untraceable as why:
        sys.exit(f"many members go together only in a step that can be compiled: {why}")


def double(end=False):
    """The Task of the double pendulum, 5 s; its error is the farthest that a particle is off.

    That is at twenty times or, if only the `end` counts, at the last of them.
    """
    truth = json.loads(REFERENCE.read_text(encoding="utf-8"))
    first = -1 if end else 0
    times, q = truth["times"][first:], truth["cases"]["double"]["positions"][first:]
    return Task(c.build_system("double"), len(q), times[0], partial(distance, np.array(q)))


def energy_scale(system):
    """The unit of energy errors in J."""
    return systems.energy_scale(system, c.GRAVITY)


def drift(system, run):
    """The largest energy error of a run, as a share of that."""
    return np.max(np.abs(run.energies - run.energies[0])) / energy_scale(system)


def host(**more):
    """Print what ran on what, and what would make it quicker."""
    what = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__}
    say(", ".join(f"{key} {value}" for key, value in (what | more).items()))
    if not NATIVE:
        say(f"{missing('llvmlite')}; steps are many times slower")


class Preset(argparse.Action):
    """A flag that stands for several; what is given after it counts."""

    def __call__(self, parser, namespace, values, option_string=None):
        vars(namespace).update(self.const)


def study_parser(name, doc, quick=None, **usual):
    """The Parser of the study `name`; `usual`: what else it goes by, as attributes, without flags.

    `quick`: what --quick has instead, of these or of its flags.
    """
    about = "\n\n".join(textwrap.fill(paragraph, 80) for paragraph in doc.split("\n\n"))
    parser = Parser(prog=f"python -m {__package__} {name}", description=about)
    parser.set_defaults(**usual)
    if quick:
        told = "a small one, to see what it prints; its figures mean little"
        parser.add_argument("--quick", action=Preset, nargs=0, const=quick, help=told)
    return parser
