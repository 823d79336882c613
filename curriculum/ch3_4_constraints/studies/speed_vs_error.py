"""Which method, and which step, reaches which error in what time?

Each integrator with each method, XPBD and MuJoCo, by steps from 20 ms on, halved until rounding or
a second of computing ends it. Times are medians of turns in one process.
"""

import time
from functools import partial
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.mechanics.reference import distance
from curriculum.ch3_4_constraints.mechanics.systems import has_loop
from curriculum.ch3_4_constraints.pictures import work_precision
from curriculum.ch3_4_constraints.studies import _mujoco
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step
from curriculum.common import cli, progress
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import CompiledSteps

SCENES = {"double": 5.0, "jansen_leg": 2.0, "windows": 1.0}  # how long each is followed, in s
GOALS = {1e-2: "1 cm", 1e-3: "1 mm", 1e-6: "1 um", 1e-9: "1 nm", 1e-12: "1 pm"}
LONGEST, SHOWN = 0.02, 0.005  # s: the first step, and that whose errors are printed
EXACT = 0.004  # s: the steps of the reference
MANY = 10**9  # steps in all: enough to be worth machine code
STRETCH = 4000  # steps at once: what they leave stays in the cache
LIMIT, SHORT, TURNS = 1.0, 0.05, 5  # s for a pair; runs below SHORT s are timed in turns
TIED = 1.1  # times as long is as quick


class Setting(NamedTuple):
    """What a pair makes of a step size."""

    dt: float  # s
    error: float  # m, of the worst particle at the end
    rods: float  # m, of the worst rod at the end
    times: list  # s for all steps, a turn each

    @property
    def seconds(self):
        """The median of the turns."""
        return median(self.times)


# --- steps: step(system, q, v, dt) -> q, v ---
def by_name(name, step_fn, system, q, v, dt):
    """A step of a method by name, under an integrator."""
    method = c.make_methods(dt)[name]
    force = method.make_force(system)
    return c.stabilized(step_fn, system, method)(q, v, system["m"], force, dt)


STEPS = {
    f"{integrator.removesuffix('_implicit')} {name}": partial(by_name, name, step_fn)
    for integrator, step_fn in c.INTEGRATORS.items()
    for name, method in c.make_methods(dt=1.0).items()
    if method.integrator in (None, integrator)
} | {f"XPBD x{count}": partial(xpbd_step, substeps=count) for count in (1, 4, 20)}


# --- engines: run(steps) -> seconds, q (N, 3) in m at the end ---
def ours(system, seconds, step, *more):
    """run of step(q, v, *more, dt) -> (q, v, *more), as machine code."""
    start = [system["q0"], system["v0"], *more]
    compiled = CompiledSteps(step, start, MANY, knobs=1)

    def run(steps):
        state, spent = start, 0.0
        for done in range(0, steps, STRETCH):
            count = min(STRETCH, steps - done)
            columns = compiled(state, count, seconds / steps)
            spent += compiled.seconds
            if len(columns[0]) <= count:  # a step has failed
                return spent, np.full_like(start[0], np.nan)
            state = [x[-1] for x in columns]
        return spent, state[0]

    return run


PEERS = {  # rods as what, how hard, if not as MuJoCo has it, and its integrator
    "MuJoCo hinges": (_mujoco.linkage, "", "RK4"),
    "MuJoCo connect": (_mujoco.linkage, "", "Euler"),
    "MuJoCo connect, hard": (_mujoco.linkage, _mujoco.HARD, "RK4"),
    "MuJoCo tendons": (_mujoco.tendons, "", "Euler"),
    "MuJoCo tendons, hard": (_mujoco.tendons, _mujoco.HARD, "RK4"),
}


def peer(name, system, seconds, steps):
    """A run of MuJoCo, by a row of PEERS."""
    import mujoco

    model_of, hard, integrator = PEERS[name]
    dt = seconds / steps
    options = f'integrator="{integrator}"'
    model, data = _mujoco.started(system, model_of, hard.format(2.0 * dt), dt, options)
    clock = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    took = time.perf_counter() - clock
    mujoco.mj_kinematics(model, data)  # a step leaves the places of its beginning
    return took, np.array([data.site(f"s{k}").xpos for k in range(len(system["m"]))])


def peers(system, seconds):
    """{name: run} of MuJoCo, which has `connect` where a loop closes."""
    other = "hinges" if has_loop(system) else "connect"
    return {name: partial(peer, name, system, seconds) for name in PEERS if other not in name}


# --- measuring ---
def reference(system, seconds):
    """Where the particles end, (N, 3) in m, by Gauss's rule, and how sure that is, in m."""
    ends = []
    for stages in 8, 6:
        step = partial(by_name, "project", make_gauss(stages), system)
        _, q = ours(system, seconds, step)(round(seconds / EXACT))
        ends.append(q)
    return ends[0], distance(*ends)


def ladder(run, system, seconds, known, limit):
    """The Settings of a pair, from long steps to short ones."""
    found, steps, spent, took = [], round(seconds / LONGEST), 0.0, 0.0
    while len(found) < 4 or spent + 2.0 * took < limit:
        took, q = run(steps)
        rods = float(c.constraint_violation(system, q))
        found.append(Setting(seconds / steps, distance(q, known), rods, [took]))
        spent, steps = spent + took, 2 * steps
        errors = [x.error for x in found[-4:]]
        if len(errors) == 4 and errors[0] < 0.2 and min(errors[1:]) > 0.7 * errors[0]:
            break  # rounding, or what no step makes better
    return found


def measure(scene, limit, turns):
    """{name: [Setting, ...]} of a scene, its reference's uncertainty in m, and s of building."""
    system, seconds = c.build_system(scene), SCENES[scene]
    known, gap = reference(system, seconds)
    runs, found = {}, {}
    clock = time.perf_counter()
    for name, step in STEPS.items():
        runs[name] = ours(system, seconds, partial(step, system))
    built = time.perf_counter() - clock
    runs |= peers(system, seconds)
    for name in progress.each(runs):
        found[name] = ladder(runs[name], system, seconds, known, limit)
    for _ in progress.each(f"{scene}, turn {k}" for k in range(1, turns)):
        for name, settings in found.items():
            for x in settings:
                if x.times[0] < SHORT:
                    x.times.append(runs[name](round(seconds / x.dt))[0])
    return found, gap, built


# --- what is printed ---
def reached(settings, goal):
    """The quickest of settings that are within a goal, as is the next finer one; or None."""
    there = [x for x, finer in pairwise(settings) if max(x.error, finer.error) <= goal]
    return min(there, key=lambda x: x.seconds, default=None)


def cell(setting):
    """The ms that it takes, and those of its step."""
    if setting is None:
        return "-"
    took, step = (float(f"{1e3 * x:.2g}") for x in (setting.seconds, setting.dt))
    return f"{took:g}/{step:g}"


def show(scene, found, gap, built):
    """Print the rows of a scene, and what they say."""
    print(f"\n{scene}, {SCENES[scene]:g} s; two ways to the reference are {gap:.0e} m apart")
    print(f"{'':21}{'m off at 5 ms':>16}   ms of computing / ms a step, to be right to")
    print(f"{'':21}{'worst':>8}{'rods':>8}" + "".join(f"{words:>12}" for words in GOALS.values()))
    for name, settings in found.items():
        at = next(x for x in settings if x.dt <= SHOWN)
        cells = "".join(f"{cell(reached(settings, goal)):>12}" for goal in GOALS)
        print(f"{name:21}{at.error:8.0e}{at.rods:8.0e}{cells}")
    for goal in GOALS:
        print(quickest(found, goal))
    print(f"machine code took {built:.0f} s to build, which is in no time above")


def quickest(found, goal):
    """A sentence: who is quickest to a goal, and who as quick."""
    there = {name: reached(settings, goal) for name, settings in found.items()}
    there = {name: setting for name, setting in there.items() if setting}
    if not there:
        return f"to {GOALS[goal]}: nobody"
    best = min(x.seconds for x in there.values())
    first = [f"{name} {cell(x)}" for name, x in there.items() if x.seconds <= TIED * best]
    return f"to {GOALS[goal]}: {', '.join(first)}"


def main(argv=None):
    """Measure, print and, if asked to, draw."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse, and of one scene")
    parser.add_argument("--picture", action="store_true", help="draw the diagrams again")
    args = parser.parse_args(argv)
    scenes, limit, turns = SCENES, LIMIT, TURNS
    if args.quick:
        scenes, limit, turns = ["double"], LIMIT / 50.0, 2
        print("coarse: one scene, and nothing that takes long")
    for scene in scenes:
        found, gap, built = measure(scene, limit, turns)
        show(scene, found, gap, built)
        if args.picture:
            work_precision.draw(scene, SCENES[scene], found)
