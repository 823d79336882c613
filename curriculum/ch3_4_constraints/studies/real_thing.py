"""Read the real thing: what MuJoCo calls our quantities, and what speed is worth at an error.

(a) The same quantity, two names: `soft` is MuJoCo's equality constraint of a tendon.  (b) Time to a
given error: where the double pendulum is after 5 s.  (c) Time to high precision: the simple
pendulum of IFToMM's benchmark, beside its closed form.
An engine climbs ladders of settings to the first that reaches the error, and still does at the next
finer one. These are timed in turns, and of each engine the quickest is shown, by least times, to
which a busy machine can only add: `us` for its steps, in one call of code that has been called
before, `build` for tracing, compiling, making a model, and `in all`.
"""

import math
import time
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.tables import in_turns, say, show
from curriculum.common import rules

import numpy as np

DT, REPEATS = 0.005, 9  # s, of (a); timings
OURS, SOON, PYTHON = "ours", "ours, soon built", "ours, Python"
HINGES, TAYLOR, FAST = "MuJoCo hinges", "heyoka", "heyoka, fast_math"
QUICK = "heyoka, soon built"
STEPS, ALL = "us", "in all, ms"  # of a table's columns those by which an engine is judged
JUDGED = dict.fromkeys((SOON, PYTHON, QUICK), ALL)  # others are judged by their steps
# of (b), the share of MuJoCo's least time that is allowed to an error in m; and, to each of them,
# (engine, peer, the share of the peer's)
TARGETS = {1e-3: 0.06, 1e-6: 0.02, 1e-9: 0.01, 1e-12: 0.004}
LIMITS = [(OURS, TAYLOR, 0.8), (OURS, FAST, 0.8), (PYTHON, QUICK, 1.0)]
HIGH = 1e-3  # what A01 calls high precision


# --- (a) the same quantity, two names ---
def names(system, dt=DT):
    """(a) Rows of our and MuJoCo's names for a chain, the last number of each, the largest gap.

    MuJoCo's row of J is ours over |d|, and its force ours times |d|: newtons.
    """
    q, v, hold = system["q0"], system["v0"], c.hold_table(dt)["soft"]
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    stretch, a = c.rod_errors(system, q), (jac / np.repeat(system["m"], 3)) @ jac.T  # J M^-1 J^T
    size, soft = stretch + system["lengths"], hold.softness * np.diag(a)
    asked = -hold.damping * gdot / size - hold.stiffness * stretch
    found = {
        "efc_J": ("row of J over |d|", jac / size[:, None]),
        "efc_pos": ("|d| - L", stretch),
        "efc_vel": ("gdot/|d|", gdot / size),
        "efc_aref": ("-(damping gdot + stiffness g)/|d|", asked),
        "efc_R": ("softness diag A/|d|^2", soft / size**2),
        "efc_AR": ("(A + softness diag A)/|d||d|", (a + np.diag(soft)) / np.outer(size, size)),
        "efc_force": ("lambda |d|", -c.tensions(system, q, v, hold)),
        "qacc": ("acceleration", c.make_force(system, hold)(q, v) / system["m"]),
    }
    rows, theirs = [], peers.named(system, dt, found)
    for field, (name, x) in found.items():
        its = theirs[field].reshape(x.shape)
        row = {"ours": name, "MuJoCo's": field, "ours is": x.flat[-1], "its": its.flat[-1]}
        rows.append(row | {"largest gap": np.abs(x - its).max() / np.abs(x).max()})
    return rows


# --- (b) time to an error ---
def steps_ladder(engine, task, low, high, *words, **how):
    """{setting: (build, steps a sample)} of an engine, each with about 3 % more steps.

    A run is build()(steps a sample); build is engine(task, *words, **how).
    """
    build, count = partial(engine, task, *words, **how), round(30 * np.log(high / low))
    pers = np.unique(np.geomspace(low, high, count).round().astype(int)).tolist()
    return {" ".join([*words, f"dt {task.every / per:.3g}"]): (build, per) for per in pers}


def taylor_ladder(engine, task, **how):
    """The same of heyoka, four tolerances a power of ten: engine(task, tol, **how)."""
    builds = {tol: partial(engine, task, tol, **how) for tol in 10.0 ** -np.arange(1.0, 15.0, 0.25)}
    return {f"tol {tol:.1e}": (build, 1) for tol, build in builds.items()}


def offered(error):
    """The names of our rules among which --tol chooses for an error."""
    families = (rules.offered(family, c.INTEGRATORS, error) for family in rules.FAMILIES)
    return [name for family in families for name in family]


def engines():
    """{name: version} of the other engines that are installed."""
    return {name: version(name) for name in ("mujoco", "heyoka") if find_spec(name)}


def first_there(task, ladder, error):
    """The first setting that is as near as `error`, and the next one, too: it is no accident."""
    made = cache(lambda build: build())
    near = (task.error(made(build)(per)[1]) <= error for build, per in ladder.values())
    both = zip(ladder, pairwise(near), strict=False)
    return next((setting for setting, pair in both if all(pair)), None)


def timed(task, build, per):
    """Seconds of the steps, and with what there is to build; and the error."""
    clock = time.perf_counter()
    go = build()
    built = time.perf_counter() - clock
    seconds, q = go(per)
    return seconds, seconds + built, task.error(q)


def race(task, racers, error, limits):
    """Rows and bars: how long each engine takes to an error.

    racers: {engine: ladders, each from coarse and quick to fine and slow}; limits: (engine, peer,
    the share of the peer's least time that is allowed), of what the engine is judged by.
    """
    jobs, best, bars = {}, {}, []
    for engine, ladders in racers.items():
        for ladder in ladders:
            setting = first_there(task, ladder, error)
            if setting is not None:
                jobs[engine, setting] = partial(timed, task, *ladder[setting])
    for (engine, setting), samples in in_turns(jobs, REPEATS).items():
        steps, whole, off = np.array(samples).T
        row = {"engine": engine, "error": f"{off[0]:.1e}", STEPS: 1e6 * steps.min()}
        row |= {"build, ms": 1e3 * np.min(whole - steps), ALL: 1e3 * whole.min()}
        own = JUDGED.get(engine, STEPS)
        if engine not in best or row[own] < best[engine][own]:  # of the ladders of each
            best[engine] = row | {"ours/it": "-", "setting": setting}
    for row in best.values():
        if OURS in best:
            row["ours/it"] = f"{best[OURS][STEPS] / row[STEPS]:.2g}"
    for engine, peer, limit in limits:
        if {engine, peer} <= best.keys():
            own = JUDGED.get(engine, STEPS)
            what = "its steps" if own == STEPS else "in all"
            share = best[engine][own] / best[peer][own]
            bars.append((f"{error:.0e}: {engine}, {what}, over {peer}", share, limit))
    return list(best.values()), bars


def ladders(task, error):
    """{engine: ladders, from coarse to fine}: each at its best, for the end state."""
    found = {HINGES: [steps_ladder(peers.hinges, task, 60, 30_000)]}
    if find_spec(TAYLOR):
        kinds = {TAYLOR: {}, FAST: {"fast_math": True}, QUICK: {"opt_level": 0}}
        for engine, how in kinds.items():
            found[engine] = [taylor_ladder(peers.heyoka, task, **how)]
    kinds = {PYTHON: {"machine": False}}
    if _runs.NATIVE:
        kinds |= {SOON: {"best": False}, OURS: {}}
    for engine, how in kinds.items():
        climbs = [steps_ladder(peers.ours, task, 8, 400, x, **how) for x in offered(error)]
        found[engine] = climbs
    return found


# --- (c) a published benchmark ---
def level_pendulum(times):
    """The closed form: (x, y) (T, 2) in m at `times` (T,) s of a pendulum of 1 m let go at (1, 0).

    phi is Jacobi's amplitude am(t sqrt(g / L), k) by arithmetic-geometric means (Abramowitz and
    Stegun, 16.4); k is the sine of half the angle to the vertical at the start, 45 degrees.
    """
    a, b, ratios = 1.0, math.sqrt(0.5), []
    for _ in range(5):  # each doubles the digits
        ratios.append((a - b) / (a + b))
        a, b = 0.5 * (a + b), math.sqrt(a * b)
    phi = 2.0 ** len(ratios) * a * math.sqrt(_runs.G) * times
    for ratio in reversed(ratios):
        phi = 0.5 * (phi + np.arcsin(ratio * np.sin(phi)))
    half = 0.5 * np.sin(phi) ** 2  # k^2 sn^2, which is 1 - dn^2
    return np.stack([np.cos(phi), -half], axis=-1) / (1.0 - half)[:, None]


def a01(seconds=2000.0):
    """The Task (c): A01 of M. Gonzalez et al., Multibody Syst. Dyn. 16 (2006) 179.

    Its error is the root mean square of the relative ones of x and y at all outputs, where what is
    shorter than 1 mm counts as 1 mm.
    """
    every = 0.5  # s
    q = level_pendulum(every * np.arange(1, round(seconds / every) + 1))

    def error(found):
        return np.sqrt(np.mean(((found[:, 0] - q) / np.maximum(np.abs(q), 1e-3)) ** 2))

    system = _runs.make_system([[1.0, 0, 0]], [[0.0, 0, 0]], [1.0], [(0, -1)])
    return _runs.Task(system, len(q), every, error)


def main(argv=None):
    """Measure and print."""
    parser = _runs.study_parser("real_thing", __doc__)
    parser.add_argument("--names", action="store_true", help="(a) alone; without it, (b)")
    parser.add_argument("--a01", action="store_true", help="(c) alone")
    args = parser.parse_args(argv)
    if args.names:
        rows = names(peers.random_chain(np.random.default_rng(0), 3))
        show(f"(a) soft and MuJoCo {version('mujoco')}, tendons of a random chain", rows)
        return
    _runs.host(repeats=REPEATS, **engines())
    if args.a01:
        task = a01()
        racers = {
            OURS: [steps_ladder(peers.ours, task, 2, 3, "gauss")],
            f"{OURS}, project": [steps_ladder(peers.ours, task, 2, 3, "gauss", "project")],
            HINGES: [steps_ladder(peers.hinges, task, 60, 110)],
        }
        title = f"(c) A01, the simple pendulum, 2000 s, time to high precision, {HIGH:.0e}"
        show(title, *race(task, racers, HIGH, [(OURS, HINGES, 0.01)]))
        return
    if not find_spec(TAYLOR):
        say(f"{TAYLOR} is not installed, its rows are left out: pip install -e '.[peers]'")
    task = _runs.double(end=True)
    for error, share in TARGETS.items():
        limits = [(OURS, HINGES, share), *LIMITS]
        title = f"(b) the double pendulum after 5 s, time to an error of {error:.0e} m"
        show(title, *race(task, ladders(task, error), error, limits))
