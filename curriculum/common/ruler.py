"""The truth to measure against, gauss at two steps that agree; and the step for an error."""

import math
from argparse import ArgumentTypeError
from itertools import takewhile
from typing import NamedTuple

from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.runs import distance

import numpy as np

SECONDS = 2.0  # when the truth is taken, before chaos decides
KNOWN = 1e-9  # m: it is known that well or not at all
FRAME, LONG, SEEN = 0.05, 5.0, 1e-3  # s, s, m: the true motion as it is shown
LADDER = 0.05, 0.03, 0.018, 0.011, 0.0066  # s


class Truth(NamedTuple):
    """Where the particles are at a step: q (N, 3), known to so many m; (None, inf) if not known."""

    step: int
    q: np.ndarray | None = None
    known: float = math.inf
    sought: bool = True


def once_for_all():
    """A way for simulate by which a rule is traced and compiled once, for steps of all lengths."""
    made = []  # at the first run

    def way(step_fn, m, force, dt, measure, steps):
        if not made:
            made.append(Compiled(step_fn, m, force, dt, measure, check=False))
        made[0].start(dt, steps)
        return made[0]

    return way


def rungs(seconds):
    """Ever larger numbers of steps; odd ones, so that halves of two are never the same steps."""
    counts = [-1]
    for longest in LADDER:
        counts.append(max(counts[-1] + 2, math.ceil(seconds / longest) | 1))
    return counts[1:]


def true_position(run, seconds, most=math.inf):
    """q (N, 3) after `seconds`, and by how many m two steps of gauss differ.

    (None, inf) if that is over KNOWN, or not found within `most` steps.
    run(rule, dt, steps, way) -> Run.
    """
    rule, before, way, counts = make_gauss(6), None, once_for_all(), rungs(seconds)
    if sum(counts[:2]) > most:  # one alone agrees with nothing
        return None, math.inf
    for steps in counts:
        if steps > most:
            break
        found = run(rule, seconds / steps, steps, way=way)
        most -= steps
        q = None if found.stopped else found.q[-1]
        if q is not None and before is not None and (gap := distance(q, before)) < KNOWN:
            return q, gap
        before = q
    return None, math.inf


def true_motion(run, rule, seconds):
    """(times (T,) in s, q (T, N, 3)): the true motion, while two steps of a rule agree to SEEN.

    One frame every FRAME s, for LONG s at most; None if it is not known at all.
    run(rule, dt, steps, keep, way) -> Run.
    """
    frames, found, way = round(min(seconds, LONG) / FRAME), [], once_for_all()
    if not frames:
        return None
    for fine in (4, 8):
        steps = fine * frames
        end = run(rule, FRAME / fine, steps, range(0, steps + 1, fine), way)
        found.append(end.every(fine)[0])
    agree = takewhile(lambda frame: distance(*frame) < SEEN, zip(*found, strict=False))
    q = [second for _, second in agree]
    return (FRAME * np.arange(len(q)), np.array(q)) if len(q) > 1 else None


def step_for(tol, seconds, q, runs):
    """A rule of gauss and a step with which the best of `runs` is within `tol` m of q (N, 3).

    That is after `seconds`; or as near as it gets. A stage a digit, and the largest step that will
    do. Each of runs: (rule, dt, steps) -> Run.
    """
    rule = make_gauss(max(4, round(-math.log10(tol))), 1e-3 * tol)
    steps, before = math.ceil(seconds / 0.16), math.inf
    while True:
        error, dt = math.inf, seconds / steps
        for run in runs:
            end = run(rule, dt, steps)
            error = error if end.stopped else min(error, distance(end.q[-1], q))
            if error <= tol:
                return rule, dt
        if 0.5 * before < error < math.inf or dt < 1e-4:
            return rule, dt
        steps, before = 2 * steps, error


def settle(runs, rule, dt, steps, tol, most):
    """The rule, step and number of steps to run with, and the Truth.

    With `tol` m, gauss finds rule and step. `most` steps may be spent on the truth, by the first of
    `runs`: (rule, dt, steps, ...) -> Run. ArgumentTypeError if `tol` is under what can be known.
    """
    at, seconds = dt * max(1, min(steps, round(SECONDS / dt))), steps * dt
    truth = true_position(runs[0], at, most)
    if tol and not truth[1] < tol:
        where = f"where the particles are after {at:.3g} s"
        raise ArgumentTypeError(f"{where} is not known to {tol:g} m; name a step instead")
    if tol:
        rule, dt = step_for(tol, at, truth[0], runs[1:])
    return (
        rule,
        dt,
        math.ceil(seconds / dt - 1e-9),
        Truth(round(at / dt), *truth, most >= sum(rungs(at)[:2])),
    )
