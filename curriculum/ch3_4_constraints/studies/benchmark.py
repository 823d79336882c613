"""How fast, and beside what?  Three tables of medians with quartiles, and bars.

(a) What is a step worth beside the same lines in plain numpy, and beside MuJoCo's C?  (b) How long
does one wait for a whole run, and for its recording?  (c) How does a step grow with the chain?
Whatever is compared is timed in turns, A B A B, so that a busy machine slows both. Only ratios and
exponents carry over to another machine. In (a), steps are those of one call for a whole run, and
nothing is measured of their states. `plain` is the chapter's lines as numpy runs them, `python` the
step compiled to Python alone, MuJoCo its rule of the same order on hinges. In (c) its rods are
tendons on particles with three axes, our model.
"""

import subprocess
import sys
import tempfile
import time
from functools import partial
from importlib.util import find_spec

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs
from curriculum.ch3_4_constraints.studies._race import run_ours
from curriculum.ch3_4_constraints.studies._runs import NATIVE, run
from curriculum.ch3_4_constraints.tables import in_turns, say, show, spread
from curriculum.common.cli import run_script
from curriculum.common.steps import Plain

import numpy as np

DT, PLAIN = 0.005, 40  # s; steps in plain numpy, which are slow
LINKS = (10, 40, 100, 1000, 10000)
# {(system, rule, mode, share): (at most with a compiler, at most without it)}
BARS = {
    ("double", "semi_implicit", "none", "us/plain"): (1 / 20, 1 / 20),
    ("double", "semi_implicit", "none", "us/MuJoCo"): (0.06, 1.2),
    ("double", "rk4", "none", "us/MuJoCo"): (0.05, 1.0),
    ("triple", "semi_implicit", "none", "us/MuJoCo"): (0.06, 1.2),
    ("triple", "rk4", "none", "us/MuJoCo"): (0.05, 1.0),
    ("jansen_leg", "semi_implicit", "impulse", "us"): (20.0, 20.0),
    ("jansen_leg", "semi_implicit", "project", "us/python"): (0.08, None),
}


def shares(found, base):
    """{"us/NAME": the median share of `base`'s samples in those taken in the same turn}."""
    ours, others = np.array(found[base]), {name: x for name, x in found.items() if name != base}
    return {f"us/{name}": float(np.median(ours / samples)) for name, samples in others.items()}


def plain(system, rule, mode):
    """Microseconds a step in plain numpy."""
    return run(system, rule, mode, DT, PLAIN, way=Plain).pace


def beside(repeats, quick):
    """(a) A step beside the same lines in plain numpy, in Python, and beside MuJoCo's."""
    steps, rows, bars = 2000 if quick else 4000, [], []
    cases = [(n, rule, "none") for n in ("double", "triple") for rule in ("semi_implicit", "rk4")]
    cases += [("double", "semi_implicit", mode) for mode in list(c.hold_table())[1:]]
    loops = ("jansen_leg", "windows")
    cases += [(n, "semi_implicit", mode) for n in loops for mode in ("impulse", "project")]
    for name, rule, mode in cases:
        system = c.build_system(name)
        task = peers.Task(system, 1, DT * steps, None)

        def pace(job, *settings, task=task):
            return 1e6 * job(task, steps, *settings)[0] / steps

        jobs = {"ours": partial(pace, run_ours, mode, rule)}
        jobs["plain"] = partial(plain, system, rule, mode)
        if NATIVE:
            jobs["python"] = partial(pace, run_ours, mode, rule, False)
        if name in c.SYSTEMS and mode == "none" and find_spec("mujoco"):
            theirs = {"semi_implicit": "Euler", "rk4": "RK4"}[rule]
            jobs["MuJoCo"] = partial(pace, peers.run_hinges, theirs)
        found = in_turns(jobs, repeats)
        off = float(run(system, rule, mode, DT, steps).violations.max())
        what = {"case": f"{name} {rule} {mode}", **spread(found["ours"], "us"), "rods m": off}
        row = what | {"us/plain": "-", "us/python": "-", "us/MuJoCo": "-"} | shares(found, "ours")
        rows.append(row)
        for case, limits in BARS.items():
            limit = limits[not NATIVE]
            if case[:3] == (name, rule, mode) and limit and row[case[3]] != "-":
                bars.append((f"{row['case']}, {case[3]}", row[case[3]], limit))
    return "(a) a step, us", rows, bars


def processes(repeats, quick):
    """(b) Whole runs as processes; differences are taken within each round, before the median."""

    def clock(*command):
        begin, quiet = time.perf_counter(), {"stdout": subprocess.DEVNULL, "cwd": c.HERE}
        subprocess.run([sys.executable, *command], check=True, **quiet)
        return time.perf_counter() - begin

    with tempfile.TemporaryDirectory() as folder:
        default = partial(clock, c.__file__, "--out", folder)
        jobs = {
            "import constraints": partial(clock, "-c", "import constraints"),
            "and rerun": partial(clock, "-c", "import constraints, rerun, rerun.blueprint"),
            "default, no recording": partial(default, "--no-rerun"),
            "default": default,
        }
        s = {name: np.array(x) for name, x in in_turns(jobs, repeats).items()}
    imported = s["and rerun"] - s["import constraints"]
    s["recording beyond import"] = s["default"] - s["default, no recording"] - imported
    rows = [{"process": name, **spread(x, "s")} for name, x in s.items()]
    limits = {"default, no recording": 0.25 if NATIVE else 0.35, "recording beyond import": 0.1}
    bars = [(f"{name}, s", float(np.median(s[name])), limit) for name, limit in limits.items()]
    return "(b) whole runs: five modes, 4000 steps of the double pendulum", rows, bars


def growth(repeats, quick):
    """(c) A step of a chain of N links, beside MuJoCo's rods."""
    rows = []
    for n in LINKS[:-1] if quick else LINKS:
        system, steps = c.build_system("chain", links=n), max(20, 20_000 // n)
        jobs = {m: partial(run, system, "semi_implicit", m, DT, steps) for m in ("none", "impulse")}
        if find_spec("mujoco") and n <= 1000:
            jobs["MuJoCo"] = partial(peers.pace_tendons, system, DT, 3, steps)
        found = in_turns(jobs, repeats)
        us = {m: [one.pace for one in found[m]] for m in ("none", "impulse")}
        row = {"links": n, **spread(us["none"], "us"), "impulse": float(np.median(us["impulse"]))}
        row |= {"worst rod m": float(found["none"][0].violations.max()), "us/MuJoCo": "-"}
        if "MuJoCo" in found:
            row |= shares({"none": us["none"], "MuJoCo": [x for x, _ in found["MuJoCo"]]}, "none")
        rows.append(row)
    n, us = (np.array([row[key] for row in rows if row["links"] >= 100]) for key in ("links", "us"))
    exponent = float(np.polyfit(np.log(n), np.log(us), 1)[0])
    thousand = next(row for row in rows if row["links"] == 1000)
    bars = [("1000 links, us a step", thousand["us"], 150.0)]
    bars.append(("grows as links to the power", exponent, 1.1))
    if thousand["us/MuJoCo"] != "-":
        bars.append(("1000 links, us/MuJoCo", thousand["us/MuJoCo"], 1.0 / 1.5))
    return "(c) a step of a chain, us", rows, bars


def main(argv=None) -> int:
    """Measure, print, maybe write JSON."""
    parser = _runs.study_parser("benchmark", __doc__, 9)
    parser.add_argument("--quick", action="store_true", help="a look: 3 repeats, shorter runs")
    args = parser.parse_args(argv)
    repeats = min(args.repeats, 3) if args.quick else args.repeats
    what = _runs.host(repeats=repeats)
    if not find_spec("mujoco"):
        say("MuJoCo is not installed, its columns stay empty; pip install -e '.[compare]'")
    asks = (beside, processes, growth)
    return _runs.finish(args, what | {"answers": [show(*ask(repeats, args.quick)) for ask in asks]})


if __name__ == "__main__":
    run_script(main)
