"""What can a thousand seeds say that one cannot?  Tables of the double pendulum.

(a) How fast do many seeds go in step?  (b) In how many does the drift ordering hold, and what does
drift make of the crowd?  (c) How fast do neighbours part: the largest Lyapunov exponent?
(d), with --peers: how long do a thousand take for 5 s, to the same error of the worst of them,
beside heyoka's batch mode, with `fast_math`, and MuJoCo's rollout, in joint angles, on one core?
"""

import math
import timeit
from collections import namedtuple
from functools import partial
from importlib.util import find_spec

import constraints as c
from curriculum.ch3_4_constraints.studies import _peers as peers
from curriculum.ch3_4_constraints.studies import _runs, real_thing
from curriculum.ch3_4_constraints.tables import in_turns, show, spread
from curriculum.common.cli import number
from curriculum.common.crowds import mapped
from curriculum.common.progress import work
from curriculum.common.runs import distance

import numpy as np

DT, SECONDS = 0.005, 20.0  # s, of (a) and (b)
RUNS = ("semi_implicit", "none"), ("semi_implicit", "baumgarte"), ("rk4", "none")
CROWD, WORK, REPEATS = 1000, 4_000_000, 5  # members timed, steps of all of them, how often
LEAST = {"alone": 120.0, "measured": 50.0}  # million steps a second: the bars
BLOCK = 256  # steps a call, which costs as much as some of them
CLOSE, RENEW = 1e-7, 0.5  # m, s: see `growth`
LONG, ERRORS = 5.0, (1e-3, 1e-6, 1e-9, 1e-12)  # of (d): s, m
PATIENCE = 1e-6  # m: to a smaller error a run of MuJoCo takes 20 s or more
PAIRS, SKIP, SPAN, FINE = 500, 20.0, 200.0, 0.0025  # neighbours, s, s, and rk4's step in s

# What a run came to, an entry a member: its worst rod error in m; the energy it has gained, as a
# share of m g L; where its tip (R, 3) ended, in m.
Ends = namedtuple("Ends", "rods gained tip")


def ensemble(name, seeds):
    """The system `name` with q0, v0 (R, N, 3), a start for each of `seeds`, as build_system's."""
    drawn = (c.build_system(name, seed) for seed in seeds)
    q0, v0 = np.stack([(system["q0"], system["v0"]) for system in drawn], axis=1)
    return c.build_system(name) | {"q0": q0, "v0": v0}


def follow(system, rule, mode, steps):
    """The Ends of a run whose rods are measured at every step."""
    many = _runs.crowd(system, rule, mode, DT, lambda q, v: [np.abs(c.rod_errors(system, q))])
    rods, name = 0.0, f"{len(system['q0'])} seeds, {rule} {mode}"
    for done in work.through(name, range(0, steps, BLOCK)):
        rods = np.maximum(rods, many.advance(min(BLOCK, steps - done)).max(axis=0))
    q, v = many.states()
    joules = mapped(partial(c.energy, system))
    gained = joules(q, v) - joules(system["q0"], system["v0"])
    return Ends(rods, gained / _runs.energy_scale(system), q[:, -1])


def speed(whole, repeats):
    """(a) A row of how fast a thousand go, `whole` steps in all, and what they must reach."""
    system, steps = ensemble("double", range(CROWD)), -(-whole // CROWD)

    def measure(q, v):  # of each the largest over all steps: how far rods and energy ever are off
        joules = c.energy(system, q, v)
        return np.abs(c.rod_errors(system, q)), joules, -joules

    def pace(many):
        return 1e-6 * steps * CROWD / timeit.timeit(partial(many.advance, steps), number=1)

    jobs, row, bars = {}, {"seeds": CROWD}, []
    for what, asked in {"alone": None, "measured": measure}.items():
        jobs[what] = partial(pace, _runs.crowd(system, *RUNS[0], DT, asked))
    for what, samples in in_turns(jobs, repeats).items():
        row |= spread(samples, what)
        if _runs.NATIVE:
            bars.append((f"{what}: us a step", 1 / row[what], 1 / LEAST[what]))
    return "(a) million steps a second, semi_implicit none", [row], bars


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
        row["energy gained"] = np.median(ends.gained)
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
    unit = math.sqrt(system["lengths"].sum() / _runs.G)
    away = np.random.default_rng(0).standard_normal((2, *q.shape)) * [1.0, 1.0, 0.0]
    steps = _runs.crowd(system | {"q0": q + away[0]}, "rk4", 0.0, dt)
    onto_rods = mapped(lambda q, v: c.project(system, q, q, v, math.inf))
    size, turns = np.ones(len(q)), range(round((skip + span) / RENEW))
    for _ in work.through(f"neighbours, steps of {dt:g} s", turns):
        near = away * (CLOSE / size)[:, None, None]
        both = np.concatenate([q, q + near[0]]), np.concatenate([v, v + near[1] / unit])
        steps.put(*onto_rods(*both))
        steps.advance(round(RENEW / dt))
        q, v = (x.reshape(2, -1, *x.shape[1:]) for x in steps.states())
        away, q, v = np.stack([q[1] - q[0], unit * (v[1] - v[0])]), q[0], v[0]
        size = np.sqrt(np.sum(away * away, axis=(0, 2, 3)))
        rates.append(np.log(size / CLOSE) / RENEW)
    return np.array(rates[round(skip / RENEW) :]).T


def standard_error(samples):
    """Of the mean of independent samples: their standard deviation, by n - 1, over sqrt(n)."""
    return np.std(samples, ddof=1) / math.sqrt(len(samples))


def beside():
    """(d) Print a table and bars for each error: how long each engine takes for the crowd to it."""
    system = ensemble("double", range(CROWD))
    true = _runs.crowd(system, "gauss:12", "none", LONG / 160)
    true.advance(160)
    task = _runs.Task(system, 1, LONG, partial(distance, true.states()[0][..., :2]))
    for error in ERRORS:
        racers = {}
        if find_spec("heyoka"):
            racers[real_thing.FAST] = [real_thing.taylor_ladder(peers.heyoka_crowd, task)]
        if find_spec("mujoco") and error >= PATIENCE:
            low = 140 * (ERRORS[0] / error) ** 0.25  # steps: its rule is of order 4
            ladder = real_thing.steps_ladder(peers.hinges, task, low, 1.4 * low)
            racers[real_thing.HINGES] = [ladder]
        limits = [(real_thing.OURS, engine, 1.0) for engine in racers]
        names = real_thing.offered(error)
        climbs = [real_thing.steps_ladder(peers.our_crowd, task, 8, 400, name) for name in names]
        racers[real_thing.OURS if _runs.NATIVE else real_thing.PYTHON] = climbs
        title = f"(d) {CROWD} double pendulums, {LONG:g} s, one core, to an error of {error:.0e} m"
        show(title, *real_thing.race(task, racers, error, limits))


def main(argv=None):
    """Ask and print."""
    quick = {"seeds": 100, "whole": WORK // 10, "repeats": 1, "pairs": 20, "span": 20.0}
    usual = {"whole": WORK, "repeats": REPEATS, "pairs": PAIRS, "span": SPAN}
    parser = _runs.study_parser("chaos", __doc__, quick, **usual)
    parser.add_argument("--seeds", type=number(int, 2, 10**6), default=1000, help="so many (1000)")
    parser.add_argument("--peers", action="store_true", help="(d) alone")
    args = parser.parse_args(argv)
    if args.peers:
        _runs.host(seeds=CROWD, repeats=real_thing.REPEATS, **real_thing.engines())
        beside()
        return
    seeds = args.seeds
    steps, after = round(SECONDS / DT), f"{SECONDS:g} s"
    _runs.host(seeds=seeds, steps=steps, dt=DT)
    show(*speed(args.whole, args.repeats))
    system = ensemble("double", range(seeds))
    found = {run: follow(system, *run, steps) for run in RUNS}
    show(f"(b) worst rod error in {after}, none over baumgarte", [ordering(found)])
    show(f"and after {after}: medians, and worst; energy as a share of m g L", fates(found))
    system, rows = ensemble("double", range(args.pairs)), []
    for dt in (FINE, 2.0 * FINE):
        rates = growth(system, SKIP, args.span, dt).mean(axis=1)
        row = {"pairs": args.pairs, "dt": dt, "1/s": rates.mean(), "+-": standard_error(rates)}
        rows.append(row)
    show("(c) the largest Lyapunov exponent, rk4", rows)
