"""Read the real thing: what MuJoCo calls our quantities, and what its speed is worth at the same error.

(a) The same quantity, two names: `soft` is MuJoCo's tendon equality, digit by digit.  (b) Time to a given error: the
double pendulum, 5 s, beside reference.json.  (c) A published task with published tolerances: the simple pendulum A01.
(d) How a step grows with a chain.
The engines are set up at their fastest, and their models are built before the clock starts. Whatever is compared is
timed in turns, A B A B, so that a busy machine slows both; only ratios carry over to another machine.
"""

import json
import sys
import time
from argparse import RawDescriptionHelpFormatter
from decimal import Decimal, localcontext
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.studies.benchmark import show, spread
from curriculum.common.cli import Parser, number
from curriculum.common.device import processor
from curriculum.common.files import check_writable, write_whole
from curriculum.common.gauss import make_gauss

NEEDED = ("mujoco", "exudyn", "scipy")
TARGETS = (1e-3, 1e-6, 1e-9, 1e-12)  # m
A01 = {"low precision": 1e-1, "high precision": 1e-3}  # its specification; outputs and threshold are in `a01`
OFF = "contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp nativeccd autoreset"
POINT = 1e-14  # kg m^2 about the particle: MuJoCo wants some inertia; as a share of m L^2 this moves no digit we show


# --- the engines' models of a system of constraints.py ---
def mjcf(world, rest="", off="", **option):
    """A MuJoCo model from XML, with everything switched off that these systems do not need."""
    import mujoco

    flags = " ".join(f'{name}="disable"' for name in [*OFF.split(), *off.split()])
    options = " ".join(f'{name}="{value}"' for name, value in option.items())
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/><size memory="256M"/>'
        f'<option gravity="0 -9.81 0" {options}><flag {flags}/></option><worldbody>{world}</worldbody>{rest}</mujoco>'
    )


def inertial(m, x, inertia):
    return f'<inertial pos="{x!r} 0 0" mass="{m!r}" diaginertia="{inertia} {inertia} {inertia}"/>'


def hinges(system, dt):
    """MuJoCo's model of a planar chain in joint angles: rods cannot stretch, RK4, no constraint anywhere."""
    body, beyond = "", list(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True))
    for k, (m, length) in reversed(list(enumerate(beyond))):
        at = beyond[k - 1][1] if k else 0.0
        mass = inertial(m, length, POINT)
        body = f'<body pos="{at!r} 0 0"><joint type="hinge" axis="0 0 1"/>{mass}{body}</body>'
    return mjcf(body, off="constraint", timestep=dt, integrator="RK4")


def tendons(system, dt, soft=(0.02, 0.95), axes=3, off="", **option):
    """MuJoCo's model of a chain in particles: each slides along `axes` axes, each rod a tendon made equal to L."""
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")[:axes])
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True)):
        bodies += f'<body>{joints}{inertial(m, 0.0, 1.0)}<site name="s{k}"/></body>'
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length!r} 0 0 0 0" '
        equal += f'solref="{soft[0]!r} 1" solimp="{soft[1]} {soft[1]} 0.001 0.5 2"/>'
    rest = f"<tendon>{ropes}</tendon><equality>{equal}</equality>"
    # the rods ask for a linear system, of which one Newton iteration is the exact solution
    settings = {"solver": "Newton", "jacobian": "auto", "iterations": 1, "tolerance": 0, "timestep": dt} | option
    return mjcf(bodies, rest, off, **settings)


# --- (a) the same quantity, two names ---
def random_chain(rng, rods):
    """A chain of 1 to 4 rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(rods, 3)), rng.uniform(0.5, 2.0, rods)
    d = unit / np.linalg.norm(unit, axis=1, keepdims=True) * (lengths * (1.0 + 0.03 * rng.normal(size=rods)))[:, None]
    pairs = [(k, k - 1) for k in range(rods)]
    return c.make_system(d.cumsum(0), rng.normal(size=(rods, 3)), rng.uniform(0.3, 3.0, rods), pairs, lengths)


def ours_named(system, dt):
    """{our name: value} for what MuJoCo has a field for. Its row of J is ours / |d|, so lambda is ours |d|: newtons."""
    q, v, m, hold = system["q0"], system["v0"], system["m"], c.hold_table(dt)["soft"]
    (jac, _, gdot, _), force = c.constraint_terms(system, q, v), c.constraint_force(system, q, v, hold)
    d, w = c.rod_vectors(system, q), np.repeat(1.0 / m[:, 0], 3)
    size, a = np.sqrt(c.dot(d, d)), jac * w @ jac.T
    pull = np.cumsum(force[::-1], axis=0)[::-1]  # a chain: rod k carries what acts on particle k and all beyond
    stretch, scale = size - system["lengths"], np.outer(size, size)
    return {
        ("row of J over |d|", "efc_J"): jac / size[:, None],
        ("|d| - L", "efc_pos"): stretch,
        ("gdot / |d|", "efc_vel"): gdot / size,
        ("stiffness, damping", "efc_KBIP"): np.tile([hold.stiffness, hold.damping], (len(d), 1)),
        ("-(damping gdot + stiffness g)/|d|", "efc_aref"): -hold.damping * gdot / size - hold.stiffness * stretch,
        ("softness diag A / |d|^2", "efc_R"): hold.softness * np.diag(a) / size**2,
        ("(A + softness diag A) / |d||d|", "efc_AR"): (a + hold.softness * np.diag(np.diag(a))) / scale,
        ("lambda |d|", "efc_force"): c.dot(pull, d) / size,
        ("acceleration", "qacc"): (system["weight"] + force) / m,
    }


WHERE = dict.fromkeys(("efc_J", "efc_pos", "efc_KBIP", "efc_R"), "mj_makeConstraint")
WHERE |= {"efc_vel": "mj_referenceConstraint", "efc_aref": "mj_referenceConstraint"}
WHERE |= {"efc_AR": "mj_projectConstraint", "efc_force": "mj_fwdConstraint", "qacc": "mj_fwdConstraint"}


def mujoco_named(system, dt, shapes):
    """{field: value} of MuJoCo at the same state; efc_AR is made for its dual solver PGS only, hence a second model."""
    import mujoco

    fields = {}
    for solver in ("PGS", "Newton"):  # the force of the primal solver is the exact one and comes last
        model = tendons(system, dt, solver=solver, iterations=100, jacobian="dense")
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
        mujoco.mj_forward(model, data)
        fields |= {name: np.array(getattr(data, name)) for name in shapes if getattr(data, name).size}
    k, b, imp = fields["efc_KBIP"][:, :3].T
    fields["efc_KBIP"] = np.stack([k * imp, b], axis=1)
    return {name: fields[name].reshape(shape) for name, shape in shapes.items()}


def names(states):
    """Table (a): our names and MuJoCo's, a value of the first state, and the largest difference over all states."""
    rng, dt, rows = np.random.default_rng(0), 0.005, {}
    for state in range(states):
        system = random_chain(rng, 1 + (state + 1) % 4)  # the first is a double pendulum
        ours = ours_named(system, dt)
        theirs = mujoco_named(system, dt, {field: value.shape for (_, field), value in ours.items()})
        for (name, field), value in ours.items():
            row = {"ours": name, "MuJoCo's": field, "set by": WHERE[field], "ours, last": float(value.flat[-1])}
            row |= {"MuJoCo's, last": float(theirs[field].flat[-1]), "largest gap": 0.0}
            gap = float(np.abs(value - theirs[field]).max() / np.abs(value).max())
            row = rows.setdefault(field, row)
            row["largest gap"] = max(row["largest gap"], gap)
    worst = max(rows[field]["largest gap"] for field in ("efc_force", "qacc"))
    title = f"(a) the same quantity, two names: soft and MuJoCo {version('mujoco')}, {states} random chains off the rods"
    bars = [("acceleration and rod force, largest difference as a share of the largest", worst, 1e-12)]
    return show(title, list(rows.values()), bars)


# --- (b), (c) time to an error ---
class Task(NamedTuple):
    """A system from its start to time samples * every (s), and how far positions (samples, N, 2) are off."""

    system: dict
    samples: int
    every: float
    error: Callable


def clocked(task, advance, positions):
    """(seconds, seconds with everything, positions (samples, N, 2)) of an engine that advances a sample at a time."""
    q, seconds = [], 0.0
    for _ in range(task.samples):
        clock = time.perf_counter()
        advance()
        seconds += time.perf_counter() - clock
        q.append(positions())
    return seconds, seconds, np.array(q)


def run_hinges(task, per):
    """MuJoCo in joint angles, `per` steps a sample in one C call."""
    import mujoco

    model = hinges(task.system, task.every / per)
    data, lengths = mujoco.MjData(model), task.system["lengths"][:, None]
    d = c.rod_vectors(task.system, task.system["q0"])
    data.qpos[:] = np.diff(np.arctan2(d[:, 1], d[:, 0]), prepend=0.0)

    def positions():
        angle = np.cumsum(data.qpos)
        return np.cumsum(lengths * np.stack([np.cos(angle), np.sin(angle)], axis=1), axis=0)

    return clocked(task, partial(mujoco.mj_step, model, data, per), positions)


def run_tendons(task, per, integrator, impedance, constant):
    """MuJoCo's rods; `constant`(dt) is the time constant of solref in s."""
    import mujoco

    dt, n = task.every / per, len(task.system["q0"])
    model = tendons(task.system, dt, (constant(dt), impedance), 2, "refsafe", integrator=integrator)
    data = mujoco.MjData(model)
    data.qpos[:] = task.system["q0"][:, :2].ravel()
    return clocked(task, partial(mujoco.mj_step, model, data, per), lambda: data.qpos.reshape(n, 2).copy())


def run_exudyn(task, per, tol):
    """Exudyn's point masses and distance constraints, trapezoidal rule of index 2 (it keeps gdot = 0), full Newton."""
    import exudyn
    from exudyn import itemInterface as item

    system, sensors, settings = exudyn.SystemContainer().AddSystem(), [], exudyn.SimulationSettings()
    ground = system.AddObject(item.ObjectGround())
    tied = system.AddMarker(item.MarkerBodyPosition(bodyNumber=ground, localPosition=[0.0, 0.0, 0.0]))
    for x, m, w, length in zip(*(task.system[key] for key in ("q0", "m", "weight", "lengths")), strict=True):
        node = system.AddNode(item.NodePoint2D(referenceCoordinates=x[:2].tolist()))
        system.AddObject(item.MassPoint2D(mass=float(m[0]), nodeNumber=node))
        before, tied = tied, system.AddMarker(item.MarkerNodePosition(nodeNumber=node))
        system.AddLoad(item.LoadForceVector(markerNumber=tied, loadVector=w.tolist()))
        system.AddObject(item.DistanceConstraint(markerNumbers=[before, tied], distance=float(length)))
        kind = exudyn.OutputVariableType.Position
        sensors.append(system.AddSensor(item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind)))
    system.Assemble()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = task.every
    settings.linearSolver.solverType = exudyn.LinearSolverType.EXUdense
    rule = settings.timeIntegration
    rule.numberOfSteps, rule.endTime, rule.verboseMode = per * task.samples, task.samples * task.every, 0
    rule.newton.relativeTolerance, rule.newton.absoluteTolerance = tol, 0.01 * tol
    clock = time.perf_counter()
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    seconds = time.perf_counter() - clock
    return seconds, seconds, np.stack([system.GetSensorStoredData(s)[1:, 1:3] for s in sensors], axis=1)


def run_scipy(task, tol):
    """scipy's DOP853 on our force: order 8, steps of its own choice."""
    from scipy.integrate import solve_ivp

    m, q0, force = task.system["m"], task.system["q0"], c.make_force(task.system, 0.0)

    def rate(_, y):
        q, v = y.reshape(2, *q0.shape)
        return np.concatenate([v, force(q, v) / m], axis=None)

    times, start = np.arange(1, task.samples + 1) * task.every, np.concatenate([q0, 0.0 * q0], axis=None)
    clock = time.perf_counter()
    y = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", times, rtol=tol, atol=tol).y
    seconds = time.perf_counter() - clock
    return seconds, seconds, y[: q0.size].T.reshape(-1, *q0.shape)[..., :2]


def run_ours(task, per, mode, rule, *settings):
    """Our simulate: the clock of its integration loop, and with making the rule and measuring every state."""
    dt, clock, steps = task.every / per, time.perf_counter(), per * task.samples
    run = c.simulate(
        task.system, make_gauss(*settings) if settings else rule, c.hold_table(dt)[mode], dt, steps, range(per, steps + 1, per)
    )
    q = run["kept"]["q"][..., :2]
    if run["stopped"]:
        q = np.full((task.samples, *q.shape[1:]), np.nan)
    return run["seconds_per_step"] * run["steps"], time.perf_counter() - clock, q


def rungs(low, high, ratio):
    """Whole numbers from low to high, each about `ratio` times the one before."""
    return np.unique(np.geomspace(low, high, 1 + round(np.log(high / low) / np.log(ratio))).round().astype(int)).tolist()


def climb(task, ladder, cap):
    """[(error, seconds, setting)] of the jobs {setting: job}, in that order; ends after a run longer than `cap` s."""
    found = []
    for setting, job in ladder.items():
        seconds, _, q = job()
        found.append((float(np.nan_to_num(task.error(q), nan=np.inf)), seconds, setting))
        if seconds > cap:
            break
    return found


def cheapest(found, ladder, target):
    """The setting that reaches `target` soonest: the best few of the climb, timed once more in turns."""
    reach = sorted((seconds, setting) for error, seconds, setting in found if error <= target)
    close = [setting for seconds, setting in reach[:6] if seconds < 1.3 * reach[0][0]]
    again = rounds({setting: ladder[setting] for setting in close}, 3 if len(close) > 1 else 0)
    return min(close, key=lambda s: np.median(again[s]), default=None) if len(close) > 1 else next(iter(close), None)


def rounds(jobs, repeats):
    """{name: seconds (repeats,)} of the jobs, run in turns; a job returns its own seconds first."""
    seconds = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            seconds[name].append(job()[:2])
    return {name: np.array(s) for name, s in seconds.items()}
