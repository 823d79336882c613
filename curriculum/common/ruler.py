"""The truth to measure against, gauss at two steps that agree; rule and step for an error."""

import math
from argparse import ArgumentTypeError
from functools import partial
from itertools import accumulate, pairwise, takewhile
from typing import NamedTuple

from curriculum.common.banner import work
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.runs import distance
from curriculum.common.steps import Plain
from curriculum.common.tape import Untraceable

import numpy as np

SECONDS = 2.0  # when the truth is taken, before chaos decides
KNOWN = 1e-9  # m: it is known that well or not at all
ROUNDING = 2.0**-52  # relative
WORSE = 4.0  # times as far: lengths and masses are rounded, too, and signs may be less kind
RODS = 40  # with more, finding the truth would take longer than the run
CLOSE = 1e-3  # of the longest rod: so well is the true motion known that is shown
FINE = 0.04  # s: the longest step of the true motion that is shown
HORIZON = 20.0  # s: so far it is sought first, and then twice as far as long as it is known
LADDER = 0.05, 0.03, 0.018, 0.011, 0.0066  # s
LONGEST, LEAST = 0.16, 1e-4  # s: between these `--tol` looks for a step
NEAR = 1e-2  # m: farther off than that, it is chance which is the nearest
LOOKS = 3  # states at which the forces of a step are counted


class Truth(NamedTuple):
    """Where the particles are at a step: q (N, 3), known to so many m; (None, inf) if not known.

    `unsought`: "" or, in words, that it was not looked for, and why it could not be.
    """

    step: int
    q: np.ndarray | None = None
    known: float = math.inf
    unsought: str = ""


class Plan(NamedTuple):
    """What is to be run: `steps` of `dt` s by the rule of this name, and the Truth beside it."""

    rule: str
    dt: float
    steps: int
    truth: Truth


def once_for_all(later=0):
    """A way for simulate that traces and compiles a rule once, for steps of all lengths.

    The force is that of the first run: it must not depend on dt, as that of `project` does not. A
    step that cannot be compiled is not run plainly, which would take too long: Untraceable.
    `later`: how many steps are to come behind the first run.
    """
    made = []  # at the first run

    def way(step_fn, m, force, dt, measure, steps):
        if not made:
            made.append(Compiled(step_fn, m, force, dt, measure, only=True, later=later))
        made[0].start(dt, steps)
        return made[0]

    return way


def truly(run, unsought=None, seconds=0.0):
    """(dt, steps, keep=(), nudge=False) -> Run, by gauss, compiled once for steps of all lengths.

    run(rule, dt, steps, keep, way, nudge) -> Run, of a `nudged` system if `nudge`. `unsought`: why
    it is not to be run, in words; then it raises Untraceable. `seconds` of it are to be shown.
    """

    def refuse(*_, **__):
        raise Untraceable(unsought)

    if unsought is not None:
        return refuse
    later = round(2.0 * min(seconds, HORIZON) / FINE)  # the true motion is found twice
    return partial(run, make_gauss(6), way=once_for_all(later))


def rungs(seconds):
    """Ever larger numbers of steps; odd ones, so that halves are never another's steps."""
    counts = [math.ceil(seconds / longest) | 1 for longest in LADDER]
    return list(accumulate(counts, lambda before, count: max(before + 2, count)))


def nudged(system):
    """The system, its start changed by a rounding, one entry up and the next down."""
    turns = np.arange(system["q0"].size).reshape(system["q0"].shape) % 2
    off = 1.0 + ROUNDING * (1.0 - 2.0 * turns)
    return system | {"q0": system["q0"] * off, "v0": system["v0"] * off}


def true_position(true_run, seconds):
    """q (N, 3) after `seconds`, and to how many m it is known: (None, inf) if to less than KNOWN.

    That is how far two steps of gauss differ or, if that is more, WORSE times as far as two starts
    that a rounding parts. `true_run` is made by `truly`. Raises Untraceable.
    """

    def end(steps, nudge=False):  # not a number where a run stops
        found = true_run(seconds / steps, steps, nudge=nudge)
        return found.q[-1] * (math.nan if found.stopped else 1.0)

    for (fewer, before), (_, q) in pairwise((steps, end(steps)) for steps in rungs(seconds)):
        if distance(q, before) < KNOWN:
            apart = WORSE * distance(end(fewer, nudge=True), before)
            known = float(np.maximum(distance(q, before), apart))
            return (q, known) if known < KNOWN else (None, math.inf)
    return None, math.inf


def true_motion(true_run, system, dt, shown, truth):
    """q (T, N, 3): the true motion at the steps (F,) of `dt` s that are `shown`, while it is known.

    Two steps of gauss agree that long to CLOSE of the longest rod. It is not sought where the Truth
    is not. `shown`: multiples of the first that is not 0. `true_run` is made by `truly`.
    """
    if len(shown) < 2 or truth.unsought:
        return np.array([])
    work.begin("the true motion")
    close = CLOSE * np.max(system["lengths"])
    every, frames = shown[1], len(shown)
    parts = math.ceil(every * dt / FINE)  # of the time between two frames
    last = math.ceil(HORIZON / (every * dt))  # the frame up to which it is sought
    while True:
        seen = shown[shown <= last * every]
        found = []
        for fine in (parts, parts + 1):
            keep = seen // every * fine
            end = true_run(every * dt / fine, keep[-1], keep)
            found.append(end.q[np.isin(end.kept, keep)])
        agree = takewhile(lambda pair: distance(*pair) < close, zip(*found, strict=False))
        q = np.array([finer for _, finer in agree])
        if len(q) < len(seen) or len(seen) == frames:
            return q if len(q) > 1 else np.array([])  # the start alone is no motion
        last *= 2


def cost(run, rule, dt, states):
    """How many forces a step of a rule asks for: the mean over steps that begin at `states`."""
    asked = []

    def counted(q, v, m, force, dt):
        def ask(q, v):
            asked.append(1)
            return force(q, v)

        for state in states:
            rule(*state, m, ask, dt)
        return q, v

    run(counted, dt, 1, way=Plain)  # so that the count is the same on every machine
    return len(asked) / len(states)


def finer(seconds):
    """Numbers of steps that `seconds` are parted in: by half as many again, and then twice."""

    def more(steps):
        while True:
            yield from ((3 * steps + 1) // 2, 2 * steps)
            steps *= 2

    first = math.ceil(seconds / LONGEST)
    yield first
    yield from takewhile(lambda steps: seconds / steps >= LEAST, more(first))


def climb(tol, seconds, q, runs, rule):
    """The largest step of a rule with which the best of `runs` is within `tol` m of q (N, 3).

    (error in m, step in s, (run, states on its way)) or, where no step of LEAST s or more is near
    enough, what came nearest, and None; its error is infinite if no run got to the end. Steps that
    are taken in halves are no steps to choose.
    """
    tried = []
    for steps in finer(seconds):
        dt, off, near = seconds / steps, [], math.inf
        for run in runs:
            end = run(rule, dt, steps, range(0, steps, -(-steps // LOOKS)))
            gap = math.inf if end.stopped else distance(end.q[-1], q)
            near = min(near, gap)
            off.append(math.inf if end.halved else gap)
            if off[-1] <= tol:
                return off[-1], dt, (run, list(zip(end.q[:-1], end.v[:-1], strict=True)))
        error = min(off)
        tried.append((error, dt, None))
        errors, idle = [error for error, *_ in tried], 2 if near < NEAR else 4
        if 0.5 * min(errors[:-idle], default=math.inf) < min(errors[-idle:]) < math.inf:
            break  # so many finer steps have gained nothing
        if near < NEAR:
            # each run costs a compiled step, so only the nearest goes on, and those not there yet
            runs = [run for run, x in zip(runs, off, strict=True) if x in (error, math.inf)]
    return min([(math.inf, seconds, None), *tried], key=lambda row: row[0])


def step_for(tol, seconds, q, runs, rules):
    """The name of one of `rules`, {name: rule}, and a step in s: the cheapest that will do.

    With it the best of `runs` is within `tol` m of q (N, 3) after `seconds`, or as near as any of
    them gets. A cheap one asks for few forces. Each of runs: (rule, dt, steps, keep, way) -> Run.
    """
    found = []
    for name, rule in rules.items():
        error, dt, reached = climb(tol, seconds, q, runs, rule)
        forces = 0.0
        if reached and len(rules) > 1:
            run, states = reached
            forces = cost(run, rule, dt, states) / dt
        found.append((max(error, tol), forces, name, dt))
    error, _, name, dt = min(found, key=lambda row: row[:2])
    if error == math.inf:
        why = f"no mode gets through {seconds:.3g} s whole, in steps of {LEAST:g} s or more"
        raise ArgumentTypeError(f"{why}; name a step instead")
    return name, dt


def settle(true_run, runs, rules, dt, steps, tol):
    """The Plan of a run of `steps` of `dt` s. Its Truth is found by `true_run`, made by `truly`.

    The rule is the first of `rules`, {name: rule}; or, with a `tol` in m, rule and step are those
    that step_for finds among `runs`. ArgumentTypeError if `tol` is under what can be known.
    """
    work.begin("the truth")
    at, seconds = dt * max(1, min(steps, round(SECONDS / dt))), steps * dt
    q, known, unsought = None, math.inf, ""
    try:
        q, known = true_position(true_run, at)
    except Untraceable as why:
        unsought = f"not looked for: {why}"
    if tol is not None and not known < tol:
        where = f"{tol:g} m cannot be judged: where the particles are after {at:.3g} s"
        missed = unsought or "not known so well"
        raise ArgumentTypeError(f"{where} is {missed}; name a step instead")
    name = next(iter(rules))
    if tol is not None:
        name, dt = step_for(tol, at, q, runs, rules)
    truth = Truth(round(at / dt), q, known, unsought)
    return Plan(name, dt, math.ceil(seconds / dt - 1e-9), truth)
