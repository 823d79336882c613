"""What does an error cost?  Every integrator with every way to hold a rod, over a ladder of steps,
against the truth.

Error is the largest distance of a particle, at twenty times, from where it should be. The truth is
gauss with 12 stages, run at two steps whose difference is its own error. The horizon is chosen so
that the methods decide and not chaos: the longest of 5, 2, 1, 0.5 s in which two starts 1e-9 m
apart stay within 1e-7. Cost is counted, and it is timed. Counted are linear systems solved: one for
each state at which a force is asked for, one a round of a projection. That is the same on every
machine, and what one pays where nothing but arithmetic costs. Time is that of the steps in this
program. gauss8 is gauss with 8 stages, four steps at a time; midpoint6 is no rule of the chapter,
but the extrapolated midpoint rule of order 6. A row is ahead in what is counted, a star, if no
other has both fewer solves and a smaller error; and in what is timed, a t, if no other has a
smaller error and a time that is smaller by more than the spread of both: on a busy machine fewer
can be told apart.
"""

import math
import sys
from argparse import RawDescriptionHelpFormatter
from functools import partial
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.studies._race import extrapolated_midpoint
from curriculum.ch3_4_constraints.studies._runs import drift, run
from curriculum.ch3_4_constraints.tables import in_turns, show, spread
from curriculum.common.banner import processor
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.files import write_json
from curriculum.common.gauss import make_gauss
from curriculum.common.motion import distance, followed
from curriculum.common.trace import Untraceable

import numpy as np

SAMPLES = 20
TARGETS = [1e-2, 1e-4, 1e-6, 1e-9, 1e-12]  # m
FAR = 0.3  # m: who is that far off is not listed as ahead
MOST = 10_000  # solves a simulated second: the ladder of a method ends where it takes more
RULES = {name: rule for name, rule in c.INTEGRATORS.items() if name != "gauss"}
MODES = {
    name: [mode for mode in c.hold_table() if mode != "impulse" or name in c.FOR_IMPULSE]
    for name in RULES
}
for order in (6, 8, 10):
    RULES[f"midpoint{order}"] = extrapolated_midpoint(order)
for stages, tol in ((6, 1e-6), (8, 5e-8), (10, 1e-11), (12, 1e-13)):
    RULES[f"gauss{stages}"] = make_gauss(stages, 4, tol)
METHODS = [(name, mode) for name in RULES for mode in MODES.get(name, ["none", "project"])]


def sampled(system, rule, mode, seconds, steps):
    """The Run of `steps` steps over `seconds`, and its positions (20, N, 3); None if it does not
    get there."""
    per = steps // SAMPLES
    found = run(system, rule, mode, seconds / steps, steps, range(per, steps + 1, per))
    return found, None if found.stopped else found.q


def horizon(system):
    """Seconds, how far neighbouring starts have parted by then, the true positions, how well they
    are known (m)."""
    aside = 1e-9 * np.array([0.6, 0.8, 0.0]) * np.arange(1, len(system["q0"]) + 1)[:, None]
    start = c.project(system, system["q0"], system["q0"] + aside, system["v0"], 1.0)
    near, rule = system | dict(zip(("q0", "v0"), start, strict=True)), make_gauss(12, 4, 1e-14)
    for seconds in (5.0, 2.0, 1.0, 0.5):
        steps = SAMPLES * math.ceil(seconds / SAMPLES / 0.02)
        runs = (system, 2 * steps), (system, steps), (near, steps)
        truth, check, other = (sampled(which, rule, "project", seconds, n)[1] for which, n in runs)
        if any(q is None for q in (truth, check, other)):
            continue
        growth = distance(other, check) / distance(near["q0"], system["q0"])
        if growth < 100.0:
            return seconds, growth, truth, distance(truth, check)
    raise SystemExit(
        "speed_vs_error: this scene is chaotic or unruly within half a second: nothing to compare"
    )


def solves(system, rule, mode, dt, steps):
    """Linear systems solved a step, counted over the first of them in plain numpy."""
    asked, solve = [], c.solve

    def counted(system, a, b, *rest):
        if b.dtype == object:
            raise Untraceable("it counts")
        asked.append(math.prod(b.shape[:-1]))
        return solve(system, a, b, *rest)

    hold = c.hold_table(dt)[mode]
    force, step = c.make_force(system, hold), followed(rule, hold.after, system)
    force.memory = {}  # of gauss, as in a run that is compiled
    with patch.object(c, "solve", counted):
        found = c.simulate(step, system, force, dt, min(steps, 40))
    return sum(asked) / (len(found.tip) - 1)


def ladder(system, seconds, rule, mode, truth):
    """The rows of one method: the number of steps doubles until it costs too much or the error
    stops to fall."""
    rows, steps, count = [], SAMPLES, 0.0
    while count < MOST and (len(rows) < 4 or rows[-1]["error"] < 0.9 * rows[-4]["error"]):
        dt = seconds / steps
        found, q = sampled(system, RULES[rule], mode, seconds, steps)
        if q is not None:
            count = solves(system, RULES[rule], mode, dt, steps) / dt
            row = {
                "method": f"{rule} {mode}",
                "dt": dt,
                "error": distance(q, truth),
                "solves": count,
            }
            row |= {"rods": float(found.violations.max()), "energy": float(drift(system, found))}
            rows.append(row | {"steps": steps})
        elif steps / seconds > MOST:
            break
        steps *= 2
    return rows


def time_all(rows, system, seconds, repeats):
    """Give each row its ms a simulated second, the median and quartiles of runs that take turns."""

    def pace(row):
        rule, mode = row["method"].split()
        return sampled(system, RULES[rule], mode, seconds, row["steps"])[0].seconds

    taken = in_turns({k: partial(pace, row) for k, row in enumerate(rows)}, repeats)
    for row, samples in zip(rows, taken.values(), strict=True):
        row |= spread(1e3 * np.array(samples) / seconds, "ms")


def mark(rows, known):
    """Mark those ahead in what is counted with *, in what is timed with t; under `known` m all
    errors are equal."""
    error = [max(row["error"], known) for row in rows]
    for row, e in zip(rows, error, strict=True):
        better = [(f, other) for f, other in zip(error, rows, strict=True) if f <= e]
        fewer = any((other["solves"], f) < (row["solves"], e) for f, other in better)
        sooner = any(other["ms q3"] < row["ms q1"] for _, other in better)
        row["ahead"] = "*" * (not fewer) + "t" * (not sooner)


def shown(row):
    """A row as it is printed."""
    errors = {"error m": row["error"], "rods m": row["rods"], "energy": row["energy"]}
    cost = {"solves/s": round(row["solves"]), "a step": f"{1e3 * row['ms'] * row['dt']:.3g} us"}
    cost["a second"] = f"{row['ms q1']:.3g}-{row['ms q3']:.3g} ms"
    return {"": row["ahead"], "method": row["method"], "dt": row["dt"]} | errors | cost


def cheapest(rows, target):
    """What reaches `target` m with the fewest solves, and what in the least time, as far as the
    spread tells."""
    reach = [row for row in rows if row["error"] <= target]
    if not reach:
        return {
            "good to": f"{target:.0e} m",
            "counted": "none",
            "solves": "-",
            "timed": "none",
            "at least": "-",
        }
    few, soon = (min(reach, key=lambda row, key=key: row[key]) for key in ("solves", "ms q3"))
    alike = dict.fromkeys(row["method"] for row in [soon, *reach] if row["ms q1"] <= soon["ms q3"])
    counted = {
        "good to": f"{target:.0e} m",
        "counted": few["method"],
        "solves": round(few["solves"]),
    }
    return counted | {"timed": " or ".join(alike), "at least": f"{soon['ms q1']:.3g} ms"}


def main(argv=None):
    """Print the frontier (or every row), the cheapest method for each target; write JSON if
    asked."""
    parser = Parser(
        prog="speed_vs_error", description=__doc__, formatter_class=RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add(
        "--system",
        default="double",
        metavar="NAME",
        help="a chapter scene or a scene file (double)",
    )
    add("--links", type=number(int, 1, 30), default=5, help="rods of --system chain (5)")
    add("--all", action="store_true", help="print every row, not the frontier alone")
    add("--repeats", type=number(int, 1, 1000), default=5, help="timings of each row (5)")
    add("--json", type=writable, metavar="PATH", help="write every row here, with the host")
    args = parser.parse_args(argv)
    system = parser.attempt("--system", c.build_system, args.system, 0, args.links)
    seconds, growth, truth, known = horizon(system)
    print(
        f"neighbours part {growth:.0f}-fold within {seconds:g} s; the truth is known to {known:.0e} m"
    )
    rows = [row for method in METHODS for row in ladder(system, seconds, *method, truth)]
    time_all(rows, system, seconds, args.repeats)
    mark(rows, known)
    rows.sort(key=lambda row: row["error"])
    table = [shown(row) for row in rows if args.all or row["ahead"] and row["error"] < FAR]
    show(
        f"{args.system}, {seconds:g} s: * ahead in solves, t in time; quartiles of {args.repeats} runs",
        table,
    )
    show("the cheapest", [cheapest(rows, target) for target in TARGETS])
    if args.json:
        content = {
            "system": args.system,
            "seconds": seconds,
            "growth": growth,
            "known_to": known,
            "host": processor(),
        }
        write_json(
            args.json,
            content | {"numpy": np.__version__, "python": sys.version.split()[0], "rows": rows},
        )
    return 0


if __name__ == "__main__":
    run_script(main)
