"""How fast, beside what, and at which error?  Four questions, each a table of medians with
quartiles, and its bars.

(a) What is a step worth beside the same lines in plain numpy, and beside MuJoCo's C?  (b) How long
does one wait for a whole run, and for its recording?  (c) How does a step grow with the chain?  (d)
And with a linkage? A step is the loop of `simulate`, without what measures its states. Whatever is
compared is timed in turns, A B A B, so that a busy machine slows both. Only ratios and exponents
carry over to another machine.
"""

import json
import subprocess
import sys
import tempfile
import time
from argparse import RawDescriptionHelpFormatter
from functools import partial
from importlib.util import find_spec

import constraints
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.scenes.make_scenes import net, text, windows
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies._runs import run, scene
from curriculum.ch3_4_constraints.tables import in_turns, show, spread
from curriculum.common.banner import processor
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.files import write_json
from curriculum.common.motion import followed

import numpy as np

DT, PLAIN_STEPS = 0.005, 40  # s; steps in plain numpy, which are slow
LINKS = (10, 20, 30, 40, 60, 100, 1000, 10000)


def per_step(system, rule, mode, steps):
    """Microseconds a step of ours, and the worst rod error in m."""
    found = run(system, rule, mode, DT, steps)
    return found.pace, float(found.violations.max())


def plain(system, rule, mode, steps):
    """Microseconds a step of the chapter's lines as numpy itself runs them."""
    hold = constraints.hold_table(DT)[mode]
    step, force = (
        followed(constraints.INTEGRATORS[rule], hold.after, system),
        constraints.make_force(system, hold),
    )
    q, v, clock = system["q0"], system["v0"], time.perf_counter()
    for _ in range(steps):
        q, v = step(q, v, system["m"], force, DT)
    return 1e6 * (time.perf_counter() - clock) / steps, float(
        constraints.constraint_violation(system, q)
    )


def mujoco(system, integrator, steps):
    """Microseconds a step of MuJoCo in joint angles, and no rod error: there a rod cannot
    stretch."""
    return peers.pace_hinges(system, DT, integrator, steps), 0.0


def beside(repeats, quick):
    """(a) A step beside the same lines in plain numpy, and beside MuJoCo's rule of the same order
    in joint angles."""
    steps, rows, bars = 400 if quick else 4000, [], []
    cases = [
        (name, rule, "none") for name in constraints.SYSTEMS for rule in ("semi_implicit", "rk4")
    ]
    cases[2:2] = [
        ("double", "semi_implicit", mode) for mode in ("baumgarte", "impulse", "soft", "project")
    ]
    cases += [
        (name, "semi_implicit", mode)
        for name in ("jansen_leg", "windows", "braced")
        for mode in ("impulse", "project")
    ]
    us = {}
    for name, rule, mode in cases:
        system = constraints.build_system(name) if name in constraints.SYSTEMS else scene(name)
        jobs = {
            "ours": partial(per_step, system, rule, mode, steps),
            "plain": partial(plain, system, rule, mode, PLAIN_STEPS),
        }
        if name in constraints.SYSTEMS and mode == "none" and find_spec("mujoco"):
            jobs["MuJoCo"] = partial(
                mujoco, system, "Euler" if rule == "semi_implicit" else "RK4", steps
            )
        found = {who: np.array(values) for who, values in in_turns(jobs, repeats).items()}
        ours = found["ours"][:, 0]
        row = {
            "case": f"{name} {rule} {mode}",
            **spread(ours, "us"),
            "rod error m": float(found["ours"][0, 1]),
        }
        row["plain/us"] = float(np.median(found["plain"][:, 0] / ours))
        row["us/MuJoCo"] = (
            float(np.median(ours / found["MuJoCo"][:, 0])) if "MuJoCo" in found else "-"
        )
        rows.append(row)
        us[name, rule, mode] = row
    double = us["double", "semi_implicit", "none"]
    bars.append(
        (
            "double, semi_implicit: ours as a share of plain numpy",
            1.0 / double["plain/us"],
            1.0 / 20.0,
        )
    )
    if find_spec("mujoco"):
        for name in constraints.SYSTEMS:
            bars.append(
                (
                    f"{name}, semi_implicit: ours as a share of MuJoCo's Euler",
                    us[name, "semi_implicit", "none"]["us/MuJoCo"],
                    1.2,
                )
            )
            bars.append(
                (
                    f"{name}, rk4: ours as a share of MuJoCo's RK4",
                    us[name, "rk4", "none"]["us/MuJoCo"],
                    1.0,
                )
            )
    wrapped = us["double", "semi_implicit", "project"]["us"] / double["us"]
    bars += [("double, semi_implicit: project over the step it wraps", wrapped, 10.0)]
    bars += [
        ("Jansen leg, impulse, us a step", us["jansen_leg", "semi_implicit", "impulse"]["us"], 20.0)
    ]
    return (
        "(a) a step, us: ours, beside the same lines in plain numpy, and MuJoCo's hinges in C",
        rows,
        bars,
    )


def processes(repeats, quick):
    """(b) Whole runs as processes; differences are taken within each round, before the median."""
    with tempfile.TemporaryDirectory() as folder:
        alone = (constraints.__file__, "--out", folder, "--no-rerun")
        commands = {
            "import numpy": ("-c", "import numpy"),
            "import constraints": ("-c", "import constraints"),
            "import constraints, rerun": ("-c", "import constraints, rerun, rerun.blueprint"),
            "default, no recording": alone,
            "default": (constraints.__file__, "--out", folder),
        }
        process = partial(
            subprocess.run, check=True, stdout=subprocess.DEVNULL, cwd=constraints.HERE
        )

        def clock(command):
            begin = time.perf_counter()
            process([sys.executable, *command])
            return [time.perf_counter() - begin]

        jobs = {name: partial(clock, command) for name, command in commands.items()}
        s = {
            name: np.array(x)[:, 0]
            for name, x in in_turns(jobs, (repeats + 1) // 2 if quick else repeats).items()
        }
    imported = s["import constraints, rerun"] - s["import constraints"]
    s["recording beyond import"] = s["default"] - s["default, no recording"] - imported
    rows = [{"process": name, **spread(x, "s")} for name, x in s.items()]
    limits = {"default, no recording": 0.35, "recording beyond import": 0.1}
    bars = [(f"{name}, s", float(np.median(s[name])), limit) for name, limit in limits.items()]
    return "(b) whole runs: five modes, 4000 steps of the double pendulum", rows, bars


def growth(repeats, quick):
    """(c) A step of a chain of N links."""
    rows = []
    for n in LINKS[:-1] if quick else LINKS:
        system, steps = constraints.build_system("chain", links=n), max(20, 20_000 // n)
        found = {
            m: np.array(x)
            for m, x in in_turns(
                {
                    m: partial(per_step, system, "semi_implicit", m, steps)
                    for m in ("none", "impulse")
                },
                repeats,
            ).items()
        }
        way = "arrays" if large.takes(system) else "unrolled"
        rows.append(
            {
                "links": n,
                "way": way,
                **spread(found["none"][:, 0], "us"),
                "impulse": float(np.median(found["impulse"][:, 0])),
            }
        )
        rows[-1]["rod error m"] = float(found["none"][0, 1])
    n, us = (np.array([row[key] for row in rows if row["links"] >= 100]) for key in ("links", "us"))
    exponent = float(np.polyfit(np.log(n), np.log(us), 1)[0])
    bars = [
        ("1000 links, us a step", float(us[n == 1000][0]), 150.0),
        ("grows as links to the power", exponent, 1.1),
    ]
    return "(c) a step of a chain, us, by the way that the program takes", rows, bars


def linkages(repeats, quick):
    """(d) Loading a linkage, and a force of it."""
    rows, bars = [], []
    cases = {
        "windows, 131 rods": (windows(65), 1.0),
        "net 20 x 20": (net(20), 10.0),
        "net 50 x 50": (net(50), 200.0),
    }
    for name, (document, limit) in list(cases.items())[: 2 if quick else 3]:
        with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
            file.write(text(document))
            file.flush()
            clock = time.perf_counter()
            system = constraints.build_system(file.name)
            loading = time.perf_counter() - clock
        force = constraints.make_force(system, 0.0)

        def once(force=force, system=system):
            begin = time.perf_counter()
            force(system["q0"], system["v0"])
            return [1e3 * (time.perf_counter() - begin)]

        ms = spread(np.array(in_turns({"": once}, repeats)[""])[:, 0], "ms")
        rows.append({"linkage": name, "rods": len(system["pairs"]), "loading s": loading, **ms})
        bars.append((f"{name}: a force, ms", ms["ms"], limit))
    chain = {"anchors": [[0, 0, 0]], "particles": [{"position": [k, 0, 0]} for k in range(1, 1001)]}
    chain["rods"] = [{"pair": [k, k - 1]} for k in range(1000)]
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(chain, file)
        file.flush()
        clock = time.perf_counter()
        constraints.build_system(file.name)
        bars.append(
            ("a chain of 1000 links from a file: loading, s", time.perf_counter() - clock, 1.0)
        )
    return "(d) linkages: loading, and a force by sparse LU", rows, bars


def main(argv=None) -> int:
    """Measure, print, maybe write JSON."""
    parser = Parser(
        prog="benchmark", description=__doc__, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--quick", action="store_true", help="a look in seconds: fewer repeats, shorter runs"
    )
    parser.add_argument("--repeats", type=number(int, 1, 1000), help="of each timing (9; quick: 3)")
    parser.add_argument("--json", type=writable, metavar="PATH", help="write the same as JSON")
    args = parser.parse_args(argv)
    repeats = args.repeats or (3 if args.quick else 9)
    host = {
        "processor": processor(),
        "python": sys.version.split()[0],
        "numpy": np.__version__,
        "repeats": repeats,
    }
    print(
        ", ".join(f"{key} {value}" for key, value in host.items())
        + "; medians, q1 and q3 the quartiles"
    )
    if not find_spec("mujoco"):
        print("MuJoCo is not installed, its column is left out; pip install -e '.[compare]'")
    answers = [show(*ask(repeats, args.quick)) for ask in (beside, processes, growth, linkages)]
    if args.json:
        write_json(args.json, host | {"answers": answers})
    return 0


if __name__ == "__main__":
    run_script(main)
