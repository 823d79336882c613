"""Read the real thing: what MuJoCo calls our quantities, and what its speed is worth at the same error.

(a) The same quantity, two names: `soft` is MuJoCo's tendon equality, digit by digit.  (b) Time to a given error: the
double pendulum, 5 s, beside reference.json.  (c) A published task with published tolerances: the simple pendulum A01.
(d) How a step grows with a chain.
Engines run at their fastest, their models built before the clock starts (_peers.py). Whatever is compared is timed in
turns, A B A B (_race.py), so that a busy machine slows both; only ratios carry over to another machine. The time of
ours is that of the integration loop, first stages and all; `with all around it` adds measuring every state.
"""

import json
import os
import subprocess
import sys
import time
from argparse import RawDescriptionHelpFormatter
from decimal import Decimal, localcontext
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies._race import gauss_ladder, in_turns, race, run_ours, steps_ladder
from curriculum.ch3_4_constraints.studies.benchmark import show, spread
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.device import processor
from curriculum.common.files import write_json

NEEDED = ("mujoco", "exudyn", "scipy")
OURS, HINGES, RODS = "ours, gauss", "MuJoCo hinges", "MuJoCo rods"
TARGETS = (1e-3, 1e-6, 1e-9, 1e-12)  # m
GRID = (2, 3), (5, 6, 7, 8, 9, 10, 11, 12), (3, 4, 5), (1e-4, 1e-5, 1e-6, 5e-7, 1e-7, 1e-9, 1e-10, 1e-11, 1e-13)
QUICK_GRID = (2, 3), (6, 8, 10, 12), (3, 4), (1e-5, 5e-7, 1e-10, 1e-13)  # steps a sample, stages, window, tol
SLOW = [("rk4", "none"), ("rk4", "project"), ("semi_implicit", "project")]
STEP = 0.005  # s, of the chains
MODULE = "curriculum.ch3_4_constraints.studies.real_thing"
TOLS = 10.0 ** -np.arange(3, 15)


# --- (a) the same quantity, two names ---
def ours_named(system, dt):
    """{our name: value} for what MuJoCo has a field for. Its row of J is ours / |d|, so lambda is ours |d|: newtons."""
    q, v, m, hold = system["q0"], system["v0"], system["m"], c.hold_table(dt)["soft"]
    (jac, _, gdot, _), force = c.constraint_terms(system, q, v), c.constraint_force(system, q, v, hold)
    d, w = c.rod_vectors(system, q), np.repeat(1.0 / m[:, 0], 3)
    size, a = np.sqrt(c.dot(d, d)), jac * w @ jac.T
    pull = np.cumsum(force[::-1], axis=0)[::-1]  # a chain: rod k carries what acts on particle k and all beyond
    stretch, scale = size - system["lengths"], np.outer(size, size)
    return {
        ("row of J over |d|", "efc_J"): jac / size[:, None],
        ("|d| - L", "efc_pos"): stretch,
        ("gdot / |d|", "efc_vel"): gdot / size,
        ("stiffness, damping", "efc_KBIP"): np.tile([hold.stiffness, hold.damping], (len(d), 1)),
        ("-(damping gdot + stiffness g)/|d|", "efc_aref"): -hold.damping * gdot / size - hold.stiffness * stretch,
        ("softness diag A / |d|^2", "efc_R"): hold.softness * np.diag(a) / size**2,
        ("(A + softness diag A) / |d||d|", "efc_AR"): (a + hold.softness * np.diag(np.diag(a))) / scale,
        ("lambda |d|", "efc_force"): c.dot(pull, d) / size,
        ("acceleration", "qacc"): (system["weight"] + force) / m,
    }


WHERE = dict.fromkeys(("efc_J", "efc_pos", "efc_KBIP", "efc_R"), "mj_makeConstraint")
WHERE |= {"efc_vel": "mj_referenceConstraint", "efc_aref": "mj_referenceConstraint"}
WHERE |= {"efc_AR": "mj_projectConstraint", "efc_force": "mj_fwdConstraint", "qacc": "mj_fwdConstraint"}


def names(repeats, quick):
    """Table (a): our names and MuJoCo's, a value of the first state, and the largest difference over all states."""
    rng, dt, rows, dropped, states = np.random.default_rng(0), 0.005, {}, 0.0, 20 if quick else 100
    for state in range(states):
        system = peers.random_chain(rng, 1 + (state + 1) % 4)  # the first is a double pendulum
        ours = ours_named(system, dt)
        whole = c.hold_table(dt)["soft"]._replace(use_jdotv=1.0)
        moved = c.constraint_force(system, system["q0"], system["v0"], whole) / system["m"]
        moved += c.GRAVITY - ours["acceleration", "qacc"]
        dropped = max(dropped, float(np.abs(moved).max() / np.abs(ours["acceleration", "qacc"]).max()))
        theirs = peers.named(system, dt, {field: value.shape for (_, field), value in ours.items()})
        for (name, field), value in ours.items():
            row = {"ours": name, "MuJoCo's": field, "set by": WHERE[field], "ours, last": float(value.flat[-1])}
            row |= {"MuJoCo's, last": float(theirs[field].flat[-1]), "largest gap": 0.0}
            gap = float(np.abs(value - theirs[field]).max() / np.abs(value).max())
            row = rows.setdefault(field, row)
            row["largest gap"] = max(row["largest gap"], gap)
    worst = max(rows[field]["largest gap"] for field in ("efc_force", "qacc"))
    print(f"\nneither soft nor MuJoCo asks for Jdot v: with it, accelerations would differ by up to {dropped:.0%}")
    title = f"(a) the same quantity, two names: soft and MuJoCo {version('mujoco')}; gaps over {states} random chains"
    bars = [("acceleration and rod force, largest difference as a share of the largest", worst, 1e-12)]
    return show(title, list(rows.values()), bars)


# --- (b), (c) time to an error ---
def double(repeats, quick):
    """(b) The double pendulum of seed 0, 5 s; error: the farthest that a particle is off at 20 times."""
    truth = json.loads(Path(__file__).with_name("reference.json").read_text(encoding="utf-8"))
    q = np.array(truth["cases"]["double"]["positions"])

    def error(found):
        return np.max(np.linalg.norm(found - q, axis=-1))

    task = peers.Task(c.build_system("double"), len(q), truth["times"][0], error)
    steps, cap = partial(steps_ladder, task), 0.05 if quick else 0.5
    shipped = steps("Euler, ", peers.run_tendons, 10, 500, "Euler", 0.95, lambda dt: max(0.02, 2.0 * dt))
    # the hardest that RK4 bears: 0.6 steps; MuJoCo's own limit is two, it clips the impedance at 0.9999
    hardened = steps("RK4, ", peers.run_tendons, 20, 3000, "RK4", 0.9999, lambda dt: 0.6 * dt)
    ladders = {OURS: gauss_ladder(task, ["none"], *(QUICK_GRID if quick else GRID))}
    ladders |= {f"ours, {rule} {mode}": steps("", run_ours, 5, 1000, mode, rule) for rule, mode in SLOW}
    ladders |= {HINGES: steps("RK4, ", peers.run_hinges, 4, 1500)}
    ladders |= {f"{RODS}, as shipped": shipped, f"{RODS}, hardened": hardened}
    if has("scipy"):
        ladders["scipy, DOP853 on our force"] = {f"tol {t:.0e}": partial(peers.run_scipy, task, t) for t in TOLS}
    if has("exudyn"):
        for tol in (1e-4, 1e-6, 1e-8):  # of its Newton iteration
            ladders[f"Exudyn rods, tol {tol:g}"] = steps("trapezoidal, ", peers.run_exudyn, 10, 4000, tol)
    limits = [("1e-12 m", [HINGES], 0.15), ("1e-09 m", [HINGES], 0.6), ("1e-06 m", [HINGES], 2.0)]
    limits += [(f"{t:.0e} m", [who for who in ladders if " rods, " in who], 0.1) for t in TARGETS[1:]]
    title = f"(b) the double pendulum, 5 s, time to an error; {versions()}"
    return race(title, task, ladders, {f"{t:.0e} m": t for t in TARGETS}, cap, repeats, limits)


def swing(times):
    """Positions (T, 1, 2) of the unit pendulum released level, and how well they are known, in m.

    sin(phi / 2) = k cd(sqrt(g) t, k), k = sin(phi_0 / 2), phi from straight down (DLMF 22.19(i)); decimals take off
    whole periods, 2000 s would cost a double three digits. Doubt: scipy's value half a period later is minus this one.
    """
    from scipy.special import ellipj

    with localcontext() as context:
        context.prec = 40
        a, b = Decimal(1), Decimal("0.5").sqrt()
        while a - b > Decimal("1e-36"):
            a, b = (a + b) / 2, (a * b).sqrt()
        half = Decimal("3.141592653589793238462643383279502884197") / a  # 2 K(k) by Gauss's mean
        pace = Decimal(-c.GRAVITY[1].item()).sqrt()
        u = np.array([[float(pace * Decimal(t) % (2 * half) + late * half) for t in times] for late in (0, 1)])
    _, cn, dn, _ = ellipj(u, 0.5)
    s = np.sqrt(0.5) * cn / dn
    q = np.stack([2.0 * s * np.sqrt(1.0 - s * s), 2.0 * s * s - 1.0], axis=-1)
    return q[0, :, None], float(np.abs(q[0] - q[1] * [-1.0, 1.0]).max())


def a01(repeats, quick):
    """(c) M. Gonzalez et al., Multibody Syst. Dyn. 16 (2006) 179, A01_specification.xml: outputs, threshold, errors."""
    times = 0.5 * np.arange(1, 4001)
    q, doubt = swing(times.tolist())

    def error(found):
        return np.sqrt(np.mean((np.abs(found - q) / np.maximum(np.abs(q), 1e-3)) ** 2))

    system = c.make_system([[1.0, 0.0, 0.0]], np.zeros((1, 3)), [1.0], [(0, -1)])
    task = peers.Task(system, len(times), 0.5, error)
    ladders = {OURS: gauss_ladder(task, ["none"], (2, 3), (8, 10, 12), (3, 4, 5), (1e-10, 1e-11, 3e-12))}
    ladders |= {HINGES: steps_ladder(task, "RK4, ", peers.run_hinges, 25, 120)}
    title = f"(c) A01, the simple pendulum for 2000 s; {versions()}; the truth is known to {doubt:.0e} m"
    targets = {"low precision, 0.1": 1e-1, "high precision, 0.001": 1e-3}
    answer = race(title, task, ladders, targets, 60.0, repeats, [("high precision, 0.001", [HINGES], 0.6)])
    slow = min(run_ours(task._replace(samples=200), 25, "project", "rk4")[0] for _ in range(3)) * len(times) / 200
    print(f"rk4 with project left out: at MuJoCo's coarsest step above it would take {slow:.0f} s")
    return answer


# --- (d) scale ---
def short_run(system, mode, steps):
    """(seconds a step, rod error in m) of ours."""
    run = c.simulate(system, "semi_implicit", c.hold_table(STEP)[mode], STEP, steps)
    return run["seconds_per_step"], float(run["max_violation"])


def chain_jobs(n):
    """{who: job} for a step of a chain of n links; a job returns (seconds a step, rod error in m) of a short run."""
    import mujoco

    system, steps = c.build_system("chain", links=n), max(10, 20_000 // n)

    def theirs(model, data, axes):
        mujoco.mj_resetData(model, data)
        data.qpos[:] = system["q0"][:, :axes].ravel()
        clock = time.perf_counter()
        mujoco.mj_step(model, data, steps)
        return (time.perf_counter() - clock) / steps, float(np.abs(data.efc_pos).max())

    jobs = {f"ours, {mode}": partial(short_run, system, mode, steps) for mode in ("none", "impulse")}
    for axes in (3, 2):
        model = peers.tendons(system, STEP, axes=axes, jacobian="sparse" if n > 30 else "dense")
        jobs[f"{RODS}, {axes} axes"] = partial(theirs, model, mujoco.MjData(model), axes)
    return jobs


def dense_runs(n, repeats):
    """[(seconds a step, rod error in m)] of ours for a chain with one rod named from its other end: no chain to us."""
    q, v, m, pairs, lengths = (c.build_system("chain", links=n)[key] for key in ("q0", "v0", "m", "pairs", "lengths"))
    system = c.make_system(q, v, m, [pairs[0], (0, 1), *pairs[2:]], lengths)
    return [list(short_run(system, "none", max(2, 400 // n))) for _ in range(repeats)]


def dense_alone(n, repeats):
    """dense_runs with one BLAS thread, which takes a process of its own: on a busy machine two wait for each other."""
    code = f"from {MODULE} import dense_runs; print(dense_runs({n}, {repeats}))"
    alone = os.environ | dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    settings = {"cwd": c.HERE, "env": alone, "check": True, "capture_output": True, "text": True}
    return np.array(json.loads(subprocess.run([sys.executable, "-c", code], **settings).stdout))


def scale(repeats, quick):
    """(d) ms a step of a chain; the dense solve only while its cube law lets it end within seconds."""
    rows, links = [], (10, 100, 1000) if quick else (10, 100, 1000, 10_000)
    for n in links:
        clocks = in_turns(chain_jobs(n), repeats + 1)
        clocks |= {"ours, dense": dense_alone(n, repeats + 1)} if n <= 1000 else {}
        for who, s in clocks.items():
            row = {"links": n, "who": who, **spread(1e3 * s[1:, 0], "ms"), "rod error m": float(s[-1, 1])}
            rows.append(row | {"ours, none/this": float(np.median(clocks["ours, none"][1:, 0] / s[1:, 0]))})
    for who in dict.fromkeys(row["who"] for row in rows):
        n, ms = np.array([(row["links"], row["ms"]) for row in rows if row["who"] == who and row["links"] >= 100]).T
        print(f"{who}: grows as links to the power {np.polyfit(np.log(n), np.log(ms), 1)[0]:.2f} from {n[0]:.0f} on")
    at = {row["who"]: row["ours, none/this"] for row in rows if row["links"] == 1000}
    title = f"(d) a step of a chain, MuJoCo {version('mujoco')}; 3 axes is our model, 2 axes what a planar chain needs"
    bars = [("1000 links: time of ours as a share of MuJoCo's, 3 axes", at[f"{RODS}, 3 axes"], 1.0 / 1.5)]
    return show(title, rows, bars)


def has(name):
    return find_spec(name) is not None


def versions():
    return ", ".join(f"{name} {version(name)}" for name in NEEDED if has(name))


def main(argv=None) -> int:
    """Measure, print, maybe write JSON."""
    parser = Parser(prog="real_thing", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a look in seconds: fewer repeats and rungs, no A01")
    parser.add_argument("--repeats", type=number(int, 1), help="of each timing (9; quick: 3)")
    parser.add_argument("--json", type=writable, metavar="PATH", help="write the same as JSON, ladders and all")
    args = parser.parse_args(argv)
    if not has("mujoco"):
        parser.error("MuJoCo is not installed; pip install -e '.[compare]'")
    repeats = args.repeats or (3 if args.quick else 9)
    host = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__, "repeats": repeats}
    host |= {name: version(name) for name in NEEDED if has(name)}
    print(", ".join(f"{key} {value}" for key, value in host.items()) + "; medians, q1 and q3 the quartiles")
    for name in NEEDED:
        if not has(name):
            print(f"{name} is not installed, its rows{' and A01' if name == 'scipy' else ''} are left out")
    asked = [names, double, *([a01] if has("scipy") and not args.quick else []), scale]
    answers = [ask(repeats, args.quick) for ask in asked]
    if args.json:
        write_json(args.json, host | {"answers": answers})
    return 0


if __name__ == "__main__":
    run_script(main)
