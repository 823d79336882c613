"""The aim of a run: the truth beside it and, for an error that is asked for, its rule and step."""

import math
from argparse import ArgumentTypeError
from functools import partial
from typing import NamedTuple

from curriculum.common.compiled import Compiled
from curriculum.common.progress import work
from curriculum.common.ruler import ENOUGH, LADDER, Truth, more_parts, once_for_all, true_position
from curriculum.common.runs import distance
from curriculum.common.steps import Plain
from curriculum.common.tape import Untraceable

SECONDS = 2.0  # s, when the truth is taken: before chaos decides
LONGEST, LEAST = 0.16, 1e-4  # s: between these `--tol` looks for a step
NEAR = 1e-2  # m: farther off than that, it is chance which is the nearest
LOOKS = 3  # states at which the forces of a step are counted


class Plan(NamedTuple):
    """What is to be run: `steps` of `dt` s by the rule of this name, and the Truth beside it."""

    rule: str
    dt: float
    steps: int
    truth: Truth


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


def finer(seconds, least):
    """Numbers of steps of `least` s or more in `seconds`: half as many again, and then twice."""
    steps = math.ceil(seconds / LONGEST)
    yield steps
    while True:
        for more in (more_parts(steps), 2 * steps):
            if seconds / more < least:
                return
            yield more
        steps *= 2


def promising(errors, dt):
    """Whether steps finer than dt may be nearer: `errors` in m so far, of ever finer ones.

    Of those that are NEAR the two last must be half the worst of the three before: one of these may
    be small by chance. Others tell nothing, but the truth was found by steps that are no shorter.
    """
    near = [error for error in errors if error <= NEAR]
    if not errors[-1] <= NEAR:
        return dt >= LADDER[-1]
    return len(near) < 5 or max(near[-2:]) < 0.5 * max(near[-5:-2])


def climb(tol, seconds, q, runs, rule, least=LEAST):
    """The largest step of a rule with which the best of `runs` is within `tol` m of q (N, 3).

    (error in m, step in s, (run, states on its way)) or, where no step of `least` s or more is near
    enough, what came nearest, and None; its error is infinite if no run got to the end. Steps that
    are taken in halves are no steps to choose.
    """
    ways = {run: once_for_all(partial(Compiled, halvings=0)) for run in runs}
    errors, tried = {run: [] for run in runs}, []
    for steps in finer(seconds, least):
        dt = seconds / steps
        for run in runs:
            end = run(rule, dt, steps, range(0, steps, -(-steps // LOOKS)), ways[run])
            error = math.inf if end.stopped else distance(end.q[-1], q)
            if error <= tol:
                return error, dt, (run, list(zip(end.q[:-1], end.v[:-1], strict=True)))
            errors[run].append(error)
            tried.append((error, dt, None))
        runs = [run for run in runs if promising(errors[run], dt)]
    return min(tried, key=lambda row: row[0])


def step_for(tol, seconds, q, runs, rules):
    """The name of one of `rules`, {name: rule}, and a step in s: the cheapest that will do.

    With it the best of `runs` is within `tol` m of q (N, 3) after `seconds`, or as near as any of
    them gets. A cheap one asks for few forces. Each of runs: (rule, dt, steps, keep, way) -> Run.
    """
    found, best, least = [], None, LEAST
    for name, rule in rules.items():
        if best:  # with shorter steps it asks for more than the best, though iterations get shorter
            run, dt, states, forces = best
            least = max(LEAST, 0.5 * cost(run, rule, dt, states) / forces)
        error, dt, reached = climb(tol, seconds, q, runs, rule, least)
        forces = 0.0
        if reached and len(rules) > 1:
            run, states = reached
            forces = cost(run, rule, dt, states) / dt  # a second
            if best is None or forces < best[3]:
                best = run, dt, states, forces
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
    q, uncertainty, unsought = None, math.inf, ""
    try:
        q, uncertainty = true_position(true_run, at, min(ENOUGH, tol or ENOUGH))
    except Untraceable as why:
        unsought = f"not looked for: {why}"
    if tol is not None and not uncertainty < tol:
        where = f"{tol:g} m cannot be judged: where the particles are after {at:.3g} s"
        missed = unsought or "not known so well"
        raise ArgumentTypeError(f"{where} is {missed}; name a step instead")
    name = next(iter(rules))
    if tol is not None:
        name, dt = step_for(tol, at, q, runs, rules)
    truth = Truth(round(at / dt), q, uncertainty, unsought)
    return Plan(name, dt, math.ceil(seconds / dt - 1e-9), truth)
