"""How fast, and beside what?  Two tables of medians with quartiles, and bars.

(a) What is a step worth beside the same lines in plain numpy and in Python, and beside MuJoCo's C?
(b) How does a step grow with the chain?
Whatever is compared is timed in turns, A B A B, so that a busy machine slows both: only ratios and
exponents carry over to another. Steps in (a) are those of one call for a whole run, of which
nothing is measured. `plain` is the chapter's lines as numpy runs them, `python` the step compiled
to Python alone, MuJoCo its rule of the same order on hinges.
"""

from functools import partial
from importlib.util import find_spec
from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies._command import study_parser
from curriculum.ch3_4_constraints.studies._runs import NATIVE, Task, host, run
from curriculum.ch3_4_constraints.tables import in_turns, say, show, spread
from curriculum.common.cli import run_script
from curriculum.common.steps import Plain

import numpy as np

DT, REPEATS = 0.005, 9  # s
STEPS, PLAIN = 4000, 40  # steps in plain numpy are slow
LINKS = (10, 30, 100, 300, 1000)
THEIRS = {"semi_implicit": "Euler", "rk4": "RK4"}  # MuJoCo's rules
# (system, rule, mode): {column: what it may be at most, with llvmlite}
CASES = {
    ("double", "semi_implicit", "none"): {"us/plain": 0.05, "us/MuJoCo": 0.06},
    ("double", "rk4", "none"): {"us/MuJoCo": 0.05},
    ("triple", "semi_implicit", "none"): {"us/MuJoCo": 0.06},
    ("triple", "rk4", "none"): {"us/MuJoCo": 0.05},
    **{("double", "semi_implicit", mode): {} for mode in list(c.hold_table())[1:]},
    ("jansen_leg", "semi_implicit", "impulse"): {},
    ("jansen_leg", "semi_implicit", "project"): {"us/python": 0.08},
    ("windows", "semi_implicit", "impulse"): {},
    ("windows", "semi_implicit", "project"): {},
}


def beside(cases, repeats):
    """(a) Rows and bars of a step beside the same lines in plain numpy, in Python, and MuJoCo's."""
    rows, bars = [], []
    for (name, rule, mode), limits in cases.items():
        system = c.build_system(name)
        task = Task(system, 1, DT * STEPS, None)

        def pace(job, *settings, task=task):
            return 1e6 * job(task, STEPS, *settings)[0] / STEPS

        jobs = {
            "us": partial(pace, peers.run_ours, rule, mode),
            "plain": lambda case=(system, rule, mode): run(*case, DT, PLAIN, way=Plain).pace,
            "python": partial(pace, peers.run_ours, rule, mode, False),
        }
        if name in c.SYSTEMS and mode == "none" and find_spec("mujoco"):
            jobs["MuJoCo"] = partial(pace, peers.run_hinges, THEIRS[rule])
        found = in_turns(jobs, repeats)
        row = {"case": f"{name} {rule} {mode}", **spread(found["us"], "us")}
        share = {who: np.median(np.divide(found["us"], found[who])) for who in found}  # in a turn
        row |= {f"us/{who}": share.get(who, "-") for who in ("plain", "python", "MuJoCo")}
        rows.append(row)
        for column, limit in limits.items():
            if NATIVE and row[column] != "-":
                bars.append((f"{row['case']}, {column}", row[column], limit))
    return "(a) a step, us", rows, bars


def growth(links, repeats):
    """(b) Rows and a bar of a step of a chain of N links, in Python and in quick machine code."""
    jobs, rows, kinds = {}, [], ("python", "machine")[: 1 + NATIVE]
    for n, kind in product(links, kinds):
        system, steps = c.build_system("chain", links=n), max(20, 20_000 // n)
        how = {"machine": kind == "machine", "best": False}
        step = peers.compiled_step(system, "semi_implicit", "none", DT, **how)
        jobs[n, kind] = partial(peers.timed, step, system, steps, DT)
    found = in_turns(jobs, repeats)
    for n in links:
        us = {kind: [1e6 * x / len(q) for x, q in found[n, kind]] for kind in kinds}
        rows.append({"links": n} | {kind: np.median(x) for kind, x in us.items()})
    n, us = np.array([(row["links"], row["python"]) for row in rows if row["links"] >= 30]).T
    exponent = np.polyfit(np.log(n), np.log(us), 1)[0]
    return "(b) a step of a chain, us", rows, [("grows as links to the power", exponent, 1.1)]


def main(argv=None):
    """Measure and print."""
    quick = {"repeats": 1, "cases": dict(list(CASES.items())[:2]), "links": LINKS[:3]}
    usual = {"repeats": REPEATS, "cases": CASES, "links": LINKS}
    args = study_parser("benchmark", __doc__, quick, **usual).parse_args(argv)
    host(repeats=args.repeats)
    if not find_spec("mujoco"):
        say("MuJoCo is not installed, its column stays empty; pip install -e '.[compare]'")
    show(*beside(args.cases, args.repeats))
    show(*growth(args.links, args.repeats))


if __name__ == "__main__":
    run_script(main)
