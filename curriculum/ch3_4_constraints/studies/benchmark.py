"""How fast, beside what, and at which error?  Four questions, each a table of medians with quartiles, and its bars.

(a) What is a step worth beside a first version, written here: Jacobian rows filled in a loop over the rods, one dense
    solve, the metrics after every step?  (b) How long does one wait for a whole run, and for its recording?
(c) How does a step grow with the chain, and where does numpy overtake a plain loop?  (d) And many pendulums at once?

A step is a whole run of `simulate`, metrics and all, divided by its number of steps. Whatever is compared is timed in
turns, A B A B, so that a busy machine slows both. Only ratios and exponents carry over to another machine.
"""

import platform
import subprocess
import sys
import tempfile
import time
from argparse import RawDescriptionHelpFormatter
from contextlib import contextmanager
from functools import partial
from json import dumps
from pathlib import Path

import numpy as np

import constraints
from constraints import INTEGRATORS, SHORT_CHAIN, build_system, make_force, simulate
from curriculum.common.cli import Parser, number
from curriculum.common.device import processor
from curriculum.common.files import check_writable, write_whole

DT = 0.005  # s
OMEGA = {"none": 0.0, "baumgarte": 20.0}  # rad/s
SAME = 1e-12  # largest difference of two forces, as a share of the largest force: beyond, they are not the same formula
SIZES = (1, 2, 3, 10, 19, 20, 30, 100, 1000, 10000)  # links
CROSSING = (8, 12, 16, 20, 24, 28, 32, 40)  # links
MEMBERS = (1, 10, 100, 1000, 10000)


def plain_force(system, omega, q, v):
    """Weight plus rod forces (N, 3) in N at q m and v m/s (N, 3): the formulas of the chapter, one rod after another."""
    rods, n = len(system["pairs"]), len(q)
    jac, g, gdot, jdotv = np.zeros((rods, 3 * n)), np.zeros(rods), np.zeros(rods), np.zeros(rods)
    for k, (i, j) in enumerate(system["pairs"]):
        d = q[i] - (q[j] if j >= 0 else system["anchors"][-1 - j])
        rate = v[i] - (v[j] if j >= 0 else 0.0)
        jac[k, 3 * i : 3 * i + 3] = d
        if j >= 0:
            jac[k, 3 * j : 3 * j + 3] = -d
        g[k], gdot[k], jdotv[k] = 0.5 * (d @ d - system["lengths"][k] ** 2), d @ rate, rate @ rate
    w, weight = np.repeat(1.0 / system["m"], 3), system["weight"].ravel()
    rhs = -(jac @ (w * weight) + jdotv) - 2.0 * omega * gdot - omega**2 * g
    lam = np.linalg.solve(jac @ np.diag(w) @ jac.T, rhs)
    return (weight + jac.T @ lam).reshape(n, 3)


def plain_run(system, integrator, omega, steps):
    """The worst rod error in m of `steps` steps; rod error and energy are taken after every one."""
    q, v, m, step = system["q0"], system["v0"], system["m"], INTEGRATORS[integrator]
    worst, energies, force = 0.0, [], partial(plain_force, system, omega)
    for _ in range(steps):
        q, v = step(q, v, m, force, DT)
        for (i, j), length in zip(system["pairs"], system["lengths"], strict=True):
            d = q[i] - (q[j] if j >= 0 else system["anchors"][-1 - j])
            worst = max(worst, abs(np.linalg.norm(d) - length))
        energies.append(0.5 * np.sum(m * v**2) - np.sum(system["weight"] * q))
    return worst


def run(system, integrator, omega, steps):
    """The worst rod error in m, of all members, that `simulate` finds."""
    return float(np.max(simulate(system, integrator, omega, DT, steps)["max_violation"]))


def in_turns(jobs, repeats):
    """{name: seconds (repeats,)} of the callables `jobs` by name, called A B A B; each once before, to warm up."""
    for job in jobs.values():
        job()
    seconds = {name: np.zeros(repeats) for name in jobs}
    for i in range(repeats):
        for name, job in jobs.items():
            clock = time.perf_counter()
            job()
            seconds[name][i] = time.perf_counter() - clock
    return seconds


def spread(samples, unit, name=""):
    """Median and quartiles of `samples` as columns of a table."""
    low, mid, high = np.percentile(samples, [25, 50, 75])
    return {f"{name}{unit}": float(mid), f"{name}q1": float(low), f"{name}q3": float(high)}


def bar(text, value, limit, most=True):
    """A limit to keep: at most `limit`, or at least."""
    met = bool(value <= limit if most else value >= limit)
    return {"bar": f"{text} {'<=' if most else '>='} {limit:g}", "value": float(value), "met": met}


def beside_plain(repeats, quick):
    """(a) One step of the double pendulum beside plain_force and plain_run; first, that both compute the same."""
    system, steps, rows = build_system("double"), 100 if quick else 400, []
    for integrator, mode in (("semi_implicit", "none"), ("semi_implicit", "baumgarte"), ("rk4", "none")):
        omega, gap, (q, v) = OMEGA[mode], 0.0, (system["q0"], system["v0"])
        force = make_force(system, omega)
        for _ in range(steps):
            ours, plain = force(q, v), plain_force(system, omega, q, v)
            gap = max(gap, float(np.abs(ours - plain).max() / np.abs(plain).max()))
            q, v = INTEGRATORS[integrator](q, v, system["m"], force, DT)
        jobs = {name: partial(f, system, integrator, omega, steps) for name, f in (("ours", run), ("plain", plain_run))}
        us = {name: 1e6 * s / steps for name, s in in_turns(jobs, repeats).items()}
        row = {"case": f"{integrator} {mode}"} | spread(us["ours"], "us") | spread(us["plain"], "us", "plain ")
        row["plain/ours"] = float(np.median(us["plain"]) / np.median(us["ours"]))
        rows.append(row | {"rod error m": jobs["ours"](), "plain error m": jobs["plain"](), "force gap": gap})
    worst = max(row["force gap"] for row in rows)
    return {"table": "(a) a step of the double pendulum", "rows": rows, "bars": [bar("force gap", worst, SAME)]}


def processes(repeats, quick):
    """(b) Whole runs as processes; a sum or difference is taken within each round, then the median of all rounds."""
    script = constraints.__file__

    def process(*command):
        subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL, cwd=Path(script).parent)

    with tempfile.TemporaryDirectory() as folder:
        alone = (script, "--out", folder, "--no-rerun", "--stabilization")
        commands = {
            "import numpy": ("-c", "import numpy"),
            "import numpy, rerun": ("-c", "import numpy, rerun, rerun.blueprint"),
            "none, 1 step": (*alone, "none", "--steps", "1"),
            "none": (*alone, "none"),
            "baumgarte": (*alone, "baumgarte"),
            "all five": (*alone, "all"),
            "all five, recorded": (script, "--out", folder),
        }
        s = in_turns({name: partial(process, *command) for name, command in commands.items()}, repeats)
    s["none and baumgarte"] = s["none"] + s["baumgarte"] - s["none, 1 step"]
    s["five beyond import"] = s["all five"] - s["import numpy"]
    s["recording beyond import"] = s["all five, recorded"] - s["all five"]
    s["recording beyond import"] = s["recording beyond import"] - (s["import numpy, rerun"] - s["import numpy"])
    names = ("none", "baumgarte")
    errors = {name: run(build_system("double"), "semi_implicit", OMEGA[name], 4000) for name in names}
    rows = [{"process": name} | spread(v, "s") | {"rod error m": errors.get(name, "")} for name, v in s.items()]
    limits = {"none and baumgarte": 0.25, "all five": 0.25, "recording beyond import": 0.1}
    bars = [bar(f"{name}, s", np.median(s[name]), limit) for name, limit in limits.items()]
    return {"table": "(b) whole runs, 4000 steps unless it says 1", "rows": rows, "bars": bars}


@contextmanager
def short_chain(limit):
    """Chains of fewer than `limit` links take the plain loop for a while."""
    constraints.SHORT_CHAIN = limit
    try:
        yield
    finally:
        constraints.SHORT_CHAIN = SHORT_CHAIN


def growth(repeats, quick):
    """(c) A step of a chain of N links."""
    rows = []
    for n in SIZES:
        steps, system = max(5, (20_000 if quick else 100_000) // max(50, n)), build_system("chain", links=n)
        us = 1e6 * in_turns({"": partial(run, system, "semi_implicit", 0.0, steps)}, repeats)[""] / steps
        error = run(system, "semi_implicit", 0.0, steps)
        rows.append({"links": n} | spread(us, "us") | {"us/link": float(np.median(us)) / n})
        rows[-1] |= {"steps": steps, "rod error m": error}
    n, us = (np.array([row[key] for row in rows if row["links"] >= 100]) for key in ("links", "us"))
    exponent = float(np.polyfit(np.log(n), np.log(us), 1)[0])
    bars = [bar("1000 links, ms", next(row["us"] for row in rows if row["links"] == 1000) / 1e3, 0.5)]
    note = f"a step grows as links^{exponent:.2f} between 100 and 10000"
    return {"table": "(c) a step of a chain, none", "rows": rows, "bars": bars, "note": note, "exponent": exponent}


def crossover(repeats, quick):
    """(c) Where the arrays of numpy overtake the loop over plain floats."""
    rows, steps = [], 50 if quick else 400

    def limited(system, limit):
        with short_chain(limit):
            return run(system, "semi_implicit", 0.0, steps)

    for n in CROSSING:
        system = build_system("chain", links=n)
        jobs = {"loop": partial(limited, system, n + 1), "arrays": partial(limited, system, 0)}
        us = {name: 1e6 * s / steps for name, s in in_turns(jobs, repeats).items()}
        row = {"links": n} | spread(us["loop"], "us", "loop ") | spread(us["arrays"], "us", "arrays ")
        row["arrays/loop"] = float(np.median(us["arrays"]) / np.median(us["loop"]))
        rows.append(row | {"loop error m": jobs["loop"](), "arrays error m": jobs["arrays"]()})
    first = next((row["links"] for row in rows if row["arrays/loop"] < 1.0), None)
    note = f"arrays first win at {first} links; SHORT_CHAIN is {SHORT_CHAIN}"
    return {"table": "(c) the two ways through a chain", "rows": rows, "bars": [], "note": note, "first": first}


def ensembles(repeats, quick):
    """(d) Double pendulums with a leading axis of members, started a few hundredths of a radian apart."""
    rows, steps = [], 100 if quick else 400
    for mode, omega in OMEGA.items():
        for members in MEMBERS:
            system = build_system("double")
            tilt = np.random.default_rng(0).uniform(-0.05, 0.05, (members, 1))
            direction = np.stack([np.cos(tilt), np.sin(tilt), 0.0 * tilt], axis=-1)
            system["q0"] = np.array([[1.0], [2.0]]) * direction
            system["v0"] = np.zeros_like(system["q0"])
            seconds = in_turns({"": partial(run, system, "semi_implicit", omega, steps)}, repeats)[""]
            row = {"members": members, "mode": mode} | spread(members * steps / seconds / 1e6, "Msteps/s")
            rows.append(row | {"rod error m": run(system, "semi_implicit", omega, steps)})
    best = {mode: max(row["Msteps/s"] for row in rows if row["mode"] == mode) for mode in OMEGA}
    bars = [bar(f"best, {mode}, million steps a second", value, 5.0, most=False) for mode, value in best.items()]
    return {"table": f"(d) ensembles of double pendulums, {steps} steps", "rows": rows, "bars": bars}


def show(answer):
    """Print one table, what it says, and its bars."""
    rows = [[f"{x:.3g}" if isinstance(x, float) else str(x) for x in row.values()] for row in answer["rows"]]
    rows.insert(0, list(answer["rows"][0]))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    print(f"\n{answer['table']}")
    for row in rows:
        print("  ".join([row[0].ljust(widths[0])] + [x.rjust(w) for x, w in zip(row[1:], widths[1:], strict=True)]))
    if "note" in answer:
        print(answer["note"])
    for limit in answer["bars"]:
        print(f"{limit['bar']}: {limit['value']:.3g}, {'met' if limit['met'] else 'MISSED'}")


def main(argv=None) -> int:
    """Measure, print, maybe write JSON; 1 if the two forces of (a) differ, for then there is nothing to compare."""
    parser = Parser(prog="benchmark", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a look in seconds: fewer repeats, shorter runs")
    parser.add_argument("--repeats", type=number(int, 1), help="of each timing (15; quick: 3)")
    parser.add_argument("--json", type=Path, metavar="PATH", help="write the same as JSON")
    args = parser.parse_args(argv)
    try:
        if args.json:
            check_writable(args.json)
    except OSError as error:
        parser.error(f"argument --json: cannot write '{args.json}': {error.strerror}")
    repeats = args.repeats or (3 if args.quick else 15)
    host = {"processor": processor(), "python": platform.python_version(), "numpy": np.__version__, "repeats": repeats}
    print(", ".join(f"{key} {value}" for key, value in host.items()) + "; medians, q1 and q3 the quartiles")
    answers = []
    for question in (beside_plain, processes, growth, crossover, ensembles):
        answers.append(question(repeats, args.quick))
        show(answers[-1])
        if question is beside_plain and not answers[0]["bars"][0]["met"]:
            return 1
    if args.json:
        text = dumps(host | {"answers": answers}, indent=2) + "\n"
        write_whole(args.json, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
