"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight let go falls; on a rod it swings. How hard does the rod pull? Gravity is given; this force
must be solved for, each time an integrator asks. This file derives the linear system, hides it in
force(q, v) for chapter 3.3's integrators, and measures how rods drift, what stops it, and the cost.

    python constraints.py           a double pendulum, 20 s, with each method
    python constraints.py --help    what to change, and why you would
"""

# --- region: setup ---
import argparse
import sys
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

# All mechanics of chains is below; you need not open these. systems checks a system, Run keeps
# states, solve_loops: rod loops; find_reference, make_gauss: to compare; tracing: speed; rest: I/O.
from curriculum.ch3_4_constraints.mechanics import scene_files, systems
from curriculum.ch3_4_constraints.mechanics.loops import solve_loops
from curriculum.ch3_4_constraints.mechanics.reference import find_reference
from curriculum.ch3_4_constraints.mechanics.run import Run
from curriculum.ch3_4_constraints.results import output, table
from curriculum.common import cli, progress
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import compiled, plain, vmap, while_loop

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2; y is up
PIVOT = np.zeros(3)  # m: where the first rod of a chain is fixed


# --- endregion ---
# --- region: systems ---
# A system is a dict of N particles, C rods and K anchors:
#     q0, v0   (N, 3)  where the particles start, in m, and their velocities, in m/s
#     m        (N, 1)  their masses, in kg
#     pairs            a list of (i, j), one per rod: it ties particle i to particle j or, where j
#                      is negative, to an anchor, which stands still: -1 is the first, -2 the next
#     lengths  (C,)    of the rods, in m
#     anchors  (K, 3)  where they stand, in m; without this key there is one, PIVOT
# A state is q and v, (N, 3) each: positions in m and velocities in m/s, now.
CHAINS = {"pendulum": 1, "double": 2, "triple": 3}  # how many rods each has


def build_system(name, rng=0, links=10):
    """The system called `name`: one of CHAINS, "chain" with `links` rods, a scene or its file.

    Chains: rods of 1 m, bobs of 1 kg, at rest; `rng`, or a seed, tilts them. Raises SceneError.
    """
    if name not in CHAINS and name != "chain":  # a scene, from a file: skip it at first
        return scene_files.load_scene(name, GRAVITY, CHAINS)
    n = CHAINS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)  # rad
    along = systems.direction(-tilt)  # (cos(-tilt), sin(-tilt), 0): along the chain
    system = {
        "q0": PIVOT + np.arange(1.0, n + 1.0)[:, None] * along,  # bob k is k + 1 m out
        "v0": np.zeros((n, 3)),
        "m": np.ones((n, 1)),
        "pairs": [(k, k - 1) for k in range(n)],  # rod 0 hangs on anchor -1
        "lengths": np.ones(n),
    }
    return systems.check_system(system, PIVOT)  # a checked copy


def external_force(system, q, v=None):
    """All forces but the rods', (N, 3) in N. Add drag or a motor; energy() will not know of it."""
    return system["m"] * GRAVITY


def rod_lengths(system, q):
    """How long each rod is, (..., C) in m, at q (..., N, 3): of one state or of many."""
    anchors = system.get("anchors", [PIVOT])
    rods = [q[..., i, :] - (anchors[-1 - j] if j < 0 else q[..., j, :]) for i, j in system["pairs"]]
    return np.stack([np.sqrt(np.sum(d * d, axis=-1)) for d in rods], axis=-1)


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i, and L its length. Then
#     g = (d . d - L^2) / 2 = 0                  (squares: no root to differentiate)
# is its constraint, . being the dot product. Differentiate twice in time. With d_dot = v_i - v_j
#     gdot  = d . d_dot                        = J v
#     gddot = d . (a_i - a_j) + d_dot . d_dot  = J a + Jdot v
# v and a now stack all particles: 3N numbers each. J = dg/dq, the Jacobian, has a row per rod: d in
# the columns of particle i, -d in those of j (an anchor has none), else 0. Jdot has d_dot for d.
# A rod can only push or pull along d: lambda d on i, -lambda d on j. That is its row of J, as a
# column, times lambda; all rods together: J^T lambda. One unknown per rod, lambda, its Lagrange
# multiplier, in N/m, below 0 if it pulls. With masses M (a diagonal), other forces f, Newton says
#     M a = f + J^T lambda
# If g and gdot start at 0 and gddot stays 0, a rod keeps its length. Put a into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
def constraint_terms(system, q, v):
    """J (C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (C,) each."""
    rods = len(system["pairs"])
    anchors = system.get("anchors", [PIVOT])
    jac = np.zeros((rods, *q.shape), like=q)  # jac[k, i]: in row k, the columns of particle i
    g, gdot, jdotv = np.zeros((3, rods), like=q)  # (C,) each; like=q: for speed, ignore it
    for k, (i, j) in enumerate(system["pairs"]):
        if j < 0:  # an anchor, which stands still
            d = q[i] - anchors[-1 - j]
            d_dot = v[i]
        else:
            d = q[i] - q[j]
            d_dot = v[i] - v[j]
            jac[k, j] = -d
        jac[k, i] = d
        g[k] = 0.5 * (d @ d - system["lengths"][k] ** 2)
        gdot[k] = d @ d_dot  # = (J v)_k
        jdotv[k] = d_dot @ d_dot  # = (Jdot v)_k
    return jac.reshape(rods, q.size), g, gdot, jdotv


# gddot = 0 asks nothing of g and gdot: each step of an integrator leaves an error there, and
# nothing removes it. So ask that g move like a damped spring (J. Baumgarte, 1972):
#     gddot = -2 w gdot - w^2 g
# Try g = e^(rt): r^2 + 2 w r + w^2 = (r + w)^2 = 0, so r = -w, and t e^(-wt) fits, too. The spring
# is critically damped, g = (c + k t) e^(-wt): an error dies, but each step makes a new one.
def constraint_equation(system, q, v, w=0.0, change=None):
    """J, A and b of the rods' equation A lambda = b. `change` lets later methods edit A and b."""
    m = np.repeat(system["m"], 3)  # kg, one per coordinate: x / m is M^-1 x, jac / m is J M^-1
    f = external_force(system, q, v).ravel()
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    A = (jac / m) @ jac.T  # J M^-1 J^T, (C, C) in m^2/kg
    b = -(jac @ (f / m) + jdotv)  # for gddot = 0; (C,) in m^2/s^2
    b = b - 2.0 * w * gdot - w * w * g  # Baumgarte's two terms, w in rad/s; nothing if w = 0
    if change:
        A, b = change(A, b, g, gdot, jdotv)
    return jac, A, b


def solve(system, A, b, v=None, jac=None):
    """lambda (C,) with A lambda = b. In a loop v and jac make it more exact: skip both at first."""
    if systems.has_loop(system):  # a loop may have a rod too many, and then A is singular
        return solve_loops(system, A, b, v, jac)
    return np.linalg.solve(A, b)  # no loop: J M^-1 J^T is invertible, unless a d is 0


def constraint_force(system, q, v, w=0.0, change=None):
    """The rods' force J^T lambda, (N, 3) in N."""
    jac, A, b = constraint_equation(system, q, v, w, change)
    lam = solve(system, A, b, v, jac)
    return (jac.T @ lam).reshape(q.shape)


def make_force(system, w=0.0, change=None):
    """external_force and the rods' as one force(q, v), (N, 3) in N. The solve hides in here.

    Integrators call it and stay as they were: each call solves for lambda anew (RK4: 4 a step).
    """

    def force(q, v):
        return external_force(system, q, v) + constraint_force(system, q, v, w, change)

    return force


def tensions(system, q, v, w=0.0, change=None):
    """How hard each rod pulls, -lambda |d|, (C,) in N; below 0 it pushes. Skips rows added to J."""
    jac, A, b = constraint_equation(system, q, v, w, change)
    return -solve(system, A, b, v, jac)[: len(system["pairs"])] * rod_lengths(system, q)


# --- endregion ---
# --- region: integrators ---
# The first three are chapter 3.3's, to the letter: (q, v, m, force, dt) -> (q, v), in m and m/s.
def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one solve a step. A pendulum gains energy under it."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit Euler: order 1, one solve. Energy drifts under none, not under project."""
    a = force(q, v) / m
    v_next = v + dt * a
    q_next = q + dt * v_next  # the new velocity, not the old one
    return q_next, v_next


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4, four solves a step."""

    def deriv(q, v):
        return v, force(q, v) / m

    k1q, k1v = deriv(q, v)
    k2q, k2v = deriv(q + 0.5 * dt * k1q, v + 0.5 * dt * k1v)
    k3q, k3v = deriv(q + 0.5 * dt * k2q, v + 0.5 * dt * k2v)
    k4q, k4v = deriv(q + dt * k3q, v + dt * k3v)
    q_next = q + (dt / 6.0) * (k1q + 2.0 * k2q + 2.0 * k3q + k4q)
    v_next = v + (dt / 6.0) * (k1v + 2.0 * k2v + 2.0 * k3v + k4v)
    return q_next, v_next


INTEGRATORS = {
    "euler": euler_step,
    "semi_implicit": semi_implicit_step,
    "rk4": rk4_step,
    "gauss": make_gauss(8),  # order 16: very accurate and slow; not derived here
}


# --- endregion ---
# --- region: simulate ---
def energy(system, q, v):
    """Kinetic + potential, in J. A rod's power is lambda d . d_dot = lambda gdot: 0 if gdot is."""
    kinetic = 0.5 * np.sum(system["m"] * v * v, axis=(-2, -1))  # over N and 3; time stays
    potential = -np.sum(system["m"] * q * GRAVITY, axis=(-2, -1))
    return kinetic + potential


def constraint_violation(system, q):
    """The largest rod error in m, whatever its sign: the number to watch."""
    return np.max(np.abs(rod_lengths(system, q) - system["lengths"]), axis=-1)


def simulate(step_fn, system, force, dt, steps):
    """Take `steps` steps of dt s from q0, v0, and measure every state: row k is of time k dt.

    tip, violations, energies = simulate(...) works (m, m, J); as a Run it keeps q and v, too.
    """
    q = np.full((steps + 1, *system["q0"].shape), np.nan)  # (steps + 1, N, 3): all states
    v = q.copy()
    q[0], v[0] = system["q0"], system["v0"]
    step = compiled(step_fn, steps)  # step_fn's numbers, faster; step_fn itself under --plain
    for i in range(steps):  # if a step fails, the rest are nan, and run.stopped says why
        q[i + 1], v[i + 1] = step(q[i], v[i], system["m"], force, dt)
    tip = q[:, -1]  # the last particle's path
    violations = constraint_violation(system, q)  # of all states at once: the first axis is time
    energies = energy(system, q, v)
    return Run(tip, violations, energies, system, dt, q, v, step)  # run.q, run.v: all states


# --- endregion ---
# --- region: methods ---
class Stabilization(NamedTuple):
    """How a method holds the rods. Add yours to the dict below: table and page will show it."""

    w: float = 0.0  # Baumgarte's, in rad/s
    change: Callable | None = None  # (A, b, g, gdot, jdotv) -> (A, b)
    post_step: Callable | None = None  # (system, q_start, q, v, dt) -> (q, v)
    integrator: str | None = None  # the only one it works with


def stabilizations(dt, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The methods by name, for steps of dt s; `baumgarte` in rad/s, `time_constant` in s."""

    def impulse(A, b, g, gdot, jdotv):
        """Ask for J v_next = -g/dt: q + dt v_next is right to first order (as E. Catto, GDC 2005).

        With v_next = v + dt a that is J a = -gdot/dt - g/dt^2; + jdotv undoes the -jdotv in b. Of
        ours, only semi_implicit moves q by dt v_next. A step leaves dt^2 |d_dot|^2 / 2 in g.
        """
        return A, b + jdotv - gdot / dt - g / (dt * dt)

    def soft(A, b, g, gdot, jdotv):
        """Ask for a spring, but let the rod give, as the simulator MuJoCo lets tendons (its ropes).

        For one rod A + R = A / p, so lambda is p times what b asks for. At rest that takes a
        stretch of (1 - p) t^2 9.81 m/s^2, by default 0.2 mm. As Jdot v is left out, swinging adds
        t^2 |d_dot|^2 / L: 8 mm for a rod that has fallen from level, as dt goes to 0.
        """
        p = impedance
        t = np.maximum(time_constant, 2.0 * dt)  # MuJoCo keeps it at two steps or more
        R = (1.0 - p) / p * np.diag(np.diag(A))
        return A + R, b + jdotv - 2.0 / (p * t) * gdot - 1.0 / (p * t * t) * g

    return {
        "none": Stabilization(),  # gddot = 0. Drifts: nothing removes an error
        "baumgarte": Stabilization(w=baumgarte),  # explodes with dt w past STABILITY_LIMIT
        "impulse": Stabilization(change=impulse, integrator="semi_implicit"),
        "soft": Stabilization(change=soft),
        "project": Stabilization(post_step=project),  # fails where it finds no way back
    }


# The dt w up to which Baumgarte's error dies while rods hardly turn; the chapter derives it.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (np.sqrt(2.0) - 1.0), "rk4": 2.785294}


# project takes the end of a step and puts it back onto the rods. Which way? As rods push, in their
# directions at the start: q moves by -M^-1 J_start^T mu, with mu such that g = 0. As
# dg/dmu = -J M^-1 J_start^T, Newton's method solves, until g is within tolerance,
#     J M^-1 J_start^T dmu = g
# A move x in time dt is a velocity x / dt. Finally v loses what would change a rod's length:
#     J M^-1 J^T nu = gdot, so that J (v - M^-1 J^T nu) = 0
def project(system, q_start, q, v, dt):
    """Move q, v (N, 3), the end of a step from q_start, back to where g = 0 and J v = 0.

    SHAKE moves q so (J.-P. Ryckaert et al., J. Comput. Phys. 23 (1977) 327), and RATTLE v, too (H.
    Andersen, ibid. 52 (1983) 24), but after a step without the rods' force.
    """
    m = np.repeat(system["m"], 3)
    jac_start, _, _, _ = constraint_terms(system, q_start, v)
    tolerance = systems.tolerance(system, q_start, len(jac_start))  # of g: about 1e-12 L^2

    def is_off(q):
        _, g, _, _ = constraint_terms(system, q, v)
        return np.max(np.abs(g / tolerance)) > 1.0

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        dmu = solve(system, (jac / m) @ jac_start.T, g)
        return q - (jac_start.T @ dmu / m).reshape(q.shape)

    # while is_off(q): q = newton(q), 20 times at most, in a form that can be compiled
    end = while_loop(is_off, newton, q, most=20, failure="no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    nu = solve(system, (jac / m) @ jac.T, gdot)
    return end, v - (jac.T @ nu / m).reshape(q.shape)


def stabilized(step_fn, system, method):
    """step_fn, followed by the method's post_step if it has one."""

    def step(q, v, m, force, dt):
        q_end, v_end = step_fn(q.copy(), v.copy(), m, force, dt)  # copies: step_fn may edit them
        return method.post_step(system, q, q_end, v_end, dt)

    return step if method.post_step else step_fn


# --- endregion ---
# --- region: report ---
# No new mechanics; skip parse_args. One method, without flags; run.violations.max() is in m:
#     run = run_method(build_system("double"), "none", "semi_implicit", dt=0.005, steps=4000)
SMOKE_STEPS = 800  # of a --smoke run: fixed, so that CI can compare two runs byte for byte
THIS_FILE = sys.modules[__name__]  # for page and recording, which run it as you edited it


def parse_args(argv=None):
    """Parse the flags and build the system they ask for."""
    parser = cli.Parser(__doc__, "studies: python -m curriculum.ch3_4_constraints.studies --help")
    add = parser.add_argument
    add("--scenes", action=cli.Show, const=partial(scene_files.listed, CHAINS), help="list them")
    add("--system", default="double", help="one that --scenes lists, or the file of a scene")
    add("--links", type=cli.whole(1, 300), default=10, help="how many rods --system chain has")
    add("--seed", type=cli.whole(0), default=0, help="tilts the start, within 0.05 rad of level")
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="orders 1, 1, 4, 16")
    add("--stabilization", choices=["all", *stabilizations(1.0)], default="all", help="all, or one")
    add("--baumgarte", type=cli.number(0), default=20.0, help="w in rad/s: too large a w explodes")
    add("--time-constant", type=cli.positive, default=0.02, help="of soft, in s")
    add("--impedance", type=cli.number(1e-9, 1), default=0.95, help="of soft: no sag at rest if 1")
    add("--dt", type=cli.positive, default=0.005, help="s, one step: halve it, see what halves")
    add("--steps", type=cli.whole(1), default=4000, help="how many: drift shows late")
    add("--smoke", action="store_true", help=f"{SMOKE_STEPS} steps, for CI")
    add("--plain", action="store_true", help="compile nothing: print() and breakpoint() anywhere")
    add("--show-step", action="store_true", help="print the code that one step becomes")
    add("--device", choices=["cpu"], default="cpu", help="there is no other")
    add("--rerun", action=argparse.BooleanOptionalAction, default=True, help="write a recording")
    add("--page", action=argparse.BooleanOptionalAction, default=True, help="write play.html")
    add("--out", type=cli.folder, default="outputs/ch3.4-constraints", help="where to write")
    args = parser.parse_args(argv)
    args.steps = SMOKE_STEPS if args.smoke else args.steps
    args.knobs = {key: getattr(args, key) for key in ("baumgarte", "time_constant", "impedance")}
    fits = [k for k, x in stabilizations(1.0).items() if x.integrator in (None, args.integrator)]
    if args.stabilization not in ("all", *fits):
        parser.error(f"argument --stabilization: {args.stabilization} is not for {args.integrator}")
    args.methods = fits if args.stabilization == "all" else [args.stabilization]
    with parser.errors():
        system = systems.check_system(build_system(args.system, args.seed, args.links), PIVOT)
        output.check(args, system)
    return args, system


def run_method(system, name, integrator, dt, steps, **knobs):
    """The Run of a method by name, on a copy of the system; `knobs` are those of stabilizations."""
    system = systems.check_system(system, PIVOT, external_force, constraint_violation, energy)
    method = stabilizations(dt, **knobs)[name]
    step_fn = systems.checked_step(INTEGRATORS[integrator], integrator)
    force = make_force(system, method.w, method.change)
    return simulate(stabilized(step_fn, system, method), system, force, dt, steps)


def summary(system, run, method, reference):
    """What metrics.json says of a run."""

    def loads(q, v):  # the largest force of a rod in N, and the error of A lambda = b in m/s^2
        jac, A, b = constraint_equation(system, q, v, method.w, method.change)
        lam = solve(system, A, b, v, jac)
        rods = len(system["pairs"])  # they come first; skip rows that you add to J
        force = np.abs(lam[:rods]) * rod_lengths(system, q)
        residual = np.abs(b - A @ lam)[:rods] / system["lengths"]
        return np.max(force), np.max(residual)

    forces, residuals = vmap(loads)(run.q, run.v)  # zip(*map(loads, run.q, run.v)), only faster
    m_g_L = systems.m_g_L(system, GRAVITY)  # J: all m g times all L, as energy begins near 0
    return {
        "max_violation": np.max(run.violations),  # m, over all states
        "final_violation": run.violations[-1],  # m
        "energy_rel_max": np.max(np.abs(run.energies - run.energies[0])) / m_g_L,
        "energy_step_max": np.max(np.abs(np.diff(run.energies)), initial=0.0) / m_g_L,
        "constraint_residual": np.max(residuals),  # m/s^2: rounding, unless A is singular
        "tension_max": np.max(forces),  # N
        "tip_final": run.tip[-1].tolist(),  # m
        "error": reference.error(run.q),  # m, of the worst particle, at the reference's time
        "stopped": run.stopped,  # when and why, if it ended early
    }


def main(argv=None):
    """Run the methods, print what became of the rods, and write it to files."""
    args, system = parse_args(argv)
    if args.show_step:
        run = run_method(system, args.methods[0], args.integrator, args.dt, steps=1, **args.knobs)
        print(run.step.source or run.step.how)
        return 0
    print(f"ch3.4 constraints | device {args.device}")
    runs = {}
    with plain(args.plain):
        for name in progress.each(args.methods, always=args.plain):
            run = run_method(system, name, args.integrator, args.dt, args.steps, **args.knobs)
            runs[name] = run
    methods = stabilizations(args.dt, **args.knobs)
    # Rods may be right on a wrong path. So compare it with gauss in ever shorter steps, each put
    # back onto the rods by project (`hold`), at the time in the heading: before chaos decides.
    hold = partial(stabilized, system=system, method=methods["project"])
    reference = find_reference(hold, make_force(system), system, runs.values())
    results = {name: summary(system, run, methods[name], reference) for name, run in runs.items()}
    table.title(args, runs)
    print("\n               rods off by      energy off   largest   from refer-    a step")
    print(f"method         worst    at end    of m g L  force, N{reference.at:>14}        us")
    for name, row in results.items():
        if runs[name].lost:  # it failed or diverged: say when and why
            table.say(f"{name:12}{row['stopped']}")
            continue
        worst = table.length(row["max_violation"])
        end = table.length(row["final_violation"])
        drift = table.per_cent(row["energy_rel_max"])
        star = "*" if table.doubts(row, runs[name]) else ""  # notes, below, say what to doubt
        print(f"{name + star:12}{worst:>8}{end:>10}{drift:>12}{row['tension_max']:10.3g}", end="")
        print(f"{table.error(row['error'], reference):>14}{runs[name].pace:10.3g}")
    table.notes(args, runs, results, reference, STABILITY_LIMIT)
    done = {name for name, run in runs.items() if not run.stopped}
    if args.system in CHAINS and args.steps >= SMOKE_STEPS and {"none", "baumgarte"} <= done:
        ok = results["none"]["max_violation"] > 3.0 * results["baumgarte"]["max_violation"]
        print(f"largest rod error, none > 3 x baumgarte: {'as expected' if ok else 'UNEXPECTED'}")
    output.write(args, system, runs, results, reference, THIS_FILE)
    return 0


command = partial(cli.run_script, main)  # for the entry point in pyproject.toml
if __name__ == "__main__":
    command()
# --- endregion ---
