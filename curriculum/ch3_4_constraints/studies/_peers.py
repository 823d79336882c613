"""The systems of constraints.py in our hands and in other engines, each at its fastest.

An engine is imported where it is used, so that this module needs none. What a run returns first is
the seconds of its steps alone: models are built, and read, while that clock stands.
"""

import time

from curriculum.ch3_4_constraints.studies._runs import NATIVE, G, case, make_system
from curriculum.common.compiled import Compiled
from curriculum.common.steps import followed

import numpy as np

OFF = """contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp
nativeccd autoreset constraint"""  # of MuJoCo: what joint angles do not need
# kg m^2 about a particle: MuJoCo wants some; as a share of m L^2 this moves no digit we show
POINT = 1e-14


def compiled_step(system, rule, mode, dt, machine=NATIVE, best=True):
    """A step, compiled to machine code, the `best` or what is soon made, or to Python."""
    rule, force = case(system, rule, mode, dt)
    compiled = Compiled(followed(rule, force.after), check=False)
    compiled.trace(system["q0"], system["v0"], system["m"], force, dt)
    if machine:
        compiled.to_machine(best)
    return compiled.alone


def timed(step, system, steps, dt):
    """One call of a compiled step for a whole run: (seconds, q (steps, N, 3), NaN where it ended).

    As a peer's loop in C: without what `simulate` measures, logs and compares.
    """
    start = step.traced.columns(system["q0"], system["v0"])[:, 0]
    rows = np.full((steps, len(start)), np.nan)
    step.easy(start, rows[:1], dt)  # a peer's code has been called before, too
    clock = time.perf_counter()
    done = step.easy(start, rows, dt)
    seconds = time.perf_counter() - clock
    rows[done:] = np.nan
    return seconds, step.traced.states(rows[:, :, None])[0]


def run_ours(task, per, rule, mode, machine=NATIVE):
    """Our run, `per` steps a sample: (seconds, positions (samples, N, 2))."""
    steps, dt = per * task.samples, task.every / per
    step = compiled_step(task.system, rule, mode, dt, machine)
    seconds, q = timed(step, task.system, steps, dt)
    return seconds, q[per - 1 :: per, :, :2]


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
    """A MuJoCo model from XML, with what is called `off` switched off."""
    import mujoco

    flags = " ".join(f'{name}="disable"' for name in off.split())
    options = " ".join(f'{name}="{value}"' for name, value in option.items())
    return mujoco.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/><size memory="256M"/>'
        f'<option gravity="0 {-G} 0" {options}><flag {flags}/></option>'
        f"<worldbody>{world}</worldbody>{rest}</mujoco>"
    )


def masses_and_lengths(system):
    """(mass, length) of a chain's particles and rods."""
    return list(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True))


def inertial(m, x, inertia):
    return f'<inertial pos="{x!r} 0 0" mass="{m!r}" diaginertia="{inertia} {inertia} {inertia}"/>'


def run_hinges(task, per, integrator="RK4"):
    """MuJoCo in joint angles, `per` steps a sample in one C call: rods cannot stretch, and there is
    no constraint anywhere."""
    import mujoco

    system, body = task.system, ""
    for m, length in reversed(masses_and_lengths(system)):  # from the tip inwards
        rod = f'<joint type="hinge" axis="0 0 1"/>{inertial(m, length, POINT)}'
        body = f'<body>{rod}<frame pos="{length!r} 0 0">{body}</frame></body>'
    model = mjcf(body, off=OFF, timestep=task.every / per, integrator=integrator)
    data, seconds, found = mujoco.MjData(model), 0.0, []
    data.qpos[:] = np.diff(start_angles(system), prepend=0.0)
    for _ in range(task.samples):
        clock = time.perf_counter()
        mujoco.mj_step(model, data, per)
        seconds += time.perf_counter() - clock
        found.append(placed(system, np.cumsum(data.qpos)))
    return seconds, np.array(found)


def random_chain(rng, count):
    """A chain of `count` rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(count, 3)), rng.uniform(0.5, 2.0, count)
    off = lengths * (1.0 + 0.03 * rng.normal(size=count))
    d = unit / np.linalg.norm(unit, axis=1, keepdims=True) * off[:, None]
    v, m = rng.normal(size=(count, 3)), rng.uniform(0.3, 3.0, count)
    return make_system(d.cumsum(0), v, m, [(k, k - 1) for k in range(count)], lengths)


def tendons(system, dt, solver):
    """MuJoCo's model of a chain in particles: each slides along three axes, each rod is a tendon
    made equal to L, as soft as MuJoCo makes it by default."""
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(masses_and_lengths(system)):
        bodies += f'<body>{joints}{inertial(m, 0.0, 1.0)}<site name="s{k}"/></body>'
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length!r} 0 0 0 0" '
        equal += 'solref="0.02 1" solimp="0.95 0.95 0.001 0.5 2"/>'
    rest = f"<tendon>{ropes}</tendon><equality>{equal}</equality>"
    return mjcf(bodies, rest, timestep=dt, solver=solver, tolerance=0, jacobian="dense")


def named(system, dt, fields):
    """{field: value} of MuJoCo at the same state."""
    import mujoco

    found = {}
    # efc_AR is made for the dual solver PGS only; the primal one's force is exact, and comes last
    for solver in ("PGS", "Newton"):
        model = tendons(system, dt, solver)
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
        mujoco.mj_forward(model, data)
        values = {name: np.array(getattr(data, name)) for name in fields}
        found |= {name: value for name, value in values.items() if value.size}
    return found


# --- heyoka ---
def run_heyoka(task, tol):
    """heyoka's Taylor series for a double pendulum in angles from +x, at the samples by dense
    output: Lagrange's equations, solved and compiled by LLVM.

    With d = th_1 - th_2 and M = m_1 + m_2,
        M a th_1'' + m_2 b cos d th_2'' = -m_2 b sin d th_2'^2 - M g cos th_1
          a cos d th_1'' + b th_2''     =      a sin d th_1'^2 -   g cos th_2
    """
    import heyoka as hy

    hy.llvm_state.set_diskcache_enabled(False)  # it is built anew, as for whoever asks once
    hy.llvm_state.clear_memcache()
    (m1, a), (m2, b) = masses_and_lengths(task.system)
    th1, th2, w1, w2 = hy.make_vars("th1", "th2", "w1", "w2")
    sin, cos, whole = hy.sin(th1 - th2), hy.cos(th1 - th2), m1 + m2
    p = -m2 * b * sin * w2 * w2 - whole * G * hy.cos(th1)
    r = a * sin * w1 * w1 - G * hy.cos(th2)
    share = whole - m2 * cos * cos
    turning = (p - m2 * cos * r) / (a * share), (whole * r - cos * p) / (b * share)
    equations = [(th1, w1), (th2, w2), *zip((w1, w2), turning, strict=True)]
    start = [*start_angles(task.system).tolist(), 0.0, 0.0]
    flow = hy.taylor_adaptive(equations, start, tol=tol)
    times = task.every * np.arange(task.samples + 1)
    flow.step()  # as ours, its code has been called before
    flow.time, flow.state[:] = 0.0, start
    clock = time.perf_counter()
    found = flow.propagate_grid(times)
    seconds = time.perf_counter() - clock
    return seconds, placed(task.system, found[-1][1:, :2])
