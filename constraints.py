"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight on a rod would fall straight down, but the rod makes it swing. How hard does the rod pull?
No formula tells: a linear system does, solved again each time an integrator asks for the force.
This file derives that system, hides its solution inside `force(q, v)`, hands that to the
integrators of chapter 3.3, which never learn of it, and measures what becomes of the rods.

Run: python constraints.py --help. The lines you read are the lines that run: on numbers or, to be
compiled, on symbols (the chapter tells how; --show-step prints the result). Change one, and see.
"""

# --- region: setup ---
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

# To follow the force, know three of these: `solve` solves a linear system; `states`, of q and v,
# and `ordered`, of any array, make arrays whose sums and @ add from first to last. Skip the rest.
from curriculum.ch3_4_constraints import publish, run_checks, scene_files, statics, tables
from curriculum.ch3_4_constraints.comparison import Comparison, frames
from curriculum.ch3_4_constraints.solving import solve, unanswered
from curriculum.ch3_4_constraints.systems import check_links, direction, energy_scale, states
from curriculum.common import aim, banner, progress, ruler, rules
from curriculum.common.arrays import ordered
from curriculum.common.cli import chapter_parser, installed, number, run_script
from curriculum.common.compiled import Compiled
from curriculum.common.crowds import mapped
from curriculum.common.gauss import make_gauss
from curriculum.common.midpoint import make_midpoint
from curriculum.common.programs import repeat
from curriculum.common.runs import Log
from curriculum.common.steps import Plain, followed

import numpy as np  # last on purpose: curriculum answers Ctrl-C in words while numpy loads

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2: y is up
PIVOT = np.zeros((1, 3))  # m, (K, 3): the anchors of a system that names none
HERE = Path(__file__).resolve().parent
CHAPTER = "curriculum/ch3_4_constraints"
OUT = "outputs/ch3.4-constraints"
SMOKE_STEPS = 800  # of a --smoke run: enough to tell the modes apart
# --- endregion ---
# --- region: systems ---
# A system is N particles, C rods and K anchors, and nothing derived from them: a dict of
#     q0, v0   (N, 3)  where the particles start, in m, and how fast, in m/s
#     m        (N, 1)  their masses, in kg
#     pairs            a list of (i, j), one per rod: it ties particle i to particle j or, where j
#                      is negative, to an anchor, which stands still: -1 is the first, -2 the next
#     lengths  (C,)    of the rods, in m
#     anchors  (K, 3)  where they stand, in m; without this key they are PIVOT
# A state is q and v, (N, 3) each: where the particles are now, in m, and how fast, in m/s.
SYSTEMS = {"pendulum": 1, "double": 2, "triple": 3}  # made here: how many rods each has


def build_system(name, rng=0, links=10):
    """The system called `name`: one of SYSTEMS, "chain" with `links` rods, a scene or its file.

    Chains made here have rods of 1 m and bobs of 1 kg, and start at rest, nearly level: `rng`, a
    Generator or a seed, draws their tilt. That is all that is random here. Raises SceneError.
    """
    if name not in SYSTEMS and name != "chain":
        return scene_files.load_scene(name, HERE / CHAPTER, [*SYSTEMS, "chain"], GRAVITY)
    count = SYSTEMS.get(name, links)
    check_links(count)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)
    along = direction(-tilt)  # (cos, sin, 0), the same bits on every processor
    return {
        "q0": PIVOT + np.arange(1.0, count + 1.0)[:, None] * along,
        "v0": np.zeros((count, 3)),
        "m": np.ones((count, 1)),
        "pairs": [(k, k - 1) for k in range(count)],  # rod 0 hangs on anchor -1
        "lengths": np.ones(count),
        "anchors": PIVOT.copy(),
    }


def external_force(system, q, v=None):
    """All forces but the rods', (N, 3) in N: add drag or a motor. energy() counts GRAVITY alone."""
    return system["m"] * GRAVITY


def applied_force(system, q, v):
    """external_force, checked: yours may take no v, return lists, or one [x, y, z]. (N, 3) in N."""
    return run_checks.own_force(external_force, system, q, v)


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i. Its constraint is
#     g = (d . d - L^2) / 2 = 0
# where . is the dot product; gdot and gddot are its derivatives in time. With rate = v_i - v_j
#     gdot  = d . rate                         = J v
#     gddot = d . (a_i - a_j) + rate . rate    = J a + Jdot v
# v and a hold all particles, 3N numbers. J has one row per rod: d in the columns of particle i and
# -d in those of j. (Jdot has rate where J has d.) A rod pulls along d, equally and oppositely at
# its ends, with lambda d and -lambda d; all rods together exert J^T lambda. So there is one unknown
# number per rod, lambda, in N/m, below zero where the rod pulls. Newton, with M the masses, says
#     M a = f + J^T lambda
# A right rod stays right if gddot stays 0. So put that a into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
def constraint_terms(system, q, v):
    """J (C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (C,) each."""
    q, v = states(system, q, v)  # @ and sums add from first to last: the same bits everywhere
    rods = len(system["pairs"])
    anchors = system.get("anchors", PIVOT)
    jac = np.zeros_like(q, shape=(rods, *q.shape))  # (C, N, 3), of floats or symbols, as q is
    g, gdot, jdotv = np.zeros_like(q, shape=(3, rods))  # three arrays of zeros, (C,) each
    for k, (i, j) in enumerate(system["pairs"]):
        if j < 0:
            d = q[i] - anchors[-1 - j]
            rate = v[i]  # an anchor stands still
        else:
            d = q[i] - q[j]
            rate = v[i] - v[j]
            jac[k, j] = -d
        jac[k, i] = d
        L = float(system["lengths"][k])  # a float32 would be squared with its few digits
        g[k] = 0.5 * (d @ d - L * L)
        gdot[k] = d @ rate  # = (J v)_k
        jdotv[k] = rate @ rate  # = (Jdot v)_k
    return jac.reshape(rods, q.size), g, gdot, jdotv


# gddot = 0 keeps a right rod right, but asks nothing of g and gdot: each step of an integrator
# leaves an error there, and nothing takes it back. So ask that g behave like a damped spring:
#     gddot = -2 w gdot - w^2 g
# e^(rt) solves that if r = -w: errors die like e^(-wt), and do not swing. Most remedies differ by
# four numbers only. (use_jdotv is 1 or 0, A is J M^-1 J^T, and diag A is its diagonal.)
#     (A + softness diag A) lambda = -(J M^-1 f + use_jdotv Jdot v) - damping gdot - stiffness g
class Hold(NamedTuple):
    """A way to hold rods: what it asks of gddot, and for which steps it is meant."""

    use_jdotv: float  # 1, or 0 without the term Jdot v
    damping: float  # 1/s
    stiffness: float  # 1/s^2
    softness: float  # a share of A's diagonal
    dt: float | None = None  # s, if it is for steps of this length only
    rule: str | None = None  # the name of an integrator, if it is for that one only
    after: Callable | None = None  # (system, q_start, q, v, dt) -> (q, v): it mends a step


def multipliers(system, q, v, hold, f=None):
    """J (C, 3N); lambda (C,) in N/m; A (C, C), its softness included, and b (C,): A lambda = b.

    `hold`: a Hold, a mode's name, or Baumgarte's w in rad/s. f (N, 3) in N: all other forces.
    """
    q, v = states(system, q, v)
    if f is None:
        f = applied_force(system, q, v)
    hold = run_checks.chosen(hold, hold_table)  # now it is a Hold
    m = np.repeat(system["m"], 3)  # kg, (3N,)
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    A = (jac / m) @ jac.T  # J M^-1 J^T
    if hold.softness > 0.0:  # MuJoCo's error is |d| - L, for its row of J is ours / |d|
        stretch = rod_errors(system, q)  # |d| - L
        g = (system["lengths"] + stretch) * stretch  # |d| (|d| - L): for a row of J like ours
        A = A + hold.softness * np.diag(np.diag(A))
    b = -(jac @ (f.ravel() / m) + hold.use_jdotv * jdotv)
    b = b - hold.damping * gdot - hold.stiffness * g
    lam = solve(system, A, b, v, jac)  # as np.linalg.solve(A, b); v, jac: where rods close a loop
    return jac, lam, A, b


def constraint_force(system, q, v, hold="none", f=None):
    """The rods' force J^T lambda (N, 3) in N; f: all other forces, or else external_force's."""
    jac, lam, _, _ = multipliers(system, q, v, hold, f)
    return (jac.T @ lam).reshape(np.shape(q))


def hold_table(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The modes by name: `baumgarte` in rad/s, MuJoCo's `time_constant` in s and `impedance`."""
    w = baumgarte
    p = impedance
    t = np.maximum(time_constant, 2.0 * dt)  # MuJoCo keeps it at two steps at least
    return {  # of Holds: use_jdotv, damping, stiffness, softness and, if it matters, dt, rule
        # gddot = 0. Fails by drift: what has gone wrong stays, and every step adds to it.
        "none": Hold(1.0, 0.0, 0.0, 0.0),
        # gddot = -2 w gdot - w^2 g (J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1).
        # Fails when dt w passes STABILITY_LIMIT.
        "baumgarte": Hold(1.0, 2.0 * w, w * w, 0.0),
        # Ask that q + dt v_next be right: J v_next = -g/dt, to first order. With v_next = v + dt a
        # that is J a = -gdot/dt - g/dt^2, no Jdot v (E. Catto, GDC 2005). Fails under euler.
        "impulse": Hold(0.0, 1.0 / dt, 1.0 / (dt * dt), 0.0, dt, "semi_implicit"),
        # A rod that gives, as MuJoCo's tendon. For a single rod, with g = |d| (|d| - L), it makes
        # gddot = (1 - p) J M^-1 f + Jdot v - 2 gdot/t - g/t^2.
        # Fails by design: a rod under load is longer.
        "soft": Hold(0.0, 2.0 / (p * t), 1.0 / (p * t * t), (1.0 - p) / p, dt),
        # gddot = 0, and project() mends each finished step. Fails if it finds no way back.
        "project": Hold(1.0, 0.0, 0.0, 0.0, after=project),
    }


def project(system, q_start, q, v, dt):
    """Put back q, v (N, 3), where a step from q_start ended a little off, so that g = 0, J v = 0.

    First q moves by -M^-1 J(q_start)^T mu, and v changes by that move / dt: SHAKE (J.-P. Ryckaert
    et al., J. Comput. Phys. 23 (1977) 327). Then v loses its part along the rods: RATTLE (H.
    Andersen, ibid. 52 (1983) 24). With J(q) in place of J(q_start), or v left alone, the energy
    explodes. Raises Stop if Newton finds no mu: simulate then tries the step in halves.
    """
    m = np.repeat(system["m"], 3)
    jac_start, _, _, _ = constraint_terms(system, q_start, v)  # only J is used, and it needs no v
    close = statics.near(system["lengths"], q_start)  # a g that counts as zero: 1e-12 L^2, or so

    # while off @ off > 1: q = newton(q), at most 20 times: repeat() is that, and can be compiled.
    def newton(q):  # a better q, and how far this one is off
        jac, g, _, _ = constraint_terms(system, q, v)
        mu = solve(system, (jac / m) @ jac_start.T, g, rough=True)  # kg; the next round corrects it
        off = g / close
        return q - (jac_start.T @ mu / m).reshape(q.shape), off @ off

    end = repeat(newton, q, 20, "no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    nu = solve(system, (jac / m) @ jac.T, gdot)  # kg/s; J (v - M^-1 J^T nu) = 0
    return end, v - (jac.T @ nu / m).reshape(q.shape)


# --- endregion ---
# --- region: integrators ---
class Force(NamedTuple):
    """force(q, v) -> (N, 3) in N, the rods' included: a function that remembers its system."""

    system: dict
    hold: Hold
    after: Callable | None  # (q_start, q, v, dt) -> (q, v): mends a step, in your own loop, too

    def __call__(self, q, v):
        q, v = states(self.system, q, v)
        f = applied_force(self.system, q, v)
        return f + constraint_force(self.system, q, v, self.hold, f)


def make_force(system, hold):
    """A Force; `hold`: a Hold, a mode's name (for steps of 0.005 s), or Baumgarte's w in rad/s."""
    hold = run_checks.chosen(hold, hold_table)
    after = partial(hold.after, system) if hold.after else None
    return Force(system, hold, after)


# The rules of chapter 3.3, (q, v, m, force, dt) -> (q, v), without a word about rods: they need
# not know that force() solves a linear system. How fast rods drift depends on the rule's error.
def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one force a step. What swings gains energy: kept as a warning."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit (symplectic) Euler: order 1, one force, v before q; as game engines do."""
    v = v + dt * (force(q, v) / m)
    return q + dt * v, v


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4; energy drifts."""

    def slope(q, v):
        return v, force(q, v) / m

    v1, a1 = slope(q, v)
    v2, a2 = slope(q + 0.5 * dt * v1, v + 0.5 * dt * a1)
    v3, a3 = slope(q + 0.5 * dt * v2, v + 0.5 * dt * a2)
    v4, a4 = slope(q + dt * v3, v + dt * a3)
    q = q + (dt / 6.0) * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return q, v + (dt / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


INTEGRATORS = {"euler": euler_step, "semi_implicit": semi_implicit_step, "rk4": rk4_step}
INTEGRATORS |= {"midpoint": make_midpoint(8), "gauss": make_gauss(8)}  # order 8; 8 stages, order 16

# Baumgarte's spring is stable up to this z = dt w. A step multiplies its error by 1 - z (Euler) or
# 1 - z + z^2/2 - z^3/6 + z^4/24 (RK4): within -1..1. Semi-implicit (see chapter): 4 - 4z - z^2 > 0.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (np.sqrt(2.0) - 1.0), "rk4": 2.785294}


# --- endregion ---
# --- region: simulate ---
# An honest run measures at every step how far the worst rod is off, and what the energy is.
def energy(system, q, v):
    """Kinetic and potential energy in J; U = -sum m GRAVITY . q."""
    q, v = states(system, q, v)
    m = ordered(system["m"])
    return np.sum(0.5 * m * v * v - m * q * GRAVITY)


def rod_errors(system, q):
    """|d| - L (C,) in m: what a ruler would show."""
    q = states(system, q)[0]
    d = statics.differences(q, system.get("anchors", PIVOT), system["pairs"])  # (C, 3): each d
    return np.sqrt(np.sum(d * d, axis=1)) - system["lengths"]


def constraint_violation(system, q):
    """The largest rod error in m, whatever its sign."""
    return np.max(np.abs(rod_errors(system, q)))


def simulate(step_fn, system, force, dt, steps, keep=(), way=Compiled):
    """A Run of `steps` steps of `dt` s by step_fn(q, v, m, force, dt), every one of them measured.

    It unpacks into tip (steps + 1, 3), the last particle's place, violations in m, energies in J.
    `keep`: steps whose states it has, too. `way`: Compiled, or Plain, the lines as they stand.
    """
    system = run_checks.check_run(system, force, dt, steps, keep, way, step_fn, INTEGRATORS, PIVOT)
    step_fn = followed(step_fn, getattr(force, "after", None))  # a step, mended if force has after

    def measure(q, v):
        q, v = states(system, q, v)  # read-only: to measure is to change nothing
        return constraint_violation(system, q), energy(system, q, v)

    stepper = way(step_fn, system["m"], force, dt, measure, steps)  # calls step_fn and measure
    log = Log(stepper, steps, keep, 100.0 * np.sum(system["lengths"]))  # m: beyond that, "diverged"
    q, v = log.start(system["q0"], system["v0"])  # the start is measured, too: it is row 0
    with log:  # if a step fails, even in halves, this run ends, and the other modes still run
        for _ in range(steps):
            q, v = log.step(q, v)  # the state after a step by step_fn, which is measured and noted
    return log.run()  # the Run: tip, violations, energies, and the states of keep


# --- endregion ---
# --- region: report ---
def tensions(system, q, v, hold="none", f=None):
    """Newtons (C,) with which rods pull, -lambda |d|; below zero they push. f: other forces."""
    _, lam, _, _ = multipliers(system, q, v, hold, f)
    return -lam * (rod_errors(system, q) + system["lengths"])  # |d| is L and its error


def unheld(system, q, v, hold="none"):
    """The largest acceleration in m/s^2 that is asked of the rods, and that they do not make."""
    jac, lam, A, b = multipliers(system, q, v, hold)
    return unanswered(system, jac, A, b, lam, v)


# Stop reading here: what follows serves the command line, with flags, tables and files.
def parse(argv):
    """Parser, command line, and the system it names; scene() and method() add flags to --help."""
    examples = "--system jansen_leg --integrator rk4", "--dt 0.05", "--integrator gauss --tol 1e-9"
    parser, scene, method = chapter_parser("constraints.py", HERE / CHAPTER, OUT, examples)
    modes = ["all", *hold_table()]
    orders = f"{', '.join(INTEGRATORS)}; midpoint:10 is of order 10, gauss:6 has 6 stages"
    scene("--scenes", action="store_true", help="list them")
    scene("--system NAME", default="double", help="one that --scenes lists, or a file")
    scene("--links N", type=number(int, 1, 1001), help="rods of --system chain (10)")
    scene("--steps N", type=number(int, 1), default=4000, help="how many; drift shows late")
    scene("--dt S", type=number(high=1e3), default=0.005, help="length of a step, in s: halve it")
    method("--integrator RULE", default="semi_implicit", help=orders)
    method("--stabilization MODE", choices=modes, default="all", help=", ".join(modes[1:]))
    method("--baumgarte W", type=number(float, 0), default=20.0, help="its w, rad/s; has a cliff")
    method("--time-constant T", type=number(), default=0.02, help="s; how soon soft mends a rod")
    method("--impedance P", type=number(high=1), default=0.95, help="soft: hard rods near 1")
    method("--tol M", type=number(high=1), help="aim, m at 2 s; midpoint, gauss find their step")
    scenes = [*SYSTEMS, "chain", *scene_files.shipped(HERE / CHAPTER)]
    parser.names = {"--system": scenes, "--integrator": INTEGRATORS}  # when a flag is forgotten
    args = parser.parse_args(argv)
    if args.scenes:
        print(publish.scene_list(SYSTEMS, HERE / CHAPTER))
        parser.exit()
    if args.tol is not None and args.plain:
        parser.error(f"argument --tol: {args.tol:g} wants compiled steps: no --plain")
    if args.links is not None and args.system != "chain":
        parser.error(f"argument --links: {args.links} wants --system chain, not {args.system}")
    parser.attempt("--integrator", rules.named, args.integrator, INTEGRATORS)
    parser.attempt("--tol", rules.offered, args.integrator, INTEGRATORS, args.tol)
    mode = args.stabilization
    why = run_checks.misfit(hold_table().get(mode), args.integrator)
    if why is not None:
        parser.error(f"argument --stabilization: {mode} {why}")
    if args.rerun:
        parser.attempt("--rerun", installed, "rerun")
    links = 10 if args.links is None else args.links
    own = parser.attempt("--system", build_system, args.system, args.seed, links)
    system = parser.attempt("build_system", run_checks.check_system, own, PIVOT)
    if not args.show_step:  # last, so that every other mistake is told first
        args.out = parser.attempt("--out", publish.results_folder, args.out)
    return parser, args, system


def report(comparison):
    """Print the table, a sentence for each mark in it, and the verdict."""
    args, dt = comparison.args, comparison.dt
    how = "; ".join(dict.fromkeys(run.how for run in comparison.runs.values()))  # each once
    limit = STABILITY_LIMIT.get(comparison.rule, np.inf)
    tables.say(f"{args.system}: seed {args.seed}; {comparison.rule}, steps of {dt:.4g} s, {how}")
    tables.show_comparison(comparison)
    if "baumgarte" in comparison.runs and dt * args.baumgarte > limit:
        print(f"baumgarte: dt w = {dt * args.baumgarte:.3g} is past the limit {limit:.3g} here")
    if args.system in SYSTEMS and args.baumgarte > 0.0 and comparison.steps >= SMOKE_STEPS:
        tables.verdict(comparison.rows)


def main(argv=None):
    """Run the comparison that `argv` asks for, print it, write what --out is to hold."""
    parser, args, system = parse(argv)
    offered = rules.offered(args.integrator, INTEGRATORS, args.tol)
    modes = list(hold_table()) if args.stabilization == "all" else [args.stabilization]
    steps = SMOKE_STEPS if args.smoke else args.steps
    knobs = args.baumgarte, args.time_constant, args.impedance
    usual = Plain if args.plain else Compiled

    def run(mode, rule, dt, steps, keep=(), way=usual, nudge=False, start=system):
        force = make_force(system, hold_table(dt, *knobs)[mode])
        return simulate(rule, ruler.nudged(start) if nudge else start, force, dt, steps, keep, way)

    if args.show_step:
        name, rule = next(iter(offered.items()))
        print(f"# {modes[0]}, {name}\n{run(modes[0], rule, args.dt, 1).source}")
        return
    default = vars(parser.parse_args([])) == vars(args) | {"out": OUT}  # all as usual but --out?
    print(banner.banner("ch3.4", "constraints", args.device, default))
    modes = run_checks.fitting(modes, hold_table(), args.integrator)
    progress.work.plan("the truth", *modes, "the true motion", *publish.parts(args))
    unsought = run_checks.unsought(system, partial(unheld, system), args.plain, hold_table())
    right = system if unsought else run_checks.righted(system, project)
    true_run = ruler.truly(partial(run, "project", start=right), unsought)
    tried = [partial(run, mode) for mode in modes]
    plan = parser.attempt("--tol", aim.settle, true_run, tried, offered, args.dt, steps, args.tol)
    rule, holds = offered[plan.rule], hold_table(plan.dt, *knobs)  # as --tol may have chosen them
    shown = frames(plan.steps, plan.dt, len(system["q0"]), args.picture or args.rerun)
    keep, runs, pulls = [plan.truth.step, *shown], {}, {}
    for mode in progress.work.each(modes):
        watch = run_checks.watched(system, partial(unheld, system, hold=holds[mode]))
        runs[mode] = run(mode, rule, plan.dt, plan.steps, keep, partial(usual, watch=watch))
        pulls[mode] = mapped(run_checks.felt(system, partial(tensions, system, hold=holds[mode])))
    plan, motion = ruler.believed(true_run, system, plan, shown, runs.values())
    mgl = energy_scale(system, GRAVITY)  # J
    comparison = Comparison(args, system, *plan, runs, mgl, pulls, shown, motion)
    report(comparison)
    print(publish.publish(comparison, sys.modules[__name__], rule))  # a page of these lines, too


command = partial(run_script, main)  # as a program: by its entry point, or as below
if __name__ == "__main__":
    command()
# --- endregion ---
