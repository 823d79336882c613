"""How fast, beside what, and at which error?  Four questions, each a table of medians with quartiles, and its bars.

(a) What is a step worth beside a first version, written here: Jacobian rows filled in a loop over the rods, one dense
    solve, the metrics after every step?  (b) How long does one wait for a whole run, and for its recording?
(c) How does a step grow with the chain, and where does numpy overtake a plain loop?  (d) And many pendulums at once?
A step is a whole run of `simulate`, metrics and all, divided by its number of steps. Whatever is compared is timed in
turns, A B A B, so that a busy machine slows both. Only ratios and exponents carry over to another machine.
"""

import subprocess
import sys
import tempfile
import time
from argparse import RawDescriptionHelpFormatter
from functools import partial

import numpy as np

import constraints
from constraints import INTEGRATORS, SHORT_CHAIN, build_system, make_force, simulate
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.device import processor
from curriculum.common.files import write_json

DT, OMEGA = 0.005, {"none": 0.0, "baumgarte": 20.0}  # s, rad/s
SAME = 1e-12  # largest difference of two forces, as a share of the largest force: beyond, they are not the same formula
LINKS = (1, 2, 3, 10, 16, 19, 20, 24, 30, 100, 1000, 10000)
MEMBERS = (1, 10, 100, 1000, 10000)


def plain_force(system, omega, q, v):
    """Weight plus rod forces (N, 3) in N at q m and v m/s (N, 3): the chapter's formulas, one rod after another."""
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
            worst = max(worst, abs(float(np.linalg.norm(d) - length)))
        energies.append(0.5 * np.sum(m * v**2) - np.sum(system["weight"] * q))
    return worst


def run(system, integrator, omega, steps, short_chain=SHORT_CHAIN):
    """The worst rod error in m, of all members, that `simulate` finds; `short_chain` picks the way through a chain."""
    constraints.SHORT_CHAIN = short_chain
    try:
        return float(np.max(simulate(system, integrator, omega, DT, steps)["max_violation"]))
    finally:
        constraints.SHORT_CHAIN = SHORT_CHAIN


def in_turns(jobs, repeats):
    """Seconds (repeats,) and last result of the callables `jobs`, called A B A B, the first round not counted."""
    seconds, results = {name: [] for name in jobs}, {}
    for _ in range(repeats + 1):
        for name, job in jobs.items():
            clock = time.perf_counter()
            results[name] = job()
            seconds[name].append(time.perf_counter() - clock)
    return {name: np.array(s[1:]) for name, s in seconds.items()}, results


def spread(samples, unit):
    """Median and quartiles of `samples` as columns of a table."""
    return dict(zip((unit, f"{unit} q1", f"{unit} q3"), np.percentile(samples, [50, 25, 75]).tolist(), strict=True))


def beside_plain(repeats, quick):
    """(a) One step of the double pendulum beside the plain version; that both find the same force comes first."""
    system, steps, rows = build_system("double"), 100 if quick else 400, []
    for integrator, mode in (("semi_implicit", "none"), ("semi_implicit", "baumgarte"), ("rk4", "none")):
        omega, gap, q, v = OMEGA[mode], 0.0, system["q0"], system["v0"]
        force = make_force(system, omega)
        for _ in range(steps):
            plain = plain_force(system, omega, q, v)
            gap = max(gap, float(np.abs(force(q, v) - plain).max() / np.abs(plain).max()))
            q, v = INTEGRATORS[integrator](q, v, system["m"], force, DT)
        if not gap <= SAME:
            sys.exit(f"benchmark: {integrator} {mode}: the forces differ by {gap:.1e} > {SAME:g}, nothing to compare")
        jobs = {name: partial(f, system, integrator, omega, steps) for name, f in (("us", run), ("plain", plain_run))}
        seconds, error = in_turns(jobs, repeats)
        us, plain = (spread(1e6 * s / steps, name) for name, s in seconds.items())
        rows.append({"case": f"{integrator} {mode}", **us, **plain, "plain/us": plain["plain"] / us["us"]})
        rows[-1] |= {"rod error m": error["us"], "plain error m": error["plain"], "force gap": gap}
    return "(a) a step of the double pendulum, us: the chapter's, then the plain version's", rows, []


def processes(repeats, quick):
    """(b) Whole runs as processes; sums and differences are taken within each round, before the median."""
    with tempfile.TemporaryDirectory() as folder:
        alone = (constraints.__file__, "--out", folder, "--no-rerun", "--stabilization")
        commands = {
            "import numpy": ("-c", "import numpy"),
            "import constraints": ("-c", "import constraints"),
            "import constraints, rerun": ("-c", "import constraints, rerun, rerun.blueprint"),
            "1 step": (*alone, "none", "--steps", "1"),
            "all, recorded": (constraints.__file__, "--out", folder),
        } | {mode: (*alone, mode) for mode in (*OMEGA, "all")}
        process = partial(subprocess.run, check=True, stdout=subprocess.DEVNULL, cwd=constraints.HERE)
        jobs = {name: partial(process, [sys.executable, *command]) for name, command in commands.items()}
        s, _ = in_turns(jobs, (repeats + 1) // 2 if quick else repeats)
    s["none and baumgarte"] = s["none"] + s["baumgarte"] - s["1 step"]
    imported = s["import constraints, rerun"] - s["import constraints"]
    s["recording beyond import"] = s["all, recorded"] - s["all"] - imported
    error = {mode: run(build_system("double"), "semi_implicit", OMEGA[mode], 4000) for mode in OMEGA}
    rows = [{"process": name, **spread(v, "s"), "rod error m": error.get(name, "")} for name, v in s.items()]
    limits = {"none and baumgarte": 0.25, "all": 0.25, "recording beyond import": 0.1}
    bars = [(f"{name}, s", float(np.median(s[name])), limit) for name, limit in limits.items()]
    return "(b) whole runs, 4000 steps of the double pendulum", rows, bars


def growth(repeats, quick):
    """(c) A step of a chain of N links, both ways through the chain."""
    rows = []
    for n in LINKS:
        steps, system = max(5, (20_000 if quick else 100_000) // max(50, n)), build_system("chain", links=n)
        way = partial(run, system, "semi_implicit", 0.0, steps)
        seconds, error = in_turns({"loop": partial(way, n + 1), "arrays": partial(way, 0)}, repeats)
        loop, arrays = (spread(1e6 * s / steps, name) for name, s in seconds.items())
        rows.append({"links": n, **loop, **arrays, "arrays/loop": arrays["arrays"] / loop["loop"]})
        rows[-1] |= {"steps": steps, "rod error m": error["loop"], "arrays error m": error["arrays"]}
    n, us, ratio = (np.array([row[key] for row in rows]) for key in ("links", "arrays", "arrays/loop"))
    exponent = float(np.polyfit(np.log(n[n >= 100]), np.log(us[n >= 100]), 1)[0])
    bars = [("1000 links, us", float(us[n == 1000][0]), 500.0), ("arrays grow as links to the power", exponent, 1.1)]
    won = f"the loop wins up to {max(n[ratio > 1.0], default=0)} links (SHORT_CHAIN = {SHORT_CHAIN})"
    return f"(c) a step of a chain (none), us: the loop over floats, numpy's arrays; {won}", rows, bars


def ensembles(repeats, quick):
    """(d) Double pendulums with a leading axis of members, started a few hundredths of a radian apart."""
    rows, steps, bars = [], 100 if quick else 400, []
    for mode, omega in OMEGA.items():
        for members in MEMBERS:
            system, tilt = build_system("double"), np.random.default_rng(0).uniform(-0.05, 0.05, (members, 1))
            system["q0"] = np.stack([np.cos(tilt), np.sin(tilt), 0.0 * tilt], axis=-1) * [[1.0], [2.0]]
            system["v0"] = np.zeros_like(system["q0"])
            seconds, error = in_turns({"": partial(run, system, "semi_implicit", omega, steps)}, repeats)
            pace = spread(members * steps / seconds[""] / 1e6, "Msteps/s")
            rows.append({"members": members, "mode": mode, **pace, "rod error m": error[""]})
        best = max(row["Msteps/s"] for row in rows if row["mode"] == mode)
        bars.append((f"{mode} at its best, us a step (5 million steps a second)", 1.0 / best, 0.2))
    return f"(d) ensembles of double pendulums, {steps} steps each, million steps a second", rows, bars


def show(title, rows, bars):
    """Print a table and its bars; the same as a dict."""
    cells = [[f"{x:.3g}" if isinstance(x, float) else str(x) for x in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(rows[0], *cells, strict=True)]
    print(f"\n{title}")
    for row in (rows[0], *cells):
        print("  ".join(x.rjust(width) for x, width in zip(row, widths, strict=True)))
    bars = [{"bar": text, "value": x, "at most": limit, "met": bool(x <= limit)} for text, x, limit in bars]
    for bar in bars:
        print(f"{bar['bar']}: {bar['value']:.3g}, bar {bar['at most']:g}: {'met' if bar['met'] else 'MISSED'}")
    return {"table": title, "rows": rows, "bars": bars}


def main(argv=None) -> int:
    """Measure, print, maybe write JSON."""
    parser = Parser(prog="benchmark", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a look in seconds: fewer repeats, shorter runs")
    parser.add_argument("--repeats", type=number(int, 1), help="of each timing (15; quick: 3)")
    parser.add_argument("--json", type=writable, metavar="PATH", help="write the same as JSON")
    args = parser.parse_args(argv)
    repeats = args.repeats or (3 if args.quick else 15)
    host = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__, "repeats": repeats}
    print(", ".join(f"{key} {value}" for key, value in host.items()) + "; medians, q1 and q3 the quartiles")
    answers = [show(*ask(repeats, args.quick)) for ask in (beside_plain, processes, growth, ensembles)]
    if args.json:
        write_json(args.json, host | {"answers": answers})
    return 0


if __name__ == "__main__":
    run_script(main)
