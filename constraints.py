"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

Gravity pulls the bob down, and the rod will not let it go down. Which force does the rod apply?
Nobody wrote it down: it is the solution of a linear system, found anew at every step. This file
derives that system, hides its solution inside `force(q, v)`, hands it to the integrators of
chapter 3.3, which never learn of it, and measures what becomes of the rods. The lines you read are
the lines that run, taken once on symbols and compiled (--show-step). Change one, and see.
"""

# --- region: setup ---
import math
from argparse import BooleanOptionalAction
from collections import namedtuple
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints import large  # many rods: these formulas again, not these lines
from curriculum.ch3_4_constraints import publish as pub
from curriculum.ch3_4_constraints.picture import write_motion
from curriculum.ch3_4_constraints.recording import frames, record
from curriculum.ch3_4_constraints.scene_files import check_system, direction, load_scene
from curriculum.ch3_4_constraints.statics import in_line
from curriculum.ch3_4_constraints.tables import length, per_cent
from curriculum.common.banner import banner, in_parts
from curriculum.common.cli import chapter_parser, number, run_script
from curriculum.common.gauss import make_gauss
from curriculum.common.graph import elimination_order, has_loop
from curriculum.common.midpoint import make_midpoint
from curriculum.common.ruler import settle
from curriculum.common.runs import Log
from curriculum.common.steps import Compiled, Plain, followed
from curriculum.common.trace import repeat

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
#     anchors  (K, 3)  where they stand, in m; without this key there is one, PIVOT
SYSTEMS = {"pendulum": 1, "double": 2, "triple": 3}  # the chapter's scenes, and how many rods


def build_system(name, rng=0, links=10):
    """The system called `name`: one of SYSTEMS, "chain" with `links` rods, a scene or its file.

    The named ones, unit rods and masses, start at rest, stretched out sideways and tilted by the
    only random number of this program, from `rng`, a Generator or a seed. Raises SceneError.
    """
    if name not in SYSTEMS and name != "chain":
        return load_scene(name, HERE / CHAPTER / "scenes", [*SYSTEMS, "chain"], GRAVITY)
    count = SYSTEMS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)
    q0 = PIVOT + np.arange(1.0, count + 1.0)[:, None] * direction(-tilt)
    pairs = [(k, k - 1) for k in range(count)]  # rod 0 hangs on anchor -1, rod k on particle k - 1
    rods = {"pairs": pairs, "lengths": np.ones(count), "anchors": PIVOT[None]}
    return {"q0": q0, "v0": np.zeros_like(q0), "m": np.ones((count, 1)), **rods}


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
            d = d - system.get("anchors", PIVOT[None])[-1 - j]
        jac[..., k, i, :] = d
        g[..., k] = 0.5 * (dot(d, d) - system["lengths"][k] * system["lengths"][k])
        gdot[..., k] = dot(d, rate)
        jdotv[..., k] = dot(rate, rate)
    return jac.reshape(*shape, -1), g, gdot, jdotv


def mobility(system, jac, along=None):
    """A = J M^-1 J^T (..., C, C): how each rod's gddot answers to each lambda.

    Particle by particle: J has three columns for each. `along`: another J^T, for `project` alone.
    """
    own, other = (
        np.split(x, len(system["m"]), axis=-1) for x in (jac, jac if along is None else along)
    )
    terms = zip(own, other, system["m"], strict=True)
    return sum(j @ np.swapaxes(o, -1, -2) / m for j, o, m in terms)


def solve(system, a, b, share=0.0, turned=0.0):
    """lambda (..., C) with a lambda = b: Gauss's elimination, rods with few neighbours first.

    Only rods that share a particle feel each other: along a chain this is a sweep out and one back,
    O(N), as R. Featherstone's articulated bodies (1983). In a loop a rod may be too many, or J lose
    rank in passing. There `a` is blurred, by a share (...) of its diagonal and by `turned` (..., C,
    C), and rounds take that back, each solving for what is left of b, as long as they at least
    halve it (J. Carpentier, R. Budhiraja, N. Mansard, RSS 2021). Loads along eigenvalues of `a`
    above the blur are met to rounding, those far below it are left: `unheld` tells how much.
    """
    order = elimination_order(tuple(system["pairs"]))  # [(k, the rods still left that feel k)]
    loop = has_loop(tuple(system["pairs"]))
    rods = np.arange(a.shape[-1])
    own = a[..., rods, rods]
    spread = a + turned if loop else a
    rows = np.moveaxis(spread, (-2, -1), (0, 1)).astype(np.result_type(a, 1.0))  # a copy, of floats
    if loop:
        more = np.moveaxis(own, -1, 0) * (1e-12 + share)  # over rounding in any case
        rows[rods, rods] = rows[rods, rods] + more
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
    if isinstance(hold, str):
        return hold_table()[hold]
    return hold if isinstance(hold, Hold) else hold_table(baumgarte=hold)["baumgarte"]


def right_side(hold, lengths, pushed, g, gdot, jdotv):
    """b (..., C) of the linear system, where `pushed` is J M^-1 f."""
    if hold.softness:
        length = np.sqrt(2.0 * g + np.square(lengths))
        g = length * (length - lengths)
    return -(pushed + hold.use_jdotv * jdotv) - hold.damping * gdot - hold.stiffness * g


def blur(lengths, g, jdotv):
    """Which share (...) of A's diagonal an eigenvalue must have to mean anything, in a loop.

    Its root is an angle, from the pose where rods lose rank. It has to be larger than those by
    which rods turn in an INSTANT, and than the shares by which their lengths are wrong. Rods that
    turn together come no nearer to such a pose: where J is at hand, `multipliers` asks how much of
    that J M^-1 J^T gains in an INSTANT.
    """
    square = np.square(lengths)
    return np.sum(np.square(g / square) + INSTANT**2 * (jdotv / square), axis=-1)


def multipliers(system, q, v, hold=0.0, f=None):
    """J (..., C, 3N), and Lagrange's multipliers lambda (..., C) in N/m, at q, v (..., N, 3).

    f: the other forces, if known.
    """
    hold, lengths = as_hold(hold), system["lengths"]
    f = external_force(system, q, v) if f is None else f
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    accel = np.broadcast_to(f / system["m"], q.shape).reshape(*q.shape[:-2], 1, -1)  # M^-1 f
    b = right_side(hold, lengths, dot(jac, accel), g, gdot, jdotv)
    a = mobility(system, jac) * (1.0 + hold.softness * np.eye(len(lengths)))
    turn = constraint_terms(system, q + INSTANT * v, v)[0] - jac
    return jac, solve(system, a, b, blur(lengths, g, 0.0), mobility(system, turn))


def pull(jac, lam):
    """J^T lambda (..., N, 3): what the particles feel when the rods carry lambda."""
    return np.sum(jac * lam[..., None], axis=-2).reshape(*jac.shape[:-2], -1, 3)


def constraint_force(system, q, v, hold=0.0, f=None):
    """The force of the rods (..., N, 3) in N: `hold` is a Hold, or Baumgarte's w in rad/s."""
    return pull(*multipliers(system, q, v, hold, f))


def tensions(system, q, v, hold=0.0, f=None):
    """Newtons (..., C) with which the rods pull, -lambda |d|; below zero they push."""
    _, lam = multipliers(system, q, v, hold, f)
    return -lam * (rod_errors(system, q) + system["lengths"])


class Force(namedtuple("Force", "system hold")):
    """The seam of the chapter: force(q, v) -> (N, 3) in N, rods and all, for an integrator."""

    def __call__(self, q, v):
        f = external_force(self.system, q, v)
        return f + constraint_force(self.system, q, v, self.hold, f)

    @property
    def after(self):
        """(q_start, q, v, dt) -> (q, v): what the hold does to a finished step, or None."""
        return self.hold.after and partial(self.hold.after, self.system)

    def tensions(self, q, v):
        """Newtons (..., C) with which the rods pull at q, v (..., N, 3)."""
        return tensions(self.system, q, v, self.hold)


def unheld(system, q, v, hold=0.0):
    """The largest acceleration (...) along a rod, in m/s^2, that its force leaves unanswered."""
    force, lengths = make_force(system, hold), system["lengths"]
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    a = (force(q, v) / system["m"]).reshape(*q.shape[:-2], 1, -1)
    return np.max(
        np.abs(right_side(force.hold, lengths, dot(jac, a), g, gdot, jdotv)) / lengths, -1
    )


def make_force(system, hold, plain=False):
    """A Force; `hold` is a Hold, a mode's name, or Baumgarte's w in rad/s. Many rods need another."""
    hold = as_hold(hold)
    if large.takes(system) and not plain:
        return large.LargeForce(system, hold, external_force, right_side, blur, near)
    return Force(system, hold)


def near(lengths, q):
    """The g (..., C) at which rods are right: 1e-12 of L^2, and as g is rounded far away."""
    far = np.mean(np.sum(np.abs(q), axis=-1), axis=-1, keepdims=True)
    return 1e-12 * np.square(lengths) + 1e-15 * far * lengths


def project(system, q_start, q, v, dt):
    """A step from q_start that ended at q, v (..., N, 3), a little off, put back: g = 0, J v = 0.

    Rods correct as they pull, q = q - M^-1 J(q_start)^T mu, and v is told: SHAKE (J.-P. Ryckaert et
    al., J. Comput. Phys. 23 (1977) 327). Then v loses its part along the rods, as in RATTLE (H.
    Andersen, ibid. 52 (1983) 24). RK4 keeps order 4, semi-implicit Euler 1; this one is symplectic,
    and blows up along J(q), or if v is not told. Stop where Newton's method finds no way.
    """
    along, lengths = constraint_terms(system, q_start, v)[0], system["lengths"]
    close = near(lengths, q_start)

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        mu = solve(system, mobility(system, jac, along), g, blur(lengths, g, 0.0))
        return q - pull(along, mu) / system["m"], dot(g / close, g / close)

    end = repeat(newton, q, 20, "no way back onto the rods")
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    return end, v - pull(jac, solve(system, mobility(system, jac), gdot)) / system["m"]


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
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4, four forces; energy wanders."""

    def slope(q, v):
        return v, force(q, v) / m

    v1, a1 = slope(q, v)
    v2, a2 = slope(q + 0.5 * dt * v1, v + 0.5 * dt * a1)
    v3, a3 = slope(q + 0.5 * dt * v2, v + 0.5 * dt * a2)
    v4, a4 = slope(q + dt * v3, v + dt * a3)
    q = q + (dt / 6.0) * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return q, v + (dt / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


# Two of high order come from elsewhere: the midpoint rule, extrapolated to order 8; and the ruler for
# the others, Gauss-Legendre collocation, order 16, symplectic, exact to rounding at 0.05 s here. That
# one is implicit: it iterates its stages by calls of the same force.
INTEGRATORS = {"euler": euler_step, "semi_implicit": semi_implicit_step, "rk4": rk4_step}
INTEGRATORS |= {"midpoint": make_midpoint(8), "gauss": make_gauss(8)}
FOR_IMPULSE = ["semi_implicit"]  # v_next = v + dt a and q_next = q + dt v_next, as it presumes
NOT_IMPULSE = "which does not end a step at q + dt (v + dt a)"

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


def rod_vectors(system, x, fixed):
    """x_i - x_j (..., C, 3) of every rod, of x (..., N, 3), which is `fixed` (K, 3) at anchors."""
    i, j = np.transpose(system["pairs"])
    fixed = np.broadcast_to(fixed[::-1], (*x.shape[:-2], *np.shape(fixed)))
    x = np.concatenate([x, fixed], axis=-2)  # a negative j counts from the end: -1, the first
    return x[..., i, :] - x[..., j, :]


def rod_errors(system, q):
    """|d| - L (..., C) in m, what a ruler would show, at positions q (..., N, 3)."""
    d = rod_vectors(system, q, system.get("anchors", PIVOT[None]))
    return np.sqrt(dot(d, d)) - system["lengths"]


def constraint_violation(system, q):
    """The largest rod error (...,) in m, whatever its sign."""
    return np.max(np.abs(rod_errors(system, q)), axis=-1)


def simulate(step_fn, system, force, dt, steps, keep=(), way=Compiled):
    """`steps` steps of `dt` s by step_fn(q, v, m, force, dt), measured at every one: a Run.

    Its first three are series from the start on: tip (steps + 1, ..., 3), the last particle, in m;
    violations (steps + 1, ...) in m; energies in J. `keep`: steps whose states it has as well.
    Members of leading axes in q0, v0 go in step. `way`: Compiled, or Plain, the lines as they stand.
    """
    hold = getattr(force, "hold", as_hold(0.0))  # any function (q, v) -> N will do
    if hold.dt not in (None, dt):
        raise ValueError(f"this force is for steps of {hold.dt:g} s, not of {dt:g} s")
    system = check_system({"anchors": PIVOT[None], **system})
    q, v, m = system["q0"], system["v0"], system["m"]
    step_fn = way(followed(step_fn, getattr(force, "after", None)), steps)
    log = Log(steps, keep, 100.0 * np.sum(system["lengths"]))
    log.note(q, v, constraint_violation(system, q), energy(system, q, v))
    with log:
        for _ in log.turns():
            q, v = step_fn(q, v, m, force, dt)  # compiled, many steps: (steps, ..., N, 3)
            violations, energies = constraint_violation(system, q), energy(system, q, v)
            log.note(q, v, violations, energies)
    return log.run(step_fn)


# --- endregion ---
# --- region: report ---
def parse(argv):
    """The command line; the system that it names; and whether it asks for a default run."""
    about = {x: f"let go level, rods: {n}" for x, n in [*SYSTEMS.items(), ("chain", "--links")]}
    parser, what, how, see = chapter_parser("constraints.py", HERE / CHAPTER, OUT, EXAMPLES)
    rules, modes = list(INTEGRATORS), ["all", *hold_table()]
    what("--scenes", action=pub.SceneList, nargs=0, const=(about, HERE / CHAPTER), help="list them")
    what("--system NAME", default="double", help="one that --scenes lists, or a file")
    what("--links N", type=number(int, 1, 20_000), default=10, help="rods of --system chain")
    what("--steps N", type=number(int, 1), default=4000, help="drift is patient: run longer")
    what("--dt S", type=number(), default=0.005, help="s; halve it and see the rule's order")
    how("--integrator RULE", choices=rules, default="semi_implicit", help=", ".join(rules))
    how("--stabilization MODE", choices=modes, default="all", help=", ".join(modes[1:]))
    how("--baumgarte W", type=number(float, 0), default=20.0, help="rad/s; too much blows up")
    how("--time-constant T", type=number(), default=0.02, help="s; how soon soft mends a rod")
    how("--impedance P", type=number(high=1), default=0.95, help="soft: hard rods near 1")
    how("--tol M", type=number(), help="m at 2 s; gauss then finds its stages and step")
    aim = "run the lines as they stand, in numpy: slow; print, breakpoint, traceback"
    how("--plain", action="store_true", help=aim)
    see("--picture", action=BooleanOptionalAction, default=True, help="motion.svg; or none")
    see("--show-step", action="store_true", help="print the code that a step becomes, no more")
    args = parser.parse_args(argv)
    if args.tol and args.integrator != "gauss":
        parser.error(f"argument --tol: {args.tol:g} is for --integrator gauss; give --dt")
    if args.stabilization == "impulse" and args.integrator not in FOR_IMPULSE:
        why = f"does not fit {args.integrator}, {NOT_IMPULSE}; give --integrator {FOR_IMPULSE[0]}"
        parser.error(f"argument --stabilization: impulse {why}")
    system = parser.attempt("--system", build_system, args.system, args.seed, args.links)
    usual = args == parser.parse_args(["--out", args.out])
    if not args.show_step:  # last, so that every other mistake is told first
        args.out = parser.attempt("--out", pub.results_folder, args.out)
    return args, system, usual


def report(args, system, rows, runs, dt, truth):
    """Print the table, a sentence for each mark in it, and the verdict."""
    ways = "; ".join(dict.fromkeys(run.way for run in runs.values()))
    at, limit = f"{truth.step * dt:.3g} s", STABILITY_LIMIT.get(args.integrator, math.inf)
    print(f"{args.system}: seed {args.seed}; {args.integrator}, steps of {dt:.4g} s, {ways}\n")
    print("               rods off by      energy off  from the truth    a step")
    print(f"mode          worst     at end    of m g L  {f'at {at}':>14}        us")
    for (mode, row), run in zip(rows.items(), runs.values(), strict=True):
        rods = f"{length(np.max(run.violations)):>9}  {length(run.violations[-1]):>9}"
        error = "-" if row["error"] is None else length(row["error"])
        rest = f"{per_cent(row['energy_rel_max']):>10}  {error:>14}  {run.pace:8.3g}"
        print(f"{mode + '*' * bool(run.note):<10}{rods}  {rest}")
    for mode, run in runs.items():
        if run.note:
            print(f"* {mode} {run.note}{in_line(constraint_terms, system, run)}")
    lost = [mode for mode, row in rows.items() if row["error"] is None]
    if lost:
        why = "the truth is not known to 1 nm at" if truth.q is None else "stopped before"
        print(f"- {', '.join(lost)}: {why} {at}")
    over = [mode for mode in rows if mode in lost or rows[mode]["error"] > (args.tol or math.inf)]
    if args.tol and over:
        print(f"--tol {args.tol:g} is the aim of the best mode; not met by {', '.join(over)}")
    if "baumgarte" in runs and dt * args.baumgarte > limit:
        print(f"baumgarte: dt*omega {dt * args.baumgarte:.3g} is past the limit {limit:.3g} here")
    drift = {mode: row["max_violation"] for mode, row in rows.items() if not row["stopped"]}
    told = args.system in SYSTEMS and drift.get("none", 0.0) > 1e-9 and "baumgarte" in drift
    if told and args.baumgarte and len(runs["none"].tip) > SMOKE_STEPS:
        none, helped = drift["none"], max(drift["baumgarte"], 1e-12)
        verdict = "as expected, over 3" if none > 3.0 * helped else "UNEXPECTED, not over 3"
        print(f"verdict: worst rod error, none / baumgarte = {none / helped:.1f}: {verdict}")


def main(argv=None):
    """Run the comparison that `argv` asks for, print it, write what --out is to hold."""
    args, system, usual = parse(argv)
    modes = list(hold_table()) if args.stabilization == "all" else [args.stabilization]
    rule, steps = INTEGRATORS[args.integrator], SMOKE_STEPS if args.smoke else args.steps
    knobs = args.baumgarte, args.time_constant, args.impedance

    def run(mode, rule, dt, steps, keep=(), way=Plain if args.plain else Compiled):
        force = make_force(system, hold_table(dt, *knobs)[mode], args.plain)
        return simulate(rule, system, force, dt, steps, keep, way)

    if args.show_step:
        print(run(modes[0], rule, args.dt, 1).source)
        return 0
    print(banner("ch3.4", "constraints", args.device, usual))
    if args.stabilization == "all" and args.integrator not in FOR_IMPULSE:
        modes.remove("impulse")
        print(f"impulse left out: it does not fit {args.integrator}, {NOT_IMPULSE}")
    most = 0 if large.takes(system) else 5000 // (len(system["pairs"]) + 5)
    rule, dt, steps, truth = settle(run, modes, rule, args.dt, steps, args.tol, most)
    shown = frames(steps, dt, len(system["q0"])) if args.rerun or args.picture else ()
    runs = {mode: run(mode, rule, dt, steps, [truth.step, *shown]) for mode in in_parts(modes)}
    fall = np.sum(system["m"]) * np.max(np.abs(GRAVITY)) * np.sum(system["lengths"]) or 1.0
    rows = {mode: runs[mode].summary(fall, truth) for mode in modes}
    report(args, system, rows, runs, dt, truth)
    used = {"dt": dt, "steps": steps, "rods": len(system["pairs"]), "error_at": truth.step * dt}
    holds, scene, writers = hold_table(dt, *knobs), (args, used, system, runs), {}
    if args.picture:
        writers[pub.PICTURE] = lambda path: write_motion(path, *scene, shown)
    if args.rerun:
        pulls = {mode: tensions(system, run.q, run.v, holds[mode]) for mode, run in runs.items()}
        writers[pub.RECORDING] = lambda path: record(path, *scene, rows, fall, pulls)
    print(pub.publish(args, used, rows, writers))
    return 0


if __name__ == "__main__":
    run_script(main)
# --- endregion ---
