"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

Gravity pulls the bob down, the rod does not let it go down. Which force does the rod apply? No formula for it is
written anywhere: it is the *solution* of a linear system, J M^-1 J^T lambda = ..., solved anew at every step. This file
derives that system for point masses tied by massless rods, hides the solve in `force(q, v)`, hands it to integrators
that never learn about it, and measures what becomes of the rods: how far they drift, what the energy does, what a step
costs. `python constraints.py` prints the comparison; `--help` names every flag, and why you would turn it.
"""

# --- region: setup ---
import json
import math
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from curriculum.common.cli import chapter_parser, number, run_script
from curriculum.common.device import banner, progress
from curriculum.common.files import make_ready, write_whole
from curriculum.common.gauss import make_gauss
from curriculum.common.scenes import GRAVITY, SceneError, incidence, load_scene
from curriculum.common.tridiagonal import by_halving

HERE, CHAPTER = Path(__file__).resolve().parent, "curriculum/ch3_4_constraints"
OUTPUTS = ("metrics.json", "constraints.rrd")
SMOKE_STEPS, FRAME_RATE, MAX_RECORDED = 800, 60.0, 10**6  # recorded: states a simulated second; positions at most
RULED_SECONDS, RULED_RODS = 2.0, 30  # the true error is taken then, before chaos decides, for scenes of this size
# --- endregion ---


# --- region: systems ---
# A scene is particles, rods and anchors, nothing else. Rod k is the pair (i, j): particle i tied to particle j, or to a
# fixed anchor when j is negative (-1 the first, -2 the second, ...). A chain, rod k tying particle k to the one before
# it and rod 0 to an anchor, is so common and so much cheaper to solve that the system remembers being one.


def build_system(name, seed=0, links=10):
    """A name of SYSTEMS, "chain" of `links` rods, or the path of a scene file; raises SceneError if that is no good.

    The named ones: unit rods and masses, stretched out sideways, at rest, tilted by the program's one random number.
    """
    if name not in SYSTEMS and name != "chain":
        return make_system(**load_scene(name))
    links, tilt = SYSTEMS.get(name, links), np.random.default_rng(seed).uniform(-0.05, 0.05)
    # math, not numpy: numpy has a sine of its own for every kind of processor
    q0 = np.arange(1.0, links + 1.0)[:, None] * np.array([math.cos(-tilt), math.sin(-tilt), 0.0])
    return make_system(q0, np.zeros_like(q0), np.ones(links), [(k, k - 1) for k in range(links)], np.ones(links))


def make_system(q0, v0, m, pairs, lengths=None, anchors=((0.0, 0.0, 0.0),)):
    """System dict: positions q0 (N, 3) m, velocities v0 (N, 3) m/s, masses m (N,) kg, rods `pairs`, anchors (K, 3) m.

    `lengths` (C,) m, by default as in q0. Beside these keys, m as (N, 1), whatever the solvers need again and again.
    """
    q0, v0, anchors = (np.asarray(a, dtype=float) for a in (q0, v0, anchors))
    m, pairs = np.asarray(m, dtype=float).reshape(-1, 1), [tuple(pair) for pair in pairs]
    system = {"q0": q0, "v0": v0, "m": m, "pairs": pairs, "anchors": anchors, "weight": m * GRAVITY}
    w, system["chain"] = 1.0 / m[:, 0], pairs == [(k, k - 1) for k in range(len(q0))]
    if system["chain"]:
        # A_kk = (1/m_k + 1/m_k-1) |d_k|^2 and A_k,k-1 = -1/m_k-1 d_k . d_k-1; an anchor does not move: its 1/m is 0
        system["a_diag"], system["a_off"] = w + np.append(0.0, w[:-1]), -w[:-1]
    else:
        inc, system["fixed"] = incidence(pairs, len(q0), anchors)
        system["incidence"], system["coupling"] = inc, (inc * w) @ inc.T  # B M^-1 B^T: which rods feel each other
        system["tree"] = np.linalg.matrix_rank(inc) == len(inc)  # else rods close a loop, maybe through the ground
    d = rod_vectors(system, q0)
    system["lengths"] = np.sqrt(dot(d, d)) if lengths is None else np.asarray(lengths, dtype=float)
    system["fall"] = rod_vectors(system, system["weight"] / m, rate=True)
    if system["chain"]:
        system["per_rod"] = list(zip(w.tolist(), [0.0, *w[:-1].tolist()], system["lengths"].tolist(), strict=True))
    return system


SYSTEMS = {"pendulum": 1, "double": 2, "triple": 3}  # the chapter's scenes and their rods
# --- endregion ---


# --- region: constraints ---
# Rod k, along d_k from its partner to its particle, holds when g_k = (|d_k|^2 - L_k^2)/2 is zero. Differentiate twice:
#     gdot_k  = d_k . d_k'                      (J v)_k: row k of J holds d_k for the particle, -d_k for its partner
#     gddot_k = d_k . d_k'' + |d_k'|^2          (J a + Jdot v)_k
# The rod can only pull or push along itself, so its force is J^T lambda, and Newton says M a = f + J^T lambda. Ask for
# gddot = 0 and lambda follows:   J M^-1 J^T lambda = -(J M^-1 f + Jdot v).   That is the whole chapter. The rest of
# this region is the answers to "and what if g is not exactly zero?", and a way to solve for lambda that costs O(N).


class Hold(NamedTuple):
    """One way to hold a rod: a row of numbers in the one system that all ways solve, with A = J M^-1 J^T:

    (A + softness diag A) lambda = -(J M^-1 f + use_jdotv Jdot v) - damping gdot - stiffness g
    """

    use_jdotv: float = 1.0
    damping: float = 0.0  # 1/s
    stiffness: float = 0.0  # 1/s^2
    softness: float = 0.0
    project: bool = False  # and after each step put q back on g = 0, v on J v = 0


def hold_table(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The modes by name, each a Hold; `dt` s, `baumgarte` rad/s, MuJoCo's `time_constant` s and `impedance` (0..1)."""
    spring = impedance * max(time_constant, 2.0 * dt)  # MuJoCo too keeps the time constant above two steps
    return {
        # gddot = 0 and nothing else. One solve a force. Fails by slow rot: what has drifted stays, every step adds.
        "none": Hold(),
        # gddot = -2 w gdot - w^2 g: an error dies like a critically damped spring of frequency w. One solve a force.
        # Fails when dt w passes STABILITY_LIMIT. J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1-16.
        "baumgarte": Hold(damping=2.0 * baumgarte, stiffness=baumgarte**2),
        # J v_next = -g/dt: the next step takes back what this one stretched. No Jdot v, nothing to tune; one solve a
        # step. Fails where v_next is not v + dt a: only for one-force integrators. E. Catto, GDC 2005.
        "impulse": Hold(use_jdotv=0.0, damping=1.0 / dt, stiffness=1.0 / dt**2),
        # A rod that may give: MuJoCo's equality with solref and solimp, Jdot v dropped as MuJoCo drops it. One solve a
        # force, never singular. Fails by design: a rod under load is longer. MuJoCo documentation, Computation.
        "soft": Hold(0.0, 2.0 / spring, impedance / spring**2, (1.0 - impedance) / impedance),
        # none, then Newton back onto the rods: see `project`. Two or three more solves a step. Fails at too long steps.
        "project": Hold(project=True),
    }


def as_hold(hold):
    """A bare number is a Baumgarte frequency in rad/s, 0.0 the naive solve; a Hold is itself."""
    return hold if isinstance(hold, Hold) else hold_table(baumgarte=float(hold))["baumgarte"]


def external_force(system, q, v):
    """Newtons (..., N, 3) at q and v (..., N, 3) besides the rods': weight. Add wind or drag and the rods answer."""
    return system["weight"]


def dot(a, b):
    """(..., 3), (..., 3) -> (...). Spelled out, so that every processor adds in the same order (einsum does not)."""
    p = a * b
    return p[..., 0] + p[..., 1] + p[..., 2]


def rod_vectors(system, x, rate=False):
    """(..., N, 3) -> (..., C, 3): d_k from positions x; with `rate`, d_k' from velocities x (anchors stand still)."""
    if not system["chain"]:
        return system["incidence"] @ x + (0.0 if rate else system["fixed"])
    d = x.copy(order="K")
    d[..., 1:, :] -= x[..., :-1, :]
    if not rate and system["anchors"][0].any():
        d[..., 0, :] -= system["anchors"][0]
    return d


def rod_pulls(system, d, lam):
    """J^T lambda (..., N, 3): what the particles feel when rod d (..., C, 3) carries lam (..., C) newtons per metre."""
    pull = lam[..., None] * d
    if not system["chain"]:
        return system["incidence"].T @ pull
    pull[..., :-1, :] -= pull[..., 1:, :]  # a rod pulls its particle back and the one before it forward
    return pull


def constraint_terms(system, q, v):
    """As derived, to read and to check against: jac (..., C, 3N) m; g m^2, gdot m^2/s, jdotv m^2/s^2, (..., C) each."""
    d, rate = rod_vectors(system, q), rod_vectors(system, v, rate=True)
    inc, _ = incidence(system["pairs"], q.shape[-2], system["anchors"])
    jac = (inc[:, :, None] * d[..., :, None, :]).reshape(*d.shape[:-1], -1)
    return jac, 0.5 * (dot(d, d) - system["lengths"] ** 2), dot(d, rate), dot(rate, rate)


def solve_rods(system, d, e, rhs, softness=0.0, cutoff=1e-9):
    """lam (..., C) of (A + softness diag A) lam = rhs, with A_kl = (B M^-1 B^T)_kl d_k . e_l; mostly e is d.

    A chain's A is tridiagonal: a sweep towards the tip eliminates, one back substitutes; O(N), + - * / only, hence the
    same bytes everywhere (and R. Featherstone's articulated-body method). All else gets the dense matrix. A loop may
    have more rods than it needs, or lose rank in passing: of all tensions that do, the smallest is then the right one
    (eigenvalues under `cutoff` of the largest count as zero).
    """
    if not system["chain"]:
        a = system["coupling"] * (d @ np.swapaxes(e, -1, -2)) * (1.0 + softness * np.eye(len(rhs.T)))
        if system["tree"] or softness:
            return np.linalg.solve(a, rhs[..., None])[..., 0]
        # rods measured in units of their own response, or a heavy particle would pass for a lost rank
        unit = 1.0 / np.sqrt(np.abs(np.diagonal(a, axis1=-2, axis2=-1)))
        a = a * (unit[..., :, None] * unit[..., None, :])
        rhs = (unit * rhs)[..., None]
        if d is not e:
            return unit * (np.linalg.pinv(a, rcond=cutoff) @ rhs)[..., 0]
        share, u = np.linalg.eigh(a)
        largest, share = share[..., -1:], share / share[..., -1:]
        inverse = share**15 / (share**16 + cutoff**16) / largest  # 1/share, falling to 0 steeply yet smoothly at cutoff
        return unit * (u @ (inverse[..., None] * (np.swapaxes(u, -1, -2) @ rhs)))[..., 0]
    diag = dot(d, e) * (system["a_diag"] if softness == 0.0 else system["a_diag"] * (1.0 + softness))
    upper = system["a_off"] * dot(d[..., :-1, :], e[..., 1:, :])
    lower = upper if d is e else system["a_off"] * dot(d[..., 1:, :], e[..., :-1, :])
    return by_halving(sweep, LONG_CHAIN, diag, upper, lower, rhs)


def sweep(diag, upper, lower, rhs):
    """x (..., C) of a tridiagonal system, by Gauss's elimination: over floats for one run, else over whole arrays."""
    diag, upper, lower, rhs = (a.tolist() if a.ndim == 1 else list(a.T) for a in (diag, upper, lower, rhs))
    for k in range(1, len(diag)):
        ratio = lower[k - 1] / diag[k - 1]
        diag[k] = diag[k] - ratio * upper[k - 1]
        rhs[k] = rhs[k] - ratio * rhs[k - 1]
    x = [rhs[-1] / diag[-1]]
    for k in range(len(diag) - 2, -1, -1):
        x.append((rhs[k] - upper[k] * x[-1]) / diag[k])
    return np.array(x[::-1]).T


def constraint_force(system, q, v, hold):
    """Newtons (..., N, 3) from the rods at q (m) and v (m/s), (..., N, 3); `hold`: a row of the table, or a number."""
    hold, applied = as_hold(hold), external_force(system, q, v)
    if system["chain"] and q.ndim == 2 and len(q) < SHORT_CHAIN:
        return short_chain_force(system, q, v, hold, applied)
    d, rate = rod_vectors(system, q), rod_vectors(system, v, rate=True)
    fall = system["fall"] if applied is system["weight"] else rod_vectors(system, applied / system["m"], rate=True)
    rhs = -(dot(d, fall) + dot(rate, rate)) if hold.use_jdotv else -dot(d, fall)
    if hold.stiffness:
        dd, length = dot(d, d), system["lengths"]
        # a soft rod measures |d| (|d| - L), the stretch itself, so as to equal MuJoCo in every digit
        error = dd - length * np.sqrt(dd) if hold.softness else 0.5 * (dd - length * length)
        rhs = rhs - hold.damping * dot(d, rate) - hold.stiffness * error
    # Near a pose where J loses rank, the tensions about to become arbitrary are hopelessly sensitive, too. If the step
    # ends with a projection, leave those to it: 60 times below what a straight chain of as many rods needs.
    cutoff = 0.01 / len(system["pairs"]) ** 2 if hold.project else 1e-9
    return rod_pulls(system, d, solve_rods(system, d, d, rhs, hold.softness, cutoff))


def short_chain_force(system, q, v, hold, applied):
    """constraint_force in one loop over floats, both sweeps: for few coordinates a numpy call costs more than that."""
    use_jdotv, damping, stiffness, softness, _ = hold
    pivot, sweep = 1.0, []  # for the way back: d, coupling to the rod before, pivot, eliminated right-hand side
    px, py, pz = system["anchors"][0].tolist()
    pu = pv = pw = pax = pay = paz = ex = ey = ez = y = 0.0
    columns = (*q.T.tolist(), *v.T.tolist(), *applied.T.tolist())
    for (w_here, w_back, length), qx, qy, qz, vx, vy, vz, fx, fy, fz in zip(system["per_rod"], *columns, strict=True):
        dx, dy, dz, du, dv, dw = qx - px, qy - py, qz - pz, vx - pu, vy - pv, vz - pw
        ax, ay, az = w_here * fx, w_here * fy, w_here * fz
        dd = dx * dx + dy * dy + dz * dz
        b = -(dx * (ax - pax) + dy * (ay - pay) + dz * (az - paz)) - use_jdotv * (du * du + dv * dv + dw * dw)
        if stiffness:
            error = dd - length * math.sqrt(dd) if softness else 0.5 * (dd - length * length)
            b -= damping * (dx * du + dy * dv + dz * dw) + stiffness * error
        off = -w_back * (dx * ex + dy * ey + dz * ez)
        ratio = off / pivot
        pivot = (1.0 + softness) * (w_here + w_back) * dd - ratio * off
        y = b - ratio * y
        sweep.append((dx, dy, dz, off, pivot, y))
        px, py, pz, pu, pv, pw, pax, pay, paz, ex, ey, ez = qx, qy, qz, vx, vy, vz, ax, ay, az, dx, dy, dz
    force = []
    lam = off = tx = ty = tz = 0.0  # of the rod beyond; beyond the tip there is none
    for dx, dy, dz, back, pivot, y in reversed(sweep):
        lam, off = (y - off * lam) / pivot, back
        fx, fy, fz = lam * dx, lam * dy, lam * dz
        force.append((fx - tx, fy - ty, fz - tz))
        tx, ty, tz = fx, fy, fz
    return np.array(force[::-1])


def make_force(system, hold):
    """The seam of the chapter: force(q, v) -> newtons (..., N, 3), gravity and rods together, solve and all, inside."""
    hold = as_hold(hold)
    return lambda q, v: external_force(system, q, v) + constraint_force(system, q, v, hold)


def project(system, q_start, q, v, dt):
    """A step begun at q_start ended at q, v (..., N, 3), a little off: put it back on g(q) = 0 and J v = 0.

    Positions move along M^-1 J(q_start)^T mu and v is told: with semi-implicit Euler that is SHAKE (Ryckaert, Ciccotti,
    Berendsen, J. Comput. Phys. 23 (1977) 327), and v freed of its part along the rods makes it RATTLE (Andersen,
    J. Comput. Phys. 52 (1983) 24), symplectic. RK4 keeps order 4. Moving along J(q) instead and not telling v pumps
    energy without end. Raises FloatingPointError if Newton's method finds no way back.
    """
    e, m, squared, free = rod_vectors(system, q_start), system["m"], system["lengths"] ** 2, q
    for _ in range(20):
        d = rod_vectors(system, q)
        g = 0.5 * (dot(d, d) - squared)
        if (np.abs(g) <= 1e-12 * squared).all():
            v = v + (q - free) / dt
            along = solve_rods(system, d, d, dot(d, rod_vectors(system, v, rate=True)))
            return q, v - rod_pulls(system, d, along) / m
        q = q - rod_pulls(system, e, solve_rods(system, d, e, g)) / m
    raise FloatingPointError("no way back onto the rods")


SHORT_CHAIN, LONG_CHAIN = 18, 150  # links: a loop over floats beats numpy below, halving beats walking above
# --- endregion ---


# --- region: integrators ---
# The rules of chapter 3.3, (q, v, m, force, dt) -> (q, v), without a word about rods. They do not know that force()
# solves a linear system, and need not; what they decide is how fast their own error turns into drift.


def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one force a step. Pumps energy into whatever swings; here as the warning."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit (symplectic) Euler: order 1, one force a step, v before q; the rule of real-time engines."""
    v = v + dt * (force(q, v) / m)
    return q + dt * v, v


def rk4_step(q, v, m, force, dt):
    """The Runge-Kutta rule (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4, four forces a step; energy may wander."""
    half = 0.5 * dt
    a1 = force(q, v) / m
    v2 = v + half * a1
    a2 = force(q + half * v, v2) / m
    v3 = v + half * a2
    a3 = force(q + half * v2, v3) / m
    v4 = v + dt * a3
    a4 = force(q + dt * v3, v4) / m
    return q + (dt / 6.0) * (v + 2.0 * (v2 + v3) + v4), v + (dt / 6.0) * (a1 + 2.0 * (a2 + a3) + a4)


# The fourth is the ruler that measures the others: Gauss-Legendre collocation, order 16, implicit, symplectic; for the
# double pendulum exact to rounding at 0.05 s. It iterates its stages by calls of the same force (curriculum/common).
INTEGRATORS = {"euler": euler_step, "semi_implicit": semi_implicit_step, "rk4": rk4_step, "gauss": make_gauss()}
ONE_FORCE = ("euler", "semi_implicit")  # evaluate the force once a step, as impulse presumes

# Baumgarte's spring x'' = -2 w x' - w^2 x is critically damped, a double root -w. A rule holds it up to this z = dt w.
# Euler: |1 - z| <= 1. Semi-implicit: trace 2 - 2z - z^2, determinant 1 - 2z. RK4: 1 - z + z^2/2 - z^3/6 + z^4/24 = 1.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (math.sqrt(2.0) - 1.0), "rk4": 2.785294}
# --- endregion ---


# --- region: simulate ---
# Honesty is cheap in bulk: the loop only steps and stores, and every so often the rods and the energy of a whole block
# of states are measured in one go. Memory is that block and the states asked for, however long the run.


def energy(system, q, v):
    """Total energy (...,) in J of states q, v (..., N, 3): kinetic plus potential, U = -sum m g . q."""
    m = system["m"][:, 0]
    return np.sum(0.5 * m * dot(v, v) - m * dot(q, GRAVITY), axis=-1)


def energy_scale(system):
    """The unit of energy_rel_max in J: sum m |g| sum L, about what falling from the top to the bottom is worth."""
    return float(np.sum(system["m"])) * float(np.max(np.abs(GRAVITY))) * float(np.sum(system["lengths"]))


def constraint_violation(system, q):
    """Rod error (...,) in m of positions q (..., N, 3): the largest | |d_k| - L_k |, what a ruler would show."""
    d = rod_vectors(system, q)
    return np.max(np.abs(np.sqrt(dot(d, d)) - system["lengths"]), axis=-1)


def simulate(system, integrator="semi_implicit", hold=0.0, dt=0.005, steps=4000, keep=(), tick=lambda step: None):
    """Integrate `system` for `steps` steps of `dt` seconds, by a name of INTEGRATORS or a rule; measure every step.

    `keep`: steps (0 is the start) whose states to return; `tick(step)` is called now and then. Returns q, v (..., N, 3)
    at the end; max_violation, final_violation in m, energy_rel_max in energy_scale, (...,) each; kept: step (K,),
    q (K, ..., N, 3), violation, energy error (K, ...); seconds_per_step, integration alone; steps done; stopped: None,
    or why it ended early, at a state LOST or not finite or a failed step; the rest was true until then. With leading
    axes in q0 and v0 all runs go in step, and end together.
    """
    hold, m, step = as_hold(hold), system["m"], integrator if callable(integrator) else INTEGRATORS[integrator]
    force, size = make_force(system, hold), max(1, BLOCK // (system["q0"].size // 3))
    q, v = (system[key].copy(order="F") for key in ("q0", "v0"))  # leading axes contiguous: arrays to sweep over
    qs, vs = (np.empty((size, *q.shape[::-1])).transpose(0, *range(q.ndim, 0, -1)) for _ in range(2))
    scale, start, lost = energy_scale(system), energy(system, q, v), LOST * float(np.sum(system["lengths"]))
    worst, drift = np.zeros(start.shape), np.zeros(start.shape)
    keep, kept, seconds, tried, stopped = np.array(sorted(set(keep)), dtype=int), [], 0.0, 0, None
    qs[0], vs[0], done, count = q, v, -1, 1  # the first block is the start alone
    with np.errstate(all="ignore"):  # a run that blows up is reported once and in words
        while True:
            block = qs[:count], vs[:count]
            violation, error = constraint_violation(system, block[0]), energy(system, *block) - start
            sane = ((violation < lost) & np.isfinite(error)).all(axis=tuple(range(1, error.ndim)))
            if not sane.all():
                count = int(np.argmin(sane))
                stopped = f"diverged at step {done + 1 + count}"
            if count:
                worst = np.maximum(worst, violation[:count].max(axis=0))
                drift = np.maximum(drift, np.abs(error[:count]).max(axis=0) / scale)
                last = qs[count - 1].copy(order="K"), vs[count - 1].copy(order="K"), violation[count - 1]
            q, v, final = last  # of the block before, if not one state of this is sane
            rows = keep[(keep > done) & (keep <= done + count)] - done - 1
            if len(rows) or not kept:  # not an entry a block: memory must not grow with the steps
                kept.append((rows + done + 1, qs[rows], violation[rows], error[rows] / scale))
            done += count
            tick(done)
            if stopped or done >= steps:
                break
            count, clock = min(size, steps - done), time.perf_counter()
            for i in range(count):
                try:
                    q_next, v_next = step(q, v, m, force, dt)
                    if hold.project:
                        q_next, v_next = project(system, q, q_next, v_next, dt)
                except (ArithmeticError, np.linalg.LinAlgError) as reason:
                    stopped, count = f"stopped at step {done + 1 + i}: {reason}", i
                    break
                qs[i], vs[i] = q, v = q_next, v_next
            seconds, tried = seconds + time.perf_counter() - clock, tried + count
    kept = dict(zip(("step", "q", "violation", "energy"), map(np.concatenate, zip(*kept, strict=True)), strict=True))
    run = {"q": q, "v": v, "max_violation": worst, "final_violation": final, "energy_rel_max": drift, "kept": kept}
    return run | {"stopped": stopped, "steps": done, "seconds_per_step": seconds / max(1, tried)}


def distance(a, b):
    """The largest distance in m between the same particle in positions a and b, (..., N, 3)."""
    return float(np.sqrt(np.max(dot(a - b, a - b))))


def true_position(system, seconds):
    """q (N, 3) after `seconds` by the ruler, gauss, and by how many m two steps differ; (None, inf) if over 1e-9."""
    before = None
    for steps in (math.ceil(seconds / dt) for dt in (0.05, 0.025, 0.0125, 0.00625)):
        run = simulate(system, "gauss", hold_table()["project"], seconds / steps, steps)
        if before is not None and not run["stopped"] and (error := distance(run["q"], before)) < 1e-9:
            return run["q"], error
        before = None if run["stopped"] else run["q"]
    return None, math.inf


BLOCK = 8192  # particle states measured at once: they fit the processor's cache
LOST = 100.0  # a rod error of so many times the length of all rods is no mechanism any more: the run has diverged
# --- endregion ---


# --- region: report ---
# Speed never without error, error never without speed: one row a mode, in the order in which the story is told.


def log_rerun(path, system, runs, dt):
    """Write the recording of `runs`, {mode: result of simulate}, to `path`: chains, rod errors, energy errors."""
    from curriculum.common.recording import record  # here: a run without a recording never pays for importing rerun

    movers, ends = {}, [i for i, _ in system["pairs"]]
    for mode, run in runs.items():
        step, q, violation, error = run["kept"].values()
        rods = np.stack([q[:, ends] - rod_vectors(system, q), q[:, ends]], axis=-2)
        curves = {"rod error: log10 of metres": np.log10(np.maximum(violation, 1e-16))}
        curves["energy error: share of m g L"] = error
        movers[mode] = list(hold_table()).index(mode), step * dt, q, rods, curves
    record(path, "constraints", movers, system["anchors"])


def parse(argv):
    """The command line and the system it names; the help of each flag says why one would turn it."""
    parser = chapter_parser("constraints.py", HERE / CHAPTER, "outputs/ch3.4-constraints", SMOKE_STEPS)
    add, positive = parser.add_argument, number(float, 0, False)
    add("--system", default="double", metavar="NAME", help="pendulum, double, triple, chain, or a scene file (double)")
    add(
        "--links",
        type=number(int, 1, high=10**6),
        default=10,
        help="rods of --system chain; their cost grows with N (10)",
    )
    add("--integrator", choices=INTEGRATORS, default="semi_implicit", help="who drifts, how fast? (semi_implicit)")
    add("--stabilization", choices=["all", *hold_table()], default="all", help="what to do about drift? (all)")
    add("--baumgarte", type=number(float, 0), default=20.0, metavar="RAD/S", help="its pull: too much blows up (20)")
    add("--time-constant", type=positive, default=0.02, metavar="S", help="how long soft takes to mend a rod (0.02)")
    add("--impedance", type=number(float, 0, False, 1), default=0.95, metavar="P", help="soft: hard rods near 1 (0.95)")
    add("--dt", type=positive, default=0.005, metavar="S", help="halve it, double --steps: each rule's order (0.005)")
    add("--tol", type=positive, metavar="M", help="gauss only: picks stages and step for this error after 2 s")
    add("--steps", type=number(int, 1), default=4000, help="drift is patient: run longer and none gets worse (4000)")
    args = parser.parse_args(argv)
    args.steps = SMOKE_STEPS if args.smoke else args.steps
    args.modes = list(hold_table()) if args.stabilization == "all" else [args.stabilization]
    if args.tol and args.integrator != "gauss":
        parser.error(f"argument --tol: {args.tol:g} is for --integrator gauss; {args.integrator} takes --dt")
    if args.stabilization == "impulse" and args.integrator not in ONE_FORCE:
        parser.error(
            f"argument --stabilization: impulse is no match for --integrator {args.integrator}; use {ONE_FORCE[1]}"
        )
    system = parser.attempt("--system", SceneError, build_system, args.system, args.seed, args.links)
    parser.attempt("--out", OSError, make_ready, args.out, OUTPUTS)
    if args.tol and len(system["pairs"]) > RULED_RODS:
        parser.error(f"argument --tol: {args.tol:g} cannot be judged; the ruler is for at most {RULED_RODS} rods")
    return args, system


def report(args, runs, errors, at):
    """Print what was run, the table, a sentence for every run that ended early, and the verdict."""
    print(f"{args.system}: seed {args.seed}; {args.integrator}, {args.steps} steps of {args.dt:.4g} s\n")
    when = f"error at {at:.3g} s"
    print(f"mode         max rod error  final rod error  energy drift {when:>14}     a step  real time")
    for mode, run in runs.items():
        pace, error = run["seconds_per_step"], "-" if errors[mode] is None else f"{errors[mode]:.3e} m"
        numbers = f"{run['max_violation']:11.3e} m {run['final_violation']:14.3e} m {run['energy_rel_max']:13.3e}"
        print(f"{mode:<12} {numbers} {error:>14} {1e6 * pace:7.1f} us {args.dt / pace:8.0f} x")
    print("")
    z, limit = args.dt * args.baumgarte, STABILITY_LIMIT.get(args.integrator, math.inf)
    for mode, run in runs.items():
        if run["stopped"]:
            past = f"dt*omega = {z:.3g} is past the limit of {limit:.2f} for {args.integrator}"
            hint = past if mode == "baumgarte" and z > limit else f"try --dt {0.5 * args.dt:g}"
            print(f"{mode} {run['stopped']}: {hint}")
    pair = [runs[mode] for mode in ("none", "baumgarte") if mode in runs and not runs[mode]["stopped"]]
    if args.system in SYSTEMS and len(pair) == 2 and args.baumgarte > 0.0 and args.steps >= SMOKE_STEPS:
        none, helped = (float(run["max_violation"]) for run in pair)
        verdict = "as expected, over 3" if none > 3.0 * helped else "UNEXPECTED, not over 3"
        print(f"verdict: worst rod error, none / baumgarte = {none / max(helped, 1e-300):.1f}: {verdict}")


def metrics(args, runs, errors, at):
    """The text of metrics.json: results and what they depend on, nothing of the host, so equal runs are equal bytes."""
    names = ("integrator", "dt", "tol", "steps", "seed", "links", "baumgarte", "time_constant", "impedance")
    content = {name: getattr(args, name) for name in names} | {"system": Path(args.system).name, "error_at": at}
    content["results"] = {}
    for mode, run in runs.items():
        row = {key: round(float(run[key]), 12) for key in ("max_violation", "final_violation", "energy_rel_max")}
        row["tip_final"] = [round(x, 6) for x in run["q"][-1].tolist()]
        row["error"] = None if errors[mode] is None else round(errors[mode], 8)  # the ruler's last digits are BLAS's
        content["results"][mode] = row | ({"stopped": run["stopped"]} if run["stopped"] else {})
    return json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"


def main(argv=None):
    """Run the comparison that `argv` asks for; print it, write metrics.json and the recording. Returns 0."""
    args, system = parse(argv)
    print(banner("ch3.4", "constraints", args.device, "smoke" if args.smoke else "full"))
    seconds, rule, ladder, before = args.steps * args.dt, args.integrator, [args.dt], math.inf
    at = args.dt * max(1, min(args.steps, round(RULED_SECONDS / args.dt)))
    truth, known = true_position(system, at) if len(system["pairs"]) <= RULED_RODS else (None, math.inf)
    if args.tol:  # a stage a digit, and the largest step that will do: in numpy stages cost little, steps a lot
        rule = make_gauss(max(4, round(-math.log10(args.tol))), 4, min(0.1 * args.tol, 1e-3))
        ladder = [at / (math.ceil(at / 0.16) * 2**k) for k in range(10)]
    if "impulse" in args.modes and args.integrator not in ONE_FORCE:
        args.modes.remove("impulse")
        print(f"impulse left out: it presumes one force a step, {args.integrator} takes more")
    for args.dt in ladder:
        args.steps, check, runs, errors = math.ceil(seconds / args.dt - 1e-9), round(at / args.dt), {}, {}
        stride = max(1, round(1.0 / (FRAME_RATE * args.dt)), args.steps * len(system["q0"]) // MAX_RECORDED)
        frames = range(0, args.steps + 1, stride) if args.rerun else ()
        for mode in args.modes:
            hold = hold_table(args.dt, args.baumgarte, args.time_constant, args.impedance)[mode]
            keep, tick = [*frames, check], progress(mode, args.steps)
            run = runs[mode] = simulate(system, rule, hold, args.dt, args.steps, keep, tick)
            there = run["kept"]["q"][run["kept"]["step"] == check]
            errors[mode] = distance(there, truth) if truth is not None and len(there) else None
        best = min((e for mode, e in errors.items() if e is not None and not runs[mode]["stopped"]), default=math.inf)
        if best <= (args.tol or math.inf) or 0.5 * before < best < math.inf:  # or a smaller step no longer helps
            break
        before = best
    text, paths = metrics(args, runs, errors, at), [args.out / name for name in OUTPUTS[: 1 + args.rerun]]
    if args.rerun:
        log_rerun(paths[1], system, runs, args.dt)
    write_whole(paths[0], lambda temporary: temporary.write_text(text, encoding="utf-8"))
    report(args, runs, errors, at)
    if args.tol and best > args.tol:
        print(f"--tol {args.tol:g} m is not reached by any of these modes")
    if any(error is not None for error in errors.values()):
        better = 10.0 ** math.ceil(math.log10(max(known, 1e-16)))
        print(f"error: farthest that a particle is from where it should be after {at:g} s, known to {better:.0e} m")
    print(f"wrote {' and '.join(map(str, paths))}" + (f"\nlook: python -m rerun {paths[1]}" if args.rerun else ""))
    return 0


if __name__ == "__main__":
    run_script(main)
# --- endregion ---
