"""What the chapter says on its way, shown: one small table a name.  All of them, or those named.

A table is a function that yields its rows. None holds a time, and none is rounded finer than
processors agree: a reader sees the digits of the text. `hour`, which takes long, must be named.
"""

import math
from functools import partial
from itertools import pairwise, product

import constraints as c
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._runs import G, drift, energy_scale, make_system, run
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.crowds import mapped
from curriculum.common.runs import distance

import numpy as np

DT = 0.005  # s, where nothing else is said
PENDULUM, DOUBLE = map(c.build_system, ("pendulum", "double"))
SHOWN = {}  # {name: (function, [(header, format), ...])}


def table(columns):
    """Of a function that yields rows: they are shown under `columns`, "header = format | ..."."""

    def register(function):
        SHOWN[function.__name__] = function, [x.split(" = ") for x in columns.split(" | ")]
        return function

    return register


def bobs(*at, v=None, lengths=None):
    """Bobs of 1 kg in a row on rods (`lengths`: as they hang), at (x, y) with speeds `v` (x, y)."""
    q0, v0 = (np.pad(np.array(x), [(0, 0), (0, 1)]) for x in (at, v or np.zeros((len(at), 2))))
    pairs = [(k, k - 1) for k in range(len(at))]
    return make_system(q0, v0, np.ones(len(at)), pairs, lengths)


def swinging(degrees):
    """A pendulum of 1 m, so far from the vertical and as fast as one that was let go level."""
    sin, cos = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    speed = math.sqrt(2.0 * G * cos)
    return bobs((sin, -cos), v=[(-speed * cos, -speed * sin)], lengths=[1.0])


def wrong(system, q, v):
    """g in m^2 of the first rod: above 0 if it is too long, below 0 if it is too short."""
    return c.constraint_terms(system, q, v)[1][0]


@table("seeds = {} | tips apart at the start, m = {:.6f} | after 20 s, m = {:.6f}")
def seeds():
    """the double pendulum, semi_implicit, baumgarte"""
    tips = [run(c.build_system("double", seed), hold="baumgarte").tip for seed in (0, 1)]
    for seed, tip in enumerate(tips):
        yield f"0 and {seed}", *np.linalg.norm(tip[[0, -1]] - tips[0][[0, -1]], axis=1)


@table("system = {} | seed 0 = {:.1f} | seed 1 = {:.1f} | seed 2 = {:.1f}")
def ratios():
    """worst rod error over 20 s, semi_implicit: that of none over that of baumgarte"""

    def worst(name, seed, mode):
        return run(c.build_system(name, seed), hold=mode).violations.max()

    for name in c.SYSTEMS:
        yield name, *(worst(name, k, "none") / worst(name, k, "baumgarte") for k in range(3))


@table(
    "rod = {} | J: x0 = {:g} | J: y0 = {:g} | J: x1 = {:g} | J: y1 = {:g} | A: 0 = {:g}"
    " | A: 1 = {:g} | right = {:g} | lambda = {:.2f} | pull, N = {:.2f}"
)
def matrices():
    """two bobs of 1 kg at rest, one below the other"""
    system = bobs((0.0, -1.0), (0.0, -2.0))
    q, v, m = system["q0"], system["v0"], np.repeat(system["m"], 3)
    jac, _, _, jdotv = c.constraint_terms(system, q, v)
    a = (jac / m) @ jac.T
    b = -(jac @ (c.external_force(system, q).ravel() / m) + jdotv)
    lam, pulls = np.linalg.solve(a, b), c.tensions(system, q, v)
    for k in range(2):
        yield k, *(jac[k, [0, 1, 3, 4]] + 0.0), *a[k], b[k] + 0.0, lam[k], pulls[k]


@table(
    "angle = {} deg | speed, m/s = {:.3f} | 3 m g cos, N = {:.2f} | pull found, N = {:.2f}"
    " | its power, W = {:.2f}"
)
def level():
    """a bob of 1 kg on a rod of 1 m, let go level"""
    for degrees in (90, 60, 30, 0):
        system = swinging(degrees)
        v, by_hand = system["v0"][0], 3.0 * G * math.cos(math.radians(degrees))
        force = c.constraint_force(system, system["q0"], system["v0"])[0]
        yield degrees, np.linalg.norm(v), by_hand, np.linalg.norm(force), abs(force @ v)


@table(
    "after = {:g} s | g found, m^2 = {:.8f} | the sum, m^2 = {:.8f} | with speeds before = {:.8f}"
    " | rod error, m = {:.6f}"
)
def tangent():
    """the pendulum, semi_implicit, none: g, and dt^2/2 times the sum of |v|^2"""
    found = run(PENDULUM, keep=range(4001))
    squares = np.sum(found.v**2, axis=(1, 2))
    for steps in (1, 200, 4000):
        start, end = (wrong(PENDULUM, found.q[k], found.v[k]) for k in (0, steps))
        after, before = (0.5 * DT**2 * np.sum(squares[k : k + steps]) for k in (1, 0))
        yield DT * steps, end - start, after, before, found.violations[steps]


@table("thrown = {} | g found, m^2 = {:+.8f} | by the formula = {:+.8f} | rod error, m = {:+.6f}")
def thrown():
    """a pendulum that hangs, semi_implicit, none, dt 0.005, after 20 s"""
    steps = 4000
    for speed in (1.0, 3.0):
        system = bobs((0.0, -1.0), v=[(speed, 0.0)])
        found = run(system, keep=range(steps + 1))
        q, squares = found.q[-1], np.sum(found.v**2, axis=(1, 2))
        by_formula = 0.5 * DT**2 * np.sum(squares[1:]) - steps * DT**2 * speed**2
        off = c.rod_errors(system, q)[0]
        yield f"at {speed:g} m/s", wrong(system, q, found.v[-1]), by_formula, off


@table("dt, s = {:g} | rod error, m = {:.2e} | energy, of m g L = {:.2e} | times less = {}")
def order():
    """the pendulum over 20 s, rk4, none"""
    before = None
    for dt in (0.02, 0.01, 0.005, 0.0025):
        found = run(PENDULUM, "rk4", "none", dt, round(20.0 / dt))
        now = np.array([found.violations.max(), drift(PENDULUM, found)])
        yield dt, *now, "- -" if before is None else "{:.1f} {:.1f}".format(*before / now)
        before = now


@table(
    "mode = {} | over = {} s | dt 0.01 = {:.1e} | dt 0.005 = {:.1e} | dt 0.0025 = {:.1e}"
    " | dt 0.00125 = {:.1e} | times less = {}"
)
def halving():
    """the double pendulum, semi_implicit: worst rod error, m"""
    ladder = 0.01, 0.005, 0.0025, 0.00125
    for mode, seconds in [*((mode, 2) for mode in c.hold_table()), ("none", 20)]:
        runs = (run(DOUBLE, hold=mode, dt=dt, steps=round(seconds / dt)) for dt in ladder)
        off = [found.violations.max() for found in runs]
        times = (f"{a / b:.1f}" for a, b in pairwise(off))
        yield mode, seconds, *off, " ".join(times)


@table(
    "w, rad/s = {:g} | dt w = {:g} | rod error, m = {:.2e} | energy, of m g L = {:.2g} | end = {}"
)
def knob():
    """the double pendulum over 20 s, semi_implicit, dt 0.005"""
    for w in (0.0, 5.0, 20.0, 80.0, 165.0, 170.0):
        found = run(DOUBLE, hold=w)
        yield w, DT * w, found.violations.max(), drift(DOUBLE, found), found.stopped or "reached"


@table("mode = {} | energy gained, J = {:+.1f} | work of the rods, J = {:+.1f}")
def work():
    """the double pendulum, 20 s, semi_implicit; work: mean lambda times each change of g"""
    for mode in ("none", "baumgarte"):
        hold = c.hold_table(DT)[mode]
        found = run(DOUBLE, hold=hold, keep=range(4001))
        pulls = mapped(partial(c.tensions, DOUBLE, hold=hold))(found.q, found.v)
        sizes = mapped(partial(c.rod_errors, DOUBLE))(found.q, found.v) + DOUBLE["lengths"]
        lam = -pulls / sizes
        changes = np.diff(0.5 * np.square(sizes), axis=0)
        done = np.sum(0.5 * (lam[1:] + lam[:-1]) * changes)
        yield mode, found.energies[-1] - found.energies[0], done


@table(
    "rule = {} | g found, m^2 = {:+.6e} | dt rate.rate / w, m^2 = {:.6e} | rod error, mm = {:+.4f}"
)
def turning():
    """a dumbbell falls and spins: rate 4 m/s, baumgarte, w 20, dt 0.001, after 3 s"""
    q0, v0 = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, -2.0, 0.0], [0.0, 2.0, 0.0]]
    dumbbell, dt, w = make_system(q0, v0, [1.0, 1.0], [(1, 0)]), 0.001, 20.0
    for rule in ("semi_implicit", "euler", "rk4"):
        found = run(dumbbell, rule, w, dt, 3000)
        q, v = found.q[-1], found.v[-1]
        rate = v[1] - v[0]
        off = 1e3 * c.rod_errors(dumbbell, q)[0]
        yield rule, wrong(dumbbell, q, v), dt * (rate @ rate) / w, off


@table("mode = {} | rule = {} | while = {} | by hand, mm = {:+.3f} | found, mm = {:+.3f}")
def by_hand():
    """largest error of a rod of 1 m over 2 s, dt 0.005; what swings was let go level"""
    w, time_constant, impedance = 20.0, 0.02, 0.95  # rad/s, s
    squared = 2.0 * G  # m^2/s^2, at the bottom
    stands = (1.0 - impedance) * G * time_constant**2
    turns = squared * time_constant**2
    believed = squared * time_constant * DT  # what the damping does about DT squared / 2 of gdot
    level, one, two = swinging(90.0), bobs((0.0, -1.0)), bobs((0.0, -1.0), (0.0, -2.0))
    for mode, rule, what, system, metres in (
        ("impulse", "semi_implicit", "a bob swings", level, 0.5 * DT**2 * squared),
        ("baumgarte", "semi_implicit", "a bob swings", level, -DT * squared / w),
        ("soft", "semi_implicit", "a bob swings", level, stands + turns - believed),
        ("soft", "rk4", "a bob swings", level, stands + turns),
        ("soft", "semi_implicit", "one bob hangs", one, stands),
        ("soft", "semi_implicit", "two bobs hang", two, 2.0 * stands),
    ):
        states = run(system, rule, mode, steps=400, keep=range(401)).q
        off = np.array([c.rod_errors(system, q)[0] for q in states])
        yield mode, rule, what, 1e3 * metres, 1e3 * off[np.argmax(np.abs(off))]


@table("impulse under = {} | steps 0 to 7 = {} | later = {:.3f}")
def nudge():
    """a bob hangs at rest, its rod 1 mm too long: |error|, mm; later: at most"""
    system = bobs((0.0, -1.001), lengths=[1.0])
    for rule in ("semi_implicit", "euler"):
        hold = c.hold_table(DT)["impulse"]._replace(rule=None)  # though it is made for another rule
        off = 1e3 * run(system, rule, hold, steps=2000).violations
        yield rule, "  ".join(f"{x:.3f}" for x in off[:8]), off[1995:].max()


@table(
    "along the rods = {} | v told = {} | off, m = {:.0e} | 1 s = {} | 5 s = {} | 10 s = {}"
    " | 20 s = {} | worst = {:.2g}"
)
def way_back():
    """the double pendulum, semi_implicit: energy error as a share of m g L after"""
    hold = c.hold_table()["project"]
    for told, after in product((True, False), (False, True)):

        def back(system, q_start, q, v, dt, told=told, after=after):
            """Newton's way back, right or wrong: project goes along the rods before the step."""
            return c.project(system, q if after else q_start, q, v, dt if told else math.inf)

        found = run(DOUBLE, hold=hold._replace(after=back))
        off = np.abs(found.energies - found.energies[0]) / energy_scale(DOUBLE)
        steps = [round(t / DT) for t in (1, 5, 10, 20)]
        texts = [f"{off[k]:.2g}" if k < len(off) else "lost" for k in steps]
        rods = "after the step" if after else "before the step"
        yield rods, "yes" if told else "no", found.violations.max(), *texts, off.max()


def below(x):
    """The power of ten that x is below: rounding is told no finer."""
    return f"< 1e{math.floor(math.log10(x)) + 1:+03d}" if x else "0"


@table("method = {} | dt, s = {} | spin changes by = {} | off the start, m = {}")
def laws():
    """2 s: three bodies thrown free, and a double pendulum there and back"""
    q0, v0 = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 3, 0], [0, 5, 0], [-2, 3, 0]]
    free = make_system(q0, v0, [1.0, 2.0, 5.0], [(1, 0), (2, 0), (2, 1)])
    for rule, mode, dt in (
        ("semi_implicit", "none", DT),
        ("semi_implicit", "impulse", DT),
        ("euler", "project", DT),
        ("rk4", "project", DT),
        ("gauss", "project", 0.02),
        ("gauss", "none", 0.02),
    ):
        steps = round(2.0 / dt)
        found = run(free, rule, mode, dt, steps, range(steps))
        m = free["m"]  # about the centre of mass:
        arms, speeds = (x - np.sum(m * x, 1, keepdims=True) / np.sum(m) for x in (found.q, found.v))
        turns = np.sum(m * np.cross(arms, speeds), axis=1)[:, 2]
        there = run(DOUBLE, rule, mode, dt, steps)
        turned = DOUBLE | {"q0": there.q[-1], "v0": -there.v[-1]}
        off = distance(run(turned, rule, mode, dt, steps).q[-1], DOUBLE["q0"])
        yield f"{rule} {mode}", dt, below(np.ptp(turns) / abs(turns[0])), below(off)


@table("rule = {} | rods, m = {:.0e} | 60 s = {} | 600 s = {} | 3600 s = {} | end = {}")
def hour():
    """the double pendulum, dt 0.005: energy gained, of m g L, after"""
    times = 60.0, 600.0, 3600.0
    better = ("rk4", "none"), ("rk4", "project"), ("midpoint", "project"), ("gauss", "project")
    for rule, mode in [*(("semi_implicit", mode) for mode in c.hold_table()), *better]:
        found = run(DOUBLE, rule, mode, DT, round(times[-1] / DT))
        gained = (found.energies - found.energies[0]) / energy_scale(DOUBLE)
        there = [k for k in (round(t / DT) for t in times) if k < len(gained)]
        texts = [f"{x:+.0e}" for x in gained[there]] + ["-"] * (len(times) - len(there))
        yield f"{rule} {mode}", found.violations.max(), *texts, found.stopped or "reached"


def main(argv=None):
    """Print the tables."""
    parser = _runs.study_parser("shown", __doc__)
    words = f"some of {', '.join(SHOWN)}; all (15 s) leaves out hour"
    several = {"nargs": "*", "default": "all", "choices": [*SHOWN, "all"]}
    parser.add_argument("names", metavar="NAME", **several, help=words)
    asked = parser.parse_args(argv).names
    for name in [x for x in SHOWN if x != "hour"] if "all" in asked else asked:
        function, columns = SHOWN[name]
        rows = [zip(columns, row, strict=True) for row in function()]
        rows = [{header: form.format(x) for (header, form), x in row} for row in rows]
        show(function.__doc__, rows)
