"""The truth to measure against: where particles are, by ever finer steps until two agree."""

import math
from functools import partial
from itertools import accumulate, pairwise, takewhile
from typing import NamedTuple

from curriculum.common.compiled import Compiled
from curriculum.common.midpoint import make_midpoint
from curriculum.common.progress import work
from curriculum.common.runs import distance
from curriculum.common.tape import Untraceable

import numpy as np

ORDER = 8  # of the midpoint rule: of what knows as much, Python takes these steps the soonest
KNOWN = 1e-9  # m: a place that is less certain counts as unknown
ENOUGH = 1e-11  # m: with less doubt, still finer steps are not tried
FALL = 0.05  # a rule of order 8 gains more from each rung of LADDER to the next
ROUNDING = 2.0**-52  # relative
WORSE = 4.0  # times as far: lengths and masses are rounded, too, and signs may be less kind
CLOSE = 1e-3  # of the longest rod: so well is the true motion known that is shown
FIRST, FINEST = 0.017, 1e-3  # s: between these are the steps of the true motion that is shown
MEET = 4  # of the first steps go as far as 3, or fewer, of the coarser ones that prove them
GAIN = 1.1  # times as long: if finer steps know no more, still finer ones are not tried
BUDGET = 60_000  # rods times steps: with more, still finer steps take too long in Python
HORIZON = 20.0  # s: so far it is sought first, and then twice as far as it is known
LADDER = 0.05, 0.03, 0.018, 0.011, 0.0066, 0.004, 0.0024, 0.0015, 0.0009, 0.00055  # s
MOST = 20_000  # steps to where the truth is sought


class Truth(NamedTuple):
    """Where the particles are at a step."""

    step: int
    q: np.ndarray | None = None  # (N, 3) m, if it is known
    uncertainty: float = math.inf  # m
    unsought: str = ""  # or, in words, that it was not looked for, and why it could not be


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

    run(rule, dt, steps, keep, way, nudge) -> Run, of a `nudged` system if `nudge`. Untraceable is
    raised where steps cannot be compiled: plain ones take too long; or where `unsought` says why.
    """

    def refuse(*_, **__):
        raise Untraceable(unsought)

    if unsought is not None:
        return refuse
    way = once_for_all(partial(Compiled, only=True))
    return partial(run, make_midpoint(ORDER), way=way)


def rungs(seconds):
    """Ever larger numbers of steps, of MOST at most; odd ones, so that none is twice another."""
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
    """q (N, 3) after `seconds`, and its uncertainty in m: (None, inf) if that is over KNOWN.

    It is the `doubt` that ever finer steps leave or, if that is more, WORSE times as far as two
    starts that a rounding parts. Steps become finer until it is `enough`, or rounding allows no
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
    apart = float(np.maximum(apart, WORSE * distance(end(fewer, nudge=True), before)))
    return (q, apart) if apart < KNOWN else (None, math.inf)


def more_parts(parts):
    """Half as many parts again, three for one; not twice as many: a step's halves are as short."""
    return max(3, (3 * parts + 1) // 2)


class Frames:
    """Runs to the frames of a motion: frame k is after `multiples`[k] times so many `seconds`.

    Frame 0 is the start and frame 1 the first multiple; of later multiples some are left out.
    """

    def __init__(self, true_run, seconds, multiples):
        self.true_run, self.seconds, self.multiples = true_run, seconds, multiples

    def at(self, multiple):
        """The last frame that is no later than a multiple."""
        return int(np.searchsorted(self.multiples, multiple, side="right")) - 1

    def places(self, last, steps, each=1):
        """{frame: q (N, 3)} up to the `last`, as far as a run of so many steps to `each` multiples
        gets; it has the frames at these."""
        there = np.flatnonzero(self.multiples[: last + 1] % each == 0)
        keep = self.multiples[there] // each * steps
        end = self.true_run(each * self.seconds / steps, keep[-1], keep)
        return dict(zip(there.tolist(), end.q[np.isin(end.kept, keep)], strict=False))

    def agreed(self, coarse, fine, last, each, close):
        """How many frames of `fine`, sought up to the `last`, are within `close` m of `coarse`,
        which was sought at `each` multiples. The first, the start, is in both."""
        *_, agreed = takewhile(lambda k: k in fine and distance(coarse[k], fine[k]) < close, coarse)
        left = self.multiples[last] - self.multiples[agreed]
        none_in_both = left < min(each, self.multiples[last])
        return len(fine) if none_in_both else agreed + 1


def true_motion(true_run, system, dt, shown, truth):
    """q (T, N, 3): the true motion at the steps (F,) of `dt` s that are `shown`, while it is known.

    Two steps agree that long to CLOSE of the longest rod; they become finer while that gains time.
    It is not sought where the Truth is not. All `shown` are multiples of the first that is not 0.
    """
    if len(shown) < 2 or truth.unsought:
        return np.array([])
    work.begin("the true motion")
    close = CLOSE * np.max(system["lengths"])
    seconds, multiples = shown[1] * dt, shown // shown[1]
    frames = Frames(true_run, seconds, multiples)
    share = len(system["pairs"]) / BUDGET  # of the budget, for one step
    first = steps = math.ceil(seconds / FIRST)
    each, before = math.ceil(MEET / steps), 1  # frames that are long are all compared
    coarser = (MEET - 1) * steps * each // MEET, each
    last = max(1, frames.at(min(HORIZON / seconds, 1.0 / (share * steps))))
    coarse = frames.places(last, *coarser)
    while True:
        fine = frames.places(last, steps)
        agreed = frames.agreed(coarse, fine, last, coarser[1], close)
        parted = agreed <= last
        further = min(len(shown) - 1, max(agreed, frames.at(2 * multiples[agreed - 1])))
        idle = 1 < agreed < GAIN * before or seconds / steps < FINEST
        slow = share * multiples[further] * more_parts(steps) > 1.0
        if agreed == len(shown) or (parted and (idle or slow)):
            return np.array(list(fine.values())[:agreed]) if agreed > 1 else np.array([])
        if parted:  # finer steps; these become the coarse ones
            before = agreed if steps > first else 1  # the first two steps are nearly as long
            coarse, coarser, steps = fine, (steps, 1), more_parts(steps)
        if further > last:
            coarse = frames.places(further, *coarser)
        last = further


def believed(true_run, system, plan, shown, runs):
    """The Plan, and the true_motion beside its Truth; no Truth where one of `runs` has found that
    what is compiled does something else than the lines, since it was found by such steps."""
    lies = [run.stepper.lies for run in runs if run.stepper.lies]
    if lies:
        plan = plan._replace(truth=Truth(plan.truth.step, unsought=f"not believed: {lies[0]}"))
    return plan, true_motion(true_run, system, plan.dt, shown, plan.truth)
