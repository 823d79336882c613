"""The truth to measure against: gauss at two steps, whose difference is its own error. And the step
for an error."""

import math
import sys
from functools import partial
from typing import NamedTuple

from curriculum.ch3_4_constraints import large
from curriculum.common.gauss import make_gauss
from curriculum.common.motion import distance

import numpy as np

SECONDS = 2.0  # when the truth is taken, before chaos decides
BUDGET, EACH = (
    5000,
    5,
)  # steps of gauss it may cost, times rods, and how many rods a step costs anyway: a second or so
KNOWN = 1e-9  # m: it is known that well or not at all
LADDER = (0.05, 0.025, 0.0125, 0.00625)  # s


class Truth(NamedTuple):
    """Where the particles are at a step: q (N, 3), known to so many m; (None, inf) if they are not
    known."""

    step: int
    q: np.ndarray | None = None
    known: float = math.inf


class Metered:
    """A rule that may be asked for so many steps, halves included, and then stops the run."""

    def __init__(self, rule, most):
        self.rule, self.left, self.halves = rule, most, rule.halves

    def __call__(self, q, v, m, force, dt):
        self.left -= 1
        if self.left < 0:
            raise ValueError("the ruler's budget is spent")
        return self.rule(q, v, m, force, dt)


def true_position(run, seconds, most=math.inf):
    """q (N, 3) after `seconds`, and by how many m two steps of gauss differ.

    (None, inf) if that is over KNOWN, or not found within `most` steps. run(rule, dt, steps) ->
    Run.
    """
    rule, before = Metered(make_gauss(), most), None
    for longest in LADDER:
        steps = math.ceil(seconds / longest)
        if steps + (before is None) * 2 * steps > rule.left:  # two are needed
            break
        found = run(rule, seconds / steps, steps)
        q = None if found.stopped else found.q[-1]
        if q is not None and before is not None and (gap := distance(q, before)) < KNOWN:
            return q, gap
        before = q
    return None, math.inf


def step_for(tol, seconds, q, runs):
    """A rule of gauss and a step with which the best of `runs` is within `tol` m of q (N, 3) after
    `seconds`.

    Or as near as it gets. A stage a digit, and the largest step that will do: stages cost an array
    little, steps a lot.
    """
    rule = make_gauss(max(4, round(-math.log10(tol))), 4, min(0.1 * tol, 1e-3))
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


def settle(simulate, case, modes, rule, dt, steps, tol):
    """The rule, step and number of steps to run with, and the Truth; with `tol` m, gauss finds rule
    and step.

    simulate(*case(mode, rule, dt), steps) -> Run, where a case is a step, a system, a force, dt.
    Exits with a line if the truth is wanted and not to be had.
    """

    def run(mode, rule, dt, steps):
        return simulate(*case(mode, rule, dt), steps)

    at, seconds = dt * max(1, min(steps, round(SECONDS / dt))), steps * dt
    system = case(modes[0], rule, dt)[1]
    most = 0 if large.takes(system) else BUDGET // (len(system["pairs"]) + EACH)
    truth = true_position(partial(run, "project"), at, most)
    if tol and not truth[1] < tol:
        place = f"where the particles are after {at:.3g} s is not known to {tol:g} m"
        print(f"constraints.py: error: argument --tol: {place}; give --dt", file=sys.stderr)
        sys.exit(2)
    if tol:
        rule, dt = step_for(tol, at, truth[0], [partial(run, mode) for mode in modes])
    return rule, dt, math.ceil(seconds / dt - 1e-9), Truth(round(at / dt), *truth)
