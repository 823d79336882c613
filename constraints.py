"""Chapter 3.4 - Constraints: the force that keeps a rod a rod.

Gravity pulls the bob down, and the rod will not let it go down. Which force does the rod apply?
Nobody wrote it down: it is the solution of a linear system, found anew at every step. This file
derives that system, hides its solution inside `force(q, v)`, hands it to the integrators of
chapter 3.3, which never learn of it, and measures what becomes of the rods. The lines you read are
the lines that run: once on symbols, and then compiled (--show-step). Change one, and see.
"""

# --- region: setup ---
import sys
from collections import namedtuple
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints import play, publish, recording, scene_files, statics, tables
from curriculum.common import banner, ruler
from curriculum.common.arrays import each_state, in_pieces
from curriculum.common.cli import chapter_parser, number, run_script
from curriculum.common.compiled import Compiled
from curriculum.common.elimination import eliminated, elimination_order, has_loop, refined, tied
from curriculum.common.gauss import make_gauss
from curriculum.common.midpoint import make_midpoint
from curriculum.common.runs import Log
from curriculum.common.steps import Plain, followed
from curriculum.common.trace import repeat

import numpy as np

GRAVITY = np.array([0.0, -9.81, 0.0])  # m/s^2: y is up
PIVOT = np.zeros(3)  # m: the anchor of a system that names none
HERE = Path(__file__).resolve().parent
CHAPTER, OUT = "curriculum/ch3_4_constraints", "outputs/ch3.4-constraints"
SMOKE_STEPS = 800  # they tell the modes apart
LOOKS = 100  # states at which `unheld` is asked
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
# A shape (..., N, 3) may have leading axes: members of a crowd, which go in step, or many states.
SYSTEMS = {"pendulum": 1, "double": 2, "triple": 3}  # those made here, and how many rods


def build_system(name, rng=0, links=10):
    """The system called `name`: one of SYSTEMS, "chain" with `links` rods, a scene or its file.

    Those without a file, of unit rods and masses, start at rest, stretched sideways, tilted by the
    only random number of this program, from `rng`, a Generator or a seed. Raises SceneError.
    """
    if name not in SYSTEMS and name != "chain":
        return scene_files.load_scene(name, HERE / CHAPTER / "scenes", [*SYSTEMS, "chain"], GRAVITY)
    count = SYSTEMS.get(name, links)
    tilt = np.random.default_rng(rng).uniform(-0.05, 0.05)
    q0 = PIVOT + np.arange(1.0, count + 1.0)[:, None] * scene_files.direction(-tilt)
    pairs = [(k, k - 1) for k in range(count)]  # rod 0 hangs on anchor -1, rod k on particle k - 1
    rods = {"pairs": pairs, "lengths": np.ones(count), "anchors": PIVOT[None]}
    return {"q0": q0, "v0": np.zeros_like(q0), "m": np.ones((count, 1)), **rods}


def external_force(system, q, v=None):
    """The force in newtons, (N, 3), without the rods', at one state q, v. Add drag, a motor."""
    return system["m"] * GRAVITY


# --- endregion ---
# --- region: constraints ---
# Let d be the vector along a rod, from its partner j to its particle i. The rod is right when
#     g = (d . d - L^2) / 2 = 0
# That is its constraint. Follow g in time. With d' = v_i - v_j, its two derivatives are
#     gdot  = d . d'               = J v
#     gddot = d . d'' + d' . d'    = J a + Jdot v
# v and a hold all particles, 3N numbers; J has a row a rod: d in the columns of particle i, -d in
# those of j. A rod acts along itself, oppositely on its ends: J^T lambda, one number lambda a rod,
# in N/m, below zero if it pulls. Put M a = f + J^T lambda (M: the masses) into J a + Jdot v = 0:
#     J M^-1 J^T lambda = -(J M^-1 f + Jdot v)
# As many equations as rods, and nothing unknown but lambda. That is the chapter.
def dot(a, b):
    """a . b (...,), sums over the last axis."""
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
    """A = J M^-1 J^T (..., C, C), added up over particles p; `along`: K, for A = J M^-1 K^T."""
    along = jac if along is None else along
    rods_of = tied(system["pairs"])
    a = np.zeros((*jac.shape[:-1], jac.shape[-2]), jac.dtype)
    for p, m in enumerate(system["m"]):  # p's columns of J are zero but for its own rods
        rods, x = rods_of.get(p, []), slice(3 * p, 3 * p + 3)
        share = jac[..., rods, x] @ np.swapaxes(along[..., rods, x], -1, -2) / m
        a[(..., *np.ix_(rods, rods))] += share
    return a


def solve(system, a, b, turned=0.0, rough=False):
    """lambda (..., C) with A lambda = b, A being `a`: np.linalg.solve's, for fewer operations.

    Only rods that share a particle feel each other: along a chain this is a sweep out and one back,
    O(N), as R. Featherstone's articulated bodies (1983). In a loop a rod may be too many, and `a`
    singular. There a little is added to it, of SLACK and of `turned` (..., C, C). Unless `rough`,
    rounds of refinement remove the effect (J. Carpentier, R. Budhiraja, N. Mansard, RSS 2021). What
    no lambda can meet is left: see `unheld`, and the chapter's side trip on loops.
    """
    order = elimination_order(system["pairs"])
    if not has_loop(system["pairs"]):
        return eliminated(a, order)(b)
    blurred = eliminated(a + turned + statics.SLACK * (a * np.eye(len(order))), order)
    return blurred(b) if rough else refined(blurred, a, b, "no finite tensions")


# gddot = 0 keeps a right rod right and a wrong one wrong: each step of an integrator leaves an
# error in g, and nothing takes it back. So ask for more, that g behave like a damped spring:
#     gddot = -2 w gdot - w^2 g
# e^(rt) solves that if (r + w)^2 = 0, so errors die like e^(-wt), and do not swing. Two terms more
# on the right-hand side. Most remedies are of this kind, four numbers, with A = J M^-1 J^T:
#     (A + softness diag A) lambda = -(J M^-1 f + use_jdotv Jdot v) - damping gdot - stiffness g
# A Hold is these four, in 1, 1/s, 1/s^2 and 1; `dt`, if they are for steps of so many s only;
# `rule`, if for one rule only; `after`, (system, q_start, q, v, dt) -> (q, v), if steps are mended.
Hold = namedtuple("Hold", "use_jdotv damping stiffness softness dt rule after", defaults=3 * [None])


def hold_table(dt=0.005, baumgarte=20.0, time_constant=0.02, impedance=0.95):
    """The modes by name: `baumgarte` in rad/s, MuJoCo's `time_constant` in s and `impedance`."""
    p, p_t = impedance, impedance * np.maximum(time_constant, 2.0 * dt)  # as MuJoCo
    soft = 2.0 / p_t, p / (p_t * p_t), (1.0 - p) / p
    return {
        # gddot = 0. Fails by slow rot: what has drifted stays, and every step adds to it.
        "none": Hold(1.0, 0.0, 0.0, 0.0),
        # gddot = -2 w gdot - w^2 g (J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1).
        # Fails when dt w passes STABILITY_LIMIT.
        "baumgarte": Hold(1.0, 2.0 * baumgarte, baumgarte * baumgarte, 0.0),
        # If q_next = q + dt v_next, g_next is near g + dt J v_next: ask J v_next = -g/dt. If, too,
        # v_next = v + dt a, J a = -gdot/dt - g/dt^2 (E. Catto, GDC 2005). Made for one rule only.
        "impulse": Hold(0.0, 1.0 / dt, 1.0 / (dt * dt), 0.0, dt, "semi_implicit"),
        # A rod that gives, as MuJoCo's tendon, g being |d| (|d| - L): with p, t its impedance and
        # time constant, gddot = (1 - p) J M^-1 f + Jdot v - 2 gdot/t - g/t^2 for a single one.
        # Fails by design: a rod under load is longer.
        "soft": Hold(0.0, *soft, dt),
        # gddot = 0, and steps end with Newton's way back onto the rods. Fails if there is none.
        "project": Hold(1.0, 0.0, 0.0, 0.0, after=project),
    }


def as_hold(hold):
    """A Hold is itself, or a row of the table by name, or Baumgarte's w; 0.0 is `none`."""
    named = scene_files.chosen(hold, hold_table()) if isinstance(hold, str) else hold
    return named if isinstance(named, Hold) else hold_table(baumgarte=hold)["baumgarte"]


def right_side(hold, lengths, pushed, g, gdot, jdotv):
    """b (..., C) of the linear system, where `pushed` is J M^-1 f."""
    if hold.softness:
        length = np.sqrt(2.0 * g + np.square(lengths))  # |d|
        g = length * (length - lengths)
    return -(pushed + hold.use_jdotv * jdotv) - hold.damping * gdot - hold.stiffness * g


def multipliers(system, q, v, hold=0.0, f=None):
    """J (..., C, 3N), Lagrange's multipliers lambda in N/m, b - A lambda, and b (..., C)."""
    hold = as_hold(hold)
    f = each_state(partial(external_force, system), q, v) if f is None else f
    jac, g, gdot, jdotv = constraint_terms(system, q, v)
    accel = np.broadcast_to(f / system["m"], q.shape).reshape(*q.shape[:-2], 1, -1)  # M^-1 f
    b = right_side(hold, system["lengths"], dot(jac, accel), g, gdot, jdotv)
    a = mobility(system, jac) * (1.0 + hold.softness * np.eye(len(system["pairs"])))
    turned = 0.0
    if has_loop(system["pairs"]):  # dJ M^-1 dJ^T, of what J gains in an INSTANT: statics.SLACK
        turned = mobility(system, constraint_terms(system, q + statics.INSTANT * v, v)[0] - jac)
    lam = solve(system, a, b, turned)
    return jac, lam, b - dot(a, lam[..., None, :]), b


def rod_forces(jac, lam):
    """J^T lambda (..., N, 3) in N: what the particles feel when the rods carry lambda."""
    return np.sum(jac * lam[..., None], axis=-2).reshape(*jac.shape[:-2], -1, 3)


def constraint_force(system, q, v, hold=0.0, f=None):
    """The force of the rods (..., N, 3) in N: `hold` is a Hold, or Baumgarte's w in rad/s."""
    return rod_forces(*multipliers(system, q, v, hold, f)[:2])


def tensions(system, q, v, hold=0.0):
    """Newtons (..., C) with which the rods pull, -lambda |d|; below zero they push."""
    lam = multipliers(system, q, v, hold)[1]
    return -lam * (rod_errors(system, q) + system["lengths"])


def unheld(system, q, v, hold=0.0):
    """How much of what b asks for no tensions answer (...): see statics.unanswered."""
    _, _, left, b = multipliers(system, q, v, hold)
    return statics.unanswered(left, b, system["lengths"])


class Force(namedtuple("Force", "system hold")):
    """Where rods meet integrators: force(q, v) -> (N, 3) in N, the rods' included."""

    def __call__(self, q, v):
        f = each_state(partial(external_force, self.system), q, v)
        return f + constraint_force(self.system, q, v, self.hold, f)

    @property
    def after(self):  # (q_start, q, v, dt) -> (q, v), what a finished step is mended by, or None
        return self.hold.after and partial(self.hold.after, self.system)


def make_force(system, hold):
    """A Force; `hold`: a Hold, a mode's name, or Baumgarte's w in rad/s."""
    return Force(system, as_hold(hold))


def project(system, q_start, q, v, dt):
    """A step from q_start that ended at q, v (..., N, 3), a little off, put back: g = 0, J v = 0.

    Rods correct as they pull, q = q - M^-1 J(q_start)^T mu; v gains that move / dt: SHAKE (J.-P.
    Ryckaert et al., J. Comput. Phys. 23 (1977) 327). Then v loses its part along rods: RATTLE (H.
    Andersen, ibid. 52 (1983) 24). Else energy blows up. Raises Stop: the step is tried in halves.
    """
    along = constraint_terms(system, q_start, v)[0]
    close = statics.near(system["lengths"], q_start)  # m^2: a g that counts as zero

    def newton(q):
        jac, g, _, _ = constraint_terms(system, q, v)
        mu = solve(system, mobility(system, jac, along), g, rough=True)  # the next round refines
        return q - rod_forces(along, mu) / system["m"], dot(g / close, g / close)

    end = repeat(newton, q, 20, "no way back onto the rods")  # until newton's second is <= 1
    v = v + (end - q) / dt
    jac, _, gdot, _ = constraint_terms(system, end, v)
    return end, v - rod_forces(jac, solve(system, mobility(system, jac), gdot)) / system["m"]


# --- endregion ---
# --- region: integrators ---
# The rules of chapter 3.3, (q, v, m, force, dt) -> (q, v), without a word about rods. That force()
# solves a linear system they need not know; how fast their own error becomes drift, they decide.
def euler_step(q, v, m, force, dt):
    """Explicit Euler: order 1, one force a step. Pumps energy into all that swings: a warning."""
    a = force(q, v) / m
    return q + dt * v, v + dt * a


def semi_implicit_step(q, v, m, force, dt):
    """Semi-implicit (symplectic) Euler: order 1, one force, v before q; as game engines do."""
    v = v + dt * (force(q, v) / m)
    return q + dt * v, v


def rk4_step(q, v, m, force, dt):
    """Runge-Kutta (W. Kutta, Z. Math. Phys. 46 (1901) 435): order 4; energy wanders."""

    def slope(q, v):
        return v, force(q, v) / m

    v1, a1 = slope(q, v)
    v2, a2 = slope(q + 0.5 * dt * v1, v + 0.5 * dt * a1)
    v3, a3 = slope(q + 0.5 * dt * v2, v + 0.5 * dt * a2)
    v4, a4 = slope(q + dt * v3, v + dt * a3)
    q = q + (dt / 6.0) * (v1 + 2.0 * v2 + 2.0 * v3 + v4)
    return q, v + (dt / 6.0) * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


INTEGRATORS = {"euler": euler_step, "semi_implicit": semi_implicit_step, "rk4": rk4_step}
INTEGRATORS |= {"midpoint": make_midpoint(8), "gauss": make_gauss(8)}  # of order 8 and 16

# Up to this z = dt w Baumgarte's spring is stable: a step multiplies e^(-wt) by at most 1 in size,
# Euler's by 1 - z, RK4's by 1 - z + z^2/2 - z^3/6 + z^4/24. Semi-implicit: 4 - 4z - z^2 >= 0.
STABILITY_LIMIT = {"euler": 2.0, "semi_implicit": 2.0 * (np.sqrt(2.0) - 1.0), "rk4": 2.785294}


# --- endregion ---
# --- region: simulate ---
# An honest run says at every step how far the worst rod is off, and how far the energy.
def energy(system, q, v):
    """Kinetic and potential energy (...,) in J at q, v (..., N, 3); U = -sum m GRAVITY . q."""
    m = system["m"][:, 0]
    each = 0.5 * m * dot(v, v) - m * dot(q, GRAVITY)
    return np.cumsum(each, axis=-1)[..., -1]  # in order; np.sum's depends on how many states come


def rod_errors(system, q):
    """|d| - L (..., C) in m, what a ruler would show, at positions q (..., N, 3)."""
    d = statics.differences(q, system.get("anchors", PIVOT[None]), system["pairs"])
    return np.sqrt(dot(d, d)) - system["lengths"]


def constraint_violation(system, q):
    """The largest rod error (...,) in m, whatever its sign."""
    return np.max(np.abs(rod_errors(system, q)), axis=-1)


def simulate(step_fn, system, force, dt, steps, keep=(), way=Compiled):
    """`steps` steps of `dt` s by step_fn(q, v, m, force, dt), measured at every one: a runs.Run.

    `keep`: steps whose states it has, too. Members of leading axes in q0, v0 go in step.
    `way`: Compiled, or Plain, the lines as they stand.
    """
    system = {"anchors": PIVOT[None], **system}
    system = scene_files.check_run(system, force, dt, steps, step_fn, INTEGRATORS)
    q, v, m = system["q0"], system["v0"], system["m"]
    step_fn = way(followed(step_fn, getattr(force, "after", None)), steps)
    log = Log(steps, keep, 100.0 * np.sum(system["lengths"]))  # m: so far off is flown apart
    log.note(q, v, constraint_violation(system, q), energy(system, q, v))
    with log:
        for _ in log.turns():  # until all steps are done, or the run is lost
            q, v = step_fn(q, v, m, force, dt)  # compiled, many steps: (steps, ..., N, 3)
            measured = constraint_violation(system, q), energy(system, q, v)
            log.note(q, v, *measured)
    return log.run(step_fn)


# --- endregion ---
# --- region: report ---
def parse(argv):
    """The command line; the system that it names; and whether it asks for a default run."""
    parser, scene, method = chapter_parser("constraints.py", HERE / CHAPTER, OUT, EXAMPLES)
    modes, rules = ["all", *hold_table()], ", ".join(INTEGRATORS)
    scene("--scenes", action="store_true", help="list them")
    scene("--system NAME", default="double", help="one that --scenes lists, or a file")
    scene("--links N", type=number(int, 1, 1001), default=10, help="rods of --system chain")
    scene("--steps N", type=number(int, 1), default=4000, help="drift is patient: run longer")
    scene("--dt S", type=number(high=1e3), default=0.005, help="s; halve it: the rule's order")
    method("--integrator RULE", choices=INTEGRATORS, default="semi_implicit", help=rules)
    method("--stabilization MODE", choices=modes, default="all", help=", ".join(modes[1:]))
    method("--baumgarte W", type=number(float, 0), default=20.0, help="rad/s; too much blows up")
    method("--time-constant T", type=number(), default=0.02, help="s; how soon soft mends a rod")
    method("--impedance P", type=number(high=1), default=0.95, help="soft: hard rods near 1")
    method("--tol M", type=number(high=1), help="m at 2 s; gauss then finds its stages and step")
    args = parser.parse_args(argv)
    if args.scenes:
        print(publish.scene_list(SYSTEMS, HERE / CHAPTER))
        parser.exit()
    if args.tol and (args.plain or args.integrator != "gauss"):
        parser.error(f"argument --tol: {args.tol:g} wants --integrator gauss and no --plain")
    if why := scene_files.misfit(hold_table().get(mode := args.stabilization), args.integrator):
        parser.error(f"argument --stabilization: {mode} {why}")
    system = parser.attempt("--system", build_system, args.system, args.seed, args.links)
    usual = args == parser.parse_args(["--out", args.out])
    if not args.show_step:  # last, so that every other mistake is told first
        args.out = parser.attempt("--out", publish.results_folder, args.out)
    return args, system, usual, partial(parser.attempt, "--tol")


def report(args, rows, runs, dt, steps, truth):
    """Print the table, a sentence for each mark in it, and the verdict."""
    ways = "; ".join(dict.fromkeys(run.way for run in runs.values()))
    limit = STABILITY_LIMIT.get(args.integrator, np.inf)
    print(f"{args.system}: seed {args.seed}; {args.integrator}, steps of {dt:.4g} s, {ways}\n")
    tables.comparison(rows, runs, f"{truth.step * dt:.3g} s", truth, args.tol)
    if "baumgarte" in runs and dt * args.baumgarte > limit:
        print(f"baumgarte: dt w = {dt * args.baumgarte:.3g} is past the limit {limit:.3g} here")
    if args.system in SYSTEMS and args.baumgarte and steps >= SMOKE_STEPS:
        tables.verdict(rows)


def main(argv=None):
    """Run the comparison that `argv` asks for, print it, write what --out is to hold."""
    args, system, usual, attempt = parse(argv)
    modes = list(hold_table()) if args.stabilization == "all" else [args.stabilization]
    rule, steps = INTEGRATORS[args.integrator], SMOKE_STEPS if args.smoke else args.steps
    knobs = args.baumgarte, args.time_constant, args.impedance

    def run(mode, rule, dt, steps, keep=(), way=Plain if args.plain else Compiled):
        force = make_force(system, hold_table(dt, *knobs)[mode])
        return simulate(rule, system, force, dt, steps, keep, way)

    if args.show_step:
        print(f"# {modes[0]}, {args.integrator}\n{run(modes[0], rule, args.dt, 1).source}")
        return
    print(banner.banner("ch3.4", "constraints", args.device, usual))
    for mode in list(modes):
        if why := scene_files.misfit(hold_table()[mode], args.integrator):
            modes.remove(mode)
            print(f"{mode} left out: it {why}")
    budget = 0 if args.plain else 5000 // (len(system["pairs"]) + 5)  # steps for the truth
    tried = [partial(run, mode) for mode in ("project", *modes)]  # the first finds the truth
    rule, dt, steps, truth = attempt(ruler.settle, tried, rule, args.dt, steps, args.tol, budget)
    shown = recording.frames(steps, dt, len(system["q0"])) if args.rerun or args.picture else ()
    look = max(1, steps // LOOKS)
    keep = [truth.step, *range(0, steps + 1, look), *shown]
    runs = {mode: run(mode, rule, dt, steps, keep) for mode in banner.in_parts(modes)}
    scale = np.sum(system["m"]) * np.max(np.abs(GRAVITY)) * np.sum(system["lengths"]) or 1.0
    rows, pulls = {}, {}
    for mode in modes:
        hold = hold_table(dt, *knobs)[mode]
        left = in_pieces(partial(unheld, system, hold=hold), *runs[mode].every(look))
        rows[mode] = runs[mode].summary(scale, truth, np.max(left))
        pulls[mode] = partial(in_pieces, partial(tensions, system, hold=hold))
    report(args, rows, runs, dt, steps, truth)
    used = {"dt": dt, "steps": steps, "rods": len(system["pairs"]), "error_at": truth.step * dt}
    ghost = budget and shown and ruler.true_motion(partial(run, "none"), rk4_step, steps * dt)
    chapter = sys.modules[__name__]  # a page is made of these very lines
    page = partial(play.page, chapter, system=system, rule=args.integrator, step_fn=rule, dt=dt)
    page = partial(page, w=knobs[0], time_constant=knobs[1], impedance=knobs[2])
    print(publish.publish(args, used, system, runs, rows, scale, pulls, shown, ghost, page))


if __name__ == "__main__":
    run_script(main)
# --- endregion ---
