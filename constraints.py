"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

A weight that is let go falls; on a rod it swings. How hard does the rod pull? Gravity is given. The
rod's force is not: we solve for it each time an integrator calls force(q, v). This file derives the
linear system, hides it in force(q, v) for chapter 3.3's integrators, and measures how far lengths
drift, what stops the drift, and what that costs.

    python constraints.py                a double pendulum, 20 s, with each method
    python constraints.py --within 1mm   which method and step to take for errors under 1 mm
    python constraints.py --plain        compile nothing: print() and breakpoint() work anywhere
    python constraints.py --help         what to change, and why you would
"""

# --- region: setup ---
from functools import partial

import numpy as np

from curriculum.ch3_4_constraints import (
    report,  # the table and the files
    rods,  # scenes from files, closed loops, the true motion
)
from curriculum.common import (
    cli,  # flags
    tracing,  # steps that are compiled, so that they are faster
)
from curriculum.common.exact import cos, sin  # whose last digits are those of any processor

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2; y is up
PIVOT = np.zeros(3)  # m: where the first rod of a chain is fixed
SMOKE_STEPS = 800  # of a --smoke run: few, since CI makes two and compares them byte for byte


# --- endregion ---
# --- region: systems ---
# N particles, and C rods that tie them. As in chapter 3.3 a state is q and v, positions in m and
# velocities in m/s; now they are (N, 3) each, with a row per particle. Masses are a column, (N, 1),
# so that force / m divides row by row. A rod is a pair (i, j): it ties particle i to particle j,
# or to PIVOT if j is -1. So the double pendulum has the pairs (0, -1) and (1, 0).
CHAINS = {"pendulum": 1, "double": 2, "triple": 3}  # how many rods each has


def build_system(name, rng=0, links=10):
    """A chain from PIVOT: one of CHAINS, or "chain" with so many `links`. Or a scene, by name.

    A chain starts at rest along +x, tilted by a small random angle. `rng`: a Generator or a seed.
    """
    count = links if name == "chain" else CHAINS.get(name)
    if count is None:
        return rods.load_scene(name, GRAVITY, CHAINS)  # from a file
    length = 1.0  # m, of each rod
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)  # rad; all that is random here
    along = length * np.array([cos(tilt), -sin(tilt), 0.0])
    return {
        "q0": np.array([PIVOT + (k + 1) * along for k in range(count)]),  # (N, 3) m, at the start
        "v0": np.zeros((count, 3)),  # (N, 3) m/s
        "m": np.ones((count, 1)),  # (N, 1) kg
        "pairs": [(k, k - 1) for k in range(count)],  # C of them
        "lengths": np.full(count, length),  # (C,) m
        "anchors": np.array([PIVOT]),  # what j = -1 is, in m; a scene may have more: -2, -3, ...
    }


def external_force(system, q, v):
    """All forces but the rods', (N, 3) in newtons. Add drag here if you like: - 0.2 * v."""
    return system["m"] * GRAVITY + system.get("load", 0.0)  # a scene may have a load, (N, 3) in N


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i, and L its length. Then
#     g = (d . d - L^2) / 2 = 0            (squares: no root to differentiate; 1/2 cancels the 2)
# is its constraint, . being the dot product. Differentiate twice in time, with d_dot = v_i - v_j:
#     gdot  = d . d_dot
#     gddot = d . (a_i - a_j) + d_dot . d_dot
# Write the v of all particles into one column, 3N numbers, and their a likewise. Then gdot = J v,
# and with two rods, from PIVOT to particle 0 and on to 1, J is
#     J = ( d_0     0  )
#         (-d_1    d_1 )
# This Jacobian, J = dg/dq, has a row per rod: d in the three columns of i, -d in those of j (PIVOT
# has none), 0 elsewhere. Jdot is J with d_dot in place of d, so a rod's row of it, times v, is
# d_dot . (v_i - v_j), that is d_dot . d_dot. For all rods the line for gddot reads
#     gddot = J a + Jdot v
# A rod without mass pulls or pushes its two ends equally, along d: lambda d on i, -lambda d on j.
# That is lambda times its row of J; all rods together give J^T lambda. So each rod has one unknown,
# its Lagrange multiplier lambda, in N/m, below 0 if the rod pulls. Newton, with masses M (a
# diagonal: each mass three times) and all other forces f, says
#     M a = f + J^T lambda
# If g and gdot start at 0 and gddot stays 0, a rod keeps its length. So set gddot = 0, and put in
# a = M^-1 (f + J^T lambda):
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# These are as many equations as rods, and only lambda is unknown. That is the chapter. Call the
# matrix A = J M^-1 J^T. For the two rods above, its entry off the diagonal is -d_0 . d_1 / m_0:
# both end at particle 0, so the pull of one moves an end of the other. All are solved at once.
# Try it: a particle of 2 kg passes 1 m below PIVOT at 3 m/s. J = (0, -1, 0), J M^-1 J^T = 1/2,
# J M^-1 f = 9.81 and Jdot v = 9, so lambda = -37.62 N/m, and J^T lambda = (0, 37.62, 0) N: its
# weight, 19.62 N, and m v^2 / L = 18 N to bend its path.
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
    """The fixed point j, (3,) in m: of the anchors -1 is the first, -2 the second."""
    return system.get("anchors", [PIVOT])[-1 - j]


def solve(system, A, b, v=None):
    """lambda (C,), so that A lambda = b: A (C, C), b (C,).

    Rods that close a loop may be one too many. Then A is singular, and many lambda give one
    J^T lambda. Where A is nearly singular, it counts how the rods move: `v`, (N, 3) in m/s.
    """
    if rods.has_loop(system):
        return rods.solve_loops(system, A, b, v)
    return np.linalg.solve(A, b)


# Why rods drift, under semi_implicit; other integrators err by other amounts. A step first changes
# v, and so d_dot; call the new one u. Then it moves q straight on, and so d:
#     new d = d + dt u
# What that does to the rod depends on s = d . u, of the old d and the new d_dot:
#     new g = g + dt s + dt^2 |u|^2 / 2
#     new gdot = (new d) . u = s + dt |u|^2
# The next step changes v by dt a, and gddot = 0 asks for (new d) . (a_i - a_j) = -|u|^2. So
#     new s = (new d) . (u + dt (a_i - a_j)) = new gdot - dt |u|^2 = s
# From rest s is 0, and stays 0. Then each step goes along the tangent and ends outside the circle,
# and nothing takes that back, as gddot = 0 never looks at g. A rod is off by about g / L: after a
# fall of 1 m |u| is 4.43 m/s, |u|^2 = 19.62 m^2/s^2, and each step of 5 ms adds 0.245 mm to a rod
# of 1 m.
#
# What pulls it back. Instead of gddot = 0, ask for a damped spring (J. Baumgarte, 1972):
#     gddot = -2 w gdot - w^2 g
# Its two terms join the right side of the linear system. Try g = exp(rt): (r + w)^2 = 0, so r = -w.
# As this root is double, t exp(-wt) is a solution, too. If gdot is 0 at first, g becomes what it
# was, times (1 + wt) exp(-wt): with w = 20 rad/s, 1 % is left after 1/3 s. Less damping would
# overshoot, more would take longer: this is critical.
#
# What is left, again under semi_implicit. At constant speed, new g = g if
#     s = -dt |u|^2 / 2
# which is a little inward, to make up for the straight step. But the next solve finds
#     new gdot = s + dt |u|^2 = +dt |u|^2 / 2
# and takes it for a rod that grows. The damper pulls, until the rod is so short that the spring
# pushes out as hard:
#     w^2 g = -2 w (new gdot), so g = -dt |u|^2 / w
# At 4.43 m/s it is 5 mm too short. Half the dt or twice the w halves that. But there is a limit.
# If |u|^2 is small enough to leave out, a step makes s = gdot - dt (2 w gdot + w^2 g), and then
# new g = g + dt s and new gdot = s. So with z = w dt it multiplies (g, dt gdot) by
#     ( 1 - z^2   1 - 2z )
#     (    -z^2   1 - 2z )
# At z = 0.83, w = 166 rad/s at 5 ms, one of its eigenvalues is -1, and beyond it below -1: each
# step overshoots more than the last, and the run explodes.
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


# This is the seam: an integrator wants force(q, v), and need not know that rods are in it. For rk4,
# which asks for four forces a step, the rods are solved for four times.
def make_force(system, w=0.0):
    """force(q, v), (N, 3) in newtons: all other forces and the rods'. `w` in rad/s."""

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
}


# --- endregion ---
# --- region: simulate ---
def trajectory(step_fn, system, force, dt, steps):
    """All states of `steps` steps of dt s from q0, v0: (steps + 1, N, 3) in m and in m/s."""
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
    return all_q, all_v


def simulate(step_fn, system, force, dt, steps):
    """Run, and measure every state: where the last particle is, (steps + 1, 3) in m, the worst rod
    error, (steps + 1,) in m, and the energy, (steps + 1,) in joules."""
    q, v = trajectory(step_fn, system, force, dt, steps)
    violations = np.array([constraint_violation(system, q[i]) for i in range(steps + 1)])
    energies = np.array([energy(system, q[i], v[i]) for i in range(steps + 1)])
    return q[:, -1], violations, energies


def energy(system, q, v):
    """Kinetic plus potential energy in J, of a state q, v, (N, 3) each.

    Rods do not change it while gdot is 0: a rod's power, lambda d . (v_i - v_j), is lambda gdot.
    """
    kinetic = 0.5 * np.sum(system["m"] * v * v)
    # Drag has no potential, and is not here. If you add a spring, add its energy.
    force = system["m"] * GRAVITY + system.get("load", 0.0)
    potential = -np.sum(force * q)
    return kinetic + potential


def rod_lengths(system, q):
    """How long each rod is, (C,) in m, at q (N, 3)."""
    lengths = []
    for i, j in system["pairs"]:
        end = anchor(system, j) if j < 0 else q[j]
        d = q[i] - end
        lengths.append(np.sqrt(np.sum(d * d)))
    return np.stack(lengths)


def constraint_violation(system, q):
    """The largest rod error at q (N, 3), in m, without its sign."""
    return np.max(np.abs(rod_lengths(system, q) - system["lengths"]))


# For the double pendulum, simulate(semi_implicit_step, system, make_force(system, w), 0.005, 4000)
# finds a rod 384 mm off with w = 0, and 23.5 mm with w = 20. That ends a first sitting.


# --- endregion ---
# --- region: methods ---
# How engines hold rods. You have two ways, w = 0 and w > 0, and `none` and `baumgarte` are their
# names. Here are three more. All five are one table, make_methods.
#
# Game engines take J as constant during a step: they leave Jdot v out. A circle needs
# J a = -|d_dot|^2, and nothing asks for it now. But each straight step leaves an error in gdot and
# g, and what takes that error back bends the path. Engines may also make a rod soft, so that it
# gives way in proportion to lambda:
#     J a = -damping gdot - stiffness g - R lambda
# R (in ODE, CFM / dt) is A's diagonal times `softness`. With M a = f + J^T lambda that is
#     (A + R) lambda = -J M^-1 f - damping gdot - stiffness g
def make_engine_force(system, damping, stiffness, softness=0.0):
    """force(q, v), (N, 3) in newtons, as in engines: make_force with that linear system.

    `damping` in 1/s, `stiffness` in 1/s^2; `softness` is a share of A.
    """

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


# project puts the end of a step back onto the rods. It corrects the pull that the step has had, so
# it pulls along the same lines, those of the rods at the start, J_start: q moves by
# -M^-1 J_start^T mu, with mu such that g = 0. As g is not linear in mu, that takes rounds of
# Newton's method. A round adds dmu to mu, and so changes g by about -J M^-1 J_start^T dmu. That is
# to be -g:
#     J M^-1 J_start^T dmu = g
# A step moves q by about dt v: so if q is moved by dq, v changes by dq / dt. Last, v loses what
# would change a rod's length. For v, nu does what lambda does for a:
#     J M^-1 J^T nu = gdot, so that J (v - M^-1 J^T nu) = 0
def project(system, q_start, q, v, dt):
    """Move q, v (N, 3), the end of a step from q_start, back to where g = 0 and J v = 0.

    SHAKE moves q like this, a rod at a time (J.-P. Ryckaert et al., J. Comput. Phys. 23 (1977)
    327). RATTLE corrects v, too (H. Andersen, ibid. 52 (1983) 24).
    """
    m = np.repeat(system["m"], 3)
    jac_start, _, _, _ = constraint_terms(system, q_start, v)  # J does not depend on v
    tolerance = rods.tolerance(system, q_start, len(jac_start))  # of g: about 1e-12 L^2

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
    """How to hold the rods: a force, and what is done after each step, if anything is.

    Add yours to make_methods: table, answer, page and recording will have it.
    """

    def __init__(self, make_force, words, post_step=None, integrator=None):
        self.make_force = make_force  # system -> force(q, v)
        self.words = words  # what it does
        self.post_step = post_step  # (system, q_start, q, v, dt) -> (q, v), after each step
        self.integrator = integrator  # the only one that it works with, if there is one

    def fits(self, integrator):
        """Whether it works with the integrator of that name."""
        return self.integrator in (None, integrator)


def make_methods(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The methods by name. `dt` and `time_constant`, tau, in s; `baumgarte` in rad/s."""
    # impulse (E. Catto, GDC 2005) looks one step ahead. semi_implicit makes
    #     new g = g + dt J v_next + dt^2 |d_dot|^2 / 2
    # Drop the last term, and ask for new g = 0: J v_next = -g/dt. As v_next = v + dt a, that is
    #     J a = -gdot/dt - g/dt^2
    # (Engines solve for dt lambda, an impulse.) What was dropped stays, but does not accumulate:
    # 0.245 mm at 4.43 m/s. (Engines take back part of g only, and sweep over the rods instead of
    # solving for all.)
    impulse = partial(make_engine_force, damping=1.0 / dt, stiffness=1.0 / (dt * dt))

    # soft is MuJoCo's rule, with a fixed impedance p; a load at rest stretches no rod with p = 1.
    # One rod has A + R = A/p. So A lambda is p times the right side, and J a = J M^-1 f + A lambda
    # is
    #     J a = -2 gdot/tau - g/tau^2 + (1 - p) J M^-1 f
    # Hanging at rest, J a and gdot are 0, and a rod of 1 m is (1 - p) tau^2 9.81 m/s^2 = 0.2 mm too
    # long. Swinging at 4.43 m/s with a constant g, J a = -|d_dot|^2, since gddot = 0. Under
    # semi_implicit, gdot = dt |d_dot|^2 / 2, as above. Without the small (1 - p) term, that makes
    #     g = tau^2 |d_dot|^2 - tau dt |d_dot|^2
    # and a rod of 1 m is 8 mm - 2 mm = 6 mm too long.
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
    """step_fn, (q, v, m, force, dt) -> (q, v), followed by the method's post_step if it has one."""

    def step(q, v, m, force, dt):
        q_end, v_end = step_fn(q.copy(), v.copy(), m, force, dt)  # copies: step_fn may edit them
        if method.post_step:
            q_end, v_end = method.post_step(system, q, q_end, v_end, dt)
        return q_end, v_end

    return step


def tensions(system, q, v, force):
    """How hard each rod pulls, -lambda |d|, (C,) in newtons; where that is below 0, it pushes.

    `force` is any method's. What it adds to external_force is J^T lambda: find that lambda. What a
    post_step does, as project's, is not in it.
    """
    jac, _, _, _ = constraint_terms(system, q, v)
    everything = force(q, v).ravel()
    others = external_force(system, q, v).ravel()
    lam = rods.least_squares(jac.T, everything, others)  # J^T lambda = everything - others
    lengths = rod_lengths(system, q)
    return -lam[: len(lengths)] * lengths  # of rods alone, if you add rows to J


# --- endregion ---
# --- region: report ---
def compare(system, integrator="semi_implicit", dt=0.005, steps=4000, **knobs):
    """Run each method for so many steps of dt s, and print its worst rod error and the energy that
    it has added by the end."""
    for name, method in make_methods(dt, **knobs).items():
        if not method.fits(integrator):
            continue
        step_fn = stabilized(INTEGRATORS[integrator], system, method)
        force = method.make_force(system)
        _, violations, energies = simulate(step_fn, system, force, dt, steps)
        added = energies[-1] - energies[0]
        print(f"{name:10}{1e3 * violations.max():6.1f} mm {added:+7.2f} J")


# To try it, start Python in this file's folder and type: from constraints import *
# Then compare(build_system("double")) prints
#     none       384.0 mm  -16.76 J
#     baumgarte   23.5 mm  +12.37 J
#     impulse      1.3 mm   -0.12 J
#     soft        29.6 mm  -10.63 J
#     project      0.0 mm   -0.07 J
# Why are rods off by so much? Under none nothing takes an error back: 4000 steps of about 0.1 mm
# add up. The regions constraints and methods have formulas for three others, with figures for
# 4.43 m/s. But here the lower rod's ends move faster, relative to each other:
#     method     formula for g, L = 1 m  greatest |u|  by the formula      measured
#     baumgarte  dt |u|^2 / w              11.0 m/s     30 mm too short     23.5 mm
#     impulse    dt^2 |u|^2 / 2            10.2 m/s    1.3 mm too long       1.3 mm
#     soft       (tau^2 - tau dt) |u|^2    10.1 m/s     31 mm too long      29.6 mm
# impulse follows |u|^2 within a step. The others need time: about 2/w = 0.1 s and 2 tau = 0.04 s.
# When their error is greatest, |u| is past its greatest: so they stay below.
#
# Why is energy off by so much? As g changes by dg, a rod does the work lambda dg. Most of the time
# rods pull, lambda < 0: one that gets longer takes energy, and one that gets shorter gives it.
#     none       only gets longer: energy is lost.
#     baumgarte  is shortest about 0.1 s after it was fastest. So it still gets shorter where it
#                pulls hardest, and longer again where it pulls less: energy is gained, as by a
#                child that stands up on a swing at its lowest point.
#     soft       is longest about 0.04 s after it was fastest: the other way round, energy is lost.
#     impulse, project   hardly change g, so they hardly change energy.


# --- endregion ---
# --- region: run ---
# No mechanics from here on: what `python constraints.py` measures besides, prints, and writes.
def main(argv=None):
    """Run each method, print what became of the rods, and write it to files."""
    asked = parse_args(argv)
    system = asked.system
    print(f"ch3.4 constraints | device {asked.device}")
    with tracing.plain(asked.plain):  # with --plain each step is ordinary Python
        # 1. Run each method.
        runs = {}
        for name in cli.progress(asked.methods):  # with a bar that shows how far it is
            runs[name] = run_method(
                system, name, asked.integrator, asked.dt, asked.steps, **asked.knobs
            )

        # 2. Measure. Rods can be right and the path wrong. So compare places with the true motion:
        # that of a far better integrator, whose steps are shortened until two of its runs agree.
        # At 2 s: later it is soon chaos that decides where the particles are, not the method.
        truth = rods.find_truth(asked.chapter, system, runs.values())
        methods = make_methods(asked.dt, **asked.knobs)
        results = {}
        for name, run in runs.items():
            row = summary(system, run, methods[name], truth)
            results[name] = report.completed(asked, run, row)  # page and files need more

        # 3. Print a row for each method, and why a figure is "-". Is the worst rod error of none
        # over three times that of baumgarte?
        report.print_table(asked, runs, results, truth, columns)

        # 4. With --within: which integrator, method and step keep all errors below that?
        answer = None
        if asked.within:
            answer = report.find_answer(asked, runs, truth)
            report.print_answer(asked, answer)

    # 5. Write metrics.json, with the results; play.html, to play with; and a recording.
    report.write_files(asked, runs, results, truth, answer)
    return 0


def run_method(system, name, integrator, dt, steps, **knobs):
    """Run a method, by name: run_method(build_system("double"), "soft", "rk4", 0.005, 4000).

    dt in s; knobs are those of make_methods. The Run has all states, `q` and `v`, and what is
    measured in them: `violations`, `energies`.
    """
    system = rods.check_run(system, PIVOT, dt, steps, external_force)  # it may be yours: check it
    method = make_methods(dt, **knobs)[name]
    if not method.fits(integrator):
        raise ValueError(f"{name} is not made for {integrator}")
    force = method.make_force(system)
    step_fn = stabilized(INTEGRATORS[integrator], system, method)
    step_fn = rods.FastStep(step_fn, steps, system, external_force)  # the same numbers, but faster
    q, v = trajectory(step_fn, system, force, dt, steps)
    return rods.Run(step_fn, force, dt, q, v, constraint_violation, energy)


def summary(system, run, method, truth):
    """What table, page and metrics.json say about a run; None is what is not known. Add keys, but
    keep these."""
    force = method.make_force(system)
    # All masses times 9.81 m/s^2 times all rods, 39.24 J for double; more if it starts faster.
    scale = rods.energy_scale(system, GRAVITY)
    return {
        "max_violation": np.max(run.violations),  # m, over all states
        "final_violation": run.violations[-1],  # m
        "energy_rel_max": np.max(np.abs(run.energies - run.energies[0])) / scale,
        # in N, the largest of all that `tensions` finds in the states of the run
        "tension_max": rods.largest_force(system, run, tensions, force, external_force),
        "error": truth.error(run.q),  # m, of the worst particle, when places are compared
        "tip_final": run.tip[-1].tolist(),  # m
    }


def columns(run, row, truth):
    """What the table shows of a run: a head in two lines, and words. A new column is a line here.

    Its figures are keys of summary, so metrics.json has them, too; it has no times.
    """
    #            rods off  rods off  energy off  largest force  places off  a step
    # method     at worst    at end    at worst    at steps, N      at 2 s      us
    # none          38 cm     38 cm        43 %           69.3      7.9 cm     0.5
    return [
        ("rods off", "at worst", report.length(row["max_violation"])),  # 0.384 m is "38 cm"
        ("rods off", "at end", report.length(row["final_violation"])),
        ("energy off", "at worst", report.energy(row)),  # "-" with drag
        ("largest force", "at steps, N", report.force(row)),
        ("places off", truth.at, truth.in_words(row["error"])),  # no finer than it is known
        ("a step", "us", f"{run.pace:.3g}"),
    ]


def choose(system, within, dt=0.005, steps=4000, **knobs):
    """The answer to --within: which integrator, method and step are right to `within` m.

    dt in s. It has a `verdict` and `rows`, one for each integrator: take row.rung.scheme, an
    integrator and a method, in steps of row.rung.dt s.
    """
    system = rods.check_run(system, PIVOT, dt, steps, external_force)
    return rods.choose(this_chapter(), system, within, dt, steps, knobs)


def this_chapter():
    """The functions of this file, as you have edited them, for rods and report to call."""
    return rods.Chapter(
        gravity=GRAVITY,
        integrators=INTEGRATORS,
        make_methods=make_methods,
        stabilized=stabilized,
        external_force=external_force,
        make_force=make_force,
        project=project,
        energy=energy,
        rod_lengths=rod_lengths,
        constraint_violation=constraint_violation,
        tensions=tensions,
    )


# --- endregion ---
# --- region: flags ---
def parse_args(argv=None):
    """Parse the flags, and build the system they ask for: a Request."""
    parser = cli.Parser(__doc__, "studies: python -m curriculum.ch3_4_constraints.studies --help")
    add = parser.add_argument
    known = [*CHAINS, "chain", *rods.SHIPPED]
    every = make_methods()
    words = "; ".join(f"{name} {method.words}" for name, method in every.items())
    add("--system", default="double", help=f"{', '.join(known)}, or a scene's file")
    add("--links", type=cli.whole(1, 300), default=10, help="how many rods --system chain has")
    add("--seed", type=cli.whole(0), default=0, help="tilts the start, within 0.05 rad of level")
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="what calls force(q, v)")
    add("--stabilization", choices=["all", *every], default="all", help=words)
    add("--baumgarte", type=cli.number(0), default=20.0, help="w in rad/s: too high, it explodes")
    add("--time-constant", type=cli.seconds, default=0.02, help="of soft, in s")
    add("--dt", type=cli.seconds, default=0.005, help="one step in s: halve it, see what halves")
    add("--steps", type=cli.whole(1), default=4000, help="how many: drift adds up")
    add("--within", type=cli.length, help="find the cheapest scheme that is right to 1mm, 1um, ...")
    add("--smoke", action="store_true", help=f"{SMOKE_STEPS} steps, for CI")
    add("--plain", action="store_true", help="compile nothing: print() and breakpoint() anywhere")
    add("--device", choices=["cpu"], default="cpu", help="the only choice")
    add("--rerun", action=cli.Switch, default=True, help="write a recording")
    add("--page", action=cli.Switch, default=True, help="write play.html")
    add("--out", type=cli.folder, default="outputs/ch3.4-constraints", help="where to write")
    args = parser.parse_args(argv)
    args.steps = SMOKE_STEPS if args.smoke else args.steps
    knobs = {"baumgarte": args.baumgarte, "time_constant": args.time_constant}
    with parser.errors("argument --system: "):
        system = build_system(args.system, args.seed, args.links)
    with parser.errors():
        return report.request(args, this_chapter(), system, every, knobs)


command = partial(cli.run_script, main)  # for the entry point in pyproject.toml
if __name__ == "__main__":
    command()
# --- endregion ---
