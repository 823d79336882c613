"""Read the real thing: what MuJoCo calls our quantities, and what speed is worth at an error.

(a) The same quantity, two names: `soft` is MuJoCo's equality constraint of a tendon.  (b) Time to a
given error: where the double pendulum is after 5 s, beside reference.json.  (c) Time to high
precision: the simple pendulum of IFToMM's benchmark, beside its closed form.
Each engine climbs ladders of settings to the first that reaches the error, and still does at the
next finer one: what is near by accident does not count. These are timed in turns, A B A B, and of
each engine the quickest is shown: `us` is the least time of its steps, one call for a whole run of
code that has been called before, with no state kept but the last. `build` is tracing, compiling,
making a model; `in all` is both. What is soon built, or runs in Python, is judged by that. Bars and
`ours/it`, our time over theirs, are of least times, to which a busy machine can only add.
MuJoCo runs RK4 in joint angles, all else switched off. heyoka runs a Taylor series in angles, with
and without `fast_math`, all optimized; soon built, it is not (`opt_level=0`). Ours are the rules
among which --tol chooses, with rods held by `none` where no mode is named. An engine that is
missing at an error did not reach it.
"""

import math
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _race, _runs
from curriculum.ch3_4_constraints.studies._race import (
    ALL,
    HINGES,
    OURS,
    PYTHON,
    QUICK,
    REPEATS,
    SOON,
    STEPS,
    TAYLOR,
    race,
    show_race,
    steps_ladder,
)
from curriculum.ch3_4_constraints.tables import say, show

import numpy as np

DT = 0.005  # s, of (a)
# of (b), {error in m: (engine, peer, of what, the share of the peer's least time that is allowed)}
TARGETS = {
    error: ((OURS, HINGES, STEPS, share), (OURS, TAYLOR, STEPS, 0.8), (PYTHON, QUICK, ALL, 1.0))
    for error, share in ((1e-3, 0.06), (1e-6, 0.02), (1e-9, 0.01), (1e-12, 0.004))
}
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
def our_ladder(task, low, high, rule, mode, **how):
    """Rungs of ours; `how` as compiled_step takes it. dt is no part of what is compiled."""
    build = partial(peers.compiled_step, task.system, rule, mode, 1.0, **how)
    words = [rule] if mode == "none" else [rule, mode]
    return steps_ladder(task, low, high, build, peers.ours, *words)


def hinge_ladder(task, low, high):
    """Rungs of MuJoCo in joint angles."""
    return steps_ladder(task, low, high, partial(peers.hinges_model, task), peers.hinges)


def taylor_ladder(task, **how):
    """Rungs of heyoka; `how` as heyoka takes it."""
    words = ["fast_math"] if how.get("fast_math") else []
    build, go = partial(peers.heyoka_flow, task, **how), partial(peers.heyoka, task=task)
    return _race.taylor_ladder(16.0, build, go, *words)


def ladders(task, error):
    """{engine: ladders, from coarse to fine}: each at its best, for the end state.

    Ours are what --tol chooses among for that error.
    """
    found = {HINGES: [hinge_ladder(task, 60, 30_000)]}
    if find_spec(TAYLOR):
        found[TAYLOR] = [taylor_ladder(task, fast_math=fast) for fast in (True, False)]
        found[QUICK] = [taylor_ladder(task, opt_level=0)]
    kinds = {PYTHON: {"machine": False}}
    if _runs.NATIVE:
        kinds |= {SOON: {"machine": True, "best": False}, OURS: {"machine": True}}
    for engine, how in kinds.items():
        found[engine] = [
            our_ladder(task, 8, 400, rule, "none", **how) for rule in _race.offered(error)
        ]
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
    _runs.host(repeats=REPEATS, **_race.engines())
    if args.a01:
        task = a01()

        def racers(_):
            modes = {OURS: "none", f"{OURS}, project": "project"}
            mine = {name: [our_ladder(task, 2, 3, "gauss", mode)] for name, mode in modes.items()}
            return mine | {HINGES: [hinge_ladder(task, 60, 110)]}

        found = race(task, racers, {HIGH: [(OURS, HINGES, STEPS, 0.01)]})
        show_race("(c) A01, the simple pendulum, 2000 s, time to high precision, {}", *found)
        return
    if not find_spec(TAYLOR):
        say(f"{TAYLOR} is not installed, its rows are left out: pip install -e '.[peers]'")
    task = _runs.double(end=True)
    found = race(task, partial(ladders, task), TARGETS)
    show_race("(b) the double pendulum after 5 s, time to an error of {} m", *found)
