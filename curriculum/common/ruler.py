"""The truth to measure against: gauss at two steps, whose difference is its own error. And the step for an error."""

import math
import sys
from functools import partial
from typing import NamedTuple

from curriculum.common.gauss import make_gauss
from curriculum.common.motion import distance

import numpy as np

SECONDS, RODS = 2.0, 30  # when the truth is taken, before chaos decides, and for scenes of how many rods
FAR = 10.0  # s: where the first step ends later than that, it is not
KNOWN = 1e-9  # m: it is known that well or not at all
LADDER = (0.05, 0.025, 0.0125, 0.00625)  # s


class Truth(NamedTuple):
    """Where the particles are at a step: q (N, 3), known to so many m; (None, inf) if they are not known."""

    step: int
    q: np.ndarray | None = None
    known: float = math.inf


def true_position(run, seconds):
    """q (N, 3) after `seconds`, and by how many m two steps of gauss differ; (None, inf) if by over KNOWN.

    run(rule, dt, steps) -> Run.
    """
    before = None
    for longest in LADDER:
        steps = math.ceil(seconds / longest)
        found = run(make_gauss(), seconds / steps, steps)
        q = None if found.stopped else found.q[-1]
        if q is not None and before is not None and (gap := distance(q, before)) < KNOWN:
            return q, gap
        before = q
    return None, math.inf


def step_for(tol, seconds, q, runs):
    """A rule of gauss and a step with which the best of `runs` is within `tol` m of q (N, 3) after `seconds`.

    Or as near as it gets. A stage a digit, and the largest step that will do: stages cost an array little, steps a lot.
    """
    rule = make_gauss(max(4, round(-math.log10(tol))), 4, min(0.1 * tol, 1e-3))
    steps, before = math.ceil(seconds / 0.16), math.inf
    while True:
        ends = [run(rule, seconds / steps, steps) for run in runs]
        error = min(math.inf if end.stopped else distance(end.q[-1], q) for end in ends)
        if error <= tol or 0.5 * before < error < math.inf or seconds / steps < 1e-4:
            return rule, seconds / steps
        steps, before = 2 * steps, error


def settle(simulate, case, modes, rule, dt, steps, tol):
    """The rule, step and number of steps to run with, and the Truth; with `tol` m, gauss finds rule and step.

    simulate(*case(mode, rule, dt), steps) -> Run, where a case is a step, a system, a force, dt. Exits with a line if
    the truth is wanted and not to be had.
    """

    def run(mode, rule, dt, steps):
        return simulate(*case(mode, rule, dt), steps)

    at, seconds = dt * max(1, min(steps, round(SECONDS / dt))), steps * dt
    rods = len(case(modes[0], rule, dt)[1]["pairs"])
    truth = true_position(partial(run, "project"), at) if rods <= RODS and at <= FAR else ()
    if tol and not (truth and truth[1] < tol):
        place = f"where the particles are after {at:.3g} s is not known to {tol:g} m"
        print(f"constraints.py: error: argument --tol: {place}; give --dt", file=sys.stderr)
        sys.exit(2)
    if tol:
        rule, dt = step_for(tol, at, truth[0], [partial(run, mode) for mode in modes])
    return rule, dt, math.ceil(seconds / dt - 1e-9), Truth(round(at / dt), *truth)
