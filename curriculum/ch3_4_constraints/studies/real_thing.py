"""Read the real thing: what MuJoCo calls our quantities, and what speed is worth at an error.

(a) The same quantity, two names: `soft` is MuJoCo's equality constraint of a tendon.  (b) Time to a
given error: the double pendulum, 5 s, beside reference.json.  (c) Time to high
precision: the simple pendulum of IFToMM's benchmark, beside its closed form.
Each rule climbs a ladder of settings to the first that reaches the error. These are timed in turns,
A B A B, and of each engine the quickest is shown. Bars and `ours/it` are of least times, to which a
busy machine can only add. `ms` counts steps alone; `build` is all around them: tracing, compiling,
building a model, measuring; `in all` is both. MuJoCo runs RK4 in joint angles, heyoka a Taylor
series in angles. Who is missing at an error did not reach it.
"""

import math
import time
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import islice, product

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._command import study_parser
from curriculum.ch3_4_constraints.tables import in_turns, say, show, spread
from curriculum.common.cli import run_script

import numpy as np

DT, REPEATS = 0.005, 9  # s, of (a); timings
OURS, PYTHON = "ours", "ours, Python"
HINGES, TAYLOR = "MuJoCo hinges", "heyoka"
STEPS, ALL = 0, 1  # the first two that `around` measures
# of (b), {error in m: (who, peer, of what, the share of the peer's least time that is allowed)}
TARGETS = {
    error: ((OURS, HINGES, STEPS, share), (OURS, TAYLOR, STEPS, 1.2), (PYTHON, TAYLOR, ALL, 0.5))
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
    stretch, a = c.rod_errors(system, q), c.mobility(system, jac)
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
def ladder(task, job, low, high, *settings):
    """{setting: job}: `job` with ever more steps a sample, each rung about a tenth more."""
    pers = np.geomspace(low, high, round(10 * np.log(high / low))).round().astype(int)
    return {
        " ".join([*settings, f"dt {task.every / per:.3g}"]): partial(job, task, per, *settings)
        for per in np.unique(pers).tolist()
    }


def ladders(task):
    """{who: ladders of settings, from coarse and quick to fine and slow}."""
    found = {HINGES: [ladder(task, peers.run_hinges, 4, 1500)]}
    if find_spec(TAYLOR):
        tols = 10.0 ** -np.arange(1.0, 16.0, 0.25)
        found[TAYLOR] = [{f"tol {tol:.1e}": partial(peers.run_heyoka, task, tol) for tol in tols}]
    high = [rule for rule in _runs.RULES if rule.startswith(("midpoint", "gauss"))]
    for who, machine in ((PYTHON, False), (OURS, _runs.NATIVE)):
        mine = partial(ladder, task, partial(peers.run_ours, machine=machine))
        found[who] = [mine(5, 600, "rk4", mode) for mode in ("none", "project")]
        found[who] += [mine(1, 17, rule, "none") for rule in high]
    return found


def around(task, job):
    """Seconds of the steps, and of all there is: a model or a step is made, states are read; and
    the error."""
    clock = time.perf_counter()
    seconds, q = job()
    return seconds, time.perf_counter() - clock, np.nan_to_num(task.error(q), nan=np.inf)


def race(task, racers, targets):
    """Rows and bars: who of `racers` (see `ladders`) takes how long to each of `targets`."""
    jobs, rows, bars = {}, [], []
    error_of = cache(lambda job: around(task, job)[-1])  # no rung is tried for a second time
    for error, who in product(targets, racers):
        for rungs in racers[who]:  # of each ladder goes the first rung that reaches the error
            there = (rung for rung in rungs.items() if error_of(rung[1]) <= error)
            for setting, job in islice(there, 1):
                jobs[error, who, setting] = partial(around, task, job)
    clocks = in_turns(jobs, REPEATS)
    for error, limits in targets.items():
        best = {}  # of the ladders of each
        for (at, who, setting), samples in clocks.items():
            times, own = np.array(samples).T, ALL if who == PYTHON else STEPS
            if at == error and (who not in best or times[own].min() < best[who][own].min()):
                best[who] = *times, setting
        for who, (steps, whole, off, setting) in best.items():
            row = {"to": f"{error:.0e}", "who": who, "error": off[0], **spread(1e3 * steps, "ms")}
            row |= {"build": 1e3 * np.median(whole - steps), "in all": 1e3 * np.median(whole)}
            row["ours/it"] = best[OURS][STEPS].min() / steps.min()
            rows.append(row | {"setting": setting})
        for who, peer, k, limit in limits:
            if {who, peer} <= best.keys():
                text = f"{error:.0e}: {who}, {('its steps', 'in all')[k]}, over {peer}"
                bars.append((text, best[who][k].min() / best[peer][k].min(), limit))
    return rows, bars


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
    parser = study_parser("real_thing", __doc__)
    parser.add_argument("--names", action="store_true", help="(a) alone; without it, (b)")
    parser.add_argument("--a01", action="store_true", help="(c) alone")
    args = parser.parse_args(argv)
    if args.names:
        rows = names(peers.random_chain(np.random.default_rng(0), 3))
        show(f"(a) soft and MuJoCo {version('mujoco')}, tendons of a random chain", rows)
        return
    engines = {name: version(name) for name in ("mujoco", TAYLOR) if find_spec(name)}
    _runs.host(repeats=REPEATS, **engines)
    if args.a01:
        task = a01()
        racers = {
            OURS: [ladder(task, peers.run_ours, 2, 3, "gauss", "none")],
            f"{OURS}, project": [ladder(task, peers.run_ours, 2, 3, "gauss", "project")],
            HINGES: [ladder(task, peers.run_hinges, 60, 110)],
        }
        found = race(task, racers, {HIGH: [(OURS, HINGES, STEPS, 0.01)]})
        show("(c) A01, the simple pendulum, 2000 s, time to high precision", *found)
        return
    if TAYLOR not in engines:
        say(f"{TAYLOR} is not installed, its rows are left out: pip install -e '.[peers]'")
    task = _runs.double()
    found = race(task, ladders(task), TARGETS)
    show("(b) the double pendulum, 5 s, time to an error in m", *found)


if __name__ == "__main__":
    run_script(main)
