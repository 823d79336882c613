"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight that is let go falls; on a rod it swings. How hard does the rod pull? Gravity is given. The
rod's force is not: we solve for it each time an integrator calls force(q, v). This file derives the
linear system, hides it in force(q, v) for chapter 3.3's integrators, and measures how far lengths
drift, what stops the drift, and what that costs.

    python constraints.py                a double pendulum, 20 s, with each method
    python constraints.py --within 1mm   which method and step to take for errors under 1 mm
    python constraints.py --help         what to change, and why you would
"""

# --- region: setup ---
from functools import partial

import numpy as np

from curriculum.ch3_4_constraints import mechanics  # rods in loops, scenes, checks, the true motion
from curriculum.ch3_4_constraints.results import output, table  # what is written and printed
from curriculum.common import cli, exact, gauss, tracing  # flags, cos and sin, an integrator, speed

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2; y is up
PIVOT = np.zeros(3)  # m: where the first rod of a chain is fixed
SMOKE_STEPS = 800  # of a --smoke run: fixed, so that CI can compare two runs byte for byte


# --- endregion ---
# --- region: systems ---
# A system is a dict: N particles, and C rods that tie them. As in chapter 3.3 a state is q and v,
# positions in m and velocities in m/s; now they are (N, 3) each, with a row per particle.
CHAINS = {"pendulum": 1, "double": 2, "triple": 3}  # how many rods each has


def build_system(name, rng=0, links=10):
    """A chain: one of CHAINS, or "chain" with so many `links`. By other names, a scene from a file.

    A chain starts at rest along +x, tilted by a small random angle. `rng`: a Generator or a seed.
    """
    rods = links if name == "chain" else CHAINS.get(name)
    if rods is None:
        return mechanics.load_scene(name, GRAVITY, CHAINS)
    length = 1.0  # m, of each rod
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)  # rad; all that is random here
    # The last digits of np.cos and np.sin depend on the processor, and a chain is chaotic.
    along = length * np.array([exact.cos(tilt), -exact.sin(tilt), 0.0])
    system = {
        "q0": np.array([PIVOT + (k + 1) * along for k in range(rods)]),  # (N, 3) m
        "v0": np.zeros((rods, 3)),  # (N, 3) m/s
        "m": np.ones((rods, 1)),  # (N, 1) kg: a column, so that force / m divides row by row
        "pairs": [(k, k - 1) for k in range(rods)],  # a rod (i, j) ties i to j; -1 is PIVOT
        "lengths": np.full(rods, length),  # (C,) m
    }
    return mechanics.check_system(system, PIVOT)  # a checked copy


def external_force(system, q, v=None):
    """All forces but the rods', (N, 3) in newtons. Add drag here if you like: energy() omits it."""
    return system["m"] * GRAVITY + system.get("load", 0.0)  # a scene may have a load, (N, 3) in N


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i, and L its length. Then
#     g = (d . d - L^2) / 2 = 0            (squares: no root to differentiate; 1/2 cancels the 2)
# is its constraint, . being the dot product. Differentiate twice in time, with d_dot = v_i - v_j:
#     gdot  = d . d_dot
#     gddot = d . (a_i - a_j) + d_dot . d_dot
# Stack v and a of all particles into vectors of 3N numbers. Then all gdot are J v, where J = dg/dq,
# the Jacobian, has a row per rod: d in the three columns of i, -d in those of j (PIVOT has none), 0
# elsewhere. With two rods, from PIVOT to particle 0 and on to 1, it is
#     J = ( d_0     0  )
#         (-d_1    d_1 )
# Jdot is J with d_dot in place of d. So, for all rods, the line for gddot reads
#     gddot = J a + Jdot v
# A rod without mass pulls or pushes its two ends equally, along d: lambda d on i, -lambda d on j.
# That is lambda times its row of J; all rods together give J^T lambda. So each rod has one unknown,
# its Lagrange multiplier lambda, in N/m, below 0 if the rod pulls. Newton, with masses M (a
# diagonal: each mass three times) and all other forces f, says
#     M a = f + J^T lambda
# If g and gdot start at 0 and gddot stays 0, a rod keeps its length. So set gddot = 0, and put in
# a = M^-1 (f + J^T lambda):
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and only lambda is unknown. That is the chapter.
# Try it: 2 kg pass 1 m below PIVOT at 3 m/s. J = (0, -1, 0), J M^-1 J^T = 1/2, J M^-1 f = 9.81 and
# Jdot v = 9: lambda = -37.62. J^T lambda is (0, 37.62, 0) N: the weight, 19.62, and m v^2 / L = 18.
def constraint_terms(system, q, v):
    """Of C rods: J (C, 3N) in m; g in m^2, gdot in m^2/s and Jdot v in m^2/s^2, (C,) each."""
    jac = []  # in each list an entry per rod; stacked at the end
    g = []
    gdot = []
    jdotv = []
    for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
        row = np.zeros_like(q)  # (N, 3): row[i] has the three columns of particle i
        if j < 0:  # j is a fixed point
            d = q[i] - anchor(system, j)
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


def anchor(system, j):
    """A fixed point, (3,) in m: PIVOT, for j = -1. A scene may have its own, for j = -1, -2, ..."""
    return system.get("anchors", [PIVOT])[-1 - j]


def solve(system, A, b, v=None):
    """lambda (C,), with A lambda = b. Rods in a loop can make A singular: v tells how they turn."""
    if mechanics.has_loop(system):
        return mechanics.solve_loops(system, A, b, v)
    return np.linalg.solve(A, b)


# gddot = 0 pulls nothing back: an error in g stays, and one in gdot makes g grow. And steps make
# errors: semi_implicit goes straight, along the tangent of the rod's circle. In a run that starts
# at rest every step adds dt^2 |d_dot|^2 / 2 to g, d_dot being the new one; the chapter proves it.
# So ask that g move like a damped spring (J. Baumgarte, 1972):
#     gddot = -2 w gdot - w^2 g
# Try g = e^(rt): r^2 + 2 w r + w^2 = (r + w)^2 = 0, so r = -w, twice: e^(-wt) and t e^(-wt) fit.
# That is critical damping: less damping would overshoot, more would be slower. An error let go dies
# like (1 + wt) e^(-wt): with w = 20 rad/s 1 % is left after 1/3 s. But each step makes a new error.
# Once g has settled, semi_implicit has gdot = dt |d_dot|^2 / 2 after a step, and the terms with w
# cancel at g = -2 gdot / w. So a rod is short by -g / L, 5 mm after a fall from level if dt = 5 ms.
def constraint_force(system, q, v, w=0.0):
    """The rods' force J^T lambda, (N, 3) in newtons; `w`, in rad/s, sets how fast g dies."""
    m = np.repeat(system["m"], 3)  # kg, one per coordinate: x / m is M^-1 x, jac / m is J M^-1
    f = external_force(system, q, v).ravel()
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    A = (jac / m) @ jac.T  # J M^-1 J^T, (C, C) in m^2/kg
    b = -(jac @ (f / m) + jdotv)  # for gddot = 0, (C,) in m^2/s^2
    b = b - 2.0 * w * gdot - w * w * g  # Baumgarte's two terms; nothing if w = 0
    lam = solve(system, A, b, v)
    return (jac.T @ lam).reshape(q.shape)


def make_force(system, w=0.0):
    """force(q, v), (N, 3) in newtons: all that an integrator sees. RK4 calls it four times."""

    def force(q, v):
        return external_force(system, q, v) + constraint_force(system, q, v, w)

    return force


# --- endregion ---
# --- region: integrators ---
# The code of euler, semi_implicit and rk4 is chapter 3.3's: (q, v, m, force, dt) -> (q, v).
def euler_step(q, v, m, force, dt):
    """Explicit Euler, order 1: everything at the old state. It adds energy to a pendulum."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit Euler, order 1: first the new velocity, then a step with that."""
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
    "gauss": gauss.make_gauss(8),  # order 16: to measure the others by; it is not derived here
}


# --- endregion ---
# --- region: simulate ---
def energy(system, q, v):
    """Kinetic plus potential energy, in joules, of one state or of many.

    Rods do not change it while gdot is 0: a rod's power, lambda d . (v_i - v_j), is lambda gdot.
    """
    kinetic = 0.5 * np.sum(system["m"] * v * v, axis=(-2, -1))  # over particles and x, y, z
    force = system["m"] * GRAVITY + system.get("load", 0.0)  # without drag: it has no potential
    potential = -np.sum(force * q, axis=(-2, -1))
    return kinetic + potential


def rod_lengths(system, q):
    """How long each rod is, (..., C) in m, at q (..., N, 3): in one state or in each of many."""
    lengths = []
    for i, j in system["pairs"]:
        end = anchor(system, j) if j < 0 else q[..., j, :]
        d = q[..., i, :] - end
        lengths.append(np.sqrt(np.sum(d * d, axis=-1)))
    return np.stack(lengths, axis=-1)


def constraint_violation(system, q):
    """The largest rod error, in m, whatever its sign."""
    return np.max(np.abs(rod_lengths(system, q) - system["lengths"]), axis=-1)


def tensions(system, q, v, force):
    """How hard each rod pulls, -lambda |d|, (C,) in newtons; where that is below 0, it pushes.

    Any method's force(q, v) hides its lambda: the rods' part of it is J^T lambda. If rods are
    redundant many lambda fit, and this takes the smallest. What a post_step does is not counted.
    """
    jac, _, _, _ = constraint_terms(system, q, v)
    rods_force = force(q, v) - external_force(system, q, v)
    lam = mechanics.least_squares(jac.T, rods_force.ravel())
    return -lam[: len(system["pairs"])] * rod_lengths(system, q)  # J may end with rows of yours


class Run:
    """All states of a run, and what is measured in them: `tip, violations, energies = run`."""

    def __init__(self, system, q, v):
        self.q = q  # (steps + 1, N, 3), in m
        self.v = v  # (steps + 1, N, 3), in m/s
        self.tip = q[:, -1]  # (steps + 1, 3): the path of the last particle, in m
        self.violations = constraint_violation(system, q)  # (steps + 1,), in m
        self.energies = energy(system, q, v)  # (steps + 1,), in joules

    def __iter__(self):
        return iter((self.tip, self.violations, self.energies))


def simulate(step_fn, system, force, dt, steps):
    """Take `steps` steps of dt s from q0, v0. Keep and measure every state: the Run."""
    q = system["q0"].copy()
    v = system["v0"].copy()
    m = system["m"]
    all_q = np.full((steps + 1, *q.shape), np.nan)  # rows stay NaN if you `break` the loop
    all_v = np.full((steps + 1, *v.shape), np.nan)
    all_q[0] = q
    all_v[0] = v
    for i in range(steps):
        q, v = step_fn(q, v, m, force, dt)
        all_q[i + 1] = q
        all_v[i + 1] = v
    return Run(system, all_q, all_v)


# --- endregion ---
# --- region: methods ---
# A method makes force(q, v), and it may do something after each step.
# Game engines, and MuJoCo for a tendon, treat J as constant during a step: they leave Jdot v out.
# They may also let a rod yield, in proportion to lambda. They ask for
#     J a = -damping gdot - stiffness g - R lambda
# where R is A's diagonal times `softness`. With M a = f + J^T lambda that is
#     (A + R) lambda = -J M^-1 f - damping gdot - stiffness g
def make_engine_force(system, damping, stiffness, softness=0.0):
    """make_force for what engines ask; `damping` in 1/s, `stiffness` in 1/s^2."""

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


# project puts the end of a step back onto the rods. semi_implicit pulls along the rods as they were
# at the start: J_start. The correction does, too: q moves by -M^-1 J_start^T mu, with mu such that
# g = 0. As dg/dmu = -J M^-1 J_start^T, a round of Newton's method is
#     J M^-1 J_start^T dmu = g
# A step moves q by about dt v: so where q is moved by dq, v changes by dq / dt. Last, v loses what
# would change a rod's length:
#     J M^-1 J^T nu = gdot, so that J (v - M^-1 J^T nu) = 0
def project(system, q_start, q, v, dt):
    """Move q, v (N, 3), the end of a step from q_start, back to where g = 0 and J v = 0.

    SHAKE moves q like this (J.-P. Ryckaert et al., J. Comput. Phys. 23 (1977) 327). RATTLE corrects
    v, too (H. Andersen, ibid. 52 (1983) 24).
    """
    m = np.repeat(system["m"], 3)
    jac_start, _, _, _ = constraint_terms(system, q_start, v)  # J does not depend on v
    tolerance = mechanics.tolerance(system, q_start, len(jac_start))  # of g: about 1e-12 L^2

    def is_off(q):
        _, g, _, _ = constraint_terms(system, q, v)
        return np.max(np.abs(g / tolerance)) > 1.0

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        dmu = solve(system, (jac / m) @ jac_start.T, g)
        return q - (jac_start.T @ dmu / m).reshape(q.shape)

    # while is_off(q): q = newton(q), at most 20 times, in a form that can be compiled
    end = tracing.while_loop(is_off, newton, q, most=20, failure="no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    nu = solve(system, (jac / m) @ jac.T, gdot)
    return end, v - (jac.T @ nu / m).reshape(q.shape)


class Method:
    """How to hold the rods. Add yours to make_methods: table and page will show it."""

    def __init__(self, make_force, words, post_step=None, integrator=None):
        self.make_force = make_force  # system -> force(q, v)
        self.words = words  # what it does
        self.post_step = post_step  # (system, q_start, q, v, dt) -> (q, v), after each step
        self.integrator = integrator  # the only one it works with, if there is one


def make_methods(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The methods by name. `dt` and `time_constant`, tau, in s; `baumgarte` in rad/s."""
    # impulse, a force times dt (E. Catto, GDC 2005): semi_implicit takes g to g + dt J v_next, plus
    # dt^2 |d_dot|^2 / 2, which is dropped. Set the rest to 0: J v_next = -g/dt.
    # As v_next = v + dt a and J v = gdot, that is J a = -gdot/dt - g/dt^2.
    impulse = partial(make_engine_force, damping=1.0 / dt, stiffness=1.0 / (dt * dt))

    # soft is MuJoCo's, with a fixed impedance p. For one rod A + R = A / p, so J a is p times what
    # is asked plus 1 - p times what f alone gives: -2 gdot/tau - g/tau^2 + (1 - p) J M^-1 f.
    # At rest a 1 m pendulum is (1 - p) tau^2 9.81 m/s^2 = 0.2 mm too long. Fallen from level, in
    # semi_implicit, it is 6 mm too long, as Jdot v is left out.
    p = impedance
    tau = np.maximum(time_constant, 2.0 * dt)  # MuJoCo keeps it at two steps or more
    soft = partial(
        make_engine_force,
        damping=2.0 / (p * tau),
        stiffness=1.0 / (p * tau * tau),
        softness=(1.0 - p) / p,
    )
    return {
        "none": Method(make_force, "asks for gddot = 0: errors stay, and rods drift"),
        "baumgarte": Method(partial(make_force, w=baumgarte), "makes g move like a damped spring"),
        "impulse": Method(impulse, "aims at g = 0 after a step", integrator="semi_implicit"),
        "soft": Method(soft, "lets a rod yield, as MuJoCo does"),
        "project": Method(make_force, "puts q and v back after each step", project),
    }


def stabilized(step_fn, system, method):
    """step_fn, followed by the method's post_step if it has one."""

    def step(q, v, m, force, dt):
        q_end, v_end = step_fn(q.copy(), v.copy(), m, force, dt)  # copies: step_fn may edit them
        if method.post_step:
            q_end, v_end = method.post_step(system, q, q_end, v_end, dt)
        return q_end, v_end

    return step


# --- endregion ---
# --- region: report ---
# A run by hand, with one method:
#     system = build_system("double")
#     run = simulate(semi_implicit_step, system, make_force(system, w=20.0), dt=0.005, steps=4000)
#     print(f"rods off by {run.violations.max():.4f} m")
def main(argv=None):
    """Run each method, in compiled steps, print what became of the rods, and write it to files."""
    args, system = parse_args(argv)
    print(f"ch3.4 constraints | device {args.device}")
    methods = make_methods(args.dt, **args.knobs)
    runs = {}
    results = {}
    with tracing.plain(args.plain):  # compiles nothing, if so asked
        for name in cli.progress(args.methods):
            run = run_method(system, name, args.integrator, args.dt, args.steps, **args.knobs)
            runs[name] = run
        # Rods can be right, the path wrong. So compare places with the true motion: gauss with
        # project, in steps so short that shorter ones change nothing, before chaos has spread.
        reference = mechanics.find_reference(system, make_force(system), project, runs.values())
        for name, run in runs.items():
            results[name] = summary(system, run, methods[name], reference)
    print_table(args, runs, results, reference)
    output.write(args, system, runs, results, reference)  # the answer to --within, and all files
    return 0


def run_method(system, name, integrator, dt, steps, **knobs):
    """Run a method, by name: run_method(build_system("double"), "soft", "rk4", 0.005, 4000)."""
    system = mechanics.check_run(system, PIVOT, dt, steps, external_force)  # a checked copy
    method = make_methods(dt, **knobs)[name]
    if method.integrator not in (None, integrator):
        raise ValueError(f"{name} is not made for {integrator}")
    step_fn = stabilized(INTEGRATORS[integrator], system, method)
    step_fn = tracing.compiled(step_fn, steps)  # the same numbers, but faster
    run = simulate(step_fn, system, method.make_force(system), dt, steps)
    # An Outcome is cut where the run failed, or was `lost`. It knows `pace`, us, and `operations`.
    return mechanics.Outcome(run, system, dt, step_fn, GRAVITY)


def summary(system, run, method, reference):
    """What metrics.json says about a run."""
    pull = partial(tensions, system, force=method.make_force(system))
    pulls = tracing.vmap(pull)(run.q, run.v)  # (steps + 1, C) in N: pull(q, v) of all states
    m_g_L = mechanics.m_g_L(system, GRAVITY)  # joules: all masses times g times all rods
    return {
        "max_violation": np.max(run.violations),  # m, over all states
        "final_violation": run.violations[-1],  # m
        "conserves": mechanics.conserves(system, external_force, energy),  # not with drag
        "energy_rel_max": np.max(np.abs(run.energies - run.energies[0])) / m_g_L,
        **table.largest_force(pulls),  # tension_max in N, and by how much it may be larger
        "operations": run.operations,
        "tip_final": run.tip[-1].tolist(),  # m
        "error": reference.error(run.q),  # m, of the worst particle, at the reference's time
        "stopped": run.stopped,  # when and why, if it ended early
    }


def print_table(args, runs, results, reference):
    """Print a row for each method. A new column: a key in summary, a heading and a line here."""
    table.title(args, runs)  # what was run, and how
    print("\n               rods off by      energy off    largest   places off    a step")
    print(f"method         worst    at end    of m g L   force, N{reference.at:>13}        us")
    for name, row in results.items():
        run = runs[name]
        if run.lost:  # it failed or diverged
            table.say(f"{name:12}{run.lost}")
            continue
        star = "*" if table.doubts(row, run) else ""  # a note says why
        print(
            f"{name + star:12}"
            f"{table.length(row['max_violation']):>8}"  # 0.384 m is "38 cm"
            f"{table.length(row['final_violation']):>10}"
            f"{table.energy(row):>12}"  # "-" where it need not stay
            f"{table.force(row):>11}"  # "over 450", if it may be larger between steps
            f"{table.error(row['error'], reference):>13}"  # no finer than the reference
            f"{run.pace:>10.3g}"
        )
    table.notes(args, runs, results, reference, INTEGRATORS[args.integrator])  # what * and - mean


def parse_args(argv=None):
    """Parse the flags and build the system they ask for."""
    parser = cli.Parser(__doc__, "studies: python -m curriculum.ch3_4_constraints.studies --help")
    add = parser.add_argument
    known = [*CHAINS, "chain", *mechanics.SHIPPED]
    every = make_methods()
    words = "; ".join(f"{name} {method.words}" for name, method in every.items())
    add("--system", default="double", help=f"{', '.join(known)}, or the file of a scene")
    add("--links", type=cli.whole(1, 300), default=10, help="how many rods --system chain has")
    add("--seed", type=cli.whole(0), default=0, help="tilts the start, within 0.05 rad of level")
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="what calls force(q, v)")
    add("--stabilization", choices=["all", *every], default="all", help=words)
    add("--baumgarte", type=cli.number(0), default=20.0, help="w in rad/s: too high, it explodes")
    add("--time-constant", type=cli.positive, default=0.02, help="of soft, in s")
    add("--dt", type=cli.positive, default=0.005, help="one step in s: halve it, see what halves")
    add("--steps", type=cli.whole(1), default=4000, help="how many: drift adds up")
    add("--within", type=cli.length, help="find the cheapest settings right to 1mm, 1um, ...")
    add("--smoke", action="store_true", help=f"{SMOKE_STEPS} steps, for CI")
    add("--plain", action="store_true", help="compile nothing: print() and breakpoint() anywhere")
    add("--device", choices=["cpu"], default="cpu", help="the only choice")
    add("--rerun", action=cli.Switch, default=True, help="write a recording")
    add("--page", action=cli.Switch, default=True, help="write play.html")
    add("--out", type=cli.folder, default="outputs/ch3.4-constraints", help="where to write")
    args = parser.parse_args(argv)
    args.steps = SMOKE_STEPS if args.smoke else args.steps
    args.this_file = globals()  # with your edits: play.html runs its functions
    args.knobs = {"baumgarte": args.baumgarte, "time_constant": args.time_constant}
    with parser.errors("argument --system: "):
        system = build_system(args.system, args.seed, args.links)
    with parser.errors():
        args.methods, args.left_out = output.methods_of(args, every)
        output.check(args, system)
    return args, system


command = partial(cli.run_script, main)  # for the entry point in pyproject.toml
if __name__ == "__main__":
    command()
# --- endregion ---
