"""What the chapter says on its way, shown: one small table a name.  All of them, or those named.

A table is a function that yields its rows. None holds a time, and none is rounded finer than
processors agree: a reader sees the digits of the text. `hour` takes long, and is shown only if it
is named.
"""

import math

import constraints as c
from curriculum.ch3_4_constraints.studies._command import study_parser
from curriculum.ch3_4_constraints.studies._runs import G, drift, energy_scale, make_system, run
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import run_script
from curriculum.common.runs import distance

import numpy as np

DT = 0.005  # s, where nothing else is said
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


@table(
    "rod = {} | J: x0 = {:g} | J: y0 = {:g} | J: x1 = {:g} | J: y1 = {:g} | A: 0 = {:g}"
    " | A: 1 = {:g} | right = {:g} | lambda = {:.2f} | pull, N = {:.2f}"
)
def matrices():
    """two bobs of 1 kg at rest, one below the other"""
    system = bobs((0.0, -1.0), (0.0, -2.0))
    q, v, m = system["q0"], system["v0"], system["m"]
    jac, _, _, jdotv = c.constraint_terms(system, q, v)
    a, b = c.mobility(system, jac), -(jac @ (c.external_force(system, q) / m).ravel() + jdotv)
    lam, pulls = c.solve(system, a, b), c.tensions(system, q, v)
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
        yield degrees, np.linalg.norm(v), by_hand, np.linalg.norm(force), abs(c.dot(force, v))


@table(
    "after = {:g} s | g found, m^2 = {:.8f} | the sum, m^2 = {:.8f} | with speeds before = {:.8f}"
    " | rod error, m = {:.6f}"
)
def tangent():
    """the pendulum, semi_implicit, none: g, and dt^2/2 times the sum of |v|^2"""
    system = c.build_system("pendulum")
    found = run(system, keep=range(4001))
    g = c.constraint_terms(system, found.q, found.v)[1][:, 0]
    squares = np.sum(found.v**2, axis=(1, 2))
    for steps in (1, 200, 4000):
        after, before = (0.5 * DT**2 * np.sum(squares[k : k + steps]) for k in (1, 0))
        yield DT * steps, g[steps] - g[0], after, before, found.violations[steps]


@table("dt, s = {:g} | rod error, m = {:.2e} | energy, of m g L = {:.2e} | times less = {}")
def order():
    """the pendulum over 20 s, rk4, none"""
    system, before = c.build_system("pendulum"), None
    for dt in (0.02, 0.01, 0.005, 0.0025):
        found = run(system, "rk4", "none", dt, round(20.0 / dt))
        now = np.array([found.violations.max(), drift(system, found)])
        yield dt, *now, "- -" if before is None else "{:.1f} {:.1f}".format(*before / now)
        before = now


@table(
    "mode = {} | over = {} s | dt 0.01 = {:.1e} | dt 0.005 = {:.1e} | dt 0.0025 = {:.1e}"
    " | dt 0.00125 = {:.1e} | times less = {}"
)
def halving():
    """the double pendulum, semi_implicit: worst rod error, m"""
    system, ladder = c.build_system("double"), (0.01, 0.005, 0.0025, 0.00125)
    for mode, seconds in [*((mode, 2) for mode in c.hold_table()), ("none", 20)]:
        runs = (run(system, hold=mode, dt=dt, steps=round(seconds / dt)) for dt in ladder)
        off = [found.violations.max() for found in runs]
        times = (f"{a / b:.1f}" for a, b in zip(off, off[1:], strict=False))
        yield mode, seconds, *off, " ".join(times)


@table(
    "w, rad/s = {:g} | dt w = {:g} | rod error, m = {:.2e} | energy, of m g L = {:.2g} | end = {}"
)
def knob():
    """the double pendulum over 20 s, semi_implicit, dt 0.005"""
    system = c.build_system("double")
    for w in (0.0, 5.0, 20.0, 80.0, 165.0, 170.0):
        found = run(system, hold=w)
        yield w, DT * w, found.violations.max(), drift(system, found), found.stopped or "reached"


@table("mode = {} | while = {} | by hand, mm = {:.3f} | found, mm = {:.3f}")
def by_hand():
    """worst error of a rod of 1 m over 2 s, dt 0.005; what swings was let go level"""
    w, time_constant, impedance = 20.0, 0.02, 0.95  # rad/s, s
    squared = 2.0 * G  # m^2/s^2, at the bottom
    stands = (1.0 - impedance) * G * time_constant**2
    level, one, two = swinging(90.0), bobs((0.0, -1.0)), bobs((0.0, -1.0), (0.0, -2.0))
    for mode, rule, what, system, metres in (
        ("impulse", "semi_implicit", "a bob swings", level, 0.5 * DT**2 * squared),
        ("baumgarte", "semi_implicit", "a bob swings", level, DT * squared / w),
        ("soft", "rk4", "a bob swings", level, stands + squared * time_constant**2),
        ("soft", "semi_implicit", "one bob hangs", one, stands),
        ("soft", "semi_implicit", "two bobs hang", two, 2.0 * stands),
    ):
        off = run(system, rule, mode, steps=400).violations.max()
        yield mode, what, 1e3 * metres, 1e3 * off


@table("impulse under = {} | after 0, 1, ... 7 steps = {} | worst of 1995 to 2000 = {:.3f}")
def nudge():
    """a bob hangs at rest, its rod 1 mm too long: rod error without its sign, mm"""
    system = bobs((0.0, -1.001), lengths=[1.0])
    for rule in ("semi_implicit", "euler"):
        hold = c.hold_table(DT)["impulse"]._replace(rule=None)  # be it made for another rule
        off = 1e3 * run(system, rule, hold, steps=2000).violations
        yield rule, "  ".join(f"{x:.3f}" for x in off[:8]), off[1995:].max()


def nearest(system, q_start, q, v, dt):
    """The obvious way back onto the rods, and a wrong one: the shortest, and v is not told."""
    return c.project(system, q, q, v, math.inf)


@table(" = {} | rods, m = {:.0e} | 1 s = {:.2g} | 5 s = {:.2g} | 10 s = {:.2g} | 20 s = {:.2g}")
def way_back():
    """the double pendulum, semi_implicit: energy error as a share of m g L after"""
    system, hold = c.build_system("double"), c.hold_table()["project"]
    for what, after in (("project", c.project), ("the shortest way, v not told", nearest)):
        found = run(system, hold=hold._replace(after=after))
        off = np.abs(found.energies - found.energies[0]) / energy_scale(system)
        yield what, found.violations.max(), *(off[round(t / DT)] for t in (1, 5, 10, 20))


def below(x):
    """The power of ten that x is below: rounding is told no finer."""
    return f"< 1e{math.floor(math.log10(x)) + 1:03d}" if x else "0"


@table("method = {} | dt, s = {} | spin changes by = {} | off the start, m = {}")
def laws():
    """2 s: three bodies thrown free, and a double pendulum there and back"""
    q0, v0 = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 3, 0], [0, 5, 0], [-2, 3, 0]]
    free = make_system(q0, v0, [1.0, 2.0, 5.0], [(1, 0), (2, 0), (2, 1)])
    double = c.build_system("double")
    cases = ("semi_implicit", "impulse", DT), ("rk4", "project", DT), ("gauss", "project", 0.02)
    for rule, mode, dt in [*cases, ("gauss", "none", 0.02)]:
        steps = round(2.0 / dt)
        found = run(free, rule, mode, dt, steps, range(steps))
        m = free["m"]  # about the centre of mass:
        arms, speeds = (x - np.sum(m * x, 1, keepdims=True) / np.sum(m) for x in (found.q, found.v))
        turns = np.sum(m * np.cross(arms, speeds), axis=1)[:, 2]
        there = run(double, rule, mode, dt, steps)
        back = run(double | {"q0": there.q[-1], "v0": -there.v[-1]}, rule, mode, dt, steps)
        off = distance(back.q[-1], double["q0"])
        yield f"{rule} {mode}", dt, below(np.ptp(turns) / abs(turns[0])), below(off)


@table("rule = {} | rods, m = {:.0e} | 60 s = {} | 600 s = {} | 3600 s = {} | end = {}")
def hour():
    """the double pendulum, dt 0.005: energy gained, of m g L, after"""
    system, times = c.build_system("double"), (60.0, 600.0, 3600.0)
    for rule, mode in [*(("semi_implicit", mode) for mode in c.hold_table()), ("rk4", "none")]:
        found = run(system, rule, mode, DT, round(times[-1] / DT))
        gained = (found.energies - found.energies[0]) / energy_scale(system)
        there = [k for k in (round(t / DT) for t in times) if k < len(gained)]
        texts = [f"{x:+.2f}" for x in gained[there]] + ["-"] * (len(times) - len(there))
        yield f"{rule} {mode}", found.violations.max(), *texts, found.stopped or "reached"


def main(argv=None):
    """Print the tables."""
    parser = study_parser("shown", __doc__)
    names = {"nargs": "*", "metavar": "NAME", "choices": [*SHOWN, []]}
    parser.add_argument("names", **names, help=f"some of {', '.join(SHOWN)}; all but hour")
    for name in parser.parse_args(argv).names or [name for name in SHOWN if name != "hour"]:
        function, columns = SHOWN[name]
        rows = [zip(columns, row, strict=True) for row in function()]
        rows = [{header: form.format(x) for (header, form), x in row} for row in rows]
        show(function.__doc__, rows)


if __name__ == "__main__":
    run_script(main)
