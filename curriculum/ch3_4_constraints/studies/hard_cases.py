"""Which method holds a scene when it gets hard, and at which step? And at which is it right?

Each scene is started many times. A start is held if no rod is ever off by more than 1 % of the
shortest, and the energy by no more than 10 % of m g L or, if that is more, of the kinetic energy at
the start. A cell is the largest step of a ladder at which all starts are held, or right; where
there is none, how many of them the smallest step holds.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.mechanics import scene_files, systems
from curriculum.ch3_4_constraints.studies.speed_vs_error import STEPS, distance
from curriculum.common import cli, progress
from curriculum.common.tracing import CompiledSteps, ordered

STARTS, SECONDS = 20, 10.0  # of each scene, and s to be held
LADDER = 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005  # s
RODS, ENERGY = 0.01, 0.1  # what holding allows, see above
ROUNDING, OTHER = 1e-14, 0.3  # how large the two changes are, relatively
MANY = 10**6  # steps in all: enough to be worth machine code
SCENES = [name for name in scene_files.SHIPPED if name != "taut_cable"]  # which is refused
NEAR, AT = 1e-3, 1.0  # m, s: what is right, and when
METHODS = [title for title in STEPS if title.startswith("semi")]
METHODS += ["rk4 baumgarte", "rk4 project", "gauss project", "XPBD x20"]


def starts(system, count):
    """[(v, m)]: this start, then by turns one a rounding error away, and one far away."""
    rng, q, v = np.random.default_rng(0), system["q0"], system["v0"]
    moves = np.any([q, v], axis=(0, 1))  # axes that the scene leaves alone are left alone
    found = [(v, system["m"])]
    for k in range(1, count):
        size = ROUNDING if k % 2 else OTHER
        m = system["m"] * (1.0 + size * rng.uniform(-1.0, 1.0, (len(q), 1)))
        if k % 2:
            other = v * (1.0 + size * rng.uniform(-1.0, 1.0))
        else:
            push = moves * rng.normal(0.0, 0.5, v.shape)  # m/s; what the rods allow remains
            other = v * rng.uniform(0.5, 2.0) + push
            _, other = c.project(system | {"m": m}, q, q, other, 1.0)
        found.append((other, m))
    return found


def compiled_for(system, step):
    """run(q, v, m, dt, steps) -> q, v (steps + 1, N, 3), or fewer: compiled once for all starts."""

    def of_masses(q, v, dt, *m):
        return step(system | {"m": ordered(m)[:, None]}, q, v, dt)

    later = [system["q0"], system["v0"] + c.GRAVITY]  # a state with all axes that may be used
    run = CompiledSteps(of_masses, later, MANY, knobs=1 + len(system["m"]))
    return lambda q, v, m, dt, steps: run([q, v], steps, dt, *m[:, 0])


def is_held(system, run, v, m, dt, seconds):
    """Whether a method holds a start."""
    steps = round(seconds / dt)
    q, v = run(system["q0"], v, m, dt, steps)
    energies = c.energy(system | {"m": m}, q, v)
    m_g_L = systems.m_g_L(system | {"m": m}, c.GRAVITY)
    allowed = ENERGY * max(m_g_L, 0.5 * np.sum(m * v[0] * v[0]))
    rods_hold = np.max(c.constraint_violation(system, q)) <= RODS * np.min(system["lengths"])
    return len(q) > steps and rods_hold and np.max(np.abs(energies - energies[0])) <= allowed


def end(system, run, v, m, dt):
    """Where a start is after AT s, (N, 3) in m; NaN if it gets nowhere."""
    steps = round(AT / dt)
    q, _ = run(system["q0"], v, m, dt, steps)
    return q[-1] if len(q) > steps else np.full_like(system["q0"], np.nan)


def is_right(system, run, v, m, true, dt):
    """Whether a start ends near where it should, `true` (N, 3)."""
    return distance(end(system, run, v, m, dt), true) < NEAR


def largest(test, many):
    """The largest step of LADDER with test(*start, dt) for each of many starts, as a cell."""
    for dt in LADDER:
        if all(test(*start, dt) for start in many):
            return f"{dt:g}"
    return "-"


def rows(name, count, seconds):
    """The row of a scene in each table."""
    system = c.build_system(name)
    many = starts(system, count)
    exact = compiled_for(system, STEPS["gauss project"])
    known = [(*start, end(system, exact, *start, LADDER[-1])) for start in many]
    holds, rights = [], []
    for title in METHODS:
        run = compiled_for(system, STEPS[title])
        held = partial(is_held, system, run, seconds=seconds)
        cell = largest(held, many)
        if cell == "-":
            share = sum(held(*start, LADDER[-1]) for start in many)
            cell = f"{share}/{count}" if share else "-"
        holds.append(cell)
        rights.append(largest(partial(is_right, system, run), known))
    return holds, rights


def show(title, rows):
    """Print a table {scene: cells}."""
    print(title)
    integrators, methods = zip(*(name.split(" ", 1) for name in METHODS), strict=True)
    widths = [max(8, len(method) + 1) for method in methods]
    for name, row in [("", integrators), ("", methods), *rows.items()]:
        line = "".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))
        print(f"{name:15}{line}")


def main(argv=None):
    """Print the tables."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse: two scenes, 2 s")
    args = parser.parse_args(argv)
    scenes, count, seconds = SCENES, STARTS, SECONDS
    if args.quick:
        scenes, count, seconds = ["cable", "spin"], 2, 2.0
        print("coarse: two scenes, few starts, 2 s")
    holds, rights = {}, {}
    for name in progress.each(scenes):
        holds[name], rights[name] = rows(name, count, seconds)
    show(f"largest step in s at which all of {count} starts hold for {seconds:g} s", holds)
    all_right = f"all are within a millimetre of the truth after {AT:g} s"
    show(f"\nlargest step in s at which {all_right}", rights)
