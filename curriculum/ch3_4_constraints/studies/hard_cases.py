"""Which method holds a scene when it gets hard, and at which step?

One run may be held by luck. So each scene is started many times: as it is, and by turns with masses
and speeds off by a rounding error, and with different ones. A start is held if no rod is ever
off by more than 1 % of the shortest, and the energy by no more than 10 % of m g L or, if that is
more, of the kinetic energy at the start. A cell is the largest step of a ladder at which all starts
are held; where there is none, how many of them the smallest step holds.
"""

from functools import partial

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints import systems
from curriculum.ch3_4_constraints.studies import _flat_pose
from curriculum.ch3_4_constraints.xpbd import xpbd_step
from curriculum.common import cli
from curriculum.common.tracing import CompiledSteps, ordered

LADDER = 0.02, 0.01, 0.005, 0.002, 0.001, 0.0005  # s
RODS, ENERGY = 0.01, 0.1  # what holding allows, see above
ROUNDING, OTHER = 1e-14, 0.3  # how large the two changes are, relatively
SUBSTEPS = 20
STRETCH, MANY = 500, 10**6  # steps at once, and in all: enough to be worth machine code
SCENES = ["braced", "cable", "heavy_tip", "light_tip", "long_chain", "peaucellier", "ring", "spin"]
SCENES += ["tight_cable", "upright", "windows"]
METHODS = {f"semi {name}": ("semi_implicit", name) for name in c.stabilizations(dt=1.0)}
METHODS |= {f"rk4 {name}": ("rk4", name) for name in ("baumgarte", "project")}
METHODS |= {"gauss project": ("gauss", "project"), f"XPBD x{SUBSTEPS}": None}


def step_of(title):
    """step(system, q, v, dt) -> (q, v) of a method."""
    if METHODS[title] is None:
        return partial(xpbd_step, substeps=SUBSTEPS)
    integrator, name = METHODS[title]
    return lambda system, q, v, dt: c.one_step(system, name, integrator, q, v, dt)


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


def energies(m, q, v):
    """In J, of states q, v (T, N, 3)."""
    return np.sum(m * (0.5 * v * v - q * c.GRAVITY), axis=(1, 2))


def is_held(system, run, v, m, dt, seconds):
    """Whether a method holds a start; it is not followed for long once it is lost."""
    q, left = system["q0"], round(seconds / dt)
    before = energies(m, q[None], v[None])
    m_g_L = systems.m_g_L(system | {"m": m}, c.GRAVITY)
    allowed = ENERGY * max(m_g_L, 0.5 * np.sum(m * v * v))
    while left > 0:
        steps = min(left, STRETCH)
        q, v = run(q, v, m, dt, steps)
        d = systems.differences(q, system["anchors"], system["pairs"])
        errors = np.abs(np.linalg.norm(d, axis=-1) - system["lengths"])
        good = np.max(errors, axis=1) <= RODS * np.min(system["lengths"])
        good &= np.abs(energies(m, q, v) - before) <= allowed
        if len(q) <= steps or not good.all():
            return False
        q, v, left = q[-1], v[-1], left - steps
    return True


def cell(name, title, count, seconds):
    """What the table says of a scene and a method."""
    system = c.build_system(name)
    many = starts(system, count)
    run = compiled_for(system, step_of(title))
    for dt in LADDER:
        if all(is_held(system, run, v, m, dt, seconds) for v, m in many):
            return f"{dt:g}"
    share = sum(is_held(system, run, v, m, LADDER[-1], seconds) for v, m in many)
    return f"{share}/{count}" if share else "-"


def main(argv=None):
    """Print the tables."""
    parser = cli.Parser(__doc__)
    parser.add_argument("scenes", nargs="*", choices=[[], *SCENES], default=[], help="only these")
    parser.add_argument("--starts", type=cli.whole(1, 10**4), default=20, help="of each scene")
    parser.add_argument("--seconds", type=cli.positive, default=10.0, help="to be held")
    parser.add_argument("--quick", action="store_true", help="three scenes, 2 s, few starts")
    args = parser.parse_args(argv)
    if args.quick:
        args.starts, args.seconds, args.scenes = 4, 2.0, ["cable", "spin", "windows"]
    print(f"largest step in s at which all of {args.starts} starts hold for {args.seconds:g} s")
    heads = [title.split(" ", 1) for title in METHODS]
    widths = [max(7, len(method) + 1) for _, method in heads]
    for words in zip(*heads, strict=True):
        cells = zip(words, widths, strict=True)
        print(f"{'':11}" + "".join(f"{word:>{width}}" for word, width in cells))
    for name in args.scenes or SCENES:
        print(f"{name:11}", end="", flush=True)
        for title, width in zip(METHODS, widths, strict=True):
            print(f"{cell(name, title, args.starts, args.seconds):>{width}}", end="", flush=True)
        print()
    _flat_pose.show({title: step_of(title) for title in METHODS})
    return 0
