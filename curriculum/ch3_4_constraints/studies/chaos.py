"""What can a thousand seeds say that one cannot?  Four questions, a table each, and a recording of the fan of tips.

(a) How many million steps a second, with everything measured, for chunks of seeds that go in step?  (b) In how many
seeds does the drift ordering hold?  (c) How fast do neighbouring seeds part: the largest Lyapunov exponent?  (d) Is the
ensemble the same as its members run alone, and the same bytes twice?
"""

import json
import math
import sys
import time
from argparse import BooleanOptionalAction
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.studies.benchmark import show
from curriculum.common.cli import Parser, number, ready
from curriculum.common.device import processor
from curriculum.common.files import check_writable, write_whole

MODES = ("none", "baumgarte")
# Particles of a chunk of seeds, to be tried. Few, and numpy's calls cost more than their arithmetic. Many, and malloc
# may no longer keep the temporaries: each is given back and comes again as new pages, to be zeroed (page faults a step,
# where they were counted: 0.4 for 4000, 56 for 8000, 261 for 16000), before the cache is full.
CHUNKS = (500, 1000, 2000, 4000, 6000, 8000)
SPEED_STEPS, REPEATS = 400, 7
YOUNG, ALONE = 2.0, 5  # s before chaos decides, and how many members to run alone
PAIRS, SKIP, SPAN, RENEW, CLOSE = 500, 20.0, 200.0, 0.5, 1e-7  # of the exponent, see growth; s, s, s, m
FINE = 0.0025  # s, the step of rk4 there; twice that must give the same exponent
PUBLISHED = """\
published: for equal masses and lengths at this energy, none found. The nearest is 2.4638 /s, 0.249 sqrt(g/l1), for rods
of 0.1, 0.08 m, masses 0.2, 0.1 kg, energy not stated: sites.google.com/view/lyapunov-spectrum/home/double_pendulum"""
SHOWN, FRAME_RATE = 300, 30.0  # seeds in the recording, and its frames a simulated second


def ensemble(name, seeds):
    """The system `name` with q0, v0 (R, N, 3) of the starts that build_system draws for `seeds`, equal to the bit."""
    systems = [c.build_system(name, seed) for seed in seeds]  # 0.06 ms each, nothing to gain from another way
    return systems[0] | {key: np.stack([system[key] for system in systems]) for key in ("q0", "v0")}


def part(system, members):
    """The ensemble of these members (a slice, or their numbers) only."""
    return system | {key: system[key][members] for key in ("q0", "v0")}


def simulate(system, mode, dt, steps, integrator="semi_implicit", keep=()):
    """constraints.simulate, but a run that ends early ends the program: one member that fails stops all."""
    run = c.simulate(system, integrator, c.hold_table(dt)[mode], dt, steps, keep)
    if run["stopped"]:
        sys.exit(f"chaos: {mode} {run['stopped']}; try a smaller --dt")
    return run


def speed(system, dt, repeats):
    """A row a chunk and mode: million steps a second with quartiles, runs taken in turns, and the rod error."""
    spent = {(mode, max(1, size // system["q0"].shape[1])): [] for mode in MODES for size in CHUNKS}
    for _ in range(repeats + 1):
        for (mode, members), samples in spent.items():
            crowd, clock = part(system, np.arange(members) % len(system["q0"])), time.perf_counter()
            run = simulate(crowd, mode, dt, SPEED_STEPS)
            paces = SPEED_STEPS / (time.perf_counter() - clock), 1.0 / run["seconds_per_step"]
            samples.append([1e-6 * members * pace for pace in paces] + [run["max_violation"].max()])
    names, rows = ("all measured", "q1", "q3", "integration alone", "rod error m"), []
    for (mode, members), samples in spent.items():  # the first of each was the warming up
        (middle, alone, error), low, high = np.percentile(samples[1:], [50, 25, 75], axis=0).tolist()
        numbers = dict(zip(names, (middle, low[0], high[0], alone, error), strict=True))
        rows.append({"mode": mode, "seeds in step": members, **numbers})
    return rows


def ordering(system, dt, steps, chunk):
    """How often none drifts more than baumgarte, and over 3 times as much; `chunk` members at a time go in step."""
    parts, worst = [part(system, slice(k, k + chunk)) for k in range(0, len(system["q0"]), chunk)], {}
    for mode in MODES:
        worst[mode] = np.concatenate([simulate(some, mode, dt, steps)["max_violation"] for some in parts])
    ratio = worst["none"] / np.maximum(worst["baumgarte"], 1e-300)
    row = {"seeds": len(ratio), "none > baumgarte": int((ratio > 1.0).sum()), "over 3x": int((ratio > 3.0).sum())}
    row |= dict(zip(("ratio 5 %", "50 %", "95 %"), np.percentile(ratio, [5, 50, 95]).tolist(), strict=True))
    return row | {f"{mode} m, median": float(np.median(errors)) for mode, errors in worst.items()}


def growth(system, skip, span, dt):
    """Rates (R, K) in 1/s at which each member and a neighbour part, in turns of RENEW s; rod and energy error.

    G. Benettin, L. Galgani, A. Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9: every turn the neighbour is put back
    to the distance CLOSE in (q, T v), T^2 = sum L / g, in the direction it has gone, and what it gained is noted, but
    for the first `skip` seconds. Both start a turn on the rods, by `project` (with dt = inf: v is not told of the
    move). Neighbours stay in the x-y plane: the exponent of the plane pendulum is meant.
    """
    unit = math.sqrt(float(np.sum(system["lengths"])) / float(np.abs(c.GRAVITY).max()))
    q, v, rates, rods, start = system["q0"], system["v0"], [], 0.0, c.energy(system, system["q0"], system["v0"])
    away, size = np.random.default_rng(0).standard_normal((2, *q.shape)) * [1.0, 1.0, 0.0], np.ones(len(q))
    for _ in range(round((skip + span) / RENEW)):
        near = away * (CLOSE / size)[:, None, None]
        q, v = np.stack([q, q + near[0]]), np.stack([v, v + near[1] / unit])
        q, v = c.project(system, q, q, v, math.inf)
        run = simulate(system | {"q0": q, "v0": v}, "none", dt, round(RENEW / dt), "rk4")
        (q, near_q), (v, near_v), rods = run["q"], run["v"], max(rods, float(run["max_violation"].max()))
        away = np.stack([near_q - q, unit * (near_v - v)])
        size = np.sqrt(np.sum(c.dot(away, away), axis=(0, -1)))
        rates.append(np.log(size / CLOSE) / RENEW)
    lost = np.abs(c.energy(system, q, v) - start).max() / c.energy_scale(system)
    return np.array(rates[round(skip / RENEW) :]).T, rods, float(lost)


def exponent(what, system, known, skip, span, dt):
    """A row: the exponent, its standard error by members and by ten blocks of time, and what is known of it."""
    rates, rods, lost = growth(system, skip, span, dt)
    members, blocks = rates.mean(axis=1), [block.mean() for block in np.array_split(rates, 10, axis=1)]
    row = {"pairs of": what, "pairs": len(members), "dt": dt, "exponent 1/s": float(members.mean()), "known": known}
    for name, x in (("members", members), ("blocks", blocks)):
        row[f"+- {name}"] = float(np.std(x, ddof=1) / math.sqrt(len(x)))
    return row | {"least": float(members.min()), "rod error m": rods, "energy error": lost}


def parting(name, system, quick):
    """The exponents of `system`, and of two systems whose exponent is known, to trust the first by."""
    pairs, skip, span, steps = (20, 5.0, 10.0, [2 * FINE]) if quick else (PAIRS, SKIP, SPAN, [FINE, 2 * FINE])
    rows, few = [exponent(name, part(system, slice(pairs)), "?", skip, span, dt) for dt in steps], range(20)
    upright = ensemble("double", few) | {"q0": np.tile([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], (len(few), 1, 1))}
    top = math.sqrt((2.0 + math.sqrt(2.0)) * 9.81)  # of x'' = 9.81 [[3, -1], [-3, 3]] x ...
    rows.append(exponent("upright double", upright, top, 5.0, 5.0, steps[0]))
    shear = f"ln(t)/t -> 0: {math.log((skip + span) / skip) / span:.3f}"  # periods differ, so neighbours part as t
    return [*rows, exponent("pendulum", ensemble("pendulum", few), shear, skip, span, steps[0])]


def consistency(system, dt):
    """A row a mode: how far apart members alone and in the ensemble end after YOUNG s, and whether bytes repeat."""
    rows, picks = [], np.linspace(0, len(system["q0"]) - 1, ALONE).astype(int)
    for mode in MODES:
        settings = (mode, dt, max(1, round(YOUNG / dt)))
        once, again = simulate(system, *settings), simulate(system, *settings)
        gap = max(c.distance(once["q"][k], simulate(part(system, k), *settings)["q"]) for k in picks)
        same = all(once[key].tobytes() == again[key].tobytes() for key in ("q", "v", "max_violation", "energy_rel_max"))
        rows.append({"mode": mode, "alone": ALONE, "farthest apart m": gap, "same bytes twice": same})
    return rows


def fan(path, system, dt, steps):
    """Write to `path` the tips of the first SHOWN seeds, a cloud a mode, seed 0 with its rods, and their spread."""
    from curriculum.common.recording import record  # here: a run without a recording never pays for importing rerun

    movers, frames = {}, range(0, steps + 1, max(1, round(1.0 / (FRAME_RATE * dt))))
    for k, mode in enumerate(MODES):
        step, q, *_ = simulate(part(system, slice(SHOWN)), mode, dt, steps, keep=frames)["kept"].values()
        rods = np.stack([q[:, 0] - c.rod_vectors(system, q[:, 0]), q[:, 0]], axis=-2)
        spread = np.log10(np.maximum(np.sqrt(q[:, :, -1].var(axis=1).sum(axis=-1)), 1e-16))
        movers[mode] = k, step * dt, q[:, ::-1, -1], rods, {"spread of the tips: log10 of metres": spread}
    record(path, "chaos", movers, system["anchors"], float(np.sum(system["lengths"])))


def parse(argv):
    """The command line."""
    parser = Parser(prog="chaos", description="What can a thousand seeds say that one cannot?")
    add, positive = parser.add_argument, number(float, 0, False)
    add("--system", choices=[*c.SYSTEMS, "chain"], default="double", help="whose start the seeds draw (double)")
    add("--seeds", type=number(int, 2, high=10**6), default=1000, help="so many, from 0 on (1000)")
    add("--seconds", type=positive, default=20.0, help="drift is patient (20)")
    add("--dt", type=positive, default=0.005, metavar="S", help="a smaller one drifts less (0.005)")
    add("--quick", action="store_true", help="a look in seconds: at most 100 seeds, 5 s, a rough exponent")
    add("--json", type=Path, metavar="PATH", help="also write all tables here")
    add("--rerun", action=BooleanOptionalAction, default=True, help="off when only the numbers count (on)")
    add("--out", type=Path, default=Path("outputs/ch3.4-chaos"), metavar="FOLDER", help="for the recording, chaos.rrd")
    args = parser.parse_args(argv)
    if args.quick:
        args.seeds, args.seconds = min(args.seeds, 100), min(args.seconds, 5.0)
    if args.rerun:
        ready(parser, args.out, ("chaos.rrd",))
    try:
        if args.json:
            check_writable(args.json)
    except OSError as error:
        parser.error(f"argument --json: cannot write '{args.json}': {error.strerror}")
    return args


def main(argv=None):
    """Ask, print, maybe write JSON and the recording. Returns 0."""
    args = parse(argv)
    dt, steps, system = args.dt, max(1, round(args.seconds / args.dt)), ensemble(args.system, range(args.seeds))
    host = {"processor": processor(), "python": sys.version.split()[0], "numpy": np.__version__}
    host |= {"system": args.system, "seeds": args.seeds, "steps": steps, "dt": dt}
    print(", ".join(f"{key} {value}" for key, value in host.items()), flush=True)
    rows = speed(system, dt, 1 if args.quick else REPEATS)
    best = max(rows, key=lambda row: row["all measured"])
    chunk, bar = best["seeds in step"], ("us a step at best (5 million a second)", 1.0 / best["all measured"], 0.2)
    tables = [show(f"(a) million steps a second, semi_implicit, {SPEED_STEPS} steps", rows, [bar])]
    title = f"(b) worst rod error in {args.seconds:g} s, {chunk} seeds in step"
    tables.append(show(title, [ordering(system, dt, steps, chunk)], []))
    title = "(c) the largest Lyapunov exponent: rk4, pairs put back on the rods and close together"
    tables.append(show(title, parting(args.system, system, args.quick), []))
    print(PUBLISHED)
    title = f"(d) the ensemble and its members alone, after {YOUNG:g} s"
    tables.append(show(title, consistency(system, dt), []))
    if args.rerun:
        fan(args.out / "chaos.rrd", system, dt, steps)
        print(f"\nwrote {args.out / 'chaos.rrd'}\nlook: rerun {args.out / 'chaos.rrd'}")
    if args.json:
        content = json.dumps(host | {"answers": tables}, indent=1) + "\n"
        write_whole(args.json, lambda temporary: temporary.write_text(content, encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
