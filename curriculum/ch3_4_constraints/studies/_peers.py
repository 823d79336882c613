"""The systems of constraints.py in other engines, each at its fastest: for the study real_thing and
its test.

An engine is imported where it is used, so that this module needs none. Models are built before the
clock starts.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import make_system

import numpy as np

OFF = "contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp nativeccd autoreset"
POINT = 1e-14  # kg m^2 about the particle: MuJoCo wants some inertia; as a share of m L^2 this moves no digit we show


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


def hinges(system, dt, integrator="RK4"):
    """MuJoCo's model of a planar chain in joint angles: rods cannot stretch, no constraint
    anywhere."""
    body, beyond = (
        "",
        list(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True)),
    )
    for k, (m, length) in reversed(list(enumerate(beyond))):
        at = beyond[k - 1][1] if k else 0.0
        mass = inertial(m, length, POINT)
        body = f'<body pos="{at!r} 0 0"><joint type="hinge" axis="0 0 1"/>{mass}{body}</body>'
    return mjcf(body, off="constraint", timestep=dt, integrator=integrator)


def tendons(system, dt, soft=(0.02, 0.95), axes=3, off="", **option):
    """MuJoCo's model of a chain in particles: each slides along `axes` axes, each rod a tendon made
    equal to L."""
    joints = "".join(
        f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1")[:axes]
    )
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(
        zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True)
    ):
        bodies += f'<body>{joints}{inertial(m, 0.0, 1.0)}<site name="s{k}"/></body>'
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length!r} 0 0 0 0" '
        equal += f'solref="{soft[0]!r} 1" solimp="{soft[1]} {soft[1]} 0.001 0.5 2"/>'
    rest = f"<tendon>{ropes}</tendon><equality>{equal}</equality>"
    # the rods ask for a linear system, of which one Newton iteration is the exact solution
    settings = {
        "solver": "Newton",
        "jacobian": "auto",
        "iterations": 1,
        "tolerance": 0,
        "timestep": dt,
    } | option
    return mjcf(bodies, rest, off, **settings)


def random_chain(rng, rods):
    """A chain of `rods` rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(rods, 3)), rng.uniform(0.5, 2.0, rods)
    d = (
        unit
        / np.linalg.norm(unit, axis=1, keepdims=True)
        * (lengths * (1.0 + 0.03 * rng.normal(size=rods)))[:, None]
    )
    pairs = [(k, k - 1) for k in range(rods)]
    return make_system(
        d.cumsum(0), rng.normal(size=(rods, 3)), rng.uniform(0.3, 3.0, rods), pairs, lengths
    )


def named(system, dt, shapes):
    """{field: value} of MuJoCo at the same state; efc_AR is made for its dual solver PGS only,
    hence a second model."""
    import mujoco

    fields = {}
    for solver in (
        "PGS",
        "Newton",
    ):  # the force of the primal solver is the exact one and comes last
        model = tendons(system, dt, solver=solver, iterations=100, jacobian="dense")
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
        mujoco.mj_forward(model, data)
        fields |= {
            name: np.array(getattr(data, name)) for name in shapes if getattr(data, name).size
        }
    k, b, imp = fields["efc_KBIP"][:, :3].T
    fields["efc_KBIP"] = np.stack([k * imp, b], axis=1)
    return {name: fields[name].reshape(shape) for name, shape in shapes.items()}


class Task(NamedTuple):
    """A system from its start to time samples * every (s), and how far positions (samples, N, 2)
    are off."""

    system: dict
    samples: int
    every: float
    error: Callable


def clocked(task, advance, positions):
    """(seconds, positions (samples, N, 2)) of an engine that advances a sample at a time."""
    q, seconds = [], 0.0
    for _ in range(task.samples):
        clock = time.perf_counter()
        advance()
        seconds += time.perf_counter() - clock
        q.append(positions())
    return seconds, np.array(q)


def start_hinges(system, dt, integrator="RK4"):
    """MuJoCo's model in joint angles, and its data at the start."""
    import mujoco

    model, d = hinges(system, dt, integrator), np.diff(system["q0"], axis=0, prepend=0.0)
    data = mujoco.MjData(model)
    data.qpos[:] = np.diff(np.arctan2(d[:, 1], d[:, 0]), prepend=0.0)
    return model, data


def pace_hinges(system, dt, integrator, steps):
    """Microseconds a step of MuJoCo in joint angles, all steps in one C call."""
    import mujoco

    model, data = start_hinges(system, dt, integrator)
    clock = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    return 1e6 * (time.perf_counter() - clock) / steps


def pace_tendons(system, dt, axes, steps):
    """Microseconds a step of MuJoCo's rods, and their worst error in m at the end."""
    import mujoco

    model = tendons(system, dt, axes=axes, jacobian="sparse" if len(system["q0"]) > 30 else "dense")
    data = mujoco.MjData(model)
    data.qpos[:] = system["q0"][:, :axes].ravel()
    clock = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    return 1e6 * (time.perf_counter() - clock) / steps, float(np.abs(data.efc_pos).max())


def run_hinges(task, per):
    """MuJoCo in joint angles, `per` steps a sample in one C call."""
    import mujoco

    (model, data), lengths = (
        start_hinges(task.system, task.every / per),
        task.system["lengths"][:, None],
    )

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
    return clocked(
        task, partial(mujoco.mj_step, model, data, per), lambda: data.qpos.reshape(n, 2).copy()
    )


def run_exudyn(task, per, tol):
    """Exudyn's point masses and distance constraints, trapezoidal rule of index 2 (it keeps gdot =
    0), full Newton."""
    import exudyn
    from exudyn import itemInterface as item

    system, sensors, settings = (
        exudyn.SystemContainer().AddSystem(),
        [],
        exudyn.SimulationSettings(),
    )
    ground = system.AddObject(item.ObjectGround())
    tied = system.AddMarker(
        item.MarkerBodyPosition(bodyNumber=ground, localPosition=[0.0, 0.0, 0.0])
    )
    for x, m, length in zip(*(task.system[key] for key in ("q0", "m", "lengths")), strict=True):
        node = system.AddNode(item.NodePoint2D(referenceCoordinates=x[:2].tolist()))
        system.AddObject(item.MassPoint2D(mass=float(m[0]), nodeNumber=node))
        before, tied = tied, system.AddMarker(item.MarkerNodePosition(nodeNumber=node))
        system.AddLoad(item.LoadForceVector(markerNumber=tied, loadVector=(m * c.GRAVITY).tolist()))
        system.AddObject(
            item.DistanceConstraint(markerNumbers=[before, tied], distance=float(length))
        )
        kind = exudyn.OutputVariableType.Position
        sensors.append(
            system.AddSensor(
                item.SensorNode(nodeNumber=node, storeInternal=True, outputVariableType=kind)
            )
        )
    system.Assemble()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = task.every
    settings.linearSolver.solverType = exudyn.LinearSolverType.EXUdense
    rule = settings.timeIntegration
    rule.numberOfSteps, rule.endTime, rule.verboseMode = (
        per * task.samples,
        task.samples * task.every,
        0,
    )
    rule.newton.relativeTolerance, rule.newton.absoluteTolerance = tol, 0.01 * tol
    clock = time.perf_counter()
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    seconds = time.perf_counter() - clock
    return seconds, np.stack([system.GetSensorStoredData(s)[1:, 1:3] for s in sensors], axis=1)


def run_pymunk(task, per):
    """Chipmunk's point masses and pin joints as pymunk ships them, a call from Python a step."""
    import pymunk

    space, dt, tied, bodies = pymunk.Space(), task.every / per, None, []
    space.gravity = tuple(c.GRAVITY[:2].tolist())
    for x, m in zip(task.system["q0"].tolist(), task.system["m"][:, 0].tolist(), strict=True):
        bodies.append(pymunk.Body(m, math.inf))
        bodies[-1].position = x[:2]
        space.add(bodies[-1], pymunk.PinJoint(tied or space.static_body, bodies[-1]))
        tied = bodies[-1]

    def advance():
        for _ in range(per):
            space.step(dt)

    return clocked(task, advance, lambda: [tuple(body.position) for body in bodies])


def dop853():
    """A rule (q, v, m, force, dt) -> (q, v): the twelve stages of DOP853, scipy's coefficients,
    order 8, explicit."""
    from scipy.integrate import DOP853

    def step(q, v, m, force, dt):
        x, rates = np.stack([q, v]), []
        for weights in [*DOP853.A[1:].tolist(), DOP853.B.tolist()]:
            rates.append(np.stack([x[1], force(*x) / m]))
            x = np.stack([q, v]) + dt * sum(
                w * rate for w, rate in zip(weights, rates, strict=False) if w
            )
        return tuple(x)

    return step
