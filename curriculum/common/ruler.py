"""The truth to measure against, gauss at two steps that agree; and the step for an error."""

import math
from argparse import ArgumentTypeError
from itertools import takewhile
from typing import NamedTuple

from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.midpoint import make_midpoint
from curriculum.common.runs import distance

import numpy as np

SECONDS = 2.0  # when the truth is taken, before chaos decides
KNOWN = 1e-9  # m: it is known that well or not at all
FINE = 0.02  # s: the longest step of the true motion that is shown
HORIZON = 20.0  # s: so far it is sought first, and then twice as far as long as it is known
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


def true_motion(run, dt, shown, close):
    """q (T, N, 3): the true motion at the steps (F,) of `dt` s that are `shown`, while it is known.

    It is known while two steps of midpoint agree to `close` m. `shown`: multiples of the first
    that is not 0. run(rule, dt, steps, keep, way) -> Run.
    """
    if len(shown) < 2:
        return np.array([])
    rule, way, every, frames = make_midpoint(8), once_for_all(), shown[1], len(shown)
    parts = math.ceil(every * dt / FINE)
    parts = parts, parts + 1  # of the time between two frames
    last = math.ceil(HORIZON / (every * dt))  # the frame up to which it is sought
    while True:
        seen = shown[shown <= last * every]
        found = []
        for fine in parts:
            keep = seen // every * fine
            end = run(rule, every * dt / fine, keep[-1], keep, way)
            found.append(end.q[np.isin(end.kept, keep)])
        agree = takewhile(lambda pair: distance(*pair) < close, zip(*found, strict=False))
        q = np.array([finer for _, finer in agree])
        if len(q) < len(seen) or len(seen) == frames:
            return q
        last *= 2


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
