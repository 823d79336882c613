"""The truth to measure against, at two steps that agree; rule and step for an error."""

import math
from argparse import ArgumentTypeError
from functools import partial
from itertools import accumulate, pairwise, takewhile
from typing import NamedTuple

from curriculum.common import banner
from curriculum.common.compiled import Compiled
from curriculum.common.midpoint import make_midpoint
from curriculum.common.runs import distance
from curriculum.common.steps import Plain
from curriculum.common.tape import Untraceable

import numpy as np

ORDER = 8  # of the midpoint rule: of what knows as much, Python takes these steps the soonest
SECONDS = 2.0  # when the truth is taken, before chaos decides
KNOWN = 1e-9  # m: it is known that well or not at all
ENOUGH = 1e-11  # m: with less doubt, still finer steps are not tried
FALL = 0.05  # a rule of order 8 gains more from each rung of LADDER to the next
ROUNDING = 2.0**-52  # relative
WORSE = 4.0  # times as far: lengths and masses are rounded, too, and signs may be less kind
CLOSE = 1e-3  # of the longest rod: so well is the true motion known that is shown
FIRST, FINEST = 0.017, 1e-3  # s: between these are the steps of the true motion that is shown
MEET = 4  # of them go as far as one less, or fewer, of those that prove them first
GAIN = 1.1  # times as long: if finer steps know no more, still finer ones are not tried
WORK = 60_000  # rods times steps: with more, still finer steps take too long in Python
HORIZON = 20.0  # s: so far it is sought first, and then twice as far as it is known
LADDER = 0.05, 0.03, 0.018, 0.011, 0.0066, 0.004, 0.0024, 0.0015, 0.0009, 0.00055  # s
MOST = 20_000  # steps to where the truth is sought
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


def once_for_all(kind):
    """A way for simulate that traces and compiles a rule once, for steps of all lengths.

    So it is done again only where the force has another Hold. `kind`: what makes the stepper,
    Compiled or what is called like that. A number of a Hold may be an array, a number a rod.
    """
    made = []  # (Hold, stepper)

    def way(step_fn, m, force, dt, measure, steps):
        hold = getattr(force, "hold", [dt])  # a reader's own may have none
        stepper = next((x for other, x in made if all(map(np.array_equal, other, hold))), None)
        if stepper is None:
            stepper = kind(step_fn, m, force, dt, measure)
            made.append((hold, stepper))
        stepper.start(dt, steps)
        return stepper

    return way


def truly(run, unsought=None):
    """(dt, steps, keep=(), nudge=False) -> Run, by one rule, compiled once for all steps' lengths.

    run(rule, dt, steps, keep, way, nudge) -> Run, of a `nudged` system if `nudge`. `unsought`: why
    it is not to be run, in words; then it raises Untraceable, as where a step cannot be compiled:
    plain ones would take too long.
    """

    def refuse(*_, **__):
        raise Untraceable(unsought)

    if unsought is not None:
        return refuse
    way = once_for_all(partial(Compiled, only=True))
    return partial(run, make_midpoint(ORDER), way=way)


def rungs(seconds):
    """Ever larger numbers of steps, of MOST at most; odd ones, so that halves are never another's
    steps."""
    counts = [math.ceil(seconds / longest) | 1 for longest in LADDER if seconds <= MOST * longest]
    return list(accumulate(counts, lambda before, count: max(before + 2, count)))


def nudged(system):
    """The system, its start changed by a rounding, one entry up and the next down."""
    turns = np.arange(system["q0"].size).reshape(system["q0"].shape) % 2
    off = 1.0 + ROUNDING * (1.0 - 2.0 * turns)
    return system | {"q0": system["q0"] * off, "v0": system["v0"] * off}


def doubt(gaps):
    """How far off, in m, the last of ever finer runs may be, by the gaps between them.

    Two may meet by chance. So a gap counts for what it is only if the two before have shown how
    fast they fall; where they fall slowly, as behind a kink of the force, the two last count.
    """
    if len(gaps) > 2 and gaps[-1] < FALL * gaps[-2] < FALL * FALL * gaps[-3]:
        return FALL * gaps[-2]
    return 3.0 * float(np.max(gaps[-2:])) if len(gaps) > 1 else math.inf


def true_position(true_run, seconds, enough=ENOUGH):
    """q (N, 3) after `seconds`, and to how many m it is known: (None, inf) if to less than KNOWN.

    That is the `doubt` that ever finer steps leave or, if that is more, WORSE times as far as two
    starts that a rounding parts. They become finer until it is `enough`, or rounding allows no
    less. `true_run` is made by `truly`. Raises Untraceable.
    """

    def end(steps, nudge=False):  # not a number where a run stops
        found = true_run(seconds / steps, steps, nudge=nudge)
        return found.q[-1] * (math.nan if found.stopped else 1.0)

    apart, best, gaps = KNOWN, None, []
    for (fewer, before), (_, q) in pairwise((steps, end(steps)) for steps in rungs(seconds)):
        gaps.append(distance(q, before))
        off = doubt(gaps)
        if off < apart:
            apart, best = off, (fewer, before, q)
        if best and not enough < off <= apart:
            break
    if best is None:
        return None, math.inf
    fewer, before, q = best
    known = float(np.maximum(apart, WORSE * distance(end(fewer, nudge=True), before)))
    return (q, known) if known < KNOWN else (None, math.inf)


def more_parts(parts):
    """Half as many parts again, and three for one: never twice as many, since a step's halves would
    agree with them."""
    return max(3, (3 * parts + 1) // 2)


def true_motion(true_run, system, dt, shown, truth):
    """q (T, N, 3): the true motion at the steps (F,) of `dt` s that are `shown`, while it is known.

    Two steps agree that long to CLOSE of the longest rod. They become finer as long as that gains
    something. It is not sought where the Truth is not. `shown`: multiples of the first that is not
    0. `true_run` is made by `truly`.
    """
    if len(shown) < 2 or truth.unsought:
        return np.array([])
    banner.work.begin("the true motion")
    close = CLOSE * np.max(system["lengths"])
    seconds, frames = shown[1] * dt, len(shown)
    parted = shown // shown[1]  # (F,) how many times as far as the first is each; some are left out

    def sought(last, parts, each=1):  # {frame: q} up to the last: each so many, by so many steps
        there = np.flatnonzero(parted[: last + 1] % each == 0)
        keep = parted[there] // each * parts
        end = true_run(each * seconds / parts, keep[-1], keep)
        return dict(zip(there.tolist(), end.q[np.isin(end.kept, keep)], strict=False))

    def agreeing(coarse, fine, last, each):  # how many frames
        same = takewhile(lambda k: k in fine and distance(coarse[k], fine[k]) < close, coarse)
        *_, known = same
        whole = parted[last] - parted[known] < min(each, parted[last])  # no other is in both
        return len(fine) if whole else known + 1

    def frame(far):  # the last one that is no further than so many times the first
        return int(np.searchsorted(parted, far, side="right")) - 1

    work = len(system["pairs"]) / WORK  # of a step
    first = parts = math.ceil(seconds / FIRST)
    each, before = math.ceil(MEET / parts), 1  # frames that are long are all compared
    longer = (MEET - 1) * parts * each // MEET, each  # steps, and frames that they go
    last = max(1, frame(min(HORIZON / seconds, 1.0 / (work * parts))))
    coarse = sought(last, *longer)
    while True:
        fine = sought(last, parts)
        known = agreeing(coarse, fine, last, longer[1])
        further = min(frames - 1, max(known, frame(2 * parted[known - 1])))  # no need to look on
        idle = 1 < known < GAIN * before or seconds / parts < FINEST
        slow = work * parted[further] * more_parts(parts) > 1.0
        if known == frames or (known <= last and (idle or slow)):
            return np.array(list(fine.values())[:known]) if known > 1 else np.array([])
        if known <= last:
            before = known if parts > first else 1  # the first two steps are nearly as long
            coarse, longer, parts = fine, (parts, 1), more_parts(parts)
        if further > last:
            coarse = sought(further, *longer)
        last = further


def believed(true_run, system, plan, shown, runs):
    """The Plan, and the true_motion beside its Truth; no Truth where one of `runs` has found that
    what is compiled does something else than the lines, since it was found by such steps."""
    lies = [run.stepper.lies for run in runs if run.stepper.lies]
    if lies:
        plan = plan._replace(truth=Truth(plan.truth.step, unsought=f"not believed: {lies[0]}"))
    return plan, true_motion(true_run, system, plan.dt, shown, plan.truth)


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
    """Numbers of steps that `seconds` are parted in: by half as many again, and then twice. They
    are no shorter than `least` s."""
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
    banner.work.begin("the truth")
    at, seconds = dt * max(1, min(steps, round(SECONDS / dt))), steps * dt
    q, known, unsought = None, math.inf, ""
    try:
        q, known = true_position(true_run, at, min(ENOUGH, tol or ENOUGH))
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
