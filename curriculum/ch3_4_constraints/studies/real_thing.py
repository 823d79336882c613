"""Read the real thing: what MuJoCo calls our quantities, and what its speed is worth at the same
error.

(a) The same quantity, two names: `soft` is MuJoCo's tendon equality, digit by digit.  (b) Time to a
given error: the double pendulum, 5 s, beside reference.json.  (c) A published task with published
tolerances: the simple pendulum A01. (d) How a step grows with a chain.  (e) Beside the engine that
readers play with. Whatever is compared is timed in turns, A B A B, and by its least time, to which
a busy machine can only add; medians and quartiles show how busy it was. Only ratios carry over to
another machine. `ms` and the bars are of the steps. `in all` is what a user waits for: ours traces
and compiles its step, once a run, and measures every state; engines build their model. Last comes
the setting: dt; of gauss also stages/window/tol, of midpoint its order. MuJoCo's rule is RK4, but
for its rods as shipped, soft and under Euler; `hard` ones are as hard as RK4 bears. Exudyn's is the
trapezoidal rule, its number the tolerance of Newton's iteration. Two explicit rules that are not
the chapter's race with its own, unrolled like these: the extrapolated midpoint rule, and the twelve
stages of DOP853.
"""

import json
import os
import sys
from argparse import RawDescriptionHelpFormatter
from decimal import Decimal, localcontext
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies._race import (
    extrapolated_midpoint,
    race,
    run_ours,
    steps_ladder,
)
from curriculum.ch3_4_constraints.studies._runs import make_system, run
from curriculum.ch3_4_constraints.tables import in_turns, say, show, spread
from curriculum.common.banner import processor
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.files import write_json
from curriculum.common.gauss import make_gauss

import numpy as np

ENGINES = ("mujoco", "exudyn", "scipy", "pymunk")
DT = 0.005  # s, of (a), (d) and (e)


def has(name):
    return find_spec(name) is not None


# --- (a) the same quantity, two names ---
def ours_named(system, dt):
    """{our name: value} for what MuJoCo has a field for. Its row of J is ours / |d|, so lambda is
    ours |d|: newtons."""
    q, v, m, hold = system["q0"], system["v0"], system["m"], c.hold_table(dt)["soft"]
    jac, _, gdot, _ = c.constraint_terms(system, q, v)
    stretch, a = c.rod_errors(system, q), c.mobility(system, jac, jac)
    size, spring = stretch + system["lengths"], [hold.stiffness, hold.damping]
    return {
        ("row of J over |d|", "efc_J"): jac / size[:, None],
        ("|d| - L", "efc_pos"): stretch,
        ("gdot / |d|", "efc_vel"): gdot / size,
        ("stiffness, damping", "efc_KBIP"): np.tile(spring, (len(size), 1)),
        ("-(damping gdot + stiffness g)/|d|", "efc_aref"): -hold.damping * gdot / size
        - hold.stiffness * stretch,
        ("softness diag A / |d|^2", "efc_R"): hold.softness * np.diag(a) / size**2,
        ("(A + softness diag A) / |d||d|", "efc_AR"): (a + hold.softness * np.diag(np.diag(a)))
        / np.outer(size, size),
        ("lambda |d|", "efc_force"): -c.tensions(system, q, v, hold),
        ("acceleration", "qacc"): c.make_force(system, hold)(q, v) / m,
    }


WHERE = dict.fromkeys(("efc_J", "efc_pos", "efc_KBIP", "efc_R"), "mj_makeConstraint")
WHERE |= {"efc_vel": "mj_referenceConstraint", "efc_aref": "mj_referenceConstraint"}
WHERE |= {
    "efc_AR": "mj_projectConstraint",
    "efc_force": "mj_fwdConstraint",
    "qacc": "mj_fwdConstraint",
}


def names(repeats, quick):
    """(a) Our names and MuJoCo's, a value of the first state, and the largest difference over all
    states."""
    rng, rows, states, dropped = np.random.default_rng(0), {}, 20 if quick else 100, 0.0
    for state in range(states):
        system = peers.random_chain(rng, 1 + (state + 1) % 4)  # the first is a double pendulum
        ours = ours_named(system, DT)
        theirs = peers.named(system, DT, {field: value.shape for (_, field), value in ours.items()})
        for (name, field), value in ours.items():
            row = {
                "ours": name,
                "MuJoCo's": field,
                "set by": WHERE[field],
                "ours is": float(value.flat[-1]),
            }
            row = rows.setdefault(
                field, row | {"its": float(theirs[field].flat[-1]), "largest gap": 0.0}
            )
            gap = float(np.abs(value - theirs[field]).max() / np.abs(value).max())
            row["largest gap"] = max(row["largest gap"], gap)
        whole, a = c.hold_table(DT)["soft"]._replace(use_jdotv=1.0), ours["acceleration", "qacc"]
        moved = c.make_force(system, whole)(system["q0"], system["v0"]) / system["m"] - a
        dropped = max(dropped, float(np.abs(moved).max() / np.abs(a).max()))
    worst = max(rows[field]["largest gap"] for field in ("efc_force", "qacc"))
    print(
        f"\nneither soft nor MuJoCo asks for Jdot v: with it, accelerations would differ by up to {dropped:.0%}"
    )
    title = f"(a) the same quantity, two names: soft and MuJoCo {version('mujoco')}; gaps over {states} random chains"
    return title, list(rows.values()), [("acceleration and rod force, largest gap", worst, 1e-12)]


# --- (b), (c) time to an error ---
def ours(task, gauss, midpoint):
    """Ladders of ours; `gauss`: (steps a sample, stages, window, tol) each, `midpoint`: (order,
    steps a sample)."""
    ladders, text = {"ours, gauss": {}, "ours, midpoint": {}}, "dt {:.3g}, {}/{}/{:g}"
    for per, *rule in gauss:
        setting = text.format(task.every / per, *rule)
        ladders["ours, gauss"][setting] = partial(run_ours, task, per, "none", make_gauss(*rule))
    for order, per in midpoint:
        setting = f"order {order}, dt {task.every / per:.3g}"
        job = partial(run_ours, task, per, "none", extrapolated_midpoint(order))
        ladders["ours, midpoint"][setting] = job
    return ladders


def double():
    """The Task (b): the double pendulum of seed 0, 5 s; error: the farthest that a particle is off
    at 20 times."""
    truth = json.loads(Path(__file__).with_name("reference.json").read_text(encoding="utf-8"))
    q = np.array(truth["cases"]["double"]["positions"])

    def error(found):
        return np.max(np.linalg.norm(found - q, axis=-1))

    return peers.Task(c.build_system("double"), len(q), truth["times"][0], error)


def to_an_error(repeats, quick):
    """(b) The double pendulum, raced to four errors."""
    task = double()
    steps, tols = partial(steps_ladder, task), (1e-5, 1e-6, 1e-7, 1e-10, 1e-13)
    ladders = ours(
        task,
        product((2, 3), (6, 7, 8, 9, 10, 12), (3, 4, 5), tols),
        product((6, 8, 10), range(2, 17)),
    )
    ladders |= {
        f"ours, rk4 {mode}": steps("", run_ours, 5, 600, mode, "rk4")
        for mode in ("none", "project")
    }
    ladders |= {"MuJoCo hinges": steps("", peers.run_hinges, 4, 1500)}
    shipped = steps("", peers.run_tendons, 10, 500, "Euler", 0.95, lambda dt: max(0.02, 2.0 * dt))
    # the hardest that RK4 bears: 0.6 steps; MuJoCo's own limit is two, it clips the impedance at
    # 0.9999
    hardened = steps("", peers.run_tendons, 20, 3000, "RK4", 0.9999, lambda dt: 0.6 * dt)
    ladders |= {"MuJoCo rods": shipped, "MuJoCo rods, hard": hardened}
    if has("scipy"):
        ladders["ours, DOP853's stages"] = steps("", run_ours, 2, 40, "none", peers.dop853())
    if has("exudyn"):
        for tol in (1e-4, 1e-6, 1e-8):  # of its Newton iteration
            ladders[f"Exudyn rods, {tol:g}"] = steps("", peers.run_exudyn, 10, 4000, tol)
    targets = {
        "1e-03 m": (1e-3, 2.0),
        "1e-06 m": (1e-6, 1.0),
        "1e-09 m": (1e-9, 0.22),
        "1e-12 m": (1e-12, 0.05),
    }
    return race(
        "(b) the double pendulum, 5 s, time to an error",
        task,
        ladders,
        targets,
        0.2 if quick else 0.5,
        repeats,
    )


def swing(times):
    """Positions (T, 1, 2) of the unit pendulum released level, and how well they are known, in m.

    sin(phi / 2) = k cd(sqrt(g) t, k), k = sin(phi_0 / 2), phi from straight down (DLMF 22.19(i));
    decimals take off whole periods, 2000 s would cost a double three digits. Doubt: scipy's value
    half a period later is minus this one.
    """
    from scipy.special import ellipj

    with localcontext() as context:
        context.prec = 40
        a, b = Decimal(1), Decimal("0.5").sqrt()
        while a - b > Decimal("1e-36"):
            a, b = (a + b) / 2, (a * b).sqrt()
        half = Decimal("3.141592653589793238462643383279502884197") / a  # 2 K(k) by Gauss's mean
        pace = Decimal(-c.GRAVITY[1].item()).sqrt()
        u = np.array(
            [
                [float(pace * Decimal(t) % (2 * half) + late * half) for t in times]
                for late in (0, 1)
            ]
        )
    _, cn, dn, _ = ellipj(u, 0.5)
    s = np.sqrt(0.5) * cn / dn
    q = np.stack([2.0 * s * np.sqrt(1.0 - s * s), 2.0 * s * s - 1.0], axis=-1)
    return q[0, :, None], float(np.abs(q[0] - q[1] * [-1.0, 1.0]).max())


def level():
    """The pendulum that swing() describes."""
    return make_system([[1.0, 0.0, 0.0]], np.zeros((1, 3)), 1.0, [(0, -1)])


def a01(repeats, quick):
    """(c) M. Gonzalez et al., Multibody Syst. Dyn. 16 (2006) 179, A01_specification.xml: outputs,
    threshold, errors."""
    times = 0.5 * np.arange(1, 4001)
    q, doubt = swing(times.tolist())

    def error(found):
        return np.sqrt(np.mean((np.abs(found - q) / np.maximum(np.abs(q), 1e-3)) ** 2))

    task = peers.Task(level(), len(times), 0.5, error)
    ladders = ours(
        task,
        product((2, 3), (8, 10), (4,), (1e-9, 1e-10, 1e-11)),
        product((8, 10, 12), range(3, 9)),
    )
    ladders |= {"MuJoCo hinges": steps_ladder(task, "", peers.run_hinges, 25, 120)}
    title = f"(c) A01, the simple pendulum for 2000 s; the truth is known to {doubt:.0e} m"
    return race(title, task, ladders, {"low": (1e-1, 1.0), "high": (1e-3, 0.4)}, 60.0, repeats)


# --- (d), (e) a step ---
def per_step(system, mode, steps):
    """Microseconds a step of ours, and the worst rod error in m."""
    found = run(system, "semi_implicit", mode, DT, steps)
    return found.pace, float(found.violations.max())


def scale(repeats, quick):
    """(d) A step of a chain."""
    rows, bars = [], []
    for n in (10, 100, 1000):
        system, steps = c.build_system("chain", links=n), max(10, 20_000 // n)
        jobs = {
            f"ours, {mode}": partial(per_step, system, mode, steps) for mode in ("none", "impulse")
        }
        jobs |= {
            f"MuJoCo rods, {axes} axes": partial(peers.pace_tendons, system, DT, axes, steps)
            for axes in (3, 2)
        }
        found = {who: np.array(samples) for who, samples in in_turns(jobs, repeats).items()}
        share = {
            who: float(found["ours, none"][:, 0].min() / samples[:, 0].min())
            for who, samples in found.items()
        }
        for who, samples in found.items():
            row = {
                "links": n,
                "who": who,
                **spread(samples[:, 0], "us"),
                "rod error m": float(samples[-1, 1]),
            }
            rows.append(row | {"ours, none/this": share[who]})
    bars = [
        (
            "1000 links: time of ours as a share of MuJoCo's, 3 axes",
            share["MuJoCo rods, 3 axes"],
            1.0 / 1.5,
        )
    ]
    return (
        "(d) a step of a chain; 3 axes is our model, 2 axes what a planar chain needs",
        rows,
        bars,
    )


def toy(repeats, quick):
    """(e) The double pendulum at a step for games: rods and speed of a velocity-level engine,
    Chipmunk by pymunk."""
    task, rows = double(), []
    per = round(task.every / DT)
    every_step = task._replace(samples=per * task.samples, every=DT)
    jobs = {"ours, impulse": partial(run_ours, mode="impulse", rule="semi_implicit")}
    if has("pymunk"):
        jobs["pymunk, as shipped"] = peers.run_pymunk
    clocks = in_turns({who: partial(job, task, per) for who, job in jobs.items()}, repeats)
    for who, job in jobs.items():
        q = job(every_step, 1)[1]
        rods = c.constraint_violation(task.system, np.pad(q, [(0, 0), (0, 0), (0, 1)])).max()
        us = [1e6 * seconds / every_step.samples for seconds, _ in clocks[who]]
        row = {
            "who": who,
            "error m": float(task.error(q[per - 1 :: per])),
            "rod error m": float(rods),
        }
        rows.append(row | spread(us, "us"))
    return (
        f"(e) the double pendulum, 5 s, steps of {DT:g} s, velocities as impulses leave them",
        rows,
        (),
    )


def main(argv=None) -> int:
    """Measure, print, maybe write JSON."""
    parser = Parser(
        prog="real_thing", description=__doc__, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="less of (a) and (b), no A01")
    parser.add_argument(
        "--repeats", type=number(int, 1, 1000), default=9, help="of each timing (9)"
    )
    parser.add_argument("--json", type=writable, metavar="PATH", help="write the same as JSON")
    args = parser.parse_args(argv)
    if not has("mujoco"):
        parser.error("MuJoCo is not installed; pip install -e '.[compare]'")
    host = {
        "processor": processor(),
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "repeats": args.repeats,
    }
    host |= {name: version(name) for name in ENGINES if has(name)}
    say(
        ", ".join(f"{key} {value}" for key, value in host.items())
        + "; medians, q1 and q3 the quartiles"
    )
    if hasattr(os, "getloadavg") and os.getloadavg()[0] > 0.5 * os.cpu_count():
        say(
            "this machine is busy: a run of a millisecond slips through, a longer one waits; the bars need an idle one"
        )
    for name in ENGINES:
        if not has(name):
            print(
                f"{name} is not installed, its rows{' and A01' if name == 'scipy' else ''} are left out"
            )
    asked = [names, to_an_error, *([a01] if has("scipy") and not args.quick else []), scale, toy]
    answers = [show(*ask(args.repeats, args.quick)) for ask in asked]
    if args.json:
        write_json(args.json, host | {"answers": answers})
    return 0


if __name__ == "__main__":
    run_script(main)
