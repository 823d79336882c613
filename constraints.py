"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

Gravity pulls the bob down, and the rod will not let it go down. Which force does the rod apply?
Nobody wrote it down: it is the solution of a linear system, found anew at every step. This file
derives that system, hides its solution inside `force(q, v)`, hands it to the integrators of
chapter 3.3, which never learn of it, and measures what becomes of the rods. The lines you read are
the lines that run, taken once on symbols and compiled (--show-step). Change one, and see.
"""

# --- region: setup ---
import math
from collections import namedtuple
from pathlib import Path

from curriculum.ch3_4_constraints import large  # many rods: these formulas again, not these lines
from curriculum.ch3_4_constraints.recording import frames, pulls, record
from curriculum.ch3_4_constraints.scene_files import direction, in_line, load_scene
from curriculum.common.banner import banner
from curriculum.common.cli import chapter_parser, number, run_script
from curriculum.common.files import publish
from curriculum.common.graph import elimination_order, has_loop
from curriculum.common.loops import repeat
from curriculum.common.motion import Motion, followed, source
from curriculum.common.ruler import make_gauss, settle

import numpy as np

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2: y is up
PIVOT = np.zeros(3)  # m: the anchor of a system that names none
INSTANT = 5e-4  # s: what is over in such a time no step of the chapter can follow
HERE = Path(__file__).resolve().parent
CHAPTER, OUT = "curriculum/ch3_4_constraints", "outputs/ch3.4-constraints"
SMOKE_STEPS = 800  # four seconds: enough to tell the modes apart
EXAMPLES = "--system jansen_leg --integrator rk4", "--dt 0.05", "--integrator gauss --tol 1e-9"
# --- endregion ---
# --- region: systems ---
# A system is particles and rods, and nothing derived from them: a dict of
#     q0, v0   (N, 3)  where the particles start, in m, and how fast, in m/s
#     m        (N, 1)  their masses, in kg
#     pairs            (i, j) a rod: it ties particle i to particle j or, where j is negative,
#                      to an anchor, which stands still: -1 is the first, -2 the second
#     lengths  (C,)    of the rods, in m
#     anchors  (K, 3)  in m; without this key there is one, PIVOT
SYSTEMS = {"pendulum": 1, "double": 2, "triple": 3}  # the chapter's scenes, and how many rods


def build_system(name, rng=0, links=10):
    """The system called `name`: one of SYSTEMS, "chain" with `links` rods, a scene or its file.

    The named ones, unit rods and masses, start at rest, stretched out sideways and tilted by the
    only random number of this program, from `rng`, a Generator or a seed. Raises SceneError.
    """
    if name not in SYSTEMS and name != "chain":
        return load_scene(name, HERE / CHAPTER / "scenes")
    count = SYSTEMS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)
    q0 = PIVOT + np.arange(1.0, count + 1.0)[:, None] * direction(-tilt)
    pairs = [(k, k - 1) for k in range(count)]  # rod 0 hangs on anchor -1, rod k on particle k - 1
    rest = {"m": np.ones((count, 1)), "pairs": pairs, "lengths": np.ones(count)}
    return {"q0": q0, "v0": np.zeros_like(q0), **rest}


def external_force(system, q, v=None):
    """f (N, 3) in N: every force but the rods'. Add drag, wind, a motor: the rods answer to it."""
    return system["m"] * GRAVITY


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i. The rod is right when
#     g = (d . d - L^2) / 2 = 0
# That is its constraint. Follow g in time. With d' = v_i - v_j, its two derivatives are
#     gdot  = d . d'               = J v
#     gddot = d . d'' + d' . d'    = J a + Jdot v
# v and a list all particles, 3N numbers; J has a row a rod: d in the columns of particle i, -d in
# those of j. A rod acts along itself, oppositely on its ends: J^T lambda, one number lambda a rod,
# in N/m, below zero if it pulls. Put M a = f + J^T lambda (M: the masses) into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
def dot(a, b):
    """a . b (...,) of vectors (..., 3)."""
    return np.sum(a * b, axis=-1)


def constraint_terms(system, q, v):
    """J (..., C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (..., C) each."""
    shape = (*q.shape[:-2], len(system["pairs"]))
    jac = np.zeros((*shape, *q.shape[-2:]), np.result_type(q, 1.0))  # of floats, or of symbols
    g, gdot, jdotv = (np.zeros(shape, jac.dtype) for _ in range(3))
    for k, (i, j) in enumerate(system["pairs"]):
        d, rate = q[..., i, :], v[..., i, :]
        if j >= 0:
            d, rate = d - q[..., j, :], rate - v[..., j, :]
            jac[..., k, j, :] = -d
        else:
            d = d - system.get("anchors", [PIVOT])[-1 - j]
        jac[..., k, i, :] = d
        g[..., k] = 0.5 * (dot(d, d) - system["lengths"][k] * system["lengths"][k])
        gdot[..., k] = dot(d, rate)
        jdotv[..., k] = dot(rate, rate)
    return jac.reshape(*shape, -1), g, gdot, jdotv


def mobility(system, jac, along):
    """A = J M^-1 J^T (..., C, C): how each rod's gddot answers to each lambda; J^T from `along`."""
    rows, columns = (x.reshape(*x.shape[:-1], -1, 3) for x in (jac, along))  # (..., C, N, 3)
    products = dot(rows[..., :, None, :, :], columns[..., None, :, :, :])
    return np.sum(products / system["m"][:, 0], axis=-1)


def solve(system, a, b, blur=0.0):
    """lambda (..., C) with a lambda = b: Gauss's elimination, rods with few neighbours first.

    Only rods that share a particle feel each other: along a chain this is a sweep out and one back,
    O(N), as R. Featherstone's articulated bodies (1983). In a loop a rod may be too many, or J lose
    rank in passing. There `blur` (..., C, C) is added to a, and rounds take it back, each solving
    for what is left of b, as long as they at least halve it (J. Carpentier, R. Budhiraja, N.
    Mansard, RSS 2021). Loads along eigenvalues of `a` above those of the blur are met to rounding,
    those along eigenvalues far below it are left: `unheld` tells how much that is.
    """
    order = elimination_order(tuple(system["pairs"]))  # [(k, the rods still left that feel k)]
    loop = has_loop(tuple(system["pairs"]))
    rods = np.arange(a.shape[-1])
    own = a[..., rods, rods]
    spread = a + blur + 1e-12 * a * np.eye(len(rods)) if loop else a
    rows = np.moveaxis(spread, (-2, -1), (0, 1)).astype(np.result_type(a, 1.0))  # a copy, of floats
    for k, rest in order:
        for i in rest:
            rows[i, k] = rows[i, k] / rows[k, k]  # less so much of row k, row i is free of lam[k]
            for j in rest:
                rows[i, j] = rows[i, j] - rows[i, k] * rows[k, j]

    def sweep(b):
        lam = np.moveaxis(b, -1, 0).astype(rows.dtype)  # a copy
        for k, rest in order:
            for i in rest:
                lam[i] = lam[i] - rows[i, k] * lam[k]
        for k, rest in reversed(order):
            for j in rest:
                lam[k] = lam[k] - rows[k, j] * lam[j]
            lam[k] = lam[k] / rows[k, k]
        return np.moveaxis(lam, 0, -1)

    if not loop:
        return sweep(b)

    def another(x):  # lambda, and behind it the square of what was left before the last round
        lam, before = x[..., :-1], x[..., -1]
        rest = b - dot(a, lam[..., None, :])
        left = dot(rest, rest / own)
        following = np.concatenate([lam + sweep(rest), np.stack([left], axis=-1)], axis=-1)
        return following, before / (4.0 * left + 1e-200)

    start = np.concatenate([sweep(b), np.stack([dot(b, b / own)], axis=-1)], axis=-1)
    return repeat(another, start, 100, "no finite tensions")[..., :-1]


# gddot = 0 keeps a right rod right and a wrong one wrong: each step of an integrator leaves an
# error in g, and nothing takes it back. So ask for more, that g behave like a damped spring:
#     gddot = -2 w gdot - w^2 g
# e^(st) solves that if (s + w)^2 = 0, so errors die like e^(-wt), and do not swing. Two terms more
# on the right-hand side. Most remedies are of this kind, four numbers, with A = J M^-1 J^T:
#     (A + softness diag A) lambda = -(J M^-1 f + use_jdotv Jdot v) - damping gdot - stiffness g
# A Hold is these four, in 1, 1/s, 1/s^2 and 1; `dt`, if they are for steps of so many seconds only;
# and `after`, (system, q_start, q, v, dt) -> (q, v), if finished steps are mended.
Hold = namedtuple("Hold", "use_jdotv damping stiffness softness dt after")


def hold_table(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The modes by name: `baumgarte` in rad/s, MuJoCo's `time_constant` in s and `impedance`."""
    spring = impedance * max(time_constant, 2.0 * dt)  # MuJoCo's 2 steps at least
    soft = 2.0 / spring, impedance / spring**2, (1.0 - impedance) / impedance
    return {
        # gddot = 0. Fails by slow rot: what has drifted stays, and every step adds to it.
        "none": Hold(1.0, 0.0, 0.0, 0.0, None, None),
        # gddot = -2 w gdot - w^2 g (J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1).
        # Fails when dt w passes STABILITY_LIMIT.
        "baumgarte": Hold(1.0, 2.0 * baumgarte, baumgarte**2, 0.0, None, None),
        # If q_next = q + dt v_next, g_next is near g + dt J v_next: ask J v_next = -g/dt. If, too,
        # v_next = v + dt a, J a = -gdot/dt - g/dt^2 (E. Catto, GDC 2005). Fails under other rules.
        "impulse": Hold(0.0, 1.0 / dt, 1.0 / dt**2, 0.0, dt, None),
        # A rod that gives: lambda falls short. Alone, gddot = (1 - p) J M^-1 f - 2 gdot/T - g/T^2:
        # p its impedance, T its time constant. As in MuJoCo, g is |d| (|d| - L), and Jdot v is left
        # out. Fails by design: a rod under load is longer.
        "soft": Hold(0.0, *soft, dt, None),
        # gddot = 0, and steps end with Newton's way back onto the rods. Fails if it is too long.
        "project": Hold(1.0, 0.0, 0.0, 0.0, None, project),
    }


def as_hold(hold):
    """A row of the table is itself; a number is Baumgarte's frequency, 0.0 the naive solve."""
    return hold if isinstance(hold, Hold) else hold_table(baumgarte=hold)["baumgarte"]


def blurred(system, a, g, turn):
    """What (..., C, C) `a` cannot be sure of: less than that of an eigenvalue means nothing.

    `turn` is by how much J changes in an INSTANT; a pose without rank that is passed in that time
    is none to resolve. And where rods are off by a share of their length, so are directions.
    """
    if not has_loop(tuple(system["pairs"])):
        return 0.0
    off = np.sum(np.square(g / np.square(system["lengths"])), axis=-1)
    share = np.stack([np.stack([off], axis=-1)], axis=-1)
    return mobility(system, turn, turn) + share * a * np.eye(len(system["pairs"]))


def multipliers(system, q, v, hold=0.0, f=None):
    """J (..., C, 3N) and lambda (..., C) in N/m at q, v (..., N, 3); f: the rest, if known."""
    hold = as_hold(hold)
    f = external_force(system, q, v) if f is None else f
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    if hold.softness:
        length = np.sqrt(2.0 * g + np.square(system["lengths"]))
        g = length * (length - system["lengths"])
    free = np.broadcast_to(f / system["m"], q.shape).reshape(*q.shape[:-2], 1, -1)  # M^-1 f
    b = -(dot(jac, free) + hold.use_jdotv * jdotv) - hold.damping * gdot - hold.stiffness * g
    a = mobility(system, jac, jac) * (1.0 + hold.softness * np.eye(len(system["pairs"])))
    turn = constraint_terms(system, q + INSTANT * v, v)[0] - jac
    return jac, solve(system, a, b, blurred(system, a, g, turn))


def pull(jac, lam):
    """J^T lambda (..., N, 3): what the particles feel when the rods carry lambda."""
    return np.sum(jac * lam[..., None], axis=-2).reshape(*jac.shape[:-2], -1, 3)


def constraint_force(system, q, v, hold=0.0, f=None):
    """The force of the rods (..., N, 3) in N: `hold` is a Hold, or Baumgarte's w in rad/s."""
    return pull(*multipliers(system, q, v, hold, f))


def tensions(system, q, v, hold):
    """Newtons (..., C) with which the rods pull, -lambda |d|; below zero they push."""
    if large.takes(system):
        return large.tensions(system, q, v, as_hold(hold), external_force(system, q, v))
    _, lam = multipliers(system, q, v, hold)
    return -lam * (rod_errors(system, q) + system["lengths"])


def unheld(system, q, v, hold):
    """The largest acceleration (...) along a rod, in m/s^2, that its force leaves unanswered."""
    hold = as_hold(hold)
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    a = make_force(system, hold)(q, v) / system["m"]
    gddot = dot(jac, a.reshape(*a.shape[:-2], 1, -1)) + hold.use_jdotv * jdotv
    asked = -hold.damping * gdot - hold.stiffness * g
    return np.max(np.abs(gddot - asked) / system["lengths"], axis=-1)


def make_force(system, hold):
    """The seam of the chapter: force(q, v) -> (..., N, 3) in N, rods and all, for an integrator."""
    hold = as_hold(hold)
    if large.takes(system):
        return large.make_force(system, hold, external_force)

    def force(q, v):
        f = external_force(system, q, v)
        return f + constraint_force(system, q, v, hold, f)

    force.dt = hold.dt
    return force


def project(system, q_start, q, v, dt):
    """A step from q_start that ended at q, v (..., N, 3), a little off, put back: g = 0, J v = 0.

    Rods correct as they pull, q = q - M^-1 J(q_start)^T mu, and v is told: SHAKE (J.-P. Ryckaert et
    al., J. Comput. Phys. 23 (1977) 327). Then v loses its part along the rods, as in RATTLE (H.
    Andersen, ibid. 52 (1983) 24). RK4 keeps order 4, semi-implicit Euler 1; this one is symplectic,
    and blows up along J(q), or if v is not told. FloatingPointError where Newton's method fails.
    """
    if large.takes(system):
        return large.project(system, q_start, q, v, dt)
    along = constraint_terms(system, q_start, v)[0]
    far = np.mean(np.sum(np.abs(q_start), axis=-1), axis=-1, keepdims=True)  # (..., 1)
    near = 1e-12 * np.square(system["lengths"]) + 1e-15 * far * system["lengths"]  # as g is rounded

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        a = mobility(system, jac, along)
        mu = solve(system, a, g, blurred(system, a, g, 0.0 * jac))
        return q - pull(along, mu) / system["m"], dot(g / near, g / near)

    end = repeat(newton, q, 20, "no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    lam = solve(system, mobility(system, jac, jac), gdot)
    return end, v - pull(jac, lam) / system["m"]


# --- endregion ---
# --- region: integrators ---
# The rules of chapter 3.3, (q, v, m, force, dt) -> (q, v), without a word about rods. That force()
# solves a linear system they need not know; how fast their own error becomes drift, they decide.
def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one force a step. Pumps energy into all that swings: the warning."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit (symplectic) Euler: order 1, one force, v before q; as game engines do."""
    v = v + dt * (force(q, v) / m)
    return q + dt * v, v


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4; energy wanders."""
    half = 0.5 * dt
    a1 = force(q, v) / m
    v2 = v + half * a1
    a2 = force(q + half * v, v2) / m
    v3 = v + half * a2
    a3 = force(q + half * v2, v3) / m
    v4 = v + dt * a3
    a4 = force(q + dt * v3, v4) / m
    q = q + (dt / 6.0) * (v + 2.0 * (v2 + v3) + v4)
    return q, v + (dt / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)


# The fourth is the ruler for the others: Gauss-Legendre collocation, order 16, symplectic, exact to
# rounding at 0.05 s here. It is implicit: it iterates its stages by calls of the same force.
INTEGRATORS = {"euler": euler_step, "semi_implicit": semi_implicit_step, "rk4": rk4_step}
INTEGRATORS["gauss"] = make_gauss()
FOR_IMPULSE = ["semi_implicit"]  # v_next = v + dt a and q_next = q + dt v_next, as it presumes

# Baumgarte's spring x'' = -2 w x' - w^2 x is stable up to this z = dt w. Euler: |1 - z| <= 1.
# Semi-implicit: 1 + trace + det = 4 - 4z - z^2 >= 0. RK4: 1 - z + z^2/2 - z^3/6 + z^4/24 <= 1.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (math.sqrt(2.0) - 1.0), "rk4": 2.785294}


# --- endregion ---
# --- region: simulate ---
# An honest run says at every step how far the worst rod is off, and how far the energy.
def energy(system, q, v):
    """Kinetic and potential energy (...,) in J of states q, v (..., N, 3); U = -sum m g . q."""
    m = system["m"][:, 0]
    return np.sum(0.5 * m * dot(v, v) - m * dot(q, GRAVITY), axis=-1)


def rod_errors(system, q):
    """|d| - L (..., C) in m, what a ruler would show, at positions q (..., N, 3)."""
    if large.takes(system):
        return large.rod_errors(system, q)
    _, g, _, _ = constraint_terms(system, q, 0.0 * q)
    return np.sqrt(2.0 * g + np.square(system["lengths"])) - system["lengths"]


def constraint_violation(system, q):
    """The largest rod error (...,) in m, whatever its sign."""
    return np.max(np.abs(rod_errors(system, q)), axis=-1)


def simulate(step_fn, system, force, dt, steps, keep=()):
    """`steps` steps of `dt` s by step_fn(q, v, m, force, dt), measured at every one: a Run.

    Its first three are series from the start on: tip (steps + 1, ..., 3), the last particle, in m;
    violations (steps + 1, ...) in m; energies in J. `keep`: steps whose states it has as well.
    Members of leading axes in q0, v0 go in step.
    """
    if getattr(force, "dt", None) not in (None, dt):
        raise ValueError(f"this force is for steps of {force.dt:g} s, not of {dt:g} s")
    motion = Motion(step_fn, system["m"], force, dt, system["q0"], system["v0"], keep)
    measure = motion.fast(lambda q, v: (rod_errors(system, q), energy(system, q, v)))
    for q, v in motion.blocks(steps):
        errors, energies = measure(q, v)
        violations = np.max(np.abs(errors), axis=-1)
        sane = (violations < 100.0 * np.sum(system["lengths"])) & np.isfinite(energies)
        motion.note(sane, q, v, violations, energies)
    return motion.run()


# --- endregion ---
# --- region: report ---
def parse(argv):
    """The command line, and the system it names."""
    parser, what, how = chapter_parser("constraints.py", HERE / CHAPTER, OUT, EXAMPLES)
    what("--system", default="double", help="pendulum, double, triple, chain, scene, file (double)")
    what("--links", type=number(int, 1, 20_000), default=10, help="rods of --system chain (10)")
    what("--steps", type=number(int, 1), default=4000, help="drift is patient: run longer (4000)")
    what("--dt", type=number(), default=0.005, help="s; halve it and see the rule's order (0.005)")
    how("--integrator", choices=INTEGRATORS, default="semi_implicit", help="who drifts, how fast?")
    how("--stabilization", choices=["all", *hold_table()], default="all", help="the cures for it")
    how("--baumgarte", type=number(float, 0), default=20.0, help="rad/s; too much blows up (20)")
    how("--time-constant", type=number(), default=0.02, help="s; how soon soft mends a rod (0.02)")
    how("--impedance", type=number(high=1), default=0.95, help="soft: hard rods near 1 (0.95)")
    how("--tol", type=number(), help="m at 2 s; gauss then finds its stages and step")
    how("--show-step", action="store_true", help="print the code that a step becomes, and no more")
    args = parser.parse_args(argv)
    if args.tol and args.integrator != "gauss":
        parser.error(f"argument --tol: {args.tol:g} is for --integrator gauss; give --dt")
    if args.stabilization == "impulse" and args.integrator not in FOR_IMPULSE:
        parser.error(f"argument --stabilization: impulse does not fit {args.integrator}")
    return args, parser.attempt("--system", build_system, args.system, args.seed, args.links)


def report(args, system, rows, runs, dt, truth):
    """Print the table, a sentence for each run that did not go straight to its end, the verdict."""
    ways = "; ".join(dict.fromkeys(run.way for run in runs.values()))
    at, limit = f"at {truth.step * dt:.3g} s, m", STABILITY_LIMIT.get(args.integrator, math.inf)
    print(f"{args.system}: seed {args.seed}; {args.integrator}, steps of {dt:.4g} s, {ways}\n")
    print("                   rods off, m    energy  true error    tip ends at, m    a step")
    print(f"mode           worst    at end  of m g L {at:>11}        x        y        us")
    for mode, row in rows.items():
        name = mode + "*" * bool(runs[mode].note)
        rods = f"{row['max_violation']:9.2e} {row['final_violation']:9.2e}"
        error = "-" if row["error"] is None else f"{row['error']:.2e}"
        end = f"{row['tip_final'][0]:8.3f} {row['tip_final'][1]:8.3f} {runs[mode].pace:9.3g}"
        print(f"{name:<10} {rods} {row['energy_rel_max']:9.1e} {error:>11} {end}")
    for mode, run in runs.items():
        if run.note:
            print(f"* {mode} {run.note}{in_line(constraint_terms, system, run)}")
    if "baumgarte" in runs and dt * args.baumgarte > limit:
        print(f"baumgarte: dt*omega {dt * args.baumgarte:.3g} is past the limit {limit:.3g} here")
    drift = {mode: row["max_violation"] for mode, row in rows.items() if not row["stopped"]}
    told = args.system in SYSTEMS and drift.get("none", 0.0) > 1e-9 and "baumgarte" in drift
    if told and args.baumgarte and len(runs["none"].tip) > SMOKE_STEPS:
        none, helped = drift["none"], max(drift["baumgarte"], 1e-12)
        verdict = "as expected, over 3" if none > 3.0 * helped else "UNEXPECTED, not over 3"
        print(f"verdict: worst rod error, none / baumgarte = {none / helped:.1f}: {verdict}")


def main(argv=None):
    """Run the comparison that `argv` asks for, print it, write metrics.json and the recording."""
    args, system = parse(argv)
    modes = list(hold_table()) if args.stabilization == "all" else [args.stabilization]
    rule = INTEGRATORS[args.integrator]
    steps = SMOKE_STEPS if args.smoke else args.steps
    knobs = args.baumgarte, args.time_constant, args.impedance

    def case(mode, rule, dt):
        hold = hold_table(dt, *knobs)[mode]
        return followed(rule, hold.after, system), system, make_force(system, hold), dt

    if args.show_step:
        print(source(*case(modes[0], rule, args.dt)))
        return 0
    print(banner("ch3.4", "constraints", args.device))
    if args.stabilization == "all" and args.integrator not in FOR_IMPULSE:
        modes.remove("impulse")
        print(f"impulse left out: {args.integrator} does not take q to q + dt (v + dt a)")
    rule, dt, steps, truth = settle(simulate, case, modes, rule, args.dt, steps, args.tol)
    keep = [truth.step, *(frames(steps, dt, len(system["q0"])) if args.rerun else ())]
    runs = {mode: simulate(*case(mode, rule, dt), steps, keep) for mode in modes}
    fall = np.sum(system["m"]) * np.max(np.abs(GRAVITY)) * np.sum(system["lengths"]) or 1.0
    rows = {mode: runs[mode].summary(fall, truth) for mode in modes}
    report(args, system, rows, runs, dt, truth)
    used = {"dt": dt, "steps": steps, "rods": len(system["pairs"]), "error_at": truth.step * dt}
    holds = hold_table(dt, *knobs)
    scene = args, used, system, runs, rows, fall, lambda: pulls(tensions, system, runs, holds)
    print(publish(args, used, rows, lambda path: record(path, *scene)))
    return 0


if __name__ == "__main__":
    run_script(main)
# --- endregion ---
