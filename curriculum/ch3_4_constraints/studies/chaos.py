"""What can a thousand seeds say that one cannot?  Three tables of the double pendulum.

(a) How fast do many seeds go in step?  (b) In how many does the drift ordering hold, and what does
drift make of the crowd?  (c) How fast do neighbours part: the largest Lyapunov exponent?
Seeds are members along a leading axis: q0, v0 (R, N, 3). Each computes what it computes alone, to
the last bit.
"""

import math
import time
from collections import namedtuple
from functools import partial

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import (
    NATIVE,
    G,
    crowd,
    energy_scale,
    host,
    study_parser,
)
from curriculum.ch3_4_constraints.tables import in_turns, show, spread
from curriculum.common.cli import number, run_script

import numpy as np

DT, SECONDS = 0.005, 20.0  # s, of (a) and (b)
RUNS = ("semi_implicit", "none"), ("semi_implicit", "baumgarte"), ("rk4", "none")
SIZES, WORK = (250, 1000, 4000), 4_000_000  # members timed, and steps of all of them together
REPEATS = 5
LEAST = {"alone": 120.0, "measured": 50.0}  # million steps a second of a thousand: the bars
BLOCK = 64  # steps a call: of a thousand seeds their rod errors fit a processor's caches
CLOSE, RENEW = 1e-7, 0.5  # m, s: see `growth`
PAIRS, SKIP, SPAN, FINE = 500, 20.0, 200.0, 0.0025  # neighbours, s, s, and rk4's step in s

# What a run came to, an entry a member: its worst rod error in m; the energy it has gained, as a
# share of m g L; where its tip (R, 3) ended, in m.
Ends = namedtuple("Ends", "rods gained tip")


def ensemble(name, seeds):
    """The system `name` with q0, v0 (R, N, 3), the starts that build_system draws for `seeds`."""
    drawn = (c.build_system(name, seed) for seed in seeds)
    q0, v0 = np.stack([(system["q0"], system["v0"]) for system in drawn], axis=1)
    return c.build_system(name) | {"q0": q0, "v0": v0}


def follow(system, rule, mode, steps):
    """The Ends of a run whose rods are measured at every step."""
    many = crowd(system, rule, mode, DT, lambda q, v: [np.abs(c.rod_errors(system, q))])
    rods = 0.0
    for done in range(0, steps, BLOCK):
        rods = np.maximum(rods, many.advance(min(BLOCK, steps - done)).max(axis=(0, 1)))
    q, v = many.states()
    gained = c.energy(system, q, v) - c.energy(system, system["q0"], system["v0"])
    return Ends(rods, gained / energy_scale(system), q[:, -1])


def speed(repeats):
    """(a) A row a size of ensemble, timed in turns; what a thousand must reach."""

    def pace(many, steps, block):
        clock = time.perf_counter()
        for _ in range(0, steps, block):
            many.advance(block)
        return 1e-6 * steps / (time.perf_counter() - clock)

    jobs = {}
    for size in SIZES:
        system, steps = ensemble("double", range(size)), -(-WORK // (BLOCK * size)) * BLOCK

        def measure(q, v, system=system):
            return c.rod_errors(system, q), c.energy(system, q, v)

        for what, asked, block in ("alone", None, steps), ("measured", measure, BLOCK):
            many = crowd(system, "semi_implicit", "none", DT, asked)
            jobs[size, what] = partial(pace, many, steps, block)
    rows, bars = {size: {"seeds in step": size} for size in SIZES}, []
    for (size, what), samples in in_turns(jobs, repeats).items():
        rows[size] |= spread([size * sample for sample in samples], what)
        if size == 1000 and NATIVE:
            bars.append((f"a thousand, {what}: us a step", 1 / rows[size][what], 1 / LEAST[what]))
    return "(a) million steps a second, semi_implicit none", list(rows.values()), bars


def ordering(found):
    """A row: in how many seeds none drifts more than baumgarte, and over 3 times as much."""
    ratio = found["semi_implicit", "none"].rods / found["semi_implicit", "baumgarte"].rods
    row = {"seeds": len(ratio), "none > baumgarte": int((ratio > 1.0).sum())}
    row["over 3x"] = int((ratio > 3.0).sum())
    return row | {"least": ratio.min(), "median": np.median(ratio), "largest": ratio.max()}


def fates(found):
    """A row a run: what became of rods and energy, and how far the tips have spread at the end."""
    rows = []
    for (rule, mode), ends in found.items():
        row = {"run": f"{rule} {mode}", "rods m": np.median(ends.rods), "worst": ends.rods.max()}
        row |= {"energy gained": np.median(ends.gained)}
        rows.append(row | {"tips spread m": np.sqrt(np.var(ends.tip, axis=0).sum())})
    return rows


def growth(system, skip, span, dt):
    """Rates (R, K) in 1/s at which each member and a neighbour part.

    G. Benettin, L. Galgani, J.-M. Strelcyn, Phys. Rev. A 14 (1976) 2338: every RENEW s the
    neighbour is put back to the distance CLOSE in (q, T v), T^2 = sum L / g, where it has gone to,
    and its gain noted, after `skip` seconds. Both start a turn on the rods, by `project` (dt = inf:
    v is not told of the move), and stay in the x-y plane.
    """
    q, v, rates = system["q0"], system["v0"], []
    unit = math.sqrt(system["lengths"].sum() / G)
    away = np.random.default_rng(0).standard_normal((2, *q.shape)) * [1.0, 1.0, 0.0]
    steps = crowd(system | {"q0": q + away[0]}, "rk4", 0.0, dt)
    size = np.ones(len(q))
    for _ in range(round((skip + span) / RENEW)):
        near = away * (CLOSE / size)[:, None, None]
        both = np.concatenate([q, q + near[0]]), np.concatenate([v, v + near[1] / unit])
        steps.put(*c.project(system, both[0], *both, math.inf))
        steps.advance(round(RENEW / dt))
        q, v = (x.reshape(2, -1, *x.shape[1:]) for x in steps.states())
        away, q, v = np.stack([q[1] - q[0], unit * (v[1] - v[0])]), q[0], v[0]
        size = np.sqrt(np.sum(c.dot(away, away), axis=(0, -1)))
        rates.append(np.log(size / CLOSE) / RENEW)
    return np.array(rates[round(skip / RENEW) :]).T


def standard_error(samples):
    """Of the mean of independent samples: their standard deviation, by n - 1, over sqrt(n)."""
    return np.std(samples, ddof=1) / math.sqrt(len(samples))


def parting(quick):
    """(c) A row a case, with standard errors: the system at two steps, then two whose exponent is
    known, to trust it by."""
    pairs, skip, span, fine = (20, 5.0, 10.0, 2 * FINE) if quick else (PAIRS, SKIP, SPAN, FINE)
    chaotic, single = ensemble("double", range(pairs)), ensemble("pendulum", range(20))
    upright = ensemble("double", range(20))
    upright["q0"][:] = [[0.0, 1, 0], [0.0, 2, 0]]
    # upright, angles'' = g/L [[2, -1], [-2, 2]] angles
    top = math.sqrt((2.0 + math.sqrt(2.0)) * G)
    # of single pendulums the periods differ, so neighbours part as t: ln(t)/t, on its way to 0
    shear, rows = math.log((skip + span) / skip) / span, []
    for what, start, known, *settings in (
        ("double", chaotic, "?", skip, span, fine),
        ("double", chaotic, "?", skip, span, 2 * fine),
        ("upright double", upright, top, 5.0, 5.0, fine),
        ("pendulum", single, shear, skip, span, fine),
    ):
        members = growth(start, *settings).mean(axis=1)
        row = {"pairs of": what, "pairs": len(members), "dt": settings[-1], "1/s": members.mean()}
        rows.append(row | {"+-": standard_error(members), "known": known})
    return rows


def main(argv=None):
    """Ask and print."""
    parser = study_parser("chaos", __doc__, timed=True)
    parser.add_argument("--seeds", type=number(int, 2, 10**6), default=1000, help="so many (1000)")
    args = parser.parse_args(argv)
    seconds = SECONDS / 4 if args.quick else SECONDS
    steps, after = round(seconds / DT), f"{seconds:g} s"
    host(seeds=args.seeds, steps=steps, dt=DT)
    show(*speed(1 if args.quick else REPEATS))
    system = ensemble("double", range(args.seeds))
    found = {run: follow(system, *run, steps) for run in RUNS}
    show(f"(b) worst rod error in {after}, none over baumgarte", [ordering(found)])
    show(f"and after {after}: medians, and worst; energy as a share of m g L", fates(found))
    show("(c) the largest Lyapunov exponent, rk4", parting(args.quick))


if __name__ == "__main__":
    run_script(main)
