"""What studies and tests do again and again: systems, runs, crowds, and a command line."""

import sys
from argparse import RawDescriptionHelpFormatter
from importlib.util import find_spec
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.studies._midpoint import make_midpoint
from curriculum.ch3_4_constraints.tables import say
from curriculum.common.banner import processor
from curriculum.common.cli import Parser, number, writable
from curriculum.common.files import write_json
from curriculum.common.gauss import make_gauss
from curriculum.common.loops import repeat
from curriculum.common.motion import Unrolled, distance, followed, source, unroll_map
from curriculum.common.trace import Untraceable

import numpy as np

# Whether steps are compiled to machine code, and not to Python only.
NATIVE = bool(find_spec("llvmlite") and find_spec("curriculum.common.native"))
__all__ = ["distance", "repeat"]  # of common, for studies
SCENES = c.HERE / c.CHAPTER / "scenes"
RULES = {name: rule for name, rule in c.INTEGRATORS.items() if name not in ("gauss", "midpoint")}
RULES |= {f"midpoint{order}": make_midpoint(order) for order in (6, 8, 10, 12)}
for stages, tol in ((6, 1e-6), (8, 5e-8), (10, 1e-11), (12, 1e-13)):
    RULES[f"gauss{stages}"] = make_gauss(stages, tol=tol)


def make_system(q0, v0, m, pairs, lengths=None, anchors=((0.0, 0.0, 0.0),)):
    """A system dict; masses m (N,) kg, lengths (C,) m by default as in q0."""
    q0, v0, anchors = (np.asarray(x, dtype=float) for x in (q0, v0, anchors))
    ends = [(q0[i], anchors[-1 - j] if j < 0 else q0[j]) for i, j in pairs]
    found = [np.sqrt(c.dot(a - b, a - b)) for a, b in ends] if lengths is None else lengths
    system = {"q0": q0, "v0": v0, "m": np.reshape(m, (-1, 1)).astype(float)}
    return system | {"pairs": list(pairs), "lengths": np.array(found, float), "anchors": anchors}


def scene(name):
    """The system of a shipped scene."""
    return c.build_system(str(SCENES / f"{name}.json"))


def case(system, rule, hold, dt):
    """(step, force) of a rule (or its name) with a Hold, the name of one, or Baumgarte's w."""
    hold = c.as_hold(c.hold_table(dt)[hold] if isinstance(hold, str) else hold)
    rule = (c.INTEGRATORS | RULES)[rule] if isinstance(rule, str) else rule
    return followed(rule, hold.after, system), c.make_force(system, hold)


def run(system, rule="semi_implicit", hold="none", dt=0.005, steps=4000, keep=()):
    """The Run of a case."""
    step, force = case(system, rule, hold, dt)
    return c.simulate(step, system, force, dt, steps, keep)


def code(system, rule, hold, dt):
    """The code that a step becomes."""
    step, force = case(system, rule, hold, dt)
    return source(step, system, force, dt)


def plain_run(system, rule, hold, dt, steps):
    """The Run of the chapter's lines as numpy itself runs them."""
    step, force = case(system, rule, hold, dt)
    force.way, force.memory = "in plain numpy", {}
    return c.simulate(step, system, force, dt, steps)


def python_run(*settings):
    """The Run of `run`, its step compiled to Python alone."""
    with patch.dict(sys.modules, dict.fromkeys(("llvmlite", "llvmlite.binding"))):
        return run(*settings)


def crowd_step(system, rule, hold, dt):
    """step(q, v) -> (q, v) for members (..., N, 3), and the masks of what stays zero in it."""
    step, force = case(system, rule, hold, dt)

    def alone(q, v):
        return step(q, v, system["m"], force, dt)

    try:
        still = unroll_map(alone, system["q0"], system["v0"])[1]
    except Untraceable:
        still = [np.zeros(system["q0"].shape[-2:], dtype=bool)] * 2
    return crowd(alone, *still), still


def crowd(function, *still):
    """function(*arrays (N, 3)) -> tuple, of members (..., N, 3): compiled for all of them at once.

    A function that branches on its values is called for one member after the other.
    """
    try:
        return Unrolled(function, *still)
    except Untraceable:
        pass

    def each(*arrays):
        lead = arrays[0].shape[:-2]
        members = zip(*(x.reshape(-1, *x.shape[-2:]) for x in arrays), strict=True)
        parts = map(np.stack, zip(*(function(*member) for member in members), strict=True))
        return tuple(part.reshape(*lead, *part.shape[1:]) for part in parts)

    return each


def energy_scale(system):
    """The unit of energy errors in J: sum m |g| sum L."""
    return float(np.sum(system["m"]) * np.abs(c.GRAVITY).max() * np.sum(system["lengths"]))


def drift(system, run):
    """The largest energy error (...) of a run, as a share of that."""
    return np.max(np.abs(run.energies - run.energies[0]), axis=0) / energy_scale(system)


def study_parser(name, doc, repeats=None):
    """A study's Parser, with --json, and --repeats where something is timed."""
    parser = Parser(prog=name, description=doc, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=writable, metavar="PATH", help="write the same as JSON")
    if repeats:
        settings = {"type": number(int, 1, 1000), "default": repeats}
        parser.add_argument("--repeats", **settings, help=f"timings of each ({repeats})")
    return parser


def host(**more):
    """What ran on what; printed, and returned for the JSON."""
    what = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__}
    say(", ".join(f"{key} {value}" for key, value in (what | more).items()))
    return what | more


def finish(args, content):
    """Write the JSON, if that is asked for. Returns the exit status."""
    if args.json:
        write_json(args.json, content)
    return 0
