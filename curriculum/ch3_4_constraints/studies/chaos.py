"""What can a thousand seeds say that one cannot?  Three tables, and a recording of the fan of their
pendulums.

(a) How fast do many seeds go in step?  (b) In how many does the drift ordering hold, and what does
drift make of the crowd?  (c) How fast do neighbours part: the largest Lyapunov exponent?
Seeds are members along a leading axis: q0, v0 (R, N, 3). Each computes what it computes alone, to
the last bit.
"""

import math
import sys
import time
from argparse import RawDescriptionHelpFormatter
from collections import namedtuple
from functools import partial
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.recording import record
from curriculum.ch3_4_constraints.studies._runs import energy_scale, run
from curriculum.ch3_4_constraints.tables import in_turns, show, spread
from curriculum.common.banner import processor, progress
from curriculum.common.cli import Parser, number, run_script
from curriculum.common.files import METRICS, RECORDING, results_folder, write_json, write_whole
from curriculum.common.motion import Motion, Unrolled, followed
from curriculum.common.ruler import Truth

import numpy as np

RUNS = (
    ("semi_implicit", "none"),
    ("semi_implicit", "baumgarte"),
    ("rk4", "none"),
)  # the last is the yardstick
# Members that go in step. Few: numpy's calls cost more than their arithmetic. Many: their states
# leave the cache. A batch leaves 48 bytes a member and run, and nothing else: 52 MB at most with a
# thousand seeds, 80 with a hundred thousand (resident, by /usr/bin/time -v).
BATCH = 4000
SIZES, WORK, REPEATS = (
    (250, 1000, 4000),
    4_000_000,
    5,
)  # of timings: members, and steps of all of them together
SHOWN, FRAME_RATE = 30, 30.0  # members in the recording, frames a simulated second
PAIRS, SKIP, SPAN, RENEW, CLOSE, FINE = (
    500,
    20.0,
    200.0,
    0.5,
    1e-7,
    0.0025,
)  # see `growth`; m, s; FINE: rk4's step
PUBLISHED = """published: nothing found for equal masses and lengths. Nearest, at an energy not told: 2.4638 /s,
0.249 sqrt(g/l1), rods 0.1, 0.08 m, masses 0.2, 0.1 kg (sites.google.com/view/lyapunov-spectrum)"""

# What a run came to, an entry a member: its worst rod error in m; its worst energy error, and the
# energy it has gained at the end, as shares of m g L; where its tip (R, 3) ended, in m. NaN for a
# member that flew apart.
Ends = namedtuple("Ends", "rods energy gained tip")


def ensemble(name, seeds):
    """The system `name` with q0, v0 (R, N, 3), the starts that build_system itself draws for
    `seeds`."""
    systems = [c.build_system(name, seed) for seed in seeds]
    return systems[0] | {key: np.stack([system[key] for system in systems]) for key in ("q0", "v0")}


def follow(system, rule, mode, dt, steps):
    """The Ends of a run that is measured at every step, as `simulate` does, and the seconds of its
    steps alone."""
    hold, scale, rods, energy = c.hold_table(dt)[mode], energy_scale(system), 0.0, 0.0
    step, force = followed(c.INTEGRATORS[rule], hold.after, system), c.make_force(system, hold)
    motion = Motion(step, system["m"], force, dt, system["q0"], system["v0"])
    measure = motion.fast(lambda q, v: (c.rod_errors(system, q), c.energy(system, q, v)))
    start = c.energy(system, system["q0"], system["v0"])
    for q, v in motion.blocks(steps):
        errors, energies = measure(q, v)
        rods = np.maximum(rods, np.abs(errors).max(axis=(0, -1)))
        energy = np.maximum(energy, np.abs(energies - start).max(axis=0))
        motion.done += len(q)
    sane = np.where(rods < 100.0 * np.sum(system["lengths"]), 0.0, math.nan)
    if motion.stopped or np.isnan(sane).all():
        sys.exit(f"chaos: {rule} {mode} {motion.stopped or 'flew apart'}; try a smaller --dt")
    ends = rods, energy / scale, (energies[-1] - start) / scale, q[-1, ..., -1, :]
    return Ends(*((x.T + sane).T for x in ends)), motion.seconds


def pace(system, mode, dt, steps):
    """Million steps a second, of all members together: everything measured, and the steps alone."""
    clock = time.perf_counter()
    _, alone = follow(system, "semi_implicit", mode, dt, steps)
    return [
        1e-6 * steps * len(system["q0"]) / seconds
        for seconds in (time.perf_counter() - clock, alone)
    ]


def speed(name, dt, repeats):
    """(a) A row a size of ensemble and mode, timed in turns; for the double pendulum, what a
    thousand must reach."""
    rows, bars, jobs = [], [], {}
    for size in SIZES:
        system, steps = ensemble(name, range(size)), WORK // max(size, 1000)
        jobs |= {
            (size, mode): partial(pace, system, mode, dt, steps) for mode in ("none", "baumgarte")
        }
    for (size, mode), found in in_turns(jobs, repeats).items():
        measured, alone = np.transpose(found)
        row = {
            "seeds in step": size,
            "mode": mode,
            **spread(measured, "all measured"),
            **spread(alone, "alone"),
        }
        rows.append(row)
        if (name, size) == ("double", 1000):
            bars.append(
                (
                    f"a thousand, {mode}, all measured: us a step",
                    1.0 / row["all measured"],
                    1.0 / 15.0,
                )
            )
            bars.append(
                (f"a thousand, {mode}, the steps alone: us a step", 1.0 / row["alone"], 1.0 / 25.0)
            )
    return "(a) million steps a second, semi_implicit", rows, bars


def crowds(name, seeds, dt, steps):
    """{(rule, mode): Ends} of all `seeds`, a range, BATCH members at a time."""
    found, tick = {key: [] for key in RUNS}, progress(f"{len(seeds)} seeds", len(seeds))
    for k in range(0, len(seeds), BATCH):
        system = ensemble(name, seeds[k : k + BATCH])
        for key, parts in found.items():
            parts.append(follow(system, *key, dt, steps)[0])
        tick(k + len(system["q0"]))
    return {
        key: Ends(*map(np.concatenate, zip(*parts, strict=True))) for key, parts in found.items()
    }


def ordering(found):
    """A row: in how many seeds none drifts more than baumgarte, and over 3 times as much, and by
    how much."""
    ratio = found["semi_implicit", "none"].rods / found["semi_implicit", "baumgarte"].rods
    row = {
        "seeds": len(ratio),
        "none > baumgarte": int((ratio > 1.0).sum()),
        "over 3x": int((ratio > 3.0).sum()),
    }
    quantiles = np.nanpercentile(ratio, [0, 5, 50, 95, 100]).tolist()
    return row | dict(
        zip(("least ratio", "5 %", "50 %", "95 %", "largest"), quantiles, strict=True)
    )


def fates(found):
    """A row a run: what became of rods and energy, and how far the tips have spread at the end."""
    rows = []
    for (rule, mode), ends in found.items():
        row = {"run": f"{rule} {mode}", "lost": int(np.isnan(ends.rods).sum())}
        row |= {"rods m": float(np.nanmedian(ends.rods)), "worst": float(np.nanmax(ends.rods))}
        row |= {
            "energy off, worst": float(np.nanmax(ends.energy)),
            "gained": float(np.nanmedian(ends.gained)),
        }
        rows.append(row | {"tips spread m": float(np.sqrt(np.nanvar(ends.tip, axis=0).sum()))})
    return rows


def growth(system, skip, span, dt):
    """Rates (R, K) in 1/s at which each member and a neighbour part, in turns of RENEW s; rod and
    energy error.

    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9: every turn the
    neighbour is put back to the distance CLOSE in (q, T v), T^2 = sum L / g, where it has gone to,
    and its gain noted, after `skip` seconds. Both start a turn on the rods, by `project` (dt = inf:
    v is not told of the move), and stay in the x-y plane.
    """
    force, still = (
        c.make_force(system, 0.0),
        [np.tile([False, False, True], (len(system["m"]), 1))] * 2,
    )
    step = Unrolled(lambda q, v: c.rk4_step(q, v, system["m"], force, dt), *still)
    back = Unrolled(lambda q, v: c.project(system, q, q, v, math.inf), *still)
    q, v, unit = (
        system["q0"],
        system["v0"],
        math.sqrt(system["lengths"].sum() / np.abs(c.GRAVITY).max()),
    )
    away, size = (
        np.random.default_rng(0).standard_normal((2, *q.shape)) * [1.0, 1.0, 0.0],
        np.ones(len(q)),
    )
    rates, rods, start, turns = [], 0.0, c.energy(system, q, v), round((skip + span) / RENEW)
    tick = progress(f"{len(q)} pairs", turns)
    for turn in range(turns):
        near = away * (CLOSE / size)[:, None, None]
        q, v = back(np.stack([q, q + near[0]]), np.stack([v, v + near[1] / unit]))
        for _ in range(round(RENEW / dt)):
            q, v = step(q, v)
        rods = max(rods, float(c.constraint_violation(system, q).max()))
        away, q, v = np.stack([q[1] - q[0], unit * (v[1] - v[0])]), q[0], v[0]
        size = np.sqrt(np.sum(c.dot(away, away), axis=(0, -1)))
        rates.append(np.log(size / CLOSE) / RENEW)
        tick(turn + 1)
    lost = np.abs(c.energy(system, q, v) - start).max() / energy_scale(system)
    return np.array(rates[round(skip / RENEW) :]).T, rods, float(lost)


def parting(name, seeds, quick):
    """A row a case, with standard errors: the system at two steps, then two whose exponent is
    known, to trust it by."""
    pairs, skip, span, steps = (
        (20, 5.0, 10.0, [2 * FINE]) if quick else (PAIRS, SKIP, SPAN, [FINE, 2 * FINE])
    )
    upright, few = np.tile([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], (20, 1, 1)), range(20)
    top = math.sqrt(
        (2.0 + math.sqrt(2.0)) * np.abs(c.GRAVITY).max()
    )  # angles'' = g/L [[2, -1], [-2, 2]] angles
    shear = (
        math.log((skip + span) / skip) / span
    )  # periods differ, so neighbours part as t: ln(t)/t, on its way to 0
    cases, rows = [(name, ensemble(name, seeds[:pairs]), "?", skip, span, dt) for dt in steps], []
    cases.append(
        ("upright double", ensemble("double", few) | {"q0": upright}, top, 5.0, 5.0, steps[0])
    )
    cases.append(("pendulum", ensemble("pendulum", few), shear, skip, span, steps[0]))
    for what, crowd, known, *settings in cases:
        rates, rods, lost = growth(crowd, *settings)
        members, blocks = (
            rates.mean(axis=1),
            [some.mean() for some in np.array_split(rates, 10, axis=1)],
        )  # of time
        errors = [float(np.std(x, ddof=1) / math.sqrt(len(x))) for x in (members, blocks)]
        row = {
            "pairs of": what,
            "pairs": len(members),
            "dt": settings[-1],
            "1/s": float(members.mean()),
        }
        row |= {
            "+- members": errors[0],
            "+- blocks": errors[1],
            "known": known,
            "least": float(members.min()),
        }
        rows.append(row | {"rods m": rods, "energy": lost})
    return rows


def fan(path, system, dt, steps):
    """Write to `path` a recording of all members (R, N, 3): a view's linkage has R parts, and their
    mean energy."""
    keep, (members, n) = (
        range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt)))),
        system["q0"].shape[:2],
    )
    pairs = [
        (i + k * n, j + k * n if j >= 0 else j) for k in range(members) for i, j in system["pairs"]
    ]
    linkage, scale = (
        {"pairs": pairs, "lengths": np.tile(system["lengths"], members)},
        energy_scale(system),
    )
    runs, rows, pulls = {}, {}, {}
    for rule, mode in RUNS:
        found, key = run(system, rule, mode, dt, steps, keep), f"{rule}_{mode}"
        pulls[key] = c.tensions(system, found.q, found.v, c.hold_table(dt)[mode]).reshape(
            len(found.q), -1
        )
        worst, mean, q = (
            found.violations.max(axis=1),
            found.energies.mean(axis=1),
            found.q.reshape(len(found.q), -1, 3),
        )
        runs[key] = found._replace(tip=found.tip[:, 0], violations=worst, energies=mean, q=q)
        rows[key] = runs[key].summary(scale, Truth(0))
    what = SimpleNamespace(
        system=f"{members} seeds", integrator=" and ".join(sorted({rule for rule, _ in RUNS}))
    )
    record(path, what, {"dt": dt, "error_at": 0.0}, linkage, runs, rows, scale, lambda: pulls)


def parse(argv):
    """The command line."""
    parser = Parser(prog="chaos", description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    add = parser.add_argument
    add(
        "--system",
        choices=[*c.SYSTEMS, "chain"],
        default="double",
        help="whose start the seeds draw (double)",
    )
    add("--seeds", type=number(int, 2, 10**7), default=1000, help="so many (1000)")
    add(
        "--first",
        type=number(int, 0),
        default=0,
        help="the first; machines that share the work start apart (0)",
    )
    add("--seconds", type=number(high=1e5), default=20.0, help="drift is patient (20)")
    add(
        "--dt",
        type=number(float, 1e-6),
        default=0.005,
        metavar="S",
        help="a smaller one drifts less (0.005)",
    )
    add(
        "--quick",
        action="store_true",
        help="a look in seconds: at most 100 seeds, 5 s, a rough exponent",
    )
    add(
        "--out",
        type=results_folder,
        default="outputs/ch3.4-chaos",
        metavar="FOLDER",
        help="for results, one a run",
    )
    add("--no-rerun", dest="rerun", action="store_false", help="no recording, numbers only")
    args = parser.parse_args(argv)
    if args.quick:
        args.seeds, args.seconds = min(args.seeds, 100), min(args.seconds, 5.0)
    return args


def main(argv=None):
    """Ask, print, write metrics.json and the recording. Returns 0."""
    args = parse(argv)
    dt, steps, seeds = (
        args.dt,
        max(1, round(args.seconds / args.dt)),
        range(args.first, args.first + args.seeds),
    )
    settings = {
        "system": args.system,
        "seeds": args.seeds,
        "first": args.first,
        "steps": steps,
        "dt": dt,
    }
    host = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__}
    for line in (host, settings):
        print(", ".join(f"{key} {value}" for key, value in line.items()), flush=True)
    show(
        *speed(args.system, dt, 1 if args.quick else REPEATS)
    )  # of this machine, so not among the metrics
    found = crowds(args.system, seeds, dt, steps)
    tables = [
        show(f"(b) worst rod error in {args.seconds:g} s, none over baumgarte", [ordering(found)])
    ]
    tables.append(
        show(
            f"and after {args.seconds:g} s: medians, and worst; energies are shares of m g L",
            fates(found),
        )
    )
    tables.append(
        show("(c) the largest Lyapunov exponent, rk4", parting(args.system, seeds, args.quick))
    )
    print(PUBLISHED if args.system == "double" else "")
    args.out.mkdir(parents=True, exist_ok=True)
    metrics, recording = args.out / METRICS, args.out / RECORDING
    recording.unlink(missing_ok=True)  # it must never lie beside another run's numbers
    write_json(metrics, settings | {"answers": tables})
    print(f"\nwrote {metrics}")
    if args.rerun:
        write_whole(
            recording, lambda path: fan(path, ensemble(args.system, seeds[:SHOWN]), dt, steps)
        )
        print(f"look: python -m rerun {recording}")
    return 0


if __name__ == "__main__":
    run_script(main)
