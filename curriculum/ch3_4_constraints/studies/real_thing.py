"""Read the real thing: what MuJoCo calls our quantities, and what speed is worth at an error.

(a) The same quantity, two names: `soft` is MuJoCo's equality constraint of a tendon.  (b) Time to a
given error: the double pendulum, 5 s, beside reference.json.  (c) A published task with published
tolerances: the simple pendulum A01.  (d) Beside the engine that readers play with.
Whatever is compared is timed in turns, A B A B. Bars and `ours/it` are of least times, to which a
busy machine can only add; medians and quartiles show how busy it was. Columns: `ms` counts steps
alone, inside the engine's own call where it has one for many. `build` is all around them: tracing,
compiling, building a model, measuring states; `in all` is both. `rods m` is the worst rod error at
the samples. Rules: ours of constraints.py; MuJoCo's RK4 in joint angles; heyoka's Taylor series and
scipy's DOP853 in angles, their setting the tolerance; Exudyn's trapezoidal rule on rods, its number
the tolerance of Newton's iteration; Chipmunk's impulses, by pymunk. Who is missing at an error did
not reach it by a run of half a second, of A01 by one of a minute.
"""

import json
import os
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._race import in_python, ours, race, run_ours, steps_ladder
from curriculum.ch3_4_constraints.studies._runs import NATIVE, make_system
from curriculum.ch3_4_constraints.tables import say, show
from curriculum.common.cli import run_script

import numpy as np

ENGINES = dict.fromkeys(("mujoco", "scipy"), "compare")
ENGINES |= dict.fromkeys(("heyoka", "exudyn", "pymunk"), "peers")
DT = 0.005  # s, of (a)
HINGES, TAYLOR = "MuJoCo hinges", "heyoka"
# steps as a share of MuJoCo's: with a compiler, and without it
LIMITS = {1e-3: (0.06, 2.0), 1e-6: (0.02, 1.0), 1e-9: (0.01, 0.22), 1e-12: (0.004, 0.05)}


def has(name):
    return find_spec(name) is not None


# --- (a) the same quantity, two names ---
def ours_named(system, dt):
    """{(our name, MuJoCo's field): value}. Its row of J is ours over |d|, and its force ours times
    |d|: newtons."""
    q, v, hold = system["q0"], system["v0"], c.hold_table(dt)["soft"]
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    stretch, a = c.rod_errors(system, q), c.mobility(system, jac, jac)
    size, soft = stretch + system["lengths"], hold.softness * np.diag(a)
    spring = np.tile([hold.stiffness, hold.damping], (len(size), 1))
    return {
        ("row of J over |d|", "efc_J"): jac / size[:, None],
        ("|d| - L", "efc_pos"): stretch,
        ("gdot/|d|", "efc_vel"): gdot / size,
        ("stiffness, damping", "efc_KBIP"): spring,
        ("-(damping gdot + stiffness g)/|d|", "efc_aref"): -hold.damping * gdot / size
        - hold.stiffness * stretch,
        ("softness diag A/|d|^2", "efc_R"): soft / size**2,
        ("(A + softness diag A)/|d||d|", "efc_AR"): (a + np.diag(soft)) / np.outer(size, size),
        ("lambda |d|", "efc_force"): -c.tensions(system, q, v, hold),
        ("acceleration", "qacc"): c.make_force(system, hold)(q, v) / system["m"],
    }


def names(quick):
    """(a) Our names and MuJoCo's, a value of the first state, the largest gap over all states."""
    rng, rows, states, dropped = np.random.default_rng(0), {}, 20 if quick else 100, 0.0
    for state in range(states):
        system = peers.random_chain(rng, 1 + (state + 1) % 4)  # the first is a double pendulum
        found = ours_named(system, DT)
        theirs = peers.named(system, DT, {field: x.shape for (_, field), x in found.items()})
        for (name, field), x in found.items():
            values = {"ours is": float(x.flat[-1]), "its": float(theirs[field].flat[-1])}
            row = {"ours": name, "MuJoCo's": field, **values, "largest gap": 0.0}
            gap = float(np.abs(x - theirs[field]).max() / np.abs(x).max())
            row = rows.setdefault(field, row)
            row["largest gap"] = max(row["largest gap"], gap)
        whole, a = c.hold_table(DT)["soft"]._replace(use_jdotv=1.0), found["acceleration", "qacc"]
        moved = c.make_force(system, whole)(system["q0"], system["v0"]) / system["m"] - a
        dropped = max(dropped, float(np.abs(moved).max() / np.abs(a).max()))
    worst = max(rows[field]["largest gap"] for field in ("efc_force", "qacc"))
    say(f"Neither asks for Jdot v: with it, accelerations would differ by up to {dropped:.0%}.")
    title = f"(a) soft and MuJoCo {version('mujoco')}, tendons; gaps over {states} random chains"
    return title, list(rows.values()), [("acceleration and force, largest gap", worst, 1e-12)]


# --- (b), (c) time to an error ---
def double():
    """The Task (b): the double pendulum of seed 0, 5 s; the farthest that a particle is off."""
    truth = json.loads(Path(__file__).with_name("reference.json").read_text(encoding="utf-8"))
    q = np.array(truth["cases"]["double"]["positions"])

    def error(found):
        return np.max(np.linalg.norm(found - q, axis=-1))

    return peers.Task(c.build_system("double"), len(q), truth["times"][0], error)


def to_an_error(repeats, quick):
    """(b) The double pendulum, raced to four errors."""
    task, tols = double(), (1e-5, 1e-7, 1e-10, 1e-13)
    steps = partial(steps_ladder, task)
    ladders = ours(task, (range(4, 13), tols, (2, 3)), ((6, 8, 10, 12), (1, 17)))
    rk4 = [steps(run_ours, 5, 600, mode, "rk4", text=f"{mode} ") for mode in ("none", "project")]
    ladders["ours, rk4"] = rk4[0] | rk4[1]
    rough = in_python(ladders)
    if NATIVE:
        ladders["ours, Python"] = {
            f"{who.split()[1]} {setting}": job
            for who, ladder in rough.items()
            for setting, job in ladder.items()
        }
    ladders[HINGES] = steps(peers.run_hinges, 4, 1500)
    for name, job, last in ((TAYLOR, peers.run_heyoka, 16.0), ("scipy", peers.run_scipy, 13.5)):
        if has(name):
            powers = np.arange(1.0, last, 0.25)
            ladders[name] = {f"tol {10**-p:.1e}": partial(job, task, 10.0**-p) for p in powers}
    if has("exudyn"):
        for tol in (1e-6, 1e-8):
            ladders[f"Exudyn, {tol:g}"] = steps(peers.run_exudyn, 10, 4000, tol)
    targets = {}
    for error, limits in LIMITS.items():
        beside = {HINGES: (limits[not NATIVE], None)} | ({TAYLOR: (1.2, 0.5)} if NATIVE else {})
        targets[f"{error:.0e} m"] = error, beside
    title = "(b) the double pendulum, 5 s, time to an error"
    return race(title, task, ladders, targets, 0.1 if quick else 0.5, repeats, rough)


def games(repeats):
    """(d) The same with rules of order 1, made for games: impulses, ours and Chipmunk's."""
    task = double()
    ladders = {"ours, impulse": steps_ladder(task, run_ours, 5, 60, "impulse", "semi_implicit")}
    if has("pymunk"):
        ladders["pymunk"] = steps_ladder(task, peers.run_pymunk, 20, 400)
    title = "(d) the double pendulum, 5 s, by impulses"
    return race(title, task, ladders, {"1e-01 m": (1e-1, {})}, 0.5, repeats)


def swing(times):
    """Positions (T, 1, 2) of the unit pendulum released level, and how well they are known, in m.

    sin(phi / 2) = k cd(sqrt(g) t, k), k = sin(phi_0 / 2), phi from straight down (DLMF 22.19(i)).
    Doubt: half a period later it is the mirror image.
    """
    from scipy.special import ellipj, ellipk

    u = np.sqrt(_runs.G) * np.array(times)
    _, cn, dn, _ = ellipj([u, u + 2.0 * ellipk(0.5)], 0.5)
    s = np.sqrt(0.5) * cn / dn
    q = np.stack([2.0 * s * np.sqrt(1.0 - s * s), 2.0 * s * s - 1.0], axis=-1)
    return q[0, :, None], float(np.abs(q[0] - q[1] * [-1.0, 1.0]).max())


def level():
    """The pendulum that swing() describes."""
    return make_system([[1.0, 0.0, 0.0]], np.zeros((1, 3)), 1.0, [(0, -1)])


def a01(repeats):
    """(c) M. Gonzalez et al., Multibody Syst. Dyn. 16 (2006) 179, A01_specification.xml."""
    times = 0.5 * np.arange(1, 4001)
    q, doubt = swing(times.tolist())

    def error(found):
        return np.sqrt(np.mean((np.abs(found - q) / np.maximum(np.abs(q), 1e-3)) ** 2))

    task = peers.Task(level(), len(times), 0.5, error)
    gauss = (8, 10), (1e-9, 1e-10, 1e-11), (2, 3)
    ladders = ours(task, gauss, ((8, 10, 12), (3, 9)))
    ladders[HINGES] = steps_ladder(task, peers.run_hinges, 25, 120)
    title = f"(c) A01, the simple pendulum for 2000 s; the truth is known to {doubt:.0e} m"
    targets = {"low": (1e-1, {HINGES: (1.0, None)}), "high": (1e-3, {HINGES: (0.4, None)})}
    return race(title, task, ladders, targets, 60.0, repeats)


def main(argv=None):
    """Measure, print, maybe write JSON."""
    parser = _runs.study_parser("real_thing", __doc__, 9)
    parser.add_argument("--quick", action="store_true", help="less of (a) and (b), no A01")
    parser.add_argument("--names", action="store_true", help="(a) alone; without it, the others")
    args = parser.parse_args(argv)
    if not has("mujoco"):
        parser.error("MuJoCo is not installed; pip install -e '.[compare]'")
    there = {name: version(name) for name in ENGINES if has(name)}
    what = _runs.host(repeats=args.repeats, **there)
    for name in ENGINES.keys() - there.keys():
        say(f"{name} is not installed, its rows are left out: pip install -e '.[{ENGINES[name]}]'")
    if hasattr(os, "getloadavg") and os.getloadavg()[0] > 0.5 * os.cpu_count():
        say("this machine is busy; the bars need an idle one")
    if args.names:
        return _runs.finish(args, what | {"answers": [show(*names(args.quick))]})
    answers = [show(*to_an_error(args.repeats, args.quick))]
    if "scipy" in there and not args.quick:
        answers.append(show(*a01(args.repeats)))
    answers.append(show(*games(args.repeats)))
    return _runs.finish(args, what | {"answers": answers})


if __name__ == "__main__":
    run_script(main)
