"""The systems of constraints.py in our hands and in other engines, each at its fastest.

An engine is imported where it is used, so that this module needs none. What a run returns first is
the seconds of its steps alone: models are built, and read, while that clock stands.
"""

import time
from functools import partial
from unittest.mock import patch

from curriculum.ch3_4_constraints.studies._runs import NATIVE, G, case, make_system
from curriculum.common import native
from curriculum.common.steps import Single, Traced, followed

import numpy as np

OFF = """contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp
nativeccd autoreset constraint"""  # of MuJoCo: what joint angles do not need
# kg m^2 about a particle: MuJoCo wants some; as a share of m L^2 this moves no digit we show
POINT = 1e-14
TRIES, SHARE = 15, 0.02  # of a run that is timed: how often, and for how many s


def compiled_step(system, rule, mode, dt, machine=NATIVE, best=True):
    """A step, compiled to machine code, the `best` or what is soon made, or to Python."""
    rule, force = case(system, rule, mode, dt)
    step = followed(rule, force.after)
    single = Single(Traced(step, system["m"], force, system["q0"], system["v0"]))
    if machine:
        single.to_machine(best)
    return single


def least(again, go):
    """The least seconds of go(), each after again(): TRIES times, or as often as fits in SHARE s.

    A peer's code has been called before, as a user's second run would find it.
    """
    times = []
    while len(times) < TRIES and sum(times) < SHARE:
        again()
        clock = time.perf_counter()
        go()
        times.append(time.perf_counter() - clock)
    return min(times)


def ours(step, task, per):
    """A whole run in one call of a compiled step, `per` steps a sample.

    (seconds, positions (samples, N, 2), NaN from where it ended). As a peer's loop in C: without
    what `simulate` measures, logs and compares. Of a task with one sample only the end is kept.
    """
    steps, dt = per * task.samples, task.every / per
    start = step.traced.columns(task.system["q0"], task.system["v0"])[:, 0]
    state, rows, done = start[:, None].copy(), np.empty((steps, len(start))), [0]
    call = partial(step.easy, start, rows, dt)
    knobs, unsettled = np.array([dt]), np.zeros(1, np.int64)
    if step.machine:  # addresses are taken once, as a peer's binding does
        place = rows.ctypes.data if task.samples > 1 else None
        addresses = state.ctypes.data, steps, place, 1, knobs.ctypes.data, unsettled.ctypes.data
        call = partial(step.machine.function, *addresses)

    def again():
        state[:, 0] = start

    def go():
        done[0] = call() if step.machine else call()[0]

    seconds = least(again, go)
    if step.machine and task.samples == 1:
        rows[-1] = state[:, 0]
    rows[done[0] :] = np.nan
    return seconds, step.traced.states(rows[per - 1 :: per])[0][:, :, :2]


def run_ours(task, per, rule, mode, machine=NATIVE):
    """Compile, and run: as `ours`."""
    step = compiled_step(task.system, rule, mode, task.every / per, machine)
    return ours(step, task, per)


def our_crowd(many, task, per):
    """A run of a Crowd, on one core, whatever there are: (seconds, positions (R, N, 2))."""
    many.dt = task.every / per

    def again():
        many.put(task.system["q0"], task.system["v0"])

    with patch.object(native, "CORES", 1):
        seconds = least(again, lambda: many.advance(per))
    return seconds, many.states()[0][..., :2]


def start_angles(system):
    """The angles (..., N) of a chain's rods from +x in rad, of one start or many."""
    d = np.diff(system["q0"], axis=-2, prepend=0.0)
    return np.arctan2(d[..., 1], d[..., 0])


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


def hinges_model(task, integrator="RK4"):
    """MuJoCo's model of a chain in joint angles: rods cannot stretch, and nothing is constrained.

    RK4 is the rule of the highest order that it has.
    """
    body = ""
    for m, length in reversed(masses_and_lengths(task.system)):  # from the tip inwards
        rod = f'<joint type="hinge" axis="0 0 1"/>{inertial(m, length, POINT)}'
        body = f'<body>{rod}<frame pos="{length!r} 0 0">{body}</frame></body>'
    return mjcf(body, off=OFF, integrator=integrator)


def hinge_angles(angles):
    """The angles (..., N) of a chain's hinges in rad: each rod's from the one before it."""
    return np.diff(angles, axis=-1, prepend=0.0)


def hinges(model, task, per):
    """A run of that model, `per` steps a sample in one C call: (seconds, positions)."""
    import mujoco

    model.opt.timestep = task.every / per
    data, found = mujoco.MjData(model), np.empty((task.samples, model.nq))

    def again():
        mujoco.mj_resetData(model, data)
        data.qpos[:] = hinge_angles(start_angles(task.system))

    def go():
        for k in range(task.samples):
            mujoco.mj_step(model, data, per)
            found[k] = data.qpos

    seconds = least(again, go)
    return seconds, placed(task.system, np.cumsum(found, axis=-1))


def run_hinges(task, per, integrator="RK4"):
    """Build, and run: as `hinges`."""
    return hinges(hinges_model(task, integrator), task, per)


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


def hinges_crowd(model, task, per):
    """A run of many in one call of MuJoCo's rollout, on one core: (seconds, positions)."""
    import mujoco
    from mujoco.rollout import Rollout

    model.opt.timestep = task.every / per
    data, whole = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = hinge_angles(start_angles(task.system))
    begin = np.zeros((len(starts), mujoco.mj_stateSize(model, whole.value)))
    begin[:, 1 : 1 + model.nq] = starts  # after the time
    kept = np.empty((len(starts), per, begin.shape[1]))  # it keeps all states
    sensed = np.empty((len(starts), per, 0))
    with Rollout(nthread=0) as alone:  # no thread but this one
        how = {"nstep": per, "skip_checks": False, "state": kept, "sensordata": sensed}
        seconds = least(lambda: None, lambda: alone.rollout(model, data, begin, **how))
    return seconds, placed(task.system, np.cumsum(kept[:, -1, 1 : 1 + model.nq], axis=-1))


# --- heyoka ---
def taylor_equations(system):
    """A double pendulum in angles from +x, as heyoka's symbols: Lagrange's equations, solved.

    With d = th_1 - th_2 and M = m_1 + m_2,
        M a th_1'' + m_2 b cos d th_2'' = -m_2 b sin d th_2'^2 - M g cos th_1
          a cos d th_1'' + b th_2''     =      a sin d th_1'^2 -   g cos th_2
    """
    import heyoka as hy

    (m1, a), (m2, b) = masses_and_lengths(system)
    th1, th2, w1, w2 = hy.make_vars("th1", "th2", "w1", "w2")
    sin, cos, whole = hy.sin(th1 - th2), hy.cos(th1 - th2), m1 + m2
    p = -m2 * b * sin * w2 * w2 - whole * G * hy.cos(th1)
    r = a * sin * w1 * w1 - G * hy.cos(th2)
    share = whole - m2 * cos * cos
    turning = (p - m2 * cos * r) / (a * share), (whole * r - cos * p) / (b * share)
    return [(th1, w1), (th2, w2), *zip((w1, w2), turning, strict=True)]


def uncached():
    """heyoka, which compiles as for whoever asks once."""
    import heyoka as hy

    hy.llvm_state.set_diskcache_enabled(False)
    hy.llvm_state.clear_memcache()
    return hy


def heyoka_flow(task, tol, **how):
    """heyoka's Taylor integrator, compiled; `how`: fast_math, opt_level and the like."""
    start = np.zeros(4)
    return uncached().taylor_adaptive(taylor_equations(task.system), start, tol=tol, **how)


def heyoka(flow, task):
    """A run of it to the end of a Task that has one sample: (seconds, positions)."""
    start = np.append(start_angles(task.system), [0.0, 0.0])

    def again():
        flow.time, flow.state[:] = 0.0, start

    seconds = least(again, lambda: flow.propagate_until(task.every))
    return seconds, placed(task.system, flow.state[None, :2])


def heyoka_batch(task, tol):
    """heyoka's integrator of a register of members at once, as many as it recommends."""
    hy = uncached()
    start = np.zeros((4, hy.recommended_simd_size()))
    how = {"tol": tol, "fast_math": True}
    return hy.taylor_adaptive_batch(taylor_equations(task.system), start, **how)


def heyoka_crowd(flow, task):
    """A run of many, register by register, on one core: (seconds, positions).

    The last register is filled with the last member.
    """
    starts, lanes = start_angles(task.system), flow.batch_size
    count = len(starts)
    filled = np.concatenate([starts, np.repeat(starts[-1:], -count % lanes, axis=0)])
    registers = filled.reshape(-1, lanes, 2).transpose(0, 2, 1)
    ends = np.empty_like(registers)

    def go():
        for begin, end in zip(registers, ends, strict=True):
            flow.set_time(0.0)
            flow.state[:2], flow.state[2:] = begin, 0.0
            flow.propagate_until(task.every)
            end[:] = flow.state[:2]

    seconds = least(lambda: None, go)
    return seconds, placed(task.system, ends.transpose(0, 2, 1).reshape(-1, 2)[:count])
