"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight that is let go falls; on a rod it swings. How hard does the rod pull? Gravity is given, but
this force must be solved for, each time an integrator asks. This file derives the linear system,
hides it in force(q, v) for chapter 3.3's integrators, and measures how far rods drift, what stops
the drift, and what that costs.

    python constraints.py           a double pendulum, 20 s, with each method
    python constraints.py --help    what to change, and why you would
"""

# --- region: setup ---
import argparse
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

# All that the chapter is about stands below. From other files come:
from curriculum.ch3_4_constraints.mechanics import scene_files, systems  # scenes; their checks
from curriculum.ch3_4_constraints.mechanics.loops import least_squares, solve_loops  # loops of rods
from curriculum.ch3_4_constraints.mechanics.outcome import Outcome  # how a run went
from curriculum.ch3_4_constraints.mechanics.reference import find_reference  # the true motion
from curriculum.ch3_4_constraints.results import output, table  # files; numbers with units
from curriculum.common import cli, progress  # flags; a progress bar
from curriculum.common.gauss import make_gauss  # a very accurate integrator
from curriculum.common.tracing import compiled, plain, vmap, while_loop  # speed

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
#     load     (N, 3)  what else pulls at the particles, in N; without this key, nothing
# A state is q and v, (N, 3) each: positions in m and velocities in m/s, now.
CHAINS = {"pendulum": 1, "double": 2, "triple": 3}  # how many rods each has


def build_system(name, rng=0, links=10):
    """The system called `name`: one of CHAINS, "chain" with `links` rods, a scene or its file.

    Chains: rods of 1 m, bobs of 1 kg, at rest; `rng`, or a seed, tilts them. Raises SceneError.
    """
    if name not in CHAINS and name != "chain":  # a scene: those are kept in files
        return scene_files.load_scene(name, GRAVITY, CHAINS)
    n = CHAINS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)  # rad
    cosine, sine = systems.cos_sin(-tilt)  # np.cos and np.sin, but alike on every processor
    along = np.array([cosine, sine, 0.0])
    system = {
        "q0": PIVOT + np.arange(1.0, n + 1.0)[:, None] * along,  # bob k is k + 1 m out
        "v0": np.zeros((n, 3)),
        "m": np.ones((n, 1)),
        "pairs": [(k, k - 1) for k in range(n)],  # rod 0 hangs on anchor -1
        "lengths": np.ones(n),
    }
    return systems.check_system(system, PIVOT)  # a checked copy


def external_force(system, q, v=None):
    """All forces but the rods', (N, 3) in N. Add drag, or a motor: energy does not count it."""
    return system["m"] * GRAVITY + system.get("load", 0.0)


def rod_lengths(system, q):
    """How long each rod is, (..., C) in m, at q (..., N, 3): of one state or of many."""
    anchors = system.get("anchors", [PIVOT])
    lengths = []
    for i, j in system["pairs"]:
        end = anchors[-1 - j] if j < 0 else q[..., j, :]
        d = q[..., i, :] - end
        lengths.append(np.sqrt(np.sum(d * d, axis=-1)))
    return np.stack(lengths, axis=-1)


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i, and L its length. Then
#     g = (d . d - L^2) / 2 = 0                  (squares: no root to differentiate)
# is its constraint, . being the dot product. Differentiate twice in time. With d_dot = v_i - v_j
#     gdot  = d . d_dot                        = J v
#     gddot = d . (a_i - a_j) + d_dot . d_dot  = J a + Jdot v
# v and a now stack all particles: 3N numbers each. J = dg/dq, the Jacobian, has a row per rod: d in
# the columns of i, -d in those of j (an anchor has none), else 0. Jdot is J with d_dot for d.
# A rod can only push or pull along d: lambda d on i, -lambda d on j. So each rod adds lambda times
# its row of J: together, J^T lambda. There is one unknown for each rod: its Lagrange multiplier
# lambda, in N/m, below 0 if the rod pulls. Newton, with masses M (a diagonal) and all other forces
# f, says
#     M a = f + J^T lambda
# If g and gdot start at 0 and gddot stays 0, a rod keeps its length. Put a into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
# Try it on a bob that hangs at rest from the pivot: J = (0, -L, 0), so L^2/m lambda = -9.81 L. The
# rod's force J^T lambda is then (0, 9.81 m, 0): it bears the weight.
def constraint_terms(system, q, v):
    """J (C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (C,) each."""
    anchors = system.get("anchors", [PIVOT])
    jac = []
    g = []
    gdot = []
    jdotv = []
    for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
        row = np.zeros_like(q)  # (N, 3): row[i] has the three columns of particle i
        if j < 0:  # an anchor, which stands still
            d = q[i] - anchors[-1 - j]
            d_dot = v[i]
        else:
            d = q[i] - q[j]
            d_dot = v[i] - v[j]
            row[j] = -d
        row[i] = d
        jac.append(row.ravel())
        g.append(0.5 * (d @ d - length**2))
        gdot.append(d @ d_dot)  # J v
        jdotv.append(d_dot @ d_dot)  # Jdot v
    return np.stack(jac), np.stack(g), np.stack(gdot), np.stack(jdotv)


# J M^-1 J^T is symmetric and positive definite unless a rod is one too many, as where rods close a
# loop: two rods can share a load in many ways.
def solve(system, A, b, v=None):
    """lambda (C,) with A lambda = b; in a loop one of many, which v helps to find."""
    if systems.has_loop(system):
        return solve_loops(system, A, b, v)
    return np.linalg.solve(A, b)


# gddot = 0 asks nothing of g and gdot. But a step of an integrator leaves the circle along a
# tangent: semi_implicit, from rest, adds dt^2 |d_dot|^2 / 2 to g each time, and nothing removes it.
# So ask that g move like a damped spring (J. Baumgarte, 1972):
#     gddot = -2 w gdot - w^2 g
# Try g = e^(rt): r^2 + 2 w r + w^2 = (r + w)^2 = 0, so r = -w, and t e^(-wt) fits, too. The spring
# is critically damped, g = (c + k t) e^(-wt): an error dies, but each step makes a new one.
def constraint_force(system, q, v, w=0.0):
    """The rods' force J^T lambda, (N, 3) in N. `w` in rad/s: how fast an error in g dies."""
    m = np.repeat(system["m"], 3)  # kg, one per coordinate: x / m is M^-1 x, jac / m is J M^-1
    f = external_force(system, q, v).ravel()
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    A = (jac / m) @ jac.T  # J M^-1 J^T, (C, C) in m^2/kg
    b = -(jac @ (f / m) + jdotv)  # for gddot = 0, (C,) in m^2/s^2
    b = b - 2.0 * w * gdot - w * w * g  # Baumgarte's two terms; nothing if w = 0
    lam = solve(system, A, b, v)
    return (jac.T @ lam).reshape(q.shape)


def make_force(system, w=0.0):
    """force(q, v), (N, 3) in N: external_force and the rods'. The solve hides in here.

    Integrators call it and stay as they were: each call solves for lambda anew (RK4: 4 a step).
    """

    def force(q, v):
        return external_force(system, q, v) + constraint_force(system, q, v, w)

    return force


def tensions(system, q, v, force):
    """How hard each rod pulls, -lambda |d|, (C,) in N; where it is below 0, the rod pushes.

    The rods' part of force(q, v) is J^T lambda. If several lambda fit, this is the smallest.
    """
    jac, _, _, _ = constraint_terms(system, q, v)
    rods_force = force(q, v) - external_force(system, q, v)
    lam = least_squares(jac.T, rods_force.ravel())
    return -lam[: len(system["pairs"])] * rod_lengths(system, q)  # of rods, if J has more rows


# --- endregion ---
# --- region: integrators ---
# The first three are chapter 3.3's, to the letter: (q, v, m, force, dt) -> (q, v), in m and m/s.
def euler_step(q, v, m, force, dt):
    """Explicit Euler, order 1: all is evaluated at the old state. A pendulum gains energy."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit Euler, order 1: first the new velocity, then a step with that.

    With the method `none` a pendulum's energy drifts; with `project` it does not.
    """
    a = force(q, v) / m
    v_next = v + dt * a
    q_next = q + dt * v_next  # the new velocity, not the old one
    return q_next, v_next


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta, order 4 (W. Kutta, Z. Math. Phys. 46 (1901) 435): four solves a step."""

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
    """Kinetic and potential energy, in J, of one state or of many. Rods should not change it.

    The power of a rod is lambda d . d_dot = lambda gdot. It is 0 if gdot is 0.
    """
    kinetic = 0.5 * np.sum(system["m"] * v * v, axis=(-2, -1))  # over particles and x, y, z
    force = system["m"] * GRAVITY + system.get("load", 0.0)  # does not depend on q
    potential = -np.sum(force * q, axis=(-2, -1))
    return kinetic + potential


def constraint_violation(system, q):
    """The largest rod error in m, whatever its sign: the number to watch."""
    return np.max(np.abs(rod_lengths(system, q) - system["lengths"]), axis=-1)


class Run:
    """All states, and what was measured in each; unpacks to tip, violations, energies."""

    def __init__(self, q, v, tip, violations, energies):
        self.q = q  # (steps + 1, N, 3), in m
        self.v = v  # (steps + 1, N, 3), in m/s
        self.tip = tip  # (steps + 1, 3): the path of the last particle, in m
        self.violations = violations  # (steps + 1,): the largest rod error, in m
        self.energies = energies  # (steps + 1,), in J

    def __iter__(self):
        return iter((self.tip, self.violations, self.energies))


def simulate(step_fn, system, force, dt, steps):
    """Take `steps` steps of dt s from q0, v0, and measure every state: the Run."""
    m = system["m"]
    q = np.full_like(system["q0"], np.nan, shape=(steps + 1, *system["q0"].shape))
    v = np.full_like(q, np.nan)
    q[0] = system["q0"]
    v[0] = system["v0"]
    for i in range(steps):
        q[i + 1], v[i + 1] = step_fn(q[i], v[i], m, force, dt)  # row i is of time i dt
    violations = constraint_violation(system, q)  # of all states at once
    return Run(q, v, q[:, -1], violations, energy(system, q, v))


# --- endregion ---
# --- region: methods ---
# A method makes force(q, v), and it may do something after each step.
# Game engines, and MuJoCo, treat J as constant during a step, so Jdot v is left out. They may also
# let a rod give, as if it were elastic. With R, a share `softness` of A's diagonal, they ask for
#     J a = -damping gdot - stiffness g - R lambda,   that is, they solve with A + R instead of A.
def make_engine_force(system, damping, stiffness, softness=0.0):
    """force(q, v), (N, 3) in N, as engines have it; `damping` in 1/s, `stiffness` in 1/s^2."""

    def force(q, v):
        m = np.repeat(system["m"], 3)
        f = external_force(system, q, v).ravel()
        jac, g, gdot, _ = constraint_terms(system, q, v)
        A = (jac / m) @ jac.T
        R = softness * np.diag(np.diag(A))
        b = -(jac @ (f / m)) - damping * gdot - stiffness * g
        lam = solve(system, A + R, b, v)
        return (f + jac.T @ lam).reshape(q.shape)

    return force


class Method(NamedTuple):
    """How to hold the rods. Add yours to make_methods: table and page will show it."""

    make_force: Callable  # system -> force(q, v)
    words: str  # what it does
    post_step: Callable | None = None  # (system, q_start, q, v, dt) -> (q, v)
    integrator: str | None = None  # the only one it works with


def make_methods(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The methods by name, for steps of dt s; `baumgarte` in rad/s, `time_constant` in s."""
    spring = partial(make_force, w=baumgarte)

    # impulse (E. Catto, GDC 2005) asks for J v_next = -g/dt: moving by dt v_next then takes g back
    # to 0, up to dt^2 |d_dot|^2 / 2. As v_next = v + dt a, that is J a = -gdot/dt - g/dt^2. Of our
    # integrators, only semi_implicit moves q by dt v_next.
    impulse = partial(make_engine_force, damping=1.0 / dt, stiffness=1.0 / (dt * dt))

    # soft is MuJoCo's. For one rod it comes to J a = -2 gdot/T - g/T^2 + (1 - p) J M^-1 f. At rest
    # that is 0, so the rod is (1 - p) T^2 9.81 m/s^2 = 0.2 mm too long. As Jdot v is left out,
    # swinging adds T^2 |d_dot|^2 / L: 8 mm for a rod that has fallen from level.
    p = impedance
    T = np.maximum(time_constant, 2.0 * dt)  # MuJoCo keeps it at two steps or more
    soft = partial(
        make_engine_force,
        damping=2.0 / (p * T),
        stiffness=1.0 / (p * T * T),
        softness=(1.0 - p) / p,
    )
    return {
        "none": Method(make_force, "asks for gddot = 0: errors stay, and rods drift"),
        "baumgarte": Method(spring, "adds a damped spring, which changes the energy"),
        "impulse": Method(impulse, "asks for the right next place", integrator="semi_implicit"),
        "soft": Method(soft, "lets a rod give, as MuJoCo does"),
        "project": Method(make_force, "puts q and v back after each step", project),
    }


# project takes the end of a step and puts it back onto the rods. It moves q along the directions
# that the rods had at the start, as rods push: by -M^-1 J_start^T mu, with mu such that g = 0. As
# dg/dmu = -J M^-1 J_start^T, a round of Newton's method is
#     J M^-1 J_start^T dmu = g
# v gains the move of q over dt. Finally v loses what would change a rod's length:
#     J M^-1 J^T nu = gdot, so that J (v - M^-1 J^T nu) = 0
def project(system, q_start, q, v, dt):
    """Move q, v (N, 3), the end of a step from q_start, back to where g = 0 and J v = 0.

    SHAKE moves q like this (J.-P. Ryckaert et al., J. Comput. Phys. 23 (1977) 327). RATTLE corrects
    v, too (H. Andersen, ibid. 52 (1983) 24). There the step before has no rods' force; here it has.
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

    # while is_off(q): q = newton(q), at most 20 times, in the form that JAX has, which compiles
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


def parse_args(argv=None):
    """Parse the flags and build the system they ask for."""
    parser = cli.Parser(__doc__, "studies: python -m curriculum.ch3_4_constraints.studies --help")
    add = parser.add_argument
    every = make_methods()
    scenes = ", ".join([*CHAINS, "chain", *scene_files.SHIPPED])
    words = "; ".join(f"{name} {method.words}" for name, method in every.items())
    add("--system", default="double", help=f"{scenes}, or the file of a scene")
    add("--links", type=cli.whole(1, 300), default=10, help="how many rods --system chain has")
    add("--seed", type=cli.whole(0), default=0, help="tilts the start, within 0.05 rad of level")
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="who calls force(q, v)")
    add("--stabilization", choices=["all", *every], default="all", help=words)
    add("--baumgarte", type=cli.number(0), default=20.0, help="w in rad/s: too large a w explodes")
    add("--time-constant", type=cli.positive, default=0.02, help="of soft, in s")
    add("--dt", type=cli.positive, default=0.005, help="s, one step: halve it, see what halves")
    add("--steps", type=cli.whole(1), default=4000, help="how many: drift shows late")
    add("--smoke", action="store_true", help=f"{SMOKE_STEPS} steps, for CI")
    add("--plain", action="store_true", help="compile nothing: print() and breakpoint() anywhere")
    add("--device", choices=["cpu"], default="cpu", help="there is no other")
    add("--rerun", action=argparse.BooleanOptionalAction, default=True, help="write a recording")
    add("--page", action=argparse.BooleanOptionalAction, default=True, help="write play.html")
    add("--out", type=cli.folder, default="outputs/ch3.4-constraints", help="where to write")
    args = parser.parse_args(argv)
    args.steps = SMOKE_STEPS if args.smoke else args.steps
    args.knobs = {"baumgarte": args.baumgarte, "time_constant": args.time_constant}
    fits = [name for name, x in every.items() if x.integrator in (None, args.integrator)]
    if args.stabilization not in ("all", *fits):
        parser.error(f"argument --stabilization: {args.stabilization} is not for {args.integrator}")
    args.methods = fits if args.stabilization == "all" else [args.stabilization]
    with parser.errors("argument --system: "):
        system = build_system(args.system, args.seed, args.links)
    with parser.errors():
        output.check(args, system)
    return args, system


def run_method(system, name, integrator, dt, steps, **knobs):
    """Run a method by name on a copy of the system; `knobs` are those of make_methods."""
    functions = external_force, constraint_violation, energy
    system = systems.check_run(system, PIVOT, dt, steps, *functions)
    method = make_methods(dt, **knobs)[name]
    step_fn = stabilized(INTEGRATORS[integrator], system, method)
    step = compiled(systems.checked_step(step_fn, integrator, method), steps)  # only faster
    run = simulate(step, system, method.make_force(system), dt, steps)
    return Outcome(run, system, dt, step)  # up to a step that fails, and why it ended


def summary(system, run, method, reference):
    """What metrics.json says of a run."""
    pull = partial(tensions, system, force=method.make_force(system))
    m_g_L = systems.m_g_L(system, GRAVITY)  # J: all m g times all L, as energy begins near 0
    return {
        "max_violation": np.max(run.violations),  # m, over all states
        "final_violation": run.violations[-1],  # m
        "conserves": systems.conserves(system, external_force, energy),  # or energy need not stay
        "energy_rel_max": np.max(np.abs(run.energies - run.energies[0])) / m_g_L,
        "energy_step_max": np.max(np.abs(np.diff(run.energies)), initial=0.0) / m_g_L,
        **table.largest_force(vmap(pull)(run.q, run.v)),  # N, over rods and states
        "tip_final": run.tip[-1].tolist(),  # m
        "error": reference.error(run.q),  # m, of the worst particle, at the reference's time
        "stopped": run.stopped,  # when and why, if it ended early
    }


def print_table(args, runs, results, reference):
    """Print a row for each method, and what there is to doubt."""
    table.title(args, runs)
    print("\n               rods off by      energy off    largest  from refer-    a step")
    print(f"method         worst    at end    of m g L   force, N{reference.at:>13}        us")
    for name, row in results.items():
        if runs[name].lost:  # it failed or diverged: say when and why
            table.say(f"{name:12}{row['stopped']}")
            continue
        worst = table.length(row["max_violation"])
        end = table.length(row["final_violation"])
        drift = table.energy(row)
        force = table.force(row)
        error = table.error(row["error"], reference)
        pace = f"{runs[name].pace:.3g}"
        star = "*" if table.doubts(row, runs[name]) else ""  # notes, below, say what to doubt
        print(f"{name + star:12}{worst:>8}{end:>10}{drift:>12}{force:>11}{error:>13}{pace:>10}")
    table.notes(args, runs, results, reference, INTEGRATORS[args.integrator])
    if args.system in CHAINS:
        table.verdict(results, runs)


def main(argv=None):
    """Run the methods, print what became of the rods, and write it to files."""
    args, system = parse_args(argv)
    print(f"ch3.4 constraints | device {args.device}")
    methods = make_methods(args.dt, **args.knobs)
    runs = {}
    results = {}
    with plain(args.plain):
        for name in progress.each(args.methods, always=args.plain):
            run = run_method(system, name, args.integrator, args.dt, args.steps, **args.knobs)
            runs[name] = run
        # Right rods can follow a wrong path. So compare with gauss and project in ever shorter
        # steps, at a time before chaos takes over.
        reference = find_reference(system, make_force(system), project, runs.values())
        for name, run in runs.items():
            results[name] = summary(system, run, methods[name], reference)
    print_table(args, runs, results, reference)
    this_file = SimpleNamespace(**globals())  # as you edited it: page and recording run it
    output.write(args, system, runs, results, reference, this_file)
    return 0


command = partial(cli.run_script, main)  # for the entry point in pyproject.toml
if __name__ == "__main__":
    command()
# --- endregion ---
