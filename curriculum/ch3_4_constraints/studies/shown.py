"""What the chapter says on its way, shown: one small table a name.  All of them, or those named.

No table holds a time, and none is rounded finer than processors agree: a reader sees the digits of
the text. `hour` takes long, and is shown only if it is named.
"""

import math

import constraints as c
from curriculum.ch3_4_constraints.studies import _runs, speed_vs_error
from curriculum.ch3_4_constraints.studies._runs import G, drift, energy_scale, run
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import Parser, run_script
from curriculum.common.runs import distance
from curriculum.common.trace import repeat

import numpy as np

DT = 0.005  # s, where nothing else is said


def bobs(*at, v=None, lengths=None):
    """Bobs of 1 kg, one below the other on rods (`lengths`: as they hang), at `at` (x, y) with
    speeds `v` (x, y)."""
    states = [np.array(x, dtype=float) for x in (at, v or np.zeros((len(at), 2)))]
    q0, v0 = (np.pad(x, [(0, 0), (0, 1)]) for x in states)
    pairs = [(k, k - 1) for k in range(len(at))]
    return _runs.make_system(q0, v0, np.ones(len(at)), pairs, lengths)


def swinging(degrees):
    """A pendulum of 1 m, so far from the vertical and as fast as one that was let go level."""
    sin, cos = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    speed = math.sqrt(2.0 * G * cos)
    return bobs((sin, -cos), v=[(-speed * cos, -speed * sin)], lengths=[1.0])


def matrices():
    """Two bobs that hang at rest: every entry of the linear system."""
    system, rows = bobs((0.0, -1.0), (0.0, -2.0)), []
    q, v, m = system["q0"], system["v0"], system["m"]
    jac, _, _, jdotv = c.constraint_terms(system, q, v)
    a, b = c.mobility(system, jac), -(jac @ (c.external_force(system, q) / m).ravel() + jdotv)
    lam, pulls = c.solve(system, a, b), c.tensions(system, q, v, c.as_hold(0.0))
    places = [(f"{axis}{i}", 3 * i + n) for i in range(2) for n, axis in enumerate("xy")]
    for k in range(2):
        row = {"rod": k} | {f"J: {name}": f"{jac[k, place] + 0.0:g}" for name, place in places}
        row |= {f"A: {i}": f"{a[k, i]:g}" for i in range(2)} | {"right": f"{b[k] + 0.0:g}"}
        rows.append(row | {"lambda": f"{lam[k]:.2f}", "pull, N": f"{pulls[k]:.2f}"})
    show("two bobs of 1 kg at rest, one below the other", rows)


def level():
    """The pendulum let go level: the pull found and the pull by hand, and the work it does."""
    rows = []
    for degrees in (90, 60, 30, 0):
        system = swinging(degrees)
        force = c.constraint_force(system, system["q0"], system["v0"])[0]
        by_hand = 3.0 * G * math.cos(math.radians(degrees))
        row = {"angle": f"{degrees} deg", "speed, m/s": f"{np.linalg.norm(system['v0']):.3f}"}
        row |= {"3 m g cos, N": f"{by_hand:.2f}", "pull found, N": f"{np.linalg.norm(force):.2f}"}
        rows.append(row | {"its power, W": f"{abs(c.dot(force, system['v0'][0])):.2f}"})
    show("a bob of 1 kg on a rod of 1 m, let go level", rows)


def tangent():
    """g of the naive rod, and the sum that it is."""
    system, rows = c.build_system("pendulum"), []
    found = run(system, keep=range(4001))
    g = c.constraint_terms(system, found.q, found.v)[1][:, 0]
    squares = np.sum(found.v**2, axis=(1, 2))
    for steps in (1, 200, 4000):
        after, before = (0.5 * DT**2 * np.sum(squares[k : k + steps]) for k in (1, 0))
        row = {"after": f"{DT * steps:g} s", "g found, m^2": f"{g[steps] - g[0]:.8f}"}
        row |= {"the sum, m^2": f"{after:.8f}", "with speeds before": f"{before:.8f}"}
        rows.append(row | {"rod error, m": f"{found.violations[steps]:.6f}"})
    show("the pendulum, semi_implicit, none: g, and dt^2/2 times the sum of |v|^2", rows)


def jdotv():
    """The naive solve as it is, and without Jdot v."""
    rows, without = [], c.hold_table()["none"]._replace(use_jdotv=0.0)
    for name in ("pendulum", "double"):
        for what, hold in (("with Jdot v", "none"), ("without", without)):
            off = run(c.build_system(name), hold=hold).violations
            row = {f"{t} s": f"{off[round(t / DT)]:.2f} m" for t in (1, 5, 20)}
            rows.append({"system": name, "solve": what} | row)
    show("rod error after", rows)


def order():
    """Half the step, again and again: what rk4 leaves of the naive pendulum's rod and energy."""
    rows, system, before = [], c.build_system("pendulum"), None
    for dt in (0.02, 0.01, 0.005, 0.0025):
        found = run(system, "rk4", "none", dt, round(20.0 / dt))
        now = np.array([found.violations.max(), drift(system, found)])
        row = {"dt, s": f"{dt:g}", "rod error, m": f"{now[0]:.2e}"}
        row["energy, of m g L"] = f"{now[1]:.2e}"
        times = "- -" if before is None else "{:.1f} {:.1f}".format(*before / now)
        rows.append(row | {"times less": times})
        before = now
    show("the pendulum over 20 s, rk4, none", rows)


def halving():
    """The order of every mode: worst rod error at ever shorter steps."""
    rows, system, ladder = [], c.build_system("double"), (0.01, 0.005, 0.0025, 0.00125)
    for mode, seconds in [*((mode, 2) for mode in c.hold_table()), ("none", 20)]:
        runs = (run(system, hold=mode, dt=dt, steps=round(seconds / dt)) for dt in ladder)
        off = [found.violations.max() for found in runs]
        row = {"mode": mode, "over": f"{seconds} s"}
        row |= {f"dt {dt}": f"{x:.1e}" for dt, x in zip(ladder, off, strict=True)}
        times = (f"{a / b:.1f}" for a, b in zip(off, off[1:], strict=False))
        rows.append(row | {"times less": " ".join(times)})
    show("the double pendulum, semi_implicit: worst rod error, m", rows)


def knob():
    """Baumgarte's w: what it buys, what it costs, and its end."""
    rows, system = [], c.build_system("double")
    for w in (0.0, 5.0, 20.0, 80.0, 165.0, 170.0):
        found = run(system, hold=w)
        row = {"w, rad/s": f"{w:g}", "dt w": f"{DT * w:g}"}
        row["rod error, m"] = f"{found.violations.max():.2e}"
        row["energy, of m g L"] = f"{drift(system, found):.2g}"
        rows.append(row | {"end": found.stopped or "reached"})
    show("the double pendulum over 20 s, semi_implicit, dt 0.005", rows)


def seeds():
    """Does baumgarte beat none, and by how much, if the start is another?"""
    rows, both = [], ("none", "baumgarte")
    for name in c.SYSTEMS:
        starts = [c.build_system(name, seed) for seed in range(3)]
        off = [[run(one, hold=mode).violations.max() for one in starts] for mode in both]
        texts = ["  ".join(f"{x:.4f}" for x in one) for one in off]
        row = {f"{mode}, m": text for mode, text in zip(both, texts, strict=True)}
        times = "  ".join(f"{x:4.1f}" for x in np.divide(*off))
        rows.append({"system": name} | row | {"none / baumgarte": times})
    show("worst rod error over 20 s, seeds 0, 1, 2", rows)


def lag():
    """One step's error against its sum over the time that Baumgarte's spring takes."""
    rows, squared, w, system = [], 2.0 * G, 20.0, swinging(90.0)  # m^2/s^2 at the bottom; rad/s
    for mode, words, by_hand in (
        ("impulse", "dt^2 |v|^2 / 2", 0.5 * DT**2 * squared),
        ("baumgarte", "dt |v|^2 / w", DT * squared / w),
    ):
        found = run(system, hold=mode, steps=400, keep=range(401))
        g = np.abs(c.constraint_terms(system, found.q, found.v)[1]).max()
        row = {"mode": mode, "by hand": words, "is, m^2": f"{by_hand:.2e}"}
        rows.append(row | {"worst g found, m^2": f"{g:.2e}"})
    show("the pendulum let go level, semi_implicit, dt 0.005, over 2 s", rows)


def nudge():
    """A rod that is 1 mm too long, and a rule under which impulse mends it or does not."""
    rows, system = [], bobs((0.0, -1.001), lengths=[1.0])
    for rule in ("semi_implicit", "euler"):
        hold = c.hold_table(DT)["impulse"]._replace(rule=None)  # be it made for another rule
        off = 1e3 * run(system, rule, hold, steps=2000).violations
        row = {"impulse under": rule} | {f"{k}": f"{off[k]:.3f}" for k in range(8)}
        rows.append(row | {"worst of 1995 to 2000": f"{off[1995:].max():.3f}"})
    what = "rod error without its sign, mm, after so many steps"
    show(f"a bob hangs at rest, its rod 1 mm too long: {what}", rows)


def soft():
    """How much longer a soft rod is under load."""
    time_constant, impedance, rows = 0.02, 0.95, []
    stands = 1e3 * (1.0 - impedance) * G * time_constant**2  # mm
    swings = stands + 1e3 * 2.0 * G * time_constant**2
    two = bobs((0.0, -1.0), (0.0, -2.0))
    for what, system, rule, by_hand in (
        ("one bob hangs", bobs((0.0, -1.0)), "semi_implicit", stands),
        ("two bobs hang, the worse rod", two, "semi_implicit", 2.0 * stands),
        ("a bob swings, let go level", swinging(90.0), "rk4", swings),
    ):
        found = 1e3 * run(system, rule, "soft", steps=400).violations.max()
        rows.append({"": what, "by hand, mm": f"{by_hand:.3f}", "found, mm": f"{found:.3f}"})
    show("soft: how much longer a rod is than it should be", rows)


def nearest(system, q_start, q, v, dt):
    """The obvious way back onto the rods, and a wrong one: along J(q), the shortest way, and v is
    not told."""

    def newton(q):
        jac, g, _, _ = c.constraint_terms(system, q, v)
        mu = c.solve(system, c.mobility(system, jac), g)
        return q - c.pull(jac, mu) / system["m"], c.dot(g / 1e-12, g / 1e-12)

    end = repeat(newton, q, 20, "no way back onto the rods")
    jac, _, gdot, _ = c.constraint_terms(system, end, v)
    return end, v - c.pull(jac, c.solve(system, c.mobility(system, jac), gdot)) / system["m"]


def way_back():
    """project, and the same by the shortest way: energy."""
    rows, system, hold = [], c.build_system("double"), c.hold_table()["project"]
    for what, after in (("project", c.project), ("the shortest way, v not told", nearest)):
        found = run(system, hold=hold._replace(after=after))
        off = np.abs(found.energies - found.energies[0]) / energy_scale(system)
        row = {"": what, "rods, m": f"{found.violations.max():.0e}"}
        rows.append(row | {f"{t} s": f"{off[round(t / DT)]:.2g}" for t in (1, 5, 10, 20)})
    show("the double pendulum, semi_implicit: energy error as a share of m g L after", rows)


def catenary():
    """The pull of a cable's end rods: as solved, by hand, and of a rope that bends anywhere.

    By hand, a link lies as its two ends' pulls ask for: with H their level part, the first of 12
    links rises by 11 / 2 bobs' weights over H. The rope is the curve y = a cosh(x / a).
    """
    system, rows = _runs.scene("tight_cable"), []
    span, rope = system["anchors"][1, 0], system["lengths"].sum()
    x, y = np.abs(system["q0"][0, :2])
    weight = system["m"].sum() * G
    found = c.tensions(system, system["q0"], system["v0"])[[0, -1]].max()
    u, last = math.sqrt(6.0 * (rope / span - 1.0)), math.inf  # u = span / 2a: sinh(u) / u is known
    while u < last:  # Newton's method, from above
        last, off = u, math.sinh(u) - u * rope / span
        u -= off / (math.cosh(u) - rope / span)
    bobs = 0.5 * weight * math.hypot(x, y) / y
    curve = G * 0.5 * span / u * math.cosh(u)  # a rope of 1 kg/m
    for what, pull in (("end rods, solved", found), ("by hand", bobs), ("a rope's ends", curve)):
        rows.append({"pull of": what, "N": f"{pull:.2f}"})
    show(f"{len(system['m'])} bobs of 1 kg on {rope:g} m between anchors {span:.4f} m apart", rows)


def rules():
    """The same number of linear systems, spent by rules of different order."""
    system, rows, spent = c.build_system("double"), [], [("semi_implicit", 0.005), ("rk4", 0.02)]
    truth = run(system, "gauss", "project", 0.02, 100).q[-1]
    for rule, dt in [*spent, ("semi_implicit", 0.00125), ("rk4", 0.005), ("gauss", 0.1)]:
        steps = round(2.0 / dt)
        solves = round(steps * speed_vs_error.solves(system, rule, "none", dt, steps))
        off = distance(run(system, rule, "none", dt, steps).q[-1], truth)
        row = {"rule": rule, "dt, s": f"{dt:g}", "systems solved": solves}
        rows.append(row | {"error at 2 s, m": f"{off:.0e}"})
    show("the double pendulum, none, 2 s", rows)


def parting():
    """Seeds 0 and 1, and seed 0 once more."""
    runs = (run(c.build_system("double", seed), hold="baumgarte") for seed in (0, 0, 1))
    once, again, other = runs
    apart = np.linalg.norm(once.tip - other.tip, axis=-1)
    row = {f"{t} s": f"{apart[round(t / DT)]:.2f}" for t in (0, 2, 5, 10, 20)}
    what = "how far apart the tips of seeds 0 and 1 are, m, after"
    show(f"the double pendulum, baumgarte: {what}", [row])
    same = all(np.array_equal(a, b) for a, b in zip(once[:3], again[:3], strict=True))
    print(f"seed 0, twice: the same to the last bit: {same}")


def thrown():
    """Three bodies on three rods that hang on nothing, thrown and turning; the third is heavy."""
    q0, v0 = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.0, 3, 0], [0, 5, 0], [-2, 3, 0]]
    return _runs.make_system(q0, v0, [1.0, 2.0, 5.0], [(1, 0), (2, 0), (2, 1)])


def spin(system, q, v):
    """Angular momentum (..., 3) about the centre of mass, in kg m^2/s."""
    m = system["m"]
    q, v = (x - np.sum(m * x, axis=-2, keepdims=True) / np.sum(m) for x in (q, v))
    return np.sum(m * np.cross(q, v), axis=-2)


def below(x):
    """The power of ten that x is below: rounding is told no finer."""
    return f"< 1e{math.floor(math.log10(x)) + 1:03d}" if x else "0"


def laws():
    """What nobody built in: bodies thrown free keep their spin, and time runs back under gauss."""
    rows, free, double = [], thrown(), c.build_system("double")
    cases = ("semi_implicit", "impulse", DT), ("rk4", "project", DT), ("gauss", "project", 0.02)
    for rule, mode, dt in [*cases, ("gauss", "none", 0.02)]:
        steps = round(2.0 / dt)
        found = run(free, rule, mode, dt, steps, range(steps))
        there = run(double, rule, mode, dt, steps)
        turns = spin(free, found.q, found.v)[:, 2]
        back = double | {"q0": there.q[-1], "v0": -there.v[-1]}
        off = distance(run(back, rule, mode, dt, steps).q[-1], double["q0"])
        row = {"method": f"{rule} {mode}", "dt, s": dt}
        row["spin changes by"] = below(np.ptp(turns) / abs(turns[0]))
        rows.append(row | {"off the start, m": below(off)})
    show("2 s: three bodies thrown free, and a double pendulum there and back", rows)


def hour():
    """An hour of the double pendulum: what becomes of energy and rods, and how far a rule gets."""
    rows, system, hour = [], c.build_system("double"), 3600.0
    for rule, mode in [("semi_implicit", m) for m in c.hold_table()] + [("rk4", "none")]:
        found = run(system, rule, mode, DT, round(hour / DT))
        gained = (found.energies - found.energies[0]) / energy_scale(system)
        row = {"rule": f"{rule} {mode}", "rods, m": f"{found.violations.max():.0e}"}
        for seconds in (60.0, 600.0, hour):
            k = round(seconds / DT)
            row[f"{seconds:g} s"] = f"{gained[k]:+.2f}" if k < len(gained) else "-"
        rows.append(row | {"end": found.stopped or "reached"})
    show("the double pendulum, dt 0.005: energy gained, of m g L, after", rows)


QUICK = (matrices, level, tangent, jdotv, order, halving, knob, seeds, lag, nudge, soft, way_back)
QUICK += (catenary, rules, parting, laws)
SHOWN = {table.__name__: table for table in [*QUICK, hour]}


def main(argv=None):
    """Print the tables."""
    parser = Parser(prog="shown", description=__doc__)
    names = {"nargs": "*", "metavar": "NAME", "choices": [*SHOWN, []]}
    parser.add_argument("names", **names, help=f"some of {', '.join(SHOWN)}; all but the last")
    for name in parser.parse_args(argv).names or [table.__name__ for table in QUICK]:
        SHOWN[name]()
    return 0


if __name__ == "__main__":
    run_script(main)
