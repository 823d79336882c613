"""The systems of constraints.py in other engines, each at its fastest.

An engine is imported where it is used, so that this module needs none. What a run returns first is
the seconds of its steps alone: models are built, and read, while that clock stands.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from curriculum.ch3_4_constraints.studies._runs import G, make_system

import numpy as np

OFF = """contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp
nativeccd autoreset"""  # of MuJoCo: what these systems do not need
# kg m^2 about a particle: MuJoCo wants some; as a share of m L^2 this moves no digit we show
POINT = 1e-14


class Task(NamedTuple):
    """A system from its start to time samples * every (s), and error(positions (samples, N, 2))."""

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


def start_angles(system):
    """The angles (N,) of a chain's rods from +x in rad."""
    d = np.diff(system["q0"], axis=0, prepend=0.0)
    return np.arctan2(d[:, 1], d[:, 0])


def placed(system, angles):
    """Positions (..., N, 2) of a chain whose rods are at `angles` (..., N)."""
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.cumsum(system["lengths"][:, None] * unit, axis=-2)


# --- MuJoCo ---
def mjcf(world, rest="", off="", **option):
    """A MuJoCo model from XML, with everything switched off that these systems do not need."""
    import mujoco

    flags = " ".join(f'{name}="disable"' for name in [*OFF.split(), *off.split()])
    options = " ".join(f'{name}="{value}"' for name, value in option.items())
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/><size memory="256M"/>'
        f'<option gravity="0 {-G} 0" {options}><flag {flags}/></option>'
        f"<worldbody>{world}</worldbody>{rest}</mujoco>"
    )


def rods(system):
    """(mass, length) of a chain's particles and rods."""
    return list(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True))


def inertial(m, x, inertia):
    return f'<inertial pos="{x!r} 0 0" mass="{m!r}" diaginertia="{(f"{inertia} " * 3).strip()}"/>'


def start_hinges(system, dt, integrator):
    """MuJoCo's model of a planar chain in joint angles, and its data at the start: rods cannot
    stretch, and there is no constraint anywhere."""
    import mujoco

    body, at = "", [0.0, *system["lengths"].tolist()]
    for (m, length), x in reversed(list(zip(rods(system), at, strict=False))):
        joint = f'<joint type="hinge" axis="0 0 1"/>{inertial(m, length, POINT)}'
        body = f'<body pos="{x!r} 0 0">{joint}{body}</body>'
    model = mjcf(body, off="constraint", timestep=dt, integrator=integrator)
    data = mujoco.MjData(model)
    data.qpos[:] = np.diff(start_angles(system), prepend=0.0)
    return model, data


def run_hinges(task, per, integrator="RK4"):
    """MuJoCo in joint angles, `per` steps a sample in one C call."""
    import mujoco

    model, data = start_hinges(task.system, task.every / per, integrator)
    advance = partial(mujoco.mj_step, model, data, per)
    return clocked(task, advance, lambda: placed(task.system, np.cumsum(data.qpos)))


def tendons(system, dt, axes=3, **option):
    """MuJoCo's model of a chain in particles: each slides along `axes` axes, each rod is a tendon
    made equal to L, as soft as MuJoCo makes it by default."""
    kinds = ("1 0 0", "0 1 0", "0 0 1")[:axes]
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in kinds)
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(rods(system)):
        bodies += f'<body>{joints}{inertial(m, 0.0, 1.0)}<site name="s{k}"/></body>'
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length!r} 0 0 0 0" '
        equal += 'solref="0.02 1" solimp="0.95 0.95 0.001 0.5 2"/>'
    rest = f"<tendon>{ropes}</tendon><equality>{equal}</equality>"
    # the rods ask for a linear system, of which one Newton iteration is the exact solution
    settings = {"solver": "Newton", "iterations": 1, "tolerance": 0, "timestep": dt}
    return mjcf(bodies, rest, **settings | option)


def pace_tendons(system, dt, axes, steps):
    """Microseconds a step of MuJoCo's rods, and their worst error in m at the end."""
    import mujoco

    model = tendons(system, dt, axes, jacobian="sparse" if len(system["q0"]) > 30 else "dense")
    data = mujoco.MjData(model)
    data.qpos[:] = system["q0"][:, :axes].ravel()
    clock = time.perf_counter()
    mujoco.mj_step(model, data, steps)
    return 1e6 * (time.perf_counter() - clock) / steps, float(np.abs(data.efc_pos).max())


def random_chain(rng, count):
    """A chain of `count` rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(count, 3)), rng.uniform(0.5, 2.0, count)
    off = lengths * (1.0 + 0.03 * rng.normal(size=count))
    d = unit / np.linalg.norm(unit, axis=1, keepdims=True) * off[:, None]
    v, m = rng.normal(size=(count, 3)), rng.uniform(0.3, 3.0, count)
    return make_system(d.cumsum(0), v, m, [(k, k - 1) for k in range(count)], lengths)


def named(system, dt, shapes):
    """{field: value} of MuJoCo at the same state."""
    import mujoco

    fields = {}
    # efc_AR is made for the dual solver PGS only; the primal one's force is exact, and comes last
    for solver in ("PGS", "Newton"):
        model = tendons(system, dt, solver=solver, iterations=100, jacobian="dense")
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
        mujoco.mj_forward(model, data)
        found = {name: np.array(getattr(data, name)) for name in shapes}
        fields |= {name: value for name, value in found.items() if value.size}
    k, b, imp = fields["efc_KBIP"][:, :3].T
    fields["efc_KBIP"] = np.stack([k * imp, b], axis=1)
    return {name: fields[name].reshape(shape) for name, shape in shapes.items()}


# --- the others ---
def turning(system, th, rate, sin, cos):
    """The second derivatives of a double pendulum's angles from +x: Lagrange's equations, solved.

    With d = th_1 - th_2 and M = m_1 + m_2,
        M a th_1'' + m_2 b cos d th_2'' = -m_2 b sin d th_2'^2 - M g cos th_1
          a cos d th_1'' + b th_2''     =      a sin d th_1'^2 -   g cos th_2
    """
    (m1, a), (m2, b) = rods(system)
    d, whole = th[0] - th[1], m1 + m2
    p = -m2 * b * sin(d) * rate[1] * rate[1] - whole * G * cos(th[0])
    r = a * sin(d) * rate[0] * rate[0] - G * cos(th[1])
    share = whole - m2 * cos(d) * cos(d)
    return (p - m2 * cos(d) * r) / (a * share), (whole * r - cos(d) * p) / (b * share)


def run_heyoka(task, tol):
    """heyoka's Taylor series, compiled for these equations by LLVM, at the samples by dense
    output."""
    import heyoka as hy

    hy.llvm_state.set_diskcache_enabled(False)  # it is built anew, as for whoever asks once
    hy.llvm_state.clear_memcache()
    *th, w1, w2 = hy.make_vars("th1", "th2", "w1", "w2")
    rates = [w1, w2, *turning(task.system, th, (w1, w2), hy.sin, hy.cos)]
    start = [*start_angles(task.system).tolist(), 0.0, 0.0]
    equations = list(zip([*th, w1, w2], rates, strict=True))
    flow = hy.taylor_adaptive(equations, start, tol=tol)
    times = task.every * np.arange(task.samples + 1)
    flow.step()  # as ours, its code has been called before
    flow.time, flow.state[:] = 0.0, start
    clock = time.perf_counter()
    found = flow.propagate_grid(times)
    seconds = time.perf_counter() - clock
    return seconds, placed(task.system, found[-1][1:, :2])


def run_scipy(task, tol):
    """scipy's DOP853 on the same equations in Python."""
    from scipy.integrate import solve_ivp

    def rates(_, y):
        y = y.tolist()
        return *y[2:], *turning(task.system, y[:2], y[2:], math.sin, math.cos)

    start, times = [*start_angles(task.system), 0.0, 0.0], task.every * np.arange(task.samples + 1)
    settings = {"method": "DOP853", "t_eval": times, "rtol": tol, "atol": tol}
    clock = time.perf_counter()
    found = solve_ivp(rates, (0.0, times[-1]), start, **settings)
    return time.perf_counter() - clock, placed(task.system, found.y[:2, 1:].T)


def run_exudyn(task, per, tol):
    """Exudyn's point masses and distance constraints; its trapezoidal rule of index 2 keeps gdot =
    0, with full Newton iterations to `tol`."""
    import exudyn
    from exudyn import itemInterface as item

    container, sensors, settings = exudyn.SystemContainer(), [], exudyn.SimulationSettings()
    system = container.AddSystem()
    ground = system.AddObject(item.ObjectGround())
    origin = item.MarkerBodyPosition(bodyNumber=ground, localPosition=[0.0, 0.0, 0.0])
    tied = system.AddMarker(origin)
    for x, (m, length) in zip(task.system["q0"], rods(task.system), strict=True):
        node = system.AddNode(item.NodePoint2D(referenceCoordinates=x[:2].tolist()))
        system.AddObject(item.MassPoint2D(mass=m, nodeNumber=node))
        before, tied = tied, system.AddMarker(item.MarkerNodePosition(nodeNumber=node))
        system.AddLoad(item.LoadForceVector(markerNumber=tied, loadVector=[0.0, -m * G, 0.0]))
        system.AddObject(item.DistanceConstraint(markerNumbers=[before, tied], distance=length))
        kind = {"storeInternal": True, "outputVariableType": exudyn.OutputVariableType.Position}
        sensors.append(system.AddSensor(item.SensorNode(nodeNumber=node, **kind)))
    system.Assemble()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = task.every
    settings.linearSolver.solverType = exudyn.LinearSolverType.EXUdense
    rule = settings.timeIntegration
    rule.numberOfSteps, rule.endTime = per * task.samples, task.samples * task.every
    rule.newton.relativeTolerance, rule.newton.absoluteTolerance = tol, 0.01 * tol
    rule.verboseMode = 0
    clock = time.perf_counter()
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    seconds = time.perf_counter() - clock
    return seconds, np.stack([system.GetSensorStoredData(s)[1:, 1:3] for s in sensors], axis=1)


def run_pymunk(task, per):
    """Chipmunk's point masses and pin joints as pymunk ships them, a call from Python a step."""
    import pymunk

    space, dt, tied, bodies = pymunk.Space(), task.every / per, None, []
    space.gravity = 0.0, -G
    for x, (m, _) in zip(task.system["q0"].tolist(), rods(task.system), strict=True):
        bodies.append(pymunk.Body(m, math.inf))
        bodies[-1].position = x[:2]
        space.add(bodies[-1], pymunk.PinJoint(tied or space.static_body, bodies[-1]))
        tied = bodies[-1]

    def advance():
        for _ in range(per):
            space.step(dt)

    return clocked(task, advance, lambda: [tuple(body.position) for body in bodies])
