"""Which method holds a scene when it gets hard, and at which step?

Each scene is started many times. A start is held if no rod is ever off by more than 1 % of the
shortest, and the energy by no more than 10 % of m g L or, if that is more, of the kinetic energy at
the start. A cell is the largest step of a ladder at which all starts are held; where there is none,
how many of them the smallest step holds.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods import scenes, systems
from curriculum.ch3_4_constraints.rods.run import measures
from curriculum.ch3_4_constraints.studies._schemes import all_schemes, short
from curriculum.common import cli
from curriculum.common.tracing import CompiledSteps, ordered

STARTS = 20  # of each scene
SECONDS = 10.0  # to be held
LADDER = 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005  # s
RODS = 0.01  # of the shortest rod: where a start is held, none is off by more
ENERGY = 0.1  # of its scale: where a start is held, it changes by no more
ROUNDING = 1e-14  # a share by which masses and speeds of every other start are changed
OTHER = 0.3  # a share by which masses of the starts between them are changed
PUSH = 0.5  # m/s: of a changed start, as a standard deviation
MANY = 10**6  # steps in all: enough to be worth machine code
SCENES = list(scenes.SHIPPED)
QUICK = "spin", "upright"  # scenes of a few rods


def has_column(scheme):
    """Whether there is a column about a Scheme."""
    if scheme.integrator == "semi_implicit":
        return True
    if scheme.integrator == "XPBD":
        return scheme.method == "x20"
    return scheme.integrator != "euler" and scheme.method not in ("none", "soft")


COLUMNS = list(filter(has_column, all_schemes()))


def axes(system):
    """Along which axes its particles may move, (3,) of 0 and 1: a linkage in the plane has hinges.

    So that is x and y, and z only in a scene that uses it.
    """
    return np.array([1.0, 1.0, 0.0 if systems.is_flat(system) else 1.0])


def starts(system, count):
    """[(v, m)]: this start, then by turns one a rounding error away, and one far away."""
    rng = np.random.default_rng(0)
    q = system["q0"]
    v = system["v0"]
    found = [(v, system["m"])]
    for k in range(1, count):
        rounding = k % 2
        size = ROUNDING if rounding else OTHER
        m = system["m"] * (1.0 + size * rng.uniform(-1.0, 1.0, (len(q), 1)))
        if rounding:
            other = v * (1.0 + size * rng.uniform(-1.0, 1.0))
        else:
            push = rng.normal(0.0, PUSH, v.shape) * axes(system)
            other = v * rng.uniform(0.5, 2.0) + push
            _, other = c.project(system | {"m": m}, q, q, other, 1.0)  # what the rods allow
        found.append((other, m))
    return found


def compiled_for(system, step):
    """run(q, v, m, dt, steps) -> q, v (steps + 1, N, 3), or fewer: compiled once for all starts."""

    def of_masses(q, v, dt, *m):
        return step(system | {"m": ordered(m)[:, None]}, q, v, dt)

    moving = np.ones_like(system["q0"]) * axes(system)
    run = CompiledSteps(of_masses, [moving, moving], MANY, scalars=1 + len(system["m"]))
    return lambda q, v, m, dt, steps: run([q, v], steps, dt, *m[:, 0])


def is_held(system, run, v, m, dt, seconds):
    """Whether a method holds a start."""
    steps = round(seconds / dt)
    q, v = run(system["q0"], v, m, dt, steps)
    if len(q) <= steps:  # a step has failed
        return False
    measure = measures(system | {"m": m}, c.constraint_violation, c.energy)
    violations, energies = measure(q, v)
    rods = np.max(violations) / np.min(system["lengths"])
    scale = systems.energy_scale(system | {"m": m, "v0": v[0]}, c.GRAVITY)
    gained = np.max(np.abs(energies - energies[0])) / scale
    return bool(rods <= RODS and gained <= ENERGY)


def cell(held, many):
    """The largest step of LADDER with held(*start, dt) for each of many starts, as is printed."""
    for dt in LADDER:
        if all(held(*start, dt) for start in many):
            return f"{dt:g}"
    share = sum(held(*start, LADDER[-1]) for start in many)
    return f"{share}/{len(many)}" if share else "-"


def row(name):
    """The cells of a scene."""
    system = c.build_system(name)
    many = starts(system, STARTS)
    cells = []
    for scheme in COLUMNS:
        run = compiled_for(system, scheme.step)
        cells.append(cell(partial(is_held, system, run, seconds=SECONDS), many))
    return cells


def show(name, cells):
    """Print a row of the table."""
    line = f"{name:15}"
    for scheme, words in zip(COLUMNS, cells, strict=True):
        line += f"{words:>{max(7, len(scheme.method) + 1)}}"
    print(line)


def main(argv=None):
    """Print the table."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="two of the scenes")
    args = parser.parse_args(argv)
    held = f"all of {STARTS} starts hold for {SECONDS:g} s"
    print(f"{len(SCENES)} scenes: largest step in s at which {held}")
    show("", [short(x.integrator) for x in COLUMNS])
    show("", [x.method for x in COLUMNS])
    names = QUICK if args.quick else SCENES
    for name in cli.progress(names):
        show(name, row(name))
