"""What can a thousand seeds say that one cannot?  A table a question, and a recording of the fan of their tips.

(a) How fast do many seeds go in step, measured and all?  (b) In how many does the drift ordering hold?  (c) How fast do
neighbours part: the largest Lyapunov exponent?  (d) Does drift change that?  (e) Is the ensemble what its members are
alone, and the same twice?
"""

import math
import sys
import time
from argparse import BooleanOptionalAction
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.studies.benchmark import show
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.device import processor
from curriculum.common.files import make_ready, write_json

MODES, SHOWN, FRAME_RATE = ("none", "baumgarte"), 300, 30.0  # compared; seeds recorded, and frames a simulated second
# Particles of a chunk, to be tried. Few: numpy's calls cost more than their arithmetic. Many: malloc gives temporaries
# back and gets new pages, to be zeroed (0.4 page faults a step at 4000, 56 at 8000, 261 at 16000, where counted).
CHUNKS = (500, 1000, 2000, 4000, 6000, 8000)
SPEED_STEPS, REPEATS, ALONE, YOUNG = 400, 7, 5, 2.0  # ALONE members are run, for YOUNG s, before chaos decides
PAIRS, SKIP, SPAN, RENEW, CLOSE, FINE = 500, 20.0, 200.0, 0.5, 1e-7, 0.0025  # see growth; m, s; FINE is rk4's step
PUBLISHED = """published: none found for equal masses and lengths at this energy; nearest: 2.4638 /s, 0.249 sqrt(g/l1),
rods 0.1, 0.08 m, masses 0.2, 0.1 kg, energy not stated: sites.google.com/view/lyapunov-spectrum/home/double_pendulum"""


def ensemble(name, seeds):
    """The system `name` with q0, v0 (R, N, 3), the starts that build_system itself draws for `seeds`, 0.06 ms each."""
    systems = [c.build_system(name, seed) for seed in seeds]
    return systems[0] | {key: np.stack([system[key] for system in systems]) for key in ("q0", "v0")}


def part(system, members):
    """The ensemble of these members (a slice, or their numbers) only."""
    return system | {key: system[key][members] for key in ("q0", "v0")}


def simulate(system, mode, dt, steps, integrator="semi_implicit", keep=()):
    """constraints.simulate, but a run that ends early ends the program: one member that fails stops all."""
    run = c.simulate(system, integrator, c.hold_table(dt)[mode], dt, steps, keep)
    return run if not run["stopped"] else sys.exit(f"chaos: {mode} {run['stopped']}; try a smaller --dt")


def speed(system, dt, repeats):
    """A row a chunk and mode: million steps a second with quartiles, runs taken in turns, and the rod error."""
    spent, rows = {(mode, max(1, size // system["q0"].shape[1])): [] for mode in MODES for size in CHUNKS}, []
    for (mode, members), samples in [*spent.items()] * (repeats + 1):
        crowd, clock = part(system, np.arange(members) % len(system["q0"])), time.perf_counter()
        run = simulate(crowd, mode, dt, SPEED_STEPS)
        paces = SPEED_STEPS / (time.perf_counter() - clock), 1.0 / run["seconds_per_step"]
        samples.append([1e-6 * members * pace for pace in paces] + [run["max_violation"].max()])
    for (mode, members), samples in spent.items():  # the first of each was the warming up
        (middle, alone, error), (low, *_), (high, *_) = np.percentile(samples[1:], [50, 25, 75], axis=0).tolist()
        row = {"mode": mode, "seeds in step": members, "all measured": middle, "q1": low, "q3": high}
        rows.append(row | {"integration alone": alone, "rod error m": error})
    return rows


def ordering(system, dt, steps, chunk):
    """How often none drifts more than baumgarte, and over 3 times as much; `chunk` members at a time go in step."""
    parts = [part(system, slice(k, k + chunk)) for k in range(0, len(system["q0"]), chunk)]
    worst = {m: np.concatenate([simulate(some, m, dt, steps)["max_violation"] for some in parts]) for m in MODES}
    ratio = worst["none"] / np.maximum(worst["baumgarte"], 1e-300)
    row = {"seeds": len(ratio), "none > baumgarte": int((ratio > 1.0).sum()), "over 3x": int((ratio > 3.0).sum())}
    row |= dict(zip(("ratio 5 %", "50 %", "95 %"), np.percentile(ratio, [5, 50, 95]).tolist(), strict=True))
    return row | {f"{mode} m, median": float(np.median(errors)) for mode, errors in worst.items()}


def growth(system, skip, span, dt):
    """Rates (R, K) in 1/s at which each member and a neighbour part, in turns of RENEW s; rod and energy error.

    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9: every turn the neighbour is put back
    to the distance CLOSE in (q, T v), T^2 = sum L / g, where it has gone to, and its gain noted, after `skip` seconds.
    Both start a turn on the rods, by `project` (dt = inf: v is not told of the move), and stay in the x-y plane.
    """
    q, v, unit = system["q0"], system["v0"], math.sqrt(system["lengths"].sum() / np.abs(c.GRAVITY).max())
    away, size = np.random.default_rng(0).standard_normal((2, *q.shape)) * [1.0, 1.0, 0.0], np.ones(len(q))
    rates, rods, start = [], 0.0, c.energy(system, q, v)
    for _ in range(round((skip + span) / RENEW)):
        near = away * (CLOSE / size)[:, None, None]
        q, v = np.stack([q, q + near[0]]), np.stack([v, v + near[1] / unit])
        q, v = c.project(system, q, q, v, math.inf)
        run = simulate(system | {"q0": q, "v0": v}, "none", dt, round(RENEW / dt), "rk4")
        away = np.stack([run["q"][1] - run["q"][0], unit * (run["v"][1] - run["v"][0])])
        q, v, rods = run["q"][0], run["v"][0], max(rods, float(run["max_violation"].max()))
        size = np.sqrt(np.sum(c.dot(away, away), axis=(0, -1)))
        rates.append(np.log(size / CLOSE) / RENEW)
    lost = np.abs(c.energy(system, q, v) - start).max() / c.energy_scale(system)
    return np.array(rates[round(skip / RENEW) :]).T, rods, float(lost)


def parting(name, system, quick):
    """A row a case, with standard errors: `system` at two steps, then two whose exponent is known, to trust it by."""
    pairs, skip, span, steps = (20, 5.0, 10.0, [2 * FINE]) if quick else (PAIRS, SKIP, SPAN, [FINE, 2 * FINE])
    upright, few = np.tile([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], (20, 1, 1)), range(20)
    top = math.sqrt((2.0 + math.sqrt(2.0)) * 9.81)  # of angles'' = g/L [[2, -1], [-2, 2]] angles, equal rods and masses
    shear = f"ln(t)/t -> 0: {math.log((skip + span) / skip) / span:.3f}"  # periods differ, so neighbours part as t
    cases, rows = [(name, part(system, slice(pairs)), "?", skip, span, dt) for dt in steps], []
    cases.append(("upright double", ensemble("double", few) | {"q0": upright}, top, 5.0, 5.0, steps[0]))
    cases.append(("pendulum", ensemble("pendulum", few), shear, skip, span, steps[0]))
    for what, crowd, known, *settings in cases:
        rates, rods, lost = growth(crowd, *settings)
        members, blocks = rates.mean(axis=1), [some.mean() for some in np.array_split(rates, 10, axis=1)]  # of time
        errors = [float(np.std(x, ddof=1) / math.sqrt(len(x))) for x in (members, blocks)]
        row = {"pairs of": what, "pairs": len(members), "dt": settings[-1], "exponent 1/s": float(members.mean())}
        row |= {"+- members": errors[0], "+- blocks": errors[1], "known": known, "least": float(members.min())}
        rows.append(row | {"rod error m": rods, "energy error": lost})
    return rows


def crowds(system, dt, steps, chunk):
    """A row a run: how far the tips have spread at the end, and what became of the energy; rk4 is the yardstick."""
    rows = []
    for rule, mode in (*(("semi_implicit", mode) for mode in MODES), ("rk4", "none")):
        tips, energies = [], []
        for k in range(0, len(system["q0"]), chunk):
            crowd = part(system, slice(k, k + chunk))
            run = simulate(crowd, mode, dt, steps, rule)
            tips.append(run["q"][:, -1])
            energies.append(c.energy(crowd, run["q"], run["v"]) - c.energy(crowd, crowd["q0"], crowd["v0"]))
        spread = float(np.sqrt(np.concatenate(tips).var(axis=0).sum()))
        gain = float(np.median(np.concatenate(energies)) / c.energy_scale(system))
        rows.append({"run": f"{rule} {mode}", "spread of the tips m": spread, "energy gained, of m g L": gain})
    return rows


def consistency(system, dt):
    """A row a mode: how far apart members alone and in the ensemble end after YOUNG s, and whether bytes repeat."""
    rows, picks = [], np.linspace(0, len(system["q0"]) - 1, ALONE).astype(int)
    for settings in ((mode, dt, max(1, round(YOUNG / dt))) for mode in MODES):
        once, again = simulate(system, *settings), simulate(system, *settings)
        gap = max(c.distance(once["q"][k], simulate(part(system, k), *settings)["q"]) for k in picks)
        same = all(once[key].tobytes() == again[key].tobytes() for key in ("q", "v", "max_violation", "energy_rel_max"))
        rows.append({"mode": settings[0], "alone": ALONE, "farthest apart m": gap, "same bytes twice": same})
    return rows


def fan(path, system, dt, steps):
    """Write to `path` tips of SHOWN seeds, a cloud a mode and one by rk4, seed 0 with its rods, and their spread."""
    from curriculum.common.recording import record  # here: a run without a recording never pays for importing rerun

    movers, frames = {}, range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt))))
    for k, (rule, mode) in enumerate((*(("semi_implicit", mode) for mode in MODES), ("rk4", "none"))):
        step, q, *_ = simulate(part(system, slice(SHOWN)), mode, dt, steps, rule, frames)["kept"].values()
        rods = np.stack([q[:, 0] - c.rod_vectors(system, q[:, 0]), q[:, 0]], axis=-2)
        spread = np.log10(np.maximum(np.sqrt(q[:, :, -1].var(axis=1).sum(axis=-1)), 1e-16))
        movers[f"{rule}_{mode}"] = k, step * dt, q[:, ::-1, -1], rods, {"spread of the tips: log10 of metres": spread}
    record(path, "chaos", movers, system["anchors"])


def parse(argv):
    """The command line."""
    parser, positive = Parser(prog="chaos", description=__doc__.splitlines()[0]), number(float, 0, False)
    add = parser.add_argument
    add("--system", choices=[*c.SYSTEMS, "chain"], default="double", help="whose start the seeds draw (double)")
    add("--seeds", type=number(int, 2, high=10**6), default=1000, help="so many, from 0 on (1000)")
    add("--seconds", type=positive, default=20.0, help="drift is patient (20)")
    add("--dt", type=positive, default=0.005, metavar="S", help="a smaller one drifts less (0.005)")
    add("--quick", action="store_true", help="a look in seconds: at most 100 seeds, 5 s, a rough exponent")
    add("--json", type=writable, metavar="PATH", help="also write all tables here")
    add("--rerun", action=BooleanOptionalAction, default=True, help="off when only the numbers count (on)")
    add("--out", type=Path, default=Path("outputs/ch3.4-chaos"), metavar="FOLDER", help="for the recording, chaos.rrd")
    args = parser.parse_args(argv)
    if args.quick:
        args.seeds, args.seconds = min(args.seeds, 100), min(args.seconds, 5.0)
    if args.rerun:
        parser.attempt("--out", OSError, make_ready, args.out, ("chaos.rrd",))
    return args


def main(argv=None):
    """Ask, print, maybe write JSON and the recording. Returns 0."""
    args = parse(argv)
    dt, steps, system = args.dt, max(1, round(args.seconds / args.dt)), ensemble(args.system, range(args.seeds))
    host = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__, "system": args.system}
    host |= {"seeds": args.seeds, "steps": steps, "dt": dt}
    print(", ".join(f"{key} {value}" for key, value in host.items()), flush=True)
    rows = speed(system, dt, 1 if args.quick else REPEATS)
    pace, chunk = max((row["all measured"], row["seeds in step"]) for row in rows)
    bars = [("us a step at best", 1.0 / pace, 0.2)] * (args.system == "double")  # the bar is for that one
    tables = [show("(a) million steps a second, semi_implicit", rows, bars)]
    tables.append(show(f"(b) worst rod error in {args.seconds:g} s", [ordering(system, dt, steps, chunk)], []))
    tables.append(show("(c) the largest Lyapunov exponent, rk4", parting(args.system, system, args.quick), []))
    print(PUBLISHED if args.system == "double" else "")
    tables.append(show(f"(d) the tips after {args.seconds:g} s", crowds(system, dt, steps, chunk), []))
    tables.append(show(f"(e) ensemble and members alone, {YOUNG:g} s", consistency(system, dt), []))
    if args.rerun:
        fan(args.out / "chaos.rrd", system, dt, steps)
        print(f"\nwrote {args.out / 'chaos.rrd'}\nlook: rerun {args.out / 'chaos.rrd'}")
    if args.json:
        write_json(args.json, host | {"answers": tables})
    return 0


if __name__ == "__main__":
    run_script(main)
