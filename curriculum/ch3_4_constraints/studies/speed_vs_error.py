"""What does an error cost?  Every integrator with every way to hold a rod, over a ladder of steps.

Error is the largest distance of a particle, at twenty times, from where gauss with 12 stages has
it; two steps of that differ by its own error. Methods are to decide and not chaos: the horizon is
the longest of 5, 2, 1, 0.5 s in which two starts 1e-9 m apart stay within 1e-7. Cost is counted, in
linear systems solved a simulated second, one for each state at which a force is asked for and one
a round of a projection: the same on every machine. gauss8 has 8 stages, midpoint6 is of order 6.
Shown are the rows that are ahead: no other has both fewer solves and a smaller error.
"""

import math
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import RULES, run, study_parser
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import run_script
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.ruler import once_for_all
from curriculum.common.runs import distance
from curriculum.common.steps import Plain

import numpy as np

SAMPLES = 20
FAR = 0.3  # m: who is that far off is not listed as ahead
MOST = 10_000  # solves a simulated second: the ladder of a method ends where it takes more
MODES = {
    name: [mode for mode, hold in c.hold_table().items() if hold.rule in (None, name)]
    for name in c.INTEGRATORS
}
METHODS = [(name, mode) for name in RULES for mode in MODES.get(name, ["none", "project"])]


def sampled(system, rule, mode, seconds, steps, way=Compiled):
    """Positions (20, N, 3) of a run of `steps` steps over `seconds`; None if it stops."""
    per = steps // SAMPLES
    found = run(system, rule, mode, seconds / steps, steps, range(per, steps + 1, per), way)
    return None if found.stopped else found.q


def horizon(system):
    """Seconds, how far neighbouring starts have parted by then, the true positions, how well they
    are known (m)."""
    aside = 1e-9 * np.array([0.6, 0.8, 0.0]) * np.arange(1, len(system["q0"]) + 1)[:, None]
    q, v = c.project(system, system["q0"], system["q0"] + aside, system["v0"], 1.0)
    near, rule = system | {"q0": q, "v0": v}, make_gauss(12, tol=1e-14)
    for seconds in (5.0, 2.0, 1.0, 0.5):
        steps = SAMPLES * math.ceil(seconds / SAMPLES / 0.02)
        runs = (system, 2 * steps), (system, steps), (near, steps)
        found = [sampled(which, rule, "project", seconds, n) for which, n in runs]
        if all(q is not None for q in found):
            truth, check, other = found
            growth = distance(other, check) / distance(near["q0"], system["q0"])
            if growth < 100.0:
                return seconds, growth, truth, distance(truth, check)
    raise SystemExit("speed_vs_error: this scene is chaotic within half a second: nothing to tell")


def solves(system, rule, mode, dt, steps):
    """Linear systems solved a step, counted over the first of them in plain numpy."""
    asked, solve = [], c.solve

    def counted(system, a, b, *rest, **how):
        asked.append(math.prod(b.shape[:-1]))
        return solve(system, a, b, *rest, **how)

    with patch.object(c, "solve", counted):
        found = run(system, rule, mode, dt, min(steps, 40), way=Plain)
    return sum(asked) / (len(found.tip) - 1)


def ladder(system, seconds, rule, mode, truth):
    """The rows of one method: the number of steps doubles until it costs too much or the error
    stops to fall."""
    rows, steps, count = [], SAMPLES, 0.0
    # compiled once, but for holds that are for one step alone
    way = Compiled if c.hold_table()[mode].dt else once_for_all()
    while count < MOST and (len(rows) < 4 or rows[-1]["error"] < 0.9 * rows[-4]["error"]):
        dt, q = seconds / steps, sampled(system, rule, mode, seconds, steps, way)
        if q is not None:
            count = solves(system, rule, mode, dt, steps) / dt
            row = {"method": f"{rule} {mode}", "dt": dt, "error": distance(q, truth)}
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


def main(argv=None):
    """Print the frontier."""
    parser = study_parser("speed_vs_error", __doc__)
    text = "a system, or a scene's file (double)"
    parser.add_argument("--system", default="double", metavar="NAME", help=text)
    name = parser.parse_args(argv).system
    system = parser.attempt("--system", c.build_system, name, 0, 5)
    seconds, growth, truth, known = horizon(system)
    print(
        f"neighbours part {growth:.0f}-fold in {seconds:g} s; the truth is known to {known:.0e} m"
    )
    rows = [row for method in METHODS for row in ladder(system, seconds, *method, truth)]
    rows = [row for row in ahead(rows, known) if row["error"] < FAR]
    rows.sort(key=lambda row: row["error"])
    show(f"{name}, {seconds:g} s: m, and solves a simulated second", rows)


if __name__ == "__main__":
    run_script(main)
