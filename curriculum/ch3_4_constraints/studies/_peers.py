"""The systems of constraints.py in our hands and in other engines, each at its fastest.

An engine is a function of a Task and of settings. It makes what is made once, a compiled step or a
model, and returns go(per), a run of it with `per` steps a sample: (seconds of the steps alone,
positions). Positions are (samples, N, 2) or, of a crowd with one sample, (R, N, 2). An engine is
imported where it is used, so that this module needs none.
"""

import timeit
from functools import partial
from unittest.mock import patch

from curriculum.ch3_4_constraints.studies._runs import NATIVE, G, case, crowd, make_system
from curriculum.common import crowds
from curriculum.common.native import Native
from curriculum.common.steps import followed
from curriculum.common.traced import Single, Traced, moves

import numpy as np

DT = 0.005  # s: steps of other lengths want a mode that does not know them, none or project
OFF = """contact warmstart island sensor actuation spring damper midphase filterparent eulerdamp
nativeccd autoreset constraint"""  # of MuJoCo: what joint angles do not need
# kg m^2 about a particle: MuJoCo wants some; as a share of m L^2 this moves no digit we show
POINT = 1e-14
TRIES, SHARE = 15, 0.02  # of a run that is timed: how often, and for how many s


def least(go, again="pass"):
    """The least seconds of go(), each after again(): TRIES times, or as often as fits in SHARE s.

    A peer's code has been called before, as a user's second run would find it.
    """
    seconds = timeit.timeit(go, again, number=1)
    tries = min(TRIES, int(SHARE / seconds))
    return min([seconds, *timeit.repeat(go, again, number=1, repeat=tries)])


def ours(task, rule, mode="none", machine=NATIVE, best=True):
    """A step compiled to machine code, the `best` or what is soon made, or to Python.

    As a peer's loop in C a run is one call, without what `simulate` measures, logs and compares. Of
    a task with one sample only the end is kept. Positions are NaN from where a run ended.
    """
    system = task.system
    rule, force = case(system, rule, mode, DT)
    step = followed(rule, force.after)
    single = Single(Traced(step, system["m"], force, moves(system["q0"], system["v0"])))
    if machine:
        single.machine = Native(single.traced.program, best=best)
    start = single.traced.columns(system["q0"], system["v0"])

    def go(per):
        steps, dt = per * task.samples, task.every / per
        state, rows, done = start.copy(), np.empty((steps, len(start))), []
        call = partial(single.easy, start[:, 0], rows, dt)
        if machine:  # addresses are taken once, as a peer's binding does
            place = rows.ctypes.data if task.samples > 1 else None
            knobs, ended = np.array([dt]), np.zeros(1, np.int64)
            ends = knobs.ctypes.data, ended.ctypes.data, 1
            call = partial(single.machine.function, state.ctypes.data, steps, place, 1, *ends)
        seconds = least(lambda: done.append(call()), partial(np.copyto, state, start))
        if machine and task.samples == 1:
            rows[-1] = state[:, 0]
        rows[np.ravel(done[-1])[0] :] = np.nan
        return seconds, single.traced.states(rows[per - 1 :: per])[0][..., :2]

    return go


def our_crowd(task, rule):
    """A Crowd, on one core, whatever there are."""
    system = task.system
    many = crowd(system, rule, "none", DT)

    def go(per):
        many.dt, again = task.every / per, partial(many.put, system["q0"], system["v0"])
        with patch.object(crowds, "CORES", 1):
            seconds = least(partial(many.advance, per), again)
        return seconds, many.states()[0][..., :2]

    return go


def start_angles(system):
    """The angles (..., N) of a chain's rods from +x in rad, of one start or many."""
    d = np.diff(system["q0"], axis=-2, prepend=0.0)
    return np.arctan2(d[..., 1], d[..., 0])


def placed(system, angles):
    """Positions (..., N, 2) of a chain whose rods are at `angles` (..., N)."""
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return np.cumsum(system["lengths"][:, None] * unit, axis=-2)


def masses_and_lengths(system):
    """(mass, length) of a chain's particles and rods."""
    return list(zip(system["m"][:, 0].tolist(), system["lengths"].tolist(), strict=True))


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


def inertial(m, x, inertia):
    return f'<inertial pos="{x!r} 0 0" mass="{m!r}" diaginertia="{inertia} {inertia} {inertia}"/>'


def hinges(task, integrator="RK4"):
    """MuJoCo in joint angles, a sample in one C call; RK4 is its rule of the highest order.

    Rods cannot stretch, and nothing is constrained. Many starts are one call of its rollout, on one
    core, which keeps all states and takes its time for that.
    """
    import mujoco
    from mujoco.rollout import Rollout

    body = ""
    for m, length in reversed(masses_and_lengths(task.system)):  # from the tip inwards
        rod = f'<joint type="hinge" axis="0 0 1"/>{inertial(m, length, POINT)}'
        body = f'<body>{rod}<frame pos="{length!r} 0 0">{body}</frame></body>'
    model = mjcf(body, off=OFF, integrator=integrator)
    data, whole = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.diff(start_angles(task.system), prepend=0.0)  # each from the rod before it
    found = np.empty((task.samples, model.nq))

    def again():
        mujoco.mj_resetData(model, data)
        data.qpos[:] = starts

    def alone(per):
        for k in range(task.samples):
            mujoco.mj_step(model, data, per)
            found[k] = data.qpos

    def go(per):
        model.opt.timestep = task.every / per
        if starts.ndim == 1:
            seconds = least(partial(alone, per), again)
            return seconds, placed(task.system, np.cumsum(found, axis=-1))
        begin = np.zeros((len(starts), mujoco.mj_stateSize(model, whole.value)))
        begin[:, 1 : 1 + model.nq] = starts  # after the time
        kept = np.empty((len(starts), per, begin.shape[1]))
        how = {"nstep": per, "skip_checks": False, "state": kept}
        how["sensordata"] = np.empty((len(starts), per, 0))
        with Rollout(nthread=0) as many:  # no thread but this one
            seconds = least(partial(many.rollout, model, data, begin, **how))
        return seconds, placed(task.system, np.cumsum(kept[:, -1, 1 : 1 + model.nq], axis=-1))

    return go


def random_chain(rng, count):
    """A chain of `count` rods, its particles a few per cent off the rods and moving anyhow."""
    unit, lengths = rng.normal(size=(count, 3)), rng.uniform(0.5, 2.0, count)
    off = lengths * (1.0 + 0.03 * rng.normal(size=count))
    d = unit / np.linalg.norm(unit, axis=1, keepdims=True) * off[:, None]
    v, m = rng.normal(size=(count, 3)), rng.uniform(0.3, 3.0, count)
    return make_system(d.cumsum(0), v, m, [(k, k - 1) for k in range(count)], lengths)


def named(system, dt, fields):
    """{field: value} of MuJoCo's model of a chain in particles, at the same state.

    Each particle slides along three axes; each rod is a tendon made equal to L, as soft as MuJoCo
    makes it by default.
    """
    import mujoco

    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    bodies, ropes, equal = '<site name="s-1"/>', "", ""
    for k, (m, length) in enumerate(masses_and_lengths(system)):
        bodies += f'<body>{joints}{inertial(m, 0.0, 1.0)}<site name="s{k}"/></body>'
        ropes += f'<spatial name="t{k}"><site site="s{k - 1}"/><site site="s{k}"/></spatial>'
        equal += f'<tendon tendon1="t{k}" polycoef="{length!r} 0 0 0 0" '
        equal += 'solref="0.02 1" solimp="0.95 0.95 0.001 0.5 2"/>'
    rest, found = f"<tendon>{ropes}</tendon><equality>{equal}</equality>", {}
    # efc_AR is made for the dual solver PGS only; the primal one's force is exact, and comes last
    for solver in ("PGS", "Newton"):
        model = mjcf(bodies, rest, timestep=dt, solver=solver, tolerance=0, jacobian="dense")
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = system["q0"].ravel(), system["v0"].ravel()
        mujoco.mj_forward(model, data)
        values = {name: np.array(getattr(data, name)) for name in fields}
        found |= {name: value for name, value in values.items() if value.size}
    return found


# --- heyoka ---
def taylor(system, lanes=None, **how):
    """heyoka's integrator, compiled, of a double pendulum in angles from +x, or of many `lanes`.

    Lagrange's equations, solved. With d = th_1 - th_2 and M = m_1 + m_2,
        M a th_1'' + m_2 b cos d th_2'' = -m_2 b sin d th_2'^2 - M g cos th_1
          a cos d th_1'' + b th_2''     =      a sin d th_1'^2 -   g cos th_2
    """
    import heyoka as hy

    hy.llvm_state.set_diskcache_enabled(False)  # it compiles as for whoever asks once
    hy.llvm_state.clear_memcache()
    (m1, a), (m2, b) = masses_and_lengths(system)
    th1, th2, w1, w2 = hy.make_vars("th1", "th2", "w1", "w2")
    sin, cos, whole = hy.sin(th1 - th2), hy.cos(th1 - th2), m1 + m2
    p = -m2 * b * sin * w2 * w2 - whole * G * hy.cos(th1)
    r = a * sin * w1 * w1 - G * hy.cos(th2)
    share = whole - m2 * cos * cos
    turning = (p - m2 * cos * r) / (a * share), (whole * r - cos * p) / (b * share)
    equations = [(th1, w1), (th2, w2), *zip((w1, w2), turning, strict=True)]
    if lanes is None:
        return hy.taylor_adaptive(equations, np.zeros(4), **how)
    return hy.taylor_adaptive_batch(equations, np.zeros((4, lanes)), **how)


def heyoka(task, tol, **how):
    """heyoka's Taylor series to the end of a Task that has one sample; `how`: as heyoka takes it.

    It chooses its own steps.
    """
    flow = taylor(task.system, tol=tol, **how)
    start = np.append(start_angles(task.system), [0.0, 0.0])

    def again():
        flow.time, flow.state[:] = 0.0, start

    def go(per):
        seconds = least(partial(flow.propagate_until, task.every), again)
        return seconds, placed(task.system, flow.state[None, :2])

    return go


def heyoka_crowd(task, tol):
    """A run of many, a register of as many as heyoka recommends after the other, on one core.

    The last register is filled with the last member.
    """
    from heyoka import recommended_simd_size

    angles, lanes = start_angles(task.system).T, recommended_simd_size()
    flow = taylor(task.system, lanes, tol=tol, fast_math=True)
    filled = np.pad(angles, [(0, 0), (0, -angles.shape[1] % lanes)], "edge")
    ends = np.empty_like(filled)

    def run():
        for first in range(0, filled.shape[1], lanes):
            register = slice(first, first + lanes)
            flow.set_time(0.0)
            flow.state[:2], flow.state[2:] = filled[:, register], 0.0
            flow.propagate_until(task.every)
            ends[:, register] = flow.state[:2]

    def go(per):
        return least(run), placed(task.system, ends.T[: angles.shape[1]])

    return go
