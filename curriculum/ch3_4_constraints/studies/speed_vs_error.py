"""Which method, and which step, reaches which error in what time?

Each integrator with each method, XPBD and MuJoCo, from long steps to ever shorter ones, until
rounding or a second of computing ends it. Times are medians of turns in one process.
"""

import time
from argparse import ArgumentTypeError
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.mechanics import choice
from curriculum.ch3_4_constraints.mechanics.reference import distance, horizon
from curriculum.ch3_4_constraints.mechanics.systems import has_loop, is_flat
from curriculum.ch3_4_constraints.pictures import work_precision
from curriculum.ch3_4_constraints.results.advice import milliseconds, spoken
from curriculum.ch3_4_constraints.results.table import in_digits
from curriculum.ch3_4_constraints.studies import _mujoco
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step
from curriculum.common import cli
from curriculum.common.files import check_writable, write_together
from curriculum.common.tracing import CompiledSteps

SCENES = {"double": 5.0, "jansen_leg": 2.0, "windows": 1.0}  # how long each is followed, in s
GOALS = 1e-2, 1e-3, 1e-6, 1e-9, 1e-12  # m
COARSE = 0.1  # of all rods together: a larger goal says nothing
USUAL = 0.005  # s: the first step is a multiple of it where it can be
SHOWN = 8  # of the first steps: so many times shorter are those whose errors are printed
MANY = 10**9  # steps in all: enough to be worth machine code
STRETCH = 4000  # steps at once: what they leave stays in the cache
LIMIT = 1.0  # s for a pair
SHORT = 0.05  # s: what takes less is timed in turns
TURNS = 5
TIED = 1.1  # times as long is as quick
TEXT = "speed_vs_error.txt"  # of a scene of one's own
DIAGRAM = "speed_vs_error.svg"
OUT = "outputs/ch3.4-constraints"


class Solver(NamedTuple):
    """What takes steps: an integrator with a method, or another way to move particles on rods."""

    integrator: str  # one of the chapter's, XPBD, or MuJoCo
    method: str

    @property
    def short(self):
        """What the integrator is called where there is little room."""
        return self.integrator.removesuffix("_implicit")

    def __str__(self):
        return f"{self.short} {self.method}"


class Timing(NamedTuple):
    """What a solver makes of a step size, and how long all its steps took."""

    solver: Solver
    dt: float  # s
    error: float  # m, of the worst particle at the end; inf where it is lost
    rods: float  # m, of the worst rod at the end
    times: list  # s for all steps, a turn each

    @property
    def seconds(self):
        """The median of the turns."""
        return median(self.times)


# --- steps: step(system, q, v, dt) -> q, v ---
def chapter_step(integrator, method, system, q, v, dt):
    """A step of an integrator and a method of the chapter."""
    return choice.step_of(c, system, integrator, method, {})(q, v, dt)


SOLVERS = {}
for pair in choice.pairs_of(c, c.INTEGRATORS):
    SOLVERS[Solver(*pair)] = partial(chapter_step, *pair)
SOLVERS |= {Solver("XPBD", f"x{count}"): partial(xpbd_step, substeps=count) for count in (1, 4, 20)}


# --- engines: run(steps) -> seconds, q (N, 3) in m at the end ---
def ours(system, seconds, step, *more):
    """run of step(q, v, *more, dt) -> (q, v, *more), as machine code."""
    start = [system["q0"], system["v0"], *more]
    compiled = CompiledSteps(step, start, MANY, knobs=1)

    def run(steps):
        state = start
        spent = 0.0
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
    Solver("MuJoCo", "hinges"): (_mujoco.linkage, "", "RK4"),
    Solver("MuJoCo", "connect"): (_mujoco.linkage, "", "Euler"),
    Solver("MuJoCo", "connect, hard"): (_mujoco.linkage, _mujoco.HARD, "RK4"),
    Solver("MuJoCo", "tendons"): (_mujoco.tendons, "", "Euler"),
    Solver("MuJoCo", "tendons, hard"): (_mujoco.tendons, _mujoco.HARD, "RK4"),
}


def model_of_peer(solver, system, dt):
    """MuJoCo's model and data by a row of PEERS."""
    parts_of, hard, integrator = PEERS[solver]
    return _mujoco.started(
        system, parts_of, hard.format(2.0 * dt), dt, f'integrator="{integrator}"'
    )


def places(data, system):
    """Where MuJoCo has the particles, (N, 3) in m."""
    return np.array([data.site(f"s{k}").xpos for k in range(len(system["m"]))])


def peer(solver, system, seconds, steps):
    """A run of MuJoCo, by a row of PEERS."""
    import mujoco

    mujoco.set_mju_user_warning(lambda text: None)  # else what diverges leaves a file of its own
    model, data = model_of_peer(solver, system, seconds / steps)
    clock = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    took = time.perf_counter() - clock
    mujoco.mj_kinematics(model, data)  # a step leaves the places of its beginning
    return took, places(data, system)


def trouble(solver, system):
    """Why a row of PEERS cannot hold a scene, in words, or ""."""
    if not find_spec("mujoco"):
        return "mujoco is not installed: pip install -e '.[fast,peers]'"
    import mujoco

    if PEERS[solver][0] is _mujoco.linkage and not is_flat(system):
        return "its hinges are for scenes in the plane z = 0"
    try:
        model, data = model_of_peer(solver, system, USUAL)
        mujoco.mj_kinematics(model, data)
        off = distance(places(data, system), system["q0"])
    except (ArgumentTypeError, ValueError, KeyError, RecursionError) as why:
        return str(why).splitlines()[0]
    return "" if off < 1e-9 * np.sum(system["lengths"]) else "its particles do not start there"


def peers(system, seconds):
    """{Solver: run} of MuJoCo, which has `connect` where a loop closes, and else `hinges`."""
    other = "hinges" if has_loop(system) else "connect"
    found = {}
    for solver in PEERS:
        if not solver.method.startswith(other):
            found[solver] = partial(peer, solver, system, seconds)
    return found


def peers_there(system, seconds):
    """{Solver: run} of the peers that can hold a scene, and {Solver: why not} of the others."""
    runs = {}
    missing = {}
    for solver, run in peers(system, seconds).items():
        why = trouble(solver, system)
        if why:
            missing[solver] = why
        else:
            runs[solver] = run
    return runs, missing


# --- measuring ---
def known_motion(system, seconds):
    """The Reference after so many seconds or, where that is not known, after fewer."""
    parts = 1 << choice.HALVED
    return choice.known_motion(c, system, seconds / parts, parts), seconds / parts


def reference(system, seconds):
    """Where the particles end, (N, 3) in m, and how sure that is, in m."""
    known, _ = known_motion(system, seconds)
    return known.q, known.uncertainty


def timed(solver, run, system, seconds, known, steps):
    """The Timing of so many steps, which end where they should if that is at `known` (N, 3)."""
    took, q = run(steps)
    rods = float(c.constraint_violation(system, q))
    return Timing(solver, seconds / steps, distance(q, known), rods, [took])


def ladder(take, first, seconds, coarsest, limit):
    """The Timings of a solver, from long steps to short ones: take(steps) is the one of so many.

    `first` is how many are tried first. Fewer and longer ones follow as long as they are within the
    coarsest goal, in m; shorter ones, until all have taken `limit` s.
    """
    found = [take(first)]
    steps = first
    while steps > 1 and found[0].error <= coarsest:
        steps = choice.fewer(steps, partial(choice.digits, seconds))
        found.insert(0, take(steps))
        if found[0].seconds >= found[1].seconds:  # gauss takes it in parts
            break
    steps = first
    spent = 0.0
    while steps < SHOWN * first or spent + 2.0 * found[-1].seconds < limit:
        steps = 2 * steps
        found.append(take(steps))
        spent += found[-1].seconds
        errors = [x.error for x in found[-4:]]
        if steps >= SHOWN * first and errors[0] < 0.2 and min(errors[1:]) > 0.7 * errors[0]:
            break  # rounding, or what no step makes better
    return found


class Measured(NamedTuple):
    """What is known of a scene: {Solver: [Timing, ...]}, and how it was measured."""

    scene: str
    seconds: float  # that it was followed
    found: dict
    goals: list  # m: those that the scene is large enough for, and the reference sure enough
    uncertainty: float  # m, of the reference
    built: float  # s, in which machine code was built
    missing: dict  # {Solver: why it is not there}
    shown: float  # s: the step whose errors are printed
    turns: int


def measure(scene, system, seconds, limit, turns):
    """The Measured of a scene; ArgumentTypeError if nobody knows its motion."""
    known, part = known_motion(system, seconds)
    if known.q is None:
        raise ArgumentTypeError(
            f"nobody knows where it is after {known.step * part:.3g} s: {known.why}"
        )
    seconds = known.step * part
    last = max(1, round(seconds / USUAL))
    first = choice.first_count(system, c.make_force(system), seconds / last, last)
    largest = COARSE * np.sum(system["lengths"])
    goals = [goal for goal in GOALS if known.uncertainty < goal < largest]
    if not goals:
        raise ArgumentTypeError(f"it is too small: {spoken(largest)} is less than all goals")
    clock = time.perf_counter()
    runs = {}
    for solver, step in SOLVERS.items():
        runs[solver] = ours(system, seconds, partial(step, system))
    built = time.perf_counter() - clock
    there, missing = peers_there(system, seconds)
    runs |= there
    found = {}
    for solver in cli.progress(runs):
        take = partial(timed, solver, runs[solver], system, seconds, known.q)
        found[solver] = ladder(take, first, seconds, goals[0], limit)
    for _ in cli.progress(f"{scene}, turn {k}" for k in range(1, turns)):
        for solver, timings in found.items():
            for x in timings:
                if x.times[0] < SHORT:
                    x.times.append(runs[solver](round(seconds / x.dt))[0])
    return Measured(
        scene=scene,
        seconds=seconds,
        found=found,
        goals=goals,
        uncertainty=known.uncertainty,
        built=built,
        missing=missing,
        shown=seconds / (SHOWN * first),
        turns=turns,
    )


# --- what is printed ---
def reached(timings, goal):
    """The quickest of a solver's that is within a goal, as is the next finer one; or None.

    Still finer ones need not be: rounding makes them worse.
    """
    there = [x for x, finer in pairwise(timings) if max(x.error, finer.error) <= goal]
    return min(there, key=lambda x: x.seconds, default=None)


def cell(timing):
    """The ms that it takes, and those of its step."""
    if timing is None:
        return "-"
    took = in_digits(1e3 * timing.seconds, 2)
    step = in_digits(1e3 * timing.dt, 2)
    return f"{took:g}/{step:g}"


def lines(measured):
    """The rows of a scene, and what they say."""
    goals = measured.goals
    scene = f"{measured.scene}, {measured.seconds:g} s"
    yield f"{scene}; the reference is known to {measured.uncertainty:.0e} m"
    shown = f"m off at {milliseconds(measured.shown)}"
    yield f"{'':21}{shown:>16}   ms of computing / ms a step, to be right to"
    yield f"{'':21}{'worst':>8}{'rods':>8}" + "".join(f"{spoken(goal):>12}" for goal in goals)
    for solver, timings in measured.found.items():
        at = next(x for x in timings if x.dt <= 1.001 * measured.shown)
        cells = "".join(f"{cell(reached(timings, goal)):>12}" for goal in goals)
        yield f"{solver!s:21}{at.error:8.0e}{at.rods:8.0e}{cells}"
    for goal in goals:
        yield quickest(measured.found, goal)
    for solver, why in measured.missing.items():
        yield f"{solver} is not there: {why}"
    yield f"machine code took {measured.built:.0f} s to build, which is in no time above"


def winners(found, goal):
    """The Timings to a goal, the quickest first.

    One that is nearly as quick, with a tenth of the error, goes before it.
    """
    there = [reached(timings, goal) for timings in found.values()]
    return choice.in_order([x for x in there if x], "error", "seconds")


def quickest(found, goal):
    """A sentence: who is quickest to a goal, and who as quick."""
    there = winners(found, goal)
    if not there:
        return f"to {spoken(goal)}: nobody"
    least = min(x.seconds for x in there)
    first = [f"{x.solver} {cell(x)}" for x in there if x.seconds <= TIED * least]
    return f"to {spoken(goal)}: {', '.join(first)}"


def parse_args(argv):
    parser = cli.Parser(__doc__)
    add = parser.add_argument
    add("--system", help="one of your own: a scene, or its file (those of the chapter)")
    add("--seconds", type=cli.positive, help="how long it is followed")
    add("--out", type=cli.folder, help=f"where its files go ({OUT})")
    add("--quick", action="store_true", help="coarse, and of one scene")
    add("--picture", action="store_true", help="draw the chapter's diagrams again")
    args = parser.parse_args(argv)
    for flag in "seconds", "out":
        if getattr(args, flag) and not args.system:
            parser.error(f"argument --{flag}: is for --system")
    if args.picture and args.system:
        parser.error("argument --picture: is for the chapter's scenes, not for --system")
    args.out = args.out or Path(OUT)
    return parser, args


def main(argv=None):
    """Measure, print and, if asked to, draw."""
    parser, args = parse_args(argv)
    limit = LIMIT
    turns = TURNS
    if args.quick:
        limit = LIMIT / 50.0
        turns = 2
        print("coarse: one scene, and nothing that takes long")
    if args.system:
        return one_of_your_own(parser, args, limit, turns)
    scenes = ["double"] if args.quick else list(SCENES)
    for scene in scenes:
        measured = measure(scene, c.build_system(scene), SCENES[scene], limit, turns)
        print()
        for line in lines(measured):
            print(line)
        if args.picture:
            work_precision.draw_for_the_chapter(measured, winners)
    return 0


def one_of_your_own(parser, args, limit, turns):
    """Measure a scene by its name or file, print it, and write text and diagram to a folder."""
    with parser.errors("argument --system: "):
        system = c.build_system(args.system)
    with parser.errors("argument --out: "):
        for name in (TEXT, DIAGRAM):
            check_writable(args.out / name)
    scene = Path(args.system).stem
    seconds = args.seconds or SCENES.get(scene)
    if seconds is None:
        seconds = USUAL * horizon(system, c.make_force(system), USUAL, 10**6)
    with parser.errors("argument --system: "):
        measured = measure(scene, system, seconds, limit, turns)
    text = list(lines(measured))
    if measured.seconds < seconds:
        shorter = f"nobody knows where it is after {seconds:g} s: so it is followed for"
        text.insert(0, f"{shorter} {measured.seconds:g} s")
    for line in text:
        print(line)
    picture = work_precision.text_of(measured, winners)
    write_together(args.out, {TEXT: "\n".join(text) + "\n", DIAGRAM: picture})
    print(f"wrote {args.out}: {TEXT}, {DIAGRAM}")
    return 0
