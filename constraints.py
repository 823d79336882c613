"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight on a rod would fall straight down, but the rod makes it swing. How hard does the rod pull?
No formula says. A linear system does, solved again each time an integrator asks for the force.
This file derives that system, hides its solution inside force(q, v), hands that to the integrators
of chapter 3.3, which never learn of it, and measures what becomes of the rods.

    python constraints.py           a double pendulum, 20 s, held by each method
    python constraints.py --help    what to change, and why you would
"""

# --- region: setup ---
import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

# The lesson uses seven of these names, each explained where it stands: solve, ordered, while_loop,
# compiled, vmap, StepFailed, Run. The others read scenes, check flags, print tables, write files.
from curriculum.ch3_4_constraints import output, scene_files, systems, table
from curriculum.ch3_4_constraints.reference import find_reference
from curriculum.ch3_4_constraints.run import Run
from curriculum.ch3_4_constraints.solving import residual, solve
from curriculum.common import cli, progress
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import StepFailed, compiled, ordered, plain, vmap, while_loop

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2; y is up
PIVOT = np.zeros(3)  # m: the one anchor of a system that names none
SMOKE_STEPS = 800  # of a --smoke run: fixed, so that CI can compare two runs byte for byte


def parse_args(argv=None):
    """Parse the flags, each of them something to turn, and build the system they ask for."""
    parser = cli.Parser(__doc__, "studies: python -m curriculum.ch3_4_constraints.studies --help")
    methods = stabilizations(dt=1.0)  # for any dt: only their names and integrators count here
    add = parser.add_argument
    add("--scenes", action="store_true", help="list the systems that have a name")
    add("--system", default="double", help="one that --scenes lists, or the file of a scene")
    add("--links", type=cli.whole(1, 300), default=10, help="how many rods --system chain has")
    add("--seed", type=cli.whole(0), default=0, help="tilts the start by a hair: see what grows")
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="orders 1, 1, 4, 16")
    add("--stabilization", choices=["all", *methods], default="all", help="what holds the rods")
    add("--baumgarte", type=cli.number(0), default=20.0, help="its w in rad/s: there is a cliff")
    add("--time-constant", type=cli.positive, default=0.02, help="s: how soon soft corrects a rod")
    add("--impedance", type=cli.number(1e-9, 1), default=0.95, help="of soft: near 1 rods are hard")
    add("--dt", type=cli.positive, default=0.005, help="s, one step: halve it, see what halves")
    add("--steps", type=cli.whole(1), default=4000, help="how many: drift shows late")
    add("--smoke", action="store_true", help=f"{SMOKE_STEPS} steps, for CI")
    add("--plain", action="store_true", help="compile nothing: print() and breakpoint() anywhere")
    add("--show-step", action="store_true", help="print the code that one step becomes")
    add("--device", choices=["cpu"], default="cpu", help="there is no other")
    add("--rerun", action=argparse.BooleanOptionalAction, default=True, help="write a recording")
    add("--page", action=argparse.BooleanOptionalAction, default=True, help="write a page to touch")
    add("--out", type=Path, default=Path("outputs/ch3.4-constraints"), help="where to write")
    args = parser.parse_args(argv)
    if args.scenes:
        print(scene_files.listed(CHAINS))
        parser.exit()
    if args.smoke:
        args.steps = SMOKE_STEPS
    asked = methods if args.stabilization == "all" else [args.stabilization]
    args.left_out = [x for x in asked if methods[x].integrator not in (None, args.integrator)]
    args.methods = [name for name in asked if name not in args.left_out]
    if not args.methods:
        parser.error(f"argument --stabilization: {args.stabilization} is not for {args.integrator}")
    args.knobs = {key: getattr(args, key) for key in ("baumgarte", "time_constant", "impedance")}
    with parser.errors():
        system = systems.check_system(build_system(args.system, args.seed, args.links), PIVOT)
        output.check(args, system)
    return args, system


# --- endregion ---
# --- region: systems ---
# A system is a dict of N particles, C rods and K anchors, and of nothing derived from them:
#     q0, v0   (N, 3)  where the particles start, in m, and how fast, in m/s
#     m        (N, 1)  their masses, in kg
#     pairs            a list of (i, j), one per rod: it ties particle i to particle j or, where j
#                      is negative, to an anchor, which stands still: -1 is the first, -2 the next
#     lengths  (C,)    of the rods, in m
#     anchors  (K, 3)  where they stand, in m; without this key there is one, PIVOT
# A state is q and v, (N, 3) each: where the particles are now, in m, and how fast, in m/s.
CHAINS = {"pendulum": 1, "double": 2, "triple": 3}  # how many rods each has


def build_system(name, rng=0, links=10):
    """The system called `name`: one of CHAINS, "chain" with `links` rods, a scene or its file.

    A chain has rods of 1 m and bobs of 1 kg and starts at rest, nearly level. `rng`, a Generator or
    a seed, draws its tilt, and nothing else here is random. Raises SceneError.
    """
    if name not in CHAINS and name != "chain":
        return scene_files.load_scene(name, GRAVITY, CHAINS)
    n = CHAINS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)  # rad
    along = systems.direction(-tilt)  # (cos, sin, 0), the same bits on every processor
    return {
        "q0": PIVOT + np.arange(1.0, n + 1.0)[:, None] * along,
        "v0": np.zeros((n, 3)),
        "m": np.ones((n, 1)),
        "pairs": [(k, k - 1) for k in range(n)],  # rod 0 hangs on anchor -1
        "lengths": np.ones(n),
        "anchors": np.array([PIVOT]),
    }


def external_force(system, q, v=None):
    """All forces but the rods', (N, 3) in N: add drag, or a motor; energy() knows GRAVITY only."""
    return system["m"] * GRAVITY


def rod_lengths(system, q):
    """How long each rod is now, (C,) in m. (For ordered, see constraint_terms.)"""
    d = systems.differences(ordered(q), system.get("anchors", [PIVOT]), system["pairs"])  # (C, 3)
    return np.sqrt(np.sum(d * d, axis=1))


def rod_errors(system, q):
    """How much too long each rod is, (C,) in m."""
    return rod_lengths(system, q) - system["lengths"]


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i. Its constraint is
#     g = (d . d - L^2) / 2 = 0
# where . is the dot product; gdot and gddot are its derivatives in time. With d_dot = v_i - v_j
#     gdot  = d . d_dot                        = J v
#     gddot = d . (a_i - a_j) + d_dot . d_dot  = J a + Jdot v
# v and a now stack all particles: 3N numbers each. J has one row per rod: d in the columns of its
# particle and -d in those of its partner. (Jdot has d_dot where J has d.) A rod pulls along d, at
# its ends equally and oppositely, with lambda d and -lambda d; all rods together exert J^T lambda.
# So there is one unknown number per rod, lambda, in N/m, below 0 if it pulls. With masses M and
# other forces f, Newton says
#     M a = f + J^T lambda
# A right rod stays right if gddot stays 0. So put that a into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
def constraint_terms(system, q, v):
    """J (C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (C,) each."""
    q, v = ordered(q), ordered(v)  # now @ and sums add from first to last: equal bits everywhere
    anchors = system.get("anchors", [PIVOT])
    rods = len(system["pairs"])
    jac = np.zeros((rods, *q.shape), like=q)  # like=q: it can hold what q holds, so it compiles
    g, gdot, jdotv = np.zeros((3, rods), like=q)
    for k, (i, j) in enumerate(system["pairs"]):
        if j < 0:
            d = q[i] - anchors[-1 - j]
            d_dot = v[i]  # an anchor stands still
        else:
            d = q[i] - q[j]
            d_dot = v[i] - v[j]
            jac[k, j] = -d
        jac[k, i] = d
        g[k] = 0.5 * (d @ d - system["lengths"][k] ** 2)
        gdot[k] = d @ d_dot  # = (J v)_k
        jdotv[k] = d_dot @ d_dot  # = (Jdot v)_k
    return jac.reshape(rods, q.size), g, gdot, jdotv


# gddot = 0 keeps a right rod right, but asks nothing of g and gdot: each step of an integrator
# leaves an error there, and nothing takes it back. So ask that g behave like a damped spring:
#     gddot = -2 w gdot - w^2 g
# Try g = e^(rt): r^2 + 2 w r + w^2 = (r + w)^2 = 0, so r = -w, twice: the spring is critically
# damped. Errors die like e^(-wt), and do not swing.
# Most methods differ in four numbers only. (use_jdotv is 1 or 0; A is J M^-1 J^T.)
#     (A + regularization diag A) lambda
#         = -(J M^-1 f + use_jdotv Jdot v) - damping gdot - stiffness g
class Stabilization(NamedTuple):
    """What a method asks of gddot, and what it does to a finished step."""

    use_jdotv: float = 1.0  # 1, or 0 without the term Jdot v
    damping: float = 0.0  # 1/s
    stiffness: float = 0.0  # 1/s^2
    regularization: float = 0.0  # a share of A's diagonal; g is then |d| (|d| - L)
    post_step: Callable | None = None  # (system, q_start, q, v, dt) -> (q, v)
    integrator: str | None = None  # the only one that it is made for


def stabilizations(dt, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The methods by name, for steps of dt s; `baumgarte` in rad/s, `time_constant` in s."""
    w, p = baumgarte, impedance
    t = np.maximum(time_constant, 2.0 * dt)  # MuJoCo keeps it at two steps at least
    return {
        # gddot = 0. Fails by drift: what has gone wrong stays, and every step adds to it.
        "none": Stabilization(),
        # gddot = -2 w gdot - w^2 g (J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1).
        # Fails, if not sooner, at dt w = 0.83 (semi_implicit), 2 (euler), 2.79 (rk4): see below.
        "baumgarte": Stabilization(damping=2.0 * w, stiffness=w * w),
        # Ask that q + dt v_next be right: J v_next = -g/dt, to first order. With v_next = v + dt a
        # that is J a = -gdot/dt - g/dt^2, no Jdot v (E. Catto, GDC 2005). Fails where q moves by
        # anything but dt v_next.
        "impulse": Stabilization(
            use_jdotv=0.0,
            damping=1.0 / dt,
            stiffness=1.0 / (dt * dt),
            integrator="semi_implicit",
        ),
        # A rod that gives, like MuJoCo's tendon (regularization is efc_R there). Fails by design: a
        # rod under load is longer.
        "soft": Stabilization(
            use_jdotv=0.0,
            damping=2.0 / (p * t),
            stiffness=1.0 / (p * t * t),
            regularization=(1.0 - p) / p,
        ),
        # gddot = 0, and project() corrects each finished step. Fails if it finds no way back.
        "project": Stabilization(post_step=project),
    }


def constraint_equation(system, q, v, method):
    """J (C, 3N), A (C, C) and b (C,) of A lambda = b, with all that a Stabilization asks for."""
    m = np.repeat(system["m"], 3)  # kg, one per coordinate: x / m is M^-1 x
    f = np.ravel(external_force(system, q, v))
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    A = (jac / m) @ jac.T  # J M^-1 J^T
    if method.regularization > 0.0:  # MuJoCo has g = |d| - L and J = d/|d|; times |d|, J is ours
        g = rod_lengths(system, q) * rod_errors(system, q)
        A = A + method.regularization * np.diag(np.diag(A))
    b = -(jac @ (f / m) + method.use_jdotv * jdotv)
    b = b - method.damping * gdot - method.stiffness * g
    return jac, A, b


def constraint_force(system, q, v, method=0.0):
    """The rods' force J^T lambda (N, 3) in N; `method`: a Stabilization, or Baumgarte's w."""
    jac, A, b = constraint_equation(system, q, v, as_stabilization(method))
    # along a chain np.linalg.solve(A, b); where rods close a loop, A can be singular
    lam = solve(system, A, b, v, jac)
    return (jac.T @ lam).reshape(np.shape(q))


def as_stabilization(method):
    """A Stabilization as it is; a number is Baumgarte's w in rad/s, 0 being none."""
    if isinstance(method, Stabilization):
        return method
    return Stabilization(damping=2.0 * method, stiffness=method * method)


def make_force(system, method):
    """force(q, v) -> (N, 3) in N, the rods' included: the seam with chapter 3.3.

    A post_step is not part of the force: see stabilized.
    """

    def force(q, v):
        return external_force(system, q, v) + constraint_force(system, q, v, method)

    return force


def project(system, q_start, q, v, dt):
    """Move q, v (N, 3), the end of a step from q_start, back to where g = 0 and J v = 0.

    First q moves by -M^-1 J(q_start)^T mu, and v changes by that move / dt: SHAKE (J.-P. Ryckaert
    et al., J. Comput. Phys. 23 (1977) 327). Then v loses its part along the rods: RATTLE (H.
    Andersen, ibid. 52 (1983) 24). Under semi_implicit, with J(q) in place of J(q_start), or v left
    alone, the energy explodes. Raises StepFailed if Newton finds no mu.
    """
    m = np.repeat(system["m"], 3)
    jac_start, _, _, _ = constraint_terms(system, q_start, v)
    tolerance = systems.tolerance(system["lengths"], q_start)  # of g: about 1e-12 L^2

    def is_off(q):
        _, g, _, _ = constraint_terms(system, q, v)
        return np.max(np.abs(g / tolerance)) > 1.0

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        mu = solve(system, (jac / m) @ jac_start.T, g, rough=True)  # kg; the next round corrects it
        return q - (jac_start.T @ mu / m).reshape(q.shape)

    # while is_off(q): q = newton(q), 20 times at most, in a form that can be compiled
    end = while_loop(is_off, newton, q, most=20, failure="no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    nu = solve(system, (jac / m) @ jac.T, gdot)  # kg/s; J (v - M^-1 J^T nu) = 0
    return end, v - (jac.T @ nu / m).reshape(q.shape)


# --- endregion ---
# --- region: integrators ---
# Those of chapter 3.3, (q, v, m, force, dt) -> (q, v), without a word about rods: they need not
# know that force() solves a linear system.
def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one solve a step. What swings gains energy: kept as a warning."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit (symplectic) Euler: order 1, one solve, v before q; as game engines do."""
    v = v + dt * (force(q, v) / m)
    return q + dt * v, v


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4, four solves a step."""

    def slope(q, v):
        return v, force(q, v) / m

    v1, a1 = slope(q, v)
    v2, a2 = slope(q + 0.5 * dt * v1, v + 0.5 * dt * a1)
    v3, a3 = slope(q + 0.5 * dt * v2, v + 0.5 * dt * a2)
    v4, a4 = slope(q + dt * v3, v + dt * a3)
    q = q + (dt / 6.0) * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return q, v + (dt / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


INTEGRATORS = {
    "euler": euler_step,
    "semi_implicit": semi_implicit_step,
    "rk4": rk4_step,
    "gauss": make_gauss(8),  # 8 stages, order 16: what the others are measured against
}

# Baumgarte's spring alone is stable up to z = dt w. A step multiplies its error by 1 - z (Euler) or
# 1 - z + z^2/2 - z^3/6 + z^4/24 (RK4): within -1..1. Semi-implicit (see chapter): 4 - 4z - z^2 > 0.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (np.sqrt(2.0) - 1.0), "rk4": 2.785294}


def stabilized(step_fn, system, method):
    """step_fn, followed by the method's post_step if it has one."""
    if method.post_step is None:
        return step_fn

    def step(q, v, m, force, dt):
        q_end, v_end = step_fn(q.copy(), v.copy(), m, force, dt)  # which may edit them
        return method.post_step(system, q, q_end, v_end, dt)

    return step


# --- endregion ---
# --- region: simulate ---
def energy(system, q, v):
    """Kinetic and potential energy in J; U = -sum m GRAVITY . q."""
    return np.sum(ordered(system["m"]) * (0.5 * v * v - q * GRAVITY))


def constraint_violation(system, q):
    """The largest rod error in m, whatever its sign: the chapter's number."""
    return np.max(np.abs(rod_errors(system, q)))


def simulate(step_fn, system, force, dt, steps):
    """Take `steps` steps of dt s, and record of each state how far rods are off, and the energy.

    A Run, which unpacks into tip (steps + 1, 3), the last particle's path in m, violations in m and
    energies in J, (steps + 1,) each. By name it has all states, too: q, v (steps + 1, N, 3).
    """
    # compiled(step, steps) is the same step, with the same bits, a hundred times as fast. The loop
    # may edit q[i + 1] and v[i + 1] as it likes; to change dt or a mass midway, use --plain.
    step = compiled(lambda q, v: step_fn(q, v, system["m"], force, dt), steps)
    q, v = np.full((2, steps + 1, *system["q0"].shape), np.nan)
    q[0], v[0] = system["q0"], system["v0"]
    stopped = None
    try:
        for i in range(steps):
            q[i + 1], v[i + 1] = step(q[i], v[i])
    except StepFailed as why:
        stopped = f"lost at {i * dt:.3g} s: {why}"
    # vmap(f)(q, v) is [f(q[0], v[0]), f(q[1], v[1]), ...]
    violations = vmap(lambda q: constraint_violation(system, q))(q)
    energies = vmap(lambda q, v: energy(system, q, v))(q, v)
    return Run(q[:, -1], violations, energies, system, dt, q, v, stopped, step)


# --- endregion ---
# --- region: report ---
def run_method(system, name, integrator, dt, steps, **knobs):
    """The Run of a method by name; `knobs` are those of stabilizations, such as baumgarte=10.0."""
    method = stabilizations(dt, **knobs)[name]
    step_fn = stabilized(INTEGRATORS[integrator], system, method)
    made = simulate(step_fn, system, make_force(system, method), dt, steps)
    return Run.of(made, system, dt)  # your own simulate may return three arrays, as chapter 3.3's


def one_step(system, name, integrator, q, v, dt, **knobs):
    """One step of run_method's, from q, v: for the page and the reference."""
    method = stabilizations(dt, **knobs)[name]
    step_fn = stabilized(INTEGRATORS[integrator], system, method)
    return step_fn(q, v, system["m"], make_force(system, method), dt)


def tensions(system, q, v, method=0.0):
    """How hard each rod pulls, -lambda |d| (C,) in N; below zero it pushes. For the recording."""
    jac, A, b = constraint_equation(system, q, v, as_stabilization(method))
    return -solve(system, A, b, v, jac) * rod_lengths(system, q)


def constraint_residual(system, q, v, method=0.0):
    """The largest acceleration in m/s^2 that a rod needs and no tensions give: 0 without loops."""
    if not systems.has_loop(system):
        return 0.0
    jac, A, b = constraint_equation(system, q, v, as_stabilization(method))
    left = residual(system, A, b, solve(system, A, b, v, jac), jac)  # b - A lambda
    return np.max(np.abs(left) / rod_lengths(system, q))


def summary(system, run, method, reference):
    """What metrics.json says of a run."""
    m_g_L = systems.m_g_L(system, GRAVITY)  # J
    return {
        "max_violation": np.max(run.violations),
        "final_violation": run.violations[-1],
        "energy_rel_max": np.max(np.abs(run.energies - run.energies[0])) / m_g_L,
        "energy_step_max": np.max(np.abs(np.diff(run.energies)), initial=0.0) / m_g_L,
        "constraint_residual": run.largest(partial(constraint_residual, system, method=method)),
        "tip_final": run.tip[-1].tolist(),
        "error": reference.error(run.q),
        "stopped": run.stopped,
    }


def main(argv=None):
    """Run the methods, print the table, and write what it shows."""
    args, system = parse_args(argv)
    run_of = partial(run_method, system, integrator=args.integrator, dt=args.dt, **args.knobs)
    if args.show_step:
        run = run_of(args.methods[0], steps=1)
        print(run.source or run.how)
        return 0
    print(f"ch3.4 constraints | device {args.device}")
    runs = {}
    with plain(args.plain):
        for name in progress.each(args.methods, always=args.plain):
            runs[name] = run_of(name, steps=args.steps)
    exact = partial(one_step, system, "project", "gauss")
    not_compiled = any(run.not_compiled for run in runs.values())
    reference = find_reference(exact, system, GRAVITY, args.dt, args.steps, not_compiled)
    methods = stabilizations(args.dt, **args.knobs)
    results = {name: summary(system, run, methods[name], reference) for name, run in runs.items()}
    table.show(args, runs, results, reference, STABILITY_LIMIT)
    output.write(args, system, runs, results, reference, sys.modules[__name__])  # this file
    return 0


command = partial(cli.run_script, main)  # for the entry point in pyproject.toml
if __name__ == "__main__":
    command()
# --- endregion ---
