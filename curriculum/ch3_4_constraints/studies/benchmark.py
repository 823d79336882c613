"""How fast, and beside what?  Tables of medians, and bars.

(a) What is a step worth beside the same lines in plain numpy and in Python, and beside MuJoCo's C?
(b) How does a step grow with the chain?  (c) How soon does a long chain begin?  Whole processes,
400 steps without the viewer, in units of a default run.  (d) What does a long run cost, all of it
measured at every step, beside MuJoCo's Euler on hinges, of which nothing is measured?  (e) What
do lanes make of a step of gauss, beside the same code with its stages one by one?
What is compared is timed in turns, A B A B, so that a busy machine slows both: only ratios and
exponents carry over to another. Steps in (a) are those of one call, of which nothing is measured;
MuJoCo's rule there is of the same order, in joint angles.
"""

import subprocess
import sys
import tempfile
import timeit
from functools import partial
from importlib.util import find_spec
from itertools import product
from unittest.mock import patch

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies._runs import NATIVE, Task, host, run, study_parser
from curriculum.ch3_4_constraints.tables import in_turns, say, show, spread
from curriculum.common.native import Writer
from curriculum.common.steps import Plain

import numpy as np

DT, REPEATS = 0.005, 9  # s
STEPS, PLAIN = 4000, 40  # steps in plain numpy are slow
FIRST = 100  # steps under gauss: later `windows` takes some in halves
BEGIN = {300: 2.0, 1000: 6.0}  # links: default runs until the 400th step, at most
LONG, FEW = 4_000_000, 3  # steps of a long run; timings of what takes seconds
LINKS = (10, 30, 100, 300, 1000)
THEIRS = {"semi_implicit": "Euler", "rk4": "RK4"}  # MuJoCo's rules
# (system, rule, mode): {column: what it may be at most, with llvmlite}
CASES = {
    ("double", "semi_implicit", "none"): {"over plain": 0.05, "over MuJoCo": 0.06},
    ("double", "rk4", "none"): {"over MuJoCo": 0.05},
    ("triple", "semi_implicit", "none"): {"over MuJoCo": 0.06},
    ("triple", "rk4", "none"): {"over MuJoCo": 0.05},
    **{("double", "semi_implicit", mode): {} for mode in list(c.hold_table())[1:]},
    ("jansen_leg", "semi_implicit", "impulse"): {},
    ("jansen_leg", "semi_implicit", "project"): {"over python": 0.08},
    ("windows", "semi_implicit", "impulse"): {},
    ("windows", "semi_implicit", "project"): {},
}


def pace(go, steps):
    """Microseconds a step of an engine's run of a Task that has one sample."""
    return 1e6 * go(steps)[0] / steps


def share(found, name, other):
    """The median of what one job took over what another took in the same turn."""
    return float(np.median(np.divide(found[name], found[other])))


def beside(cases, repeats):
    """(a) Rows and bars of a step beside the same lines in plain numpy, in Python, and MuJoCo's."""
    rows, bars = [], []
    for case in cases:
        name, rule, mode = case
        task = Task(c.build_system(name), 1, DT * STEPS, None)
        plain = partial(run, task.system, rule, mode, DT, PLAIN, way=Plain)
        jobs = {"us": partial(pace, peers.ours(task, rule, mode), STEPS)}
        jobs["plain"] = lambda plain=plain: plain().pace
        jobs["python"] = partial(pace, peers.ours(task, rule, mode, machine=False), STEPS)
        if name in c.SYSTEMS and mode == "none" and find_spec("mujoco"):
            jobs["MuJoCo"] = partial(pace, peers.hinges(task, THEIRS[rule]), STEPS)
        found = in_turns(jobs, repeats)
        row = {"case": " ".join(case), **spread(found["us"], "us")}
        for engine in ("plain", "python", "MuJoCo"):
            row[f"over {engine}"] = share(found, "us", engine) if engine in found else "-"
        rows.append(row)
        for column, limit in CASES[case].items():
            if NATIVE and row[column] != "-":
                bars.append((f"{row['case']}, {column}", row[column], limit))
    return "(a) a step, us", rows, bars


def growth(links, repeats):
    """(b) Rows and a bar of a step of a chain of N links, in Python and in quick machine code."""
    jobs, rows = {}, {n: {"links": n} for n in links}
    for n, kind in product(links, ("python", "machine")[: 1 + NATIVE]):
        steps = max(20, 20_000 // n)
        task = Task(c.build_system("chain", links=n), 1, DT * steps, None)
        go = peers.ours(task, "semi_implicit", machine=kind == "machine", best=False)
        jobs[n, kind] = partial(pace, go, steps)
    for (n, kind), us in in_turns(jobs, repeats).items():
        rows[n][kind] = np.median(us)
    n, us = np.array([(n, row["python"]) for n, row in rows.items() if n >= 30]).T
    exponent = np.polyfit(np.log(n), np.log(us), 1)[0]
    bars = [("grows as links to the power", exponent, 1.1)]
    return "(b) a step of a chain, us", list(rows.values()), bars


def process(*flags):
    """Seconds of a whole process, from its start to its end, without the viewer."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, c.HERE / "constraints.py", "--no-rerun", "--out", folder, *flags]
        whole = partial(subprocess.run, command, check=True, capture_output=True)
        return timeit.timeit(whole, number=1)


def beginnings():
    """(c) Rows and bars of how soon a chain has begun."""
    jobs, rows, bars = {"default run": process}, [], []
    for links in BEGIN:
        flags = "--system", "chain", "--links", str(links), "--steps", "400"
        jobs[f"{links} links"] = partial(process, *flags)
    found = in_turns(jobs, FEW)
    for name, limit in zip(jobs, (None, *BEGIN.values()), strict=True):
        runs = share(found, name, "default run")
        rows.append({"run": name, **spread(found[name], "s"), "default runs": runs})
        if limit is not None:
            bars.append((f"{name}, in default runs", runs, limit))
    return "(c) whole processes, s", rows, bars


def long_run():
    """(d) A row and a bar of a long run of the double pendulum through `simulate`."""
    system = c.build_system("double")
    measured = partial(run, system, "semi_implicit", "impulse", DT, LONG)
    jobs, row, bars = {"ours": partial(timeit.timeit, measured, number=1)}, {"steps": LONG}, []
    if find_spec("mujoco"):
        hinges = peers.hinges(Task(system, 1, DT * LONG, None), "Euler")
        jobs["MuJoCo"] = lambda: hinges(LONG)[0]
    found = in_turns(jobs, FEW)
    row |= {f"{engine}, s": np.median(found[engine]) for engine in found}
    if NATIVE and "MuJoCo" in found:
        row["ours/MuJoCo"] = share(found, "ours", "MuJoCo")
        bars.append(("a run, ours over MuJoCo", row["ours/MuJoCo"], 0.3))
    return "(d) impulse, measured at every step", [row], bars


def stages(repeats):
    """(e) Rows of a step under gauss, its stages in lanes, over the same one after the other."""
    rows = []
    for name in ("double", "windows", "jansen_leg"):
        task = Task(c.build_system(name), 1, DT * FIRST, None)
        jobs = {"us": partial(pace, peers.ours(task, "gauss", "project"), FIRST)}
        with patch.object(Writer, "pieces", lambda _, many: [slice(k, k + 1) for k in range(many)]):
            jobs["one"] = partial(pace, peers.ours(task, "gauss", "project"), FIRST)
        found = in_turns(jobs, repeats)
        row = {"system": name, "us": np.median(found["us"])}
        rows.append(row | {"over one by one": share(found, "us", "one")})
    return "(e) a step of gauss project, us", rows


def main(argv=None):
    """Measure and print."""
    quick = {"repeats": 1, "cases": list(CASES)[:2], "links": LINKS[:3], "whole": False}
    usual = {"repeats": REPEATS, "cases": CASES, "links": LINKS, "whole": True}
    args = study_parser("benchmark", __doc__, quick, **usual).parse_args(argv)
    host(repeats=args.repeats)
    if not find_spec("mujoco"):
        say("MuJoCo is not installed, its column stays empty; pip install -e '.[compare]'")
    show(*beside(args.cases, args.repeats))
    show(*growth(args.links, args.repeats))
    if args.whole:
        show(*beginnings())
        show(*long_run())
    if NATIVE:
        show(*stages(args.repeats))
