"""Which method reaches which error in what time?  The double pendulum, 5 s.

(a) Each integrator with each method, XPBD, and MuJoCo, at steps of 5 ms. (b) A race to four errors,
beside heyoka's Taylor series. (c) The same for a crowd, beside heyoka's batches, on one core.

An error is how far the worst particle ends from where joint angles have it. A time is the thread's
own for all steps of the 5 s, from the start again and again, compiled before. Racers take turns,
and medians count. A setting counts if the next finer one is as good.
"""

import time
from functools import partial
from importlib.util import find_spec
from itertools import pairwise, product
from statistics import median

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.xpbd import xpbd_step
from curriculum.common import cli, gauss
from curriculum.common.tracing import fori_loop, llvm
from curriculum.common.tracing.ahead import nonzero
from curriculum.common.tracing.trace import LANES, Program, trace_loop

SECONDS, DT = 5.0, 0.005  # s
G = -c.GRAVITY[1]  # m/s^2
GOALS = 1e-3, 1e-6, 1e-9, 1e-12  # m
SYSTEM = c.build_system("double")
FREE = c.make_force(SYSTEM, c.stabilizations(DT)["none"])  # knows no dt


# --- the double pendulum in joint angles from +x: rods of 1 m, bobs of 1 kg ---
def angular_accelerations(th, w, lib=np):
    """Those of both rods in rad/s^2, by Lagrange's equations; `lib` has sin and cos."""
    (th1, th2), (w1, w2) = th, w
    sin, cos = lib.sin(th1 - th2), lib.cos(th1 - th2)
    first = -sin * w2 * w2 - 2.0 * G * lib.cos(th1)
    second = sin * w1 * w1 - G * lib.cos(th2)
    share = 2.0 - cos * cos
    return np.array([(first - cos * second) / share, (2.0 * second - cos * first) / share])


def angles(q):
    """The angles (2, K) in rad of the rods at q (K, 2, 3)."""
    d = np.diff(q, axis=1, prepend=0.0)
    return np.arctan2(d[..., 1], d[..., 0]).T


def places(th):
    """The positions (K, 2, 3) in m of particles on rods at angles (2, K)."""
    along = np.stack([np.cos(th), np.sin(th), np.zeros_like(th)], axis=-1)
    return np.cumsum(along, axis=0).transpose(1, 0, 2)


def dop853_step(q, v, m, force, dt):
    """Dormand and Prince's rule of order 8, with scipy's coefficients: 12 solves (E. Hairer, S.
    Norsett, G. Wanner, Solving Ordinary Differential Equations I, II.5)."""
    from scipy.integrate import DOP853

    def moved(x, row, slopes):
        return x + sum(dt * a * slope for a, slope in zip(row, slopes, strict=False))

    speeds, accelerations = [], []
    for row in DOP853.A:
        x, speed = moved(q, row, speeds), moved(v, row, accelerations)
        speeds.append(speed)
        accelerations.append(force(x, speed) / m)
    return moved(q, DOP853.B, speeds), moved(v, DOP853.B, accelerations)


def reference(q0, steps=1000):
    """Where particles that start at q0 (K, 2, 3) at rest are after 5 s."""
    th, w = angles(q0), np.zeros((2, len(q0)))
    for _ in range(steps):
        th, w = dop853_step(th, w, 1.0, angular_accelerations, SECONDS / steps)
    return places(th)


def distance(q, known):
    """How far the worst particle is off, in m; inf if it is nowhere."""
    return float(np.nan_to_num(np.max(np.linalg.norm(q - known, axis=-1)), nan=np.inf))


# --- engines: what can be made before is made; then go() -> seconds, q (K, 2, 3) after 5 s ---
def timed(call, places_of):
    """go() of a call, from whose result the places are read afterwards."""

    def go():
        clock = time.thread_time()
        end = call()
        return time.thread_time() - clock, places_of(end)

    return go


def ours(step):
    """prepared(steps) -> go, of step(q, v, dt) -> (q, v) as machine code."""
    start = np.stack([SYSTEM["q0"], SYSTEM["v0"]])
    live = nonzero(start)
    program, loop = trace_loop(step, live, knobs=1)
    machine = llvm.single(program)

    def prepared(steps):
        rows = np.zeros((steps, loop.size))
        call = machine(np.append(start[live], SECONDS / steps), rows)
        return timed(call, lambda _: rows[-1, :6].reshape(1, 2, 3))

    return prepared


def whole_gauss(stages, tol, q, v, dt):
    """A step of Gauss's rule without parts: one whose stages do not converge is far off."""
    return gauss.attempt(stages, tol, q, v, SYSTEM["m"], FREE, dt)[:2]


def our_crowd(q0, steps):
    """go, of Dormand and Prince's rule, 16 members side by side."""
    step = partial(dop853_step, m=SYSTEM["m"], force=FREE, dt=SECONDS / steps)
    live = np.any(q0, axis=0), np.zeros((2, 3))
    program = Program(partial(fori_loop, steps, step), *live, rows=LANES)
    columns = q0.reshape(len(q0), -1).T[program.places]
    call = partial(llvm.crowd(program), columns)
    return timed(call, lambda ends: ends[:, :6].reshape(-1, 2, 3))


def mujoco_hinges(steps):
    """go, of MuJoCo in joint angles under RK4: its rods cannot stretch."""
    import mujoco

    hinge = '<joint type="hinge" axis="0 0 1"/>'
    bob = '<inertial pos="1 0 0" mass="1" diaginertia="1e-14 1e-14 1e-14"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 {-G} 0" integrator="RK4"><flag constraint="disable"/></option>'
        f'<worldbody><body>{hinge}{bob}<body pos="1 0 0">{hinge}{bob}</body></body></worldbody>'
        "</mujoco>"
    )
    model.opt.timestep = SECONDS / steps
    data = mujoco.MjData(model)
    start = np.diff(angles(SYSTEM["q0"][None])[:, 0], prepend=0.0)

    def call():
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start
        mujoco.mj_step(model, data, steps)
        return data.qpos

    return timed(call, lambda turned: places(np.cumsum(turned)[:, None]))


def heyoka(q0, tol):
    """go, of heyoka's Taylor series, which chooses its steps; of many, in its batches."""
    import heyoka as hy

    lanes = hy.recommended_simd_size() if len(q0) > 1 else 1
    th, w = hy.make_vars("th1", "th2"), hy.make_vars("w1", "w2")
    equations = list(zip([*th, *w], [*w, *angular_accelerations(th, w, hy)], strict=True))
    make = hy.taylor_adaptive_batch if lanes > 1 else hy.taylor_adaptive
    shape = (4, lanes) if lanes > 1 else 4
    flow = make(equations, np.zeros(shape), tol=tol, fast_math=True)
    start = np.pad(angles(q0), [(0, 2), (0, -len(q0) % lanes)], "edge")
    start[2:] = 0.0
    ends = np.empty_like(start)

    def go():
        seconds = 0.0
        for first in range(0, start.shape[1], lanes):
            batch = slice(first, first + lanes)
            flow.state[:] = start[:, batch].reshape(shape)
            clock = time.thread_time()
            flow.propagate_for(SECONDS)
            seconds += time.thread_time() - clock
            ends[:, batch] = flow.state.reshape(4, lanes)
        return seconds, places(ends[:2, : len(q0)])

    return go


# --- tables ---
def first_there(errors, goal):
    """The first setting of {setting: error} within a goal, whose next one is, too."""
    pairs = pairwise(errors.items())
    return next((x for (x, e), (_, after) in pairs if max(e, after) <= goal), None)


def methods():
    """Yield a name of (a), and a function of how many steps that makes its go."""
    for integrator, (name, method) in product(c.INTEGRATORS, c.stabilizations(DT).items()):
        if method.integrator in (None, integrator):
            yield f"{integrator} {name}", ours(partial(c.one_step, SYSTEM, name, integrator))
    for substeps in 1, 4, 20:
        yield f"XPBD, sub-steps: {substeps}", ours(partial(xpbd_step, SYSTEM, substeps=substeps))
    if find_spec("mujoco"):
        yield "MuJoCo, hinges, RK4", mujoco_hinges


def method_table(known):
    """Print (a)."""
    steps = round(SECONDS / DT)
    print(f"\n(a) us a step and error, at steps of {DT:g} s")
    for name, make in methods():
        try:
            go = make(steps)
            pace = 1e6 * median(go()[0] for _ in range(9)) / steps
            print(f"{name:24}{pace:8.3f}{distance(go()[1], known):8.0e} m")
        except Exception as why:
            print(f"{name:24}  failed: {why}")


def quickest(engines, known):
    """{goal: (name, go)}: of engines {name: {setting: go}} the quickest one there."""
    there = {goal: [] for goal in GOALS}
    for name, settings in engines.items():
        errors = {x: distance(go()[1], known) for x, go in settings.items()}
        for goal in GOALS:
            setting = first_there(errors, goal)
            if setting is not None:
                go = settings[setting]
                seconds = median(go()[0] for _ in range(9))
                there[goal].append((seconds, name.format(setting), go))
    return {goal: min(racers)[1:] for goal, racers in there.items() if racers}


def race(title, engines, q0, turns):
    """Print (b) or (c): at each error the quickest of our engines, heyoka, and their ratio."""
    known = reference(q0)
    racers = {"ours": quickest(engines, known)}
    if find_spec("heyoka"):
        tolerances = 10.0 ** -np.arange(1.0, 15.0, 0.5)
        flows = {f"tol {tol:.0e}": heyoka(q0, tol) for tol in tolerances}
        racers["heyoka"] = quickest({"{}": flows}, known)
    print(f"\n{title}")
    for goal in GOALS:
        ran = {who: found[goal] for who, found in racers.items() if goal in found}
        runs = range(max(1, 20 // len(q0)))  # of one after the other: what the cache holds counts
        samples = [[median(go()[0] for _ in runs) for _, go in ran.values()] for _ in range(turns)]
        times = dict(zip(ran, 1e6 * np.median(samples, axis=0), strict=True))
        cells = [f"{who} {ran[who][0]}: {us:.1f} us" for who, us in times.items()]
        if len(times) == 2:
            cells.append(f"ratio {times['ours'] / times['heyoka']:.2f}")
        print(f"{goal:.0e} m  " + "  ".join(cells))


def main(argv=None):
    """Measure and print."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse: to see what it prints")
    args = parser.parse_args(argv)
    missing = [x for x in ("llvmlite", "scipy", "mujoco", "heyoka") if not find_spec(x)]
    if {"llvmlite", "scipy"} & {*missing}:
        parser.error(f"{missing[0]} is not installed: pip install -e '.[peers]'")
    for peer in missing:
        print(f"{peer} is not installed and left out: pip install -e '.[peers]'")
    every, turns, crowd = (4, 3, 128) if args.quick else (1, 25, 1000)
    alone = SYSTEM["q0"][None]
    method_table(reference(alone))
    fine = np.unique(np.geomspace(12, 800, 100).astype(int))[::every].tolist()
    settings = {}
    for stages, tol in product((8, 4, 6)[::every], 10.0 ** -np.arange(3.0, 14.0, every)):
        prepared = ours(partial(whole_gauss, stages, tol))
        name = f"gauss({stages}, {tol:.0e}), {{}} steps"
        settings[name] = {n: prepared(n) for n in fine if n < 170}
    race("(b) 5 s of one", settings, alone, turns)
    q0 = np.stack([c.build_system("double", seed)["q0"] for seed in range(crowd)])
    settings = {"dop853, {} steps": {n: our_crowd(q0, n) for n in fine if n > 40}}
    race(f"(c) 5 s of {crowd}", settings, q0, turns)
