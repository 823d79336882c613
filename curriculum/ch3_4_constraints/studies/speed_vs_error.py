"""What does an error cost?  Every integrator with every way to hold a rod, over a ladder of steps.

The double pendulum, 5 s. Error is the largest distance of a particle, at twenty times, from where
reference.json has it. Cost is counted, in linear systems solved a simulated second, one for each
state at which a force is asked for and one a round of a projection: the same on every machine.
Rules are named as for --integrator: midpoint:6 is of order 6, gauss:8 has 8 stages. Shown are the
rows that are ahead: no other has both fewer solves and a smaller error.
"""

from itertools import product
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.run_checks import misfit
from curriculum.ch3_4_constraints.studies._runs import double, run, study_parser
from curriculum.ch3_4_constraints.tables import show
from curriculum.common import rules
from curriculum.common.progress import work
from curriculum.common.steps import Plain

FAR, ROUNDING = 0.3, 1e-13  # m: what is so far off is not listed; below it all are equal
MOST = 10_000  # solves a simulated second: the ladder of a method ends where it takes more
LOW = [name for name in c.INTEGRATORS if name not in rules.FAMILIES]
HIGH = [f"midpoint:{order}" for order in (6, 8, 10, 12)]
HIGH += ["gauss:6:1e-8", "gauss:8:1e-10", "gauss:10:1e-12", "gauss:12:1e-14"]
METHODS = [(x, mode) for x in LOW for mode, hold in c.hold_table().items() if not misfit(hold, x)]
METHODS += product(HIGH, ("none", "project"))


def solves(system, rule, mode, dt, steps):
    """Linear systems solved a step, counted over the first of them in plain numpy."""
    asked, solve = [], c.solve

    def counted(*system_and_terms, **how):
        asked.append(1)
        return solve(*system_and_terms, **how)

    with patch.object(c, "solve", counted):
        found = run(system, rule, mode, dt, min(steps, 40), way=Plain)
    return len(asked) / (len(found.tip) - 1)


def ladder(task, rule, mode, most=MOST):
    """The rows of one method: the number of steps doubles until it costs `most` solves a simulated
    second, or the error stops to fall."""
    rows, per, count, system = [], 1, 0.0, task.system
    while count < most and (len(rows) < 4 or rows[-1]["error"] < 0.9 * rows[-4]["error"]):
        dt, steps = task.every / per, per * task.samples
        found = run(system, rule, mode, dt, steps, range(per, steps + 1, per))
        if not found.stopped:
            count = solves(system, rule, mode, dt, steps) / dt
            row = {"method": f"{rule} {mode}", "dt": dt, "error": task.error(found.q[..., :2])}
            rows.append(row | {"solves": count})
        elif 1.0 / dt > most:
            break
        per *= 2
    return rows


def ahead(rows):
    """The rows that none beats in both error and solves."""
    cost = [(row["solves"], max(row["error"], ROUNDING)) for row in rows]
    better = [[other for other in cost if other[1] <= mine[1]] for mine in cost]
    return [row for row, mine, those in zip(rows, cost, better, strict=True) if min(those) >= mine]


def main(argv=None):
    """Print the frontier."""
    quick = {"most": MOST // 10, "methods": METHODS[::4]}
    parser = study_parser("speed_vs_error", __doc__, quick, most=MOST, methods=METHODS)
    args, task, rows = parser.parse_args(argv), double(), []
    for method in work.through("climbing", args.methods):
        rows += ladder(task, *method, args.most)
    rows = [row for row in ahead(rows) if row["error"] < FAR]
    rows.sort(key=lambda row: row["error"])
    show("the double pendulum, 5 s: error in m, and linear systems solved a second", rows)
