"""What does an error cost?  Every integrator with every way to hold a rod, over a ladder of steps.

Error is the largest distance of a particle, at twenty times, from where it should be. The truth is
gauss with 12 stages, run at two steps whose difference is its own error. The horizon is chosen so
that the methods decide and not chaos: the longest of 5, 2, 1, 0.5 s in which two starts 1e-9 m
apart stay within 1e-7. Cost is counted, in linear systems solved a simulated second: one for each
state at which a force is asked for, one a round of a projection. That is the same on every machine;
time is what the study real_thing measures. gauss8 is gauss with 8 stages, midpoint6 the midpoint
rule of order 6. Shown are the rows that are ahead: no other has both fewer solves and a smaller
error.
"""

import math
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._runs import RULES, drift, run
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import run_script
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.ruler import once_for_all
from curriculum.common.runs import distance
from curriculum.common.steps import Plain

import numpy as np

SAMPLES = 20
TARGETS = [1e-2, 1e-4, 1e-6, 1e-9, 1e-12]  # m
FAR = 0.3  # m: who is that far off is not listed as ahead
MOST = 10_000  # solves a simulated second: the ladder of a method ends where it takes more
MODES = {
    name: [mode for mode, hold in c.hold_table().items() if hold.rule in (None, name)]
    for name in c.INTEGRATORS
}
METHODS = [(name, mode) for name in RULES for mode in MODES.get(name, ["none", "project"])]


def sampled(system, rule, mode, seconds, steps, way=Compiled):
    """The Run of `steps` steps over `seconds`, and its positions (20, N, 3); None if it stops."""
    per = steps // SAMPLES
    found = run(system, rule, mode, seconds / steps, steps, range(per, steps + 1, per), way)
    return found, None if found.stopped else found.q


def horizon(system):
    """Seconds, how far neighbouring starts have parted by then, the true positions, how well they
    are known (m)."""
    aside = 1e-9 * np.array([0.6, 0.8, 0.0]) * np.arange(1, len(system["q0"]) + 1)[:, None]
    q, v = c.project(system, system["q0"], system["q0"] + aside, system["v0"], 1.0)
    near, rule = system | {"q0": q, "v0": v}, make_gauss(12, tol=1e-14)
    for seconds in (5.0, 2.0, 1.0, 0.5):
        steps = SAMPLES * math.ceil(seconds / SAMPLES / 0.02)
        runs = (system, 2 * steps), (system, steps), (near, steps)
        truth, check, other = (sampled(which, rule, "project", seconds, n)[1] for which, n in runs)
        if any(q is None for q in (truth, check, other)):
            continue
        growth = distance(other, check) / distance(near["q0"], system["q0"])
        if growth < 100.0:
            return seconds, growth, truth, distance(truth, check)
    raise SystemExit("speed_vs_error: this scene is chaotic within half a second: nothing to tell")


def solves(system, rule, mode, dt, steps):
    """Linear systems solved a step, counted over the first of them in plain numpy."""
    asked, solve = [], c.solve

    def counted(system, a, b, *rest):
        asked.append(math.prod(b.shape[:-1]))
        return solve(system, a, b, *rest)

    with patch.object(c, "solve", counted):
        found = run(system, rule, mode, dt, min(steps, 40), way=Plain)
    return sum(asked) / (len(found.tip) - 1)


def ladder(system, seconds, rule, mode, truth):
    """The rows of one method: the number of steps doubles until it costs too much or the error
    stops to fall."""
    rows, steps, count = [], SAMPLES, 0.0
    way = (
        Compiled if c.hold_table()[mode].dt else once_for_all()
    )  # some holds are for one step alone
    while count < MOST and (len(rows) < 4 or rows[-1]["error"] < 0.9 * rows[-4]["error"]):
        dt = seconds / steps
        found, q = sampled(system, rule, mode, seconds, steps, way)
        if q is not None:
            count = solves(system, rule, mode, dt, steps) / dt
            row = {"method": f"{rule} {mode}", "dt": dt, "error": distance(q, truth)}
            row |= {"rods": float(found.violations.max()), "energy": float(drift(system, found))}
            rows.append(row | {"solves": count})
        elif steps / seconds > MOST:
            break
        steps *= 2
    return rows


def ahead(rows, known):
    """The rows that none beats in both error and solves; under `known` m all errors are equal."""
    cost = [(row["solves"], max(row["error"], known)) for row in rows]
    better = [[other for other in cost if other[1] <= mine[1]] for mine in cost]
    return [row for row, mine, those in zip(rows, cost, better, strict=True) if min(those) >= mine]


def cheapest(rows, target):
    """What reaches `target` m with the fewest solves."""
    reach = [row for row in rows if row["error"] <= target]
    best = min(reach, key=lambda row: row["solves"], default={"method": "none", "solves": math.nan})
    return {"good to": f"{target:.0e} m", "method": best["method"], "solves": best["solves"]}


def main(argv=None):
    """Print the frontier (or every row), the cheapest method for each target."""
    parser = _runs.study_parser("speed_vs_error", __doc__)
    add = parser.add_argument
    add("--system", default="double", metavar="NAME", help="a system, or a scene's file (double)")
    add("--all", action="store_true", help="print every row, not the frontier alone")
    args = parser.parse_args(argv)
    system = parser.attempt("--system", c.build_system, args.system, 0, 5)
    seconds, growth, truth, known = horizon(system)
    print(
        f"neighbours part {growth:.0f}-fold in {seconds:g} s; the truth is known to {known:.0e} m"
    )
    rows = [row for method in METHODS for row in ladder(system, seconds, *method, truth)]
    rows.sort(key=lambda row: row["error"])
    table = rows if args.all else [row for row in ahead(rows, known) if row["error"] < FAR]
    show(f"{args.system}, {seconds:g} s: m, and solves a simulated second", table)
    show("the fewest", [cheapest(rows, target) for target in TARGETS])
    return _runs.finish(args, {"seconds": seconds, "known_to": known, "rows": rows})


if __name__ == "__main__":
    run_script(main)
