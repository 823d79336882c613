"""Which method, at which step: what each costs and how far it is off, on a ladder of steps.

What a `chapter` is to have is said in results/output.py.
"""

import math
from functools import partial
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.mechanics import reference as truth
from curriculum.ch3_4_constraints.mechanics.outcome import FAR, average, six_digits
from curriculum.ch3_4_constraints.mechanics.stability import force_calls, grows, is_explicit
from curriculum.ch3_4_constraints.mechanics.systems import EARTH, conserves, m_g_L
from curriculum.common.tracing import CompiledSteps, ordered
from curriculum.common.tracing.counting import Counter
from curriculum.common.tracing.plainly import OwnStep

EARLY = 2  # integrators that iterate are tried if none of so many of the longest steps is right
SWING = 0.2  # of sqrt(L/g): the longest step that is tried
RUNGS = 6  # steps of different lengths, each half of the one before
LEAST = 2  # rungs: of a single one nothing can be said
MANY = 30_000  # steps of a pair: they repay machine code
BUDGET = 3.5e8  # operations of all pairs: some 5 s without llvmlite
MORE = 2e7  # those of the pairs that are tried last
QUICK = 2e-3  # s: what took less is timed again,
TURNS = 3  # so many times
TIE = 1.05  # times as much work is as cheap
BETTER = 0.1  # of the error, or less, comes first where two are as cheap
HALVED = 3  # times at most that the time of the reference is halved until there is one
KEYS = ("error", "rods")  # of a Setting: what must be within
ENERGY = 0.05  # of m g L: rods that change it by more come after the others


class Setting(NamedTuple):
    """An integrator and a method at one step, over the span; None is what is not known."""

    integrator: str
    method: str
    dt: float  # s
    rods: float | None  # m, the worst, over the span
    energy: float | None  # the largest change, as a share of m g L; None if it need not stay
    error: float | None  # m, of the worst particle, at the reference's time
    operations: float  # for a second of motion
    seconds: float  # of computing, for a second of motion, on this machine
    lost: str | None  # when and why, if it did not get to the end of the span


class Pair:
    """An integrator and a method as a step(q, v, dt) of a system, compiled for all steps dt."""

    def __init__(self, chapter, system, integrator, method, knobs):
        self.integrator = integrator
        self.method = method
        self.system = system
        self.step = step_of(chapter, system, integrator, method, knobs)
        self.start = [system["q0"], system["v0"]]
        self.conserves = conserves(system, chapter.external_force, chapter.energy)
        self.run = CompiledSteps(self.step, self.start, MANY, knobs=1)
        self.count = Counter(self.run.program)

    def work(self, dt):
        """About how many operations a second of motion takes, from its first step."""
        return self.count(self.start, dt) / dt


def step_of(chapter, system, integrator, method, knobs):
    """step(q, v, dt) -> q, v of an integrator and a method."""
    step_fn = chapter.INTEGRATORS[integrator]

    def step(q, v, dt):
        held = chapter.make_methods(dt, **knobs)[method]
        force = held.make_force(system)
        return chapter.stabilized(step_fn, system, held)(q, v, system["m"], force, dt)

    return step


def suits(method, integrator):
    """Whether a Method works with the integrator of that name."""
    return method.integrator in (None, integrator)


def pairs_of(chapter, integrators):
    """[(integrator, method)] of the chapter that go together."""
    found = []
    for integrator in integrators:
        for name, method in chapter.make_methods().items():
            if suits(method, integrator):
                found.append((integrator, name))
    return found


def worth_trying(integrators):
    """The names of those that are explicit and of those that iterate, but none that is beaten."""
    explicit = []
    iterating = []
    for name, step_fn in integrators.items():
        try:
            kind = explicit if is_explicit(step_fn) else iterating
            is_left_out = is_beaten(step_fn, integrators)
        except Exception:  # as it is compiled it fails, too, and that says where
            kind = explicit
            is_left_out = False
        if not is_left_out:
            kind.append(name)
    return explicit, iterating


def is_beaten(step_fn, integrators):
    """Whether a spring swings ever wider under these steps, but not under others that cost as much.

    Steps cost as much if they ask for the force as often. They are the longest that are tried.
    """
    if not grows(step_fn, SWING, damping=0.0):
        return False
    calls = force_calls(step_fn)
    for other in integrators.values():
        if force_calls(other) == calls and not grows(other, SWING, damping=0.0):
            return True
    return False


def first_count(system, force, dt, last):
    """Into how many steps the time of `last` steps of dt s is divided first.

    A step may be SWING of sqrt(L/g), with the mean length, and turn what moves at the start by
    TURN. Of the counts that allow it, below twice the least, it is one whose step is dt times a
    power of 2, or else has the fewest digits.
    """
    _, turn = truth.time_scales(system, force)
    lengths = system["lengths"].tolist()
    swing = math.sqrt(sum(lengths) / len(lengths) / EARTH)
    seconds = last * dt
    least = max(1, math.ceil(seconds / min(SWING * swing, truth.TURN * turn)))

    def awkward(count):
        ratio = math.log2(last / count)
        return ratio != round(ratio), digits(seconds, count)

    return min(range(least, 2 * least), key=awkward)


def digits(seconds, count):
    """How many digits a step has that divides so many seconds into `count`."""
    return len(f"{seconds / count:.9e}".split("e")[0].rstrip("0"))


class Trial(NamedTuple):
    """What settings are compared with, and over how long."""

    chapter: object
    reference: truth.Reference
    seconds: float  # s, after which its places are
    span: float  # s, over which rods and energy are measured


def measure(trial, pair, count):
    """The Setting of a pair whose steps divide the trial's `seconds` into `count`."""
    chapter = trial.chapter
    reference = trial.reference
    system = pair.system
    dt = trial.seconds / count
    steps = max(count, math.floor(trial.span / dt + 1e-6))
    q, v = pair.run(pair.start, steps, dt)
    q = ordered(q)
    v = ordered(v)
    violations = chapter.constraint_violation(system, q)
    far = violations > FAR * np.sum(system["lengths"])
    good = int(np.argmax(far)) if far.any() else len(q)
    operations = average(pair.count, q[:good], v[:good], dt, dt)
    error = None
    if reference.q is not None and good > count:
        error = six_digits(truth.distance(q[count], reference.q))
    found = Setting(
        pair.integrator,
        pair.method,
        dt,
        rods=None,
        energy=None,
        error=error,
        operations=operations,
        seconds=least_time(pair, steps, dt) / max(1, len(q) - 1) / dt,
        lost=None,
    )
    if good <= steps:
        why = why_lost(pair, q[good - 1], v[good - 1], dt)
        return found._replace(lost=f"at {(good - 1) * dt:.3g} s: {why}")
    if pair.conserves:
        energies = chapter.energy(system, q, v)
        change = np.max(np.abs(energies - energies[0]))
        found = found._replace(energy=six_digits(change / m_g_L(system, chapter.GRAVITY)))
    return found._replace(rods=six_digits(np.max(violations)))


def least_time(pair, steps, dt):
    """How many s the run took that a pair has just made; or less, if that was due to others."""
    spent = pair.run.seconds
    if spent < QUICK:
        for _ in range(TURNS):
            pair.run(pair.start, steps, dt)
            spent = min(spent, pair.run.seconds)
    return spent


def why_lost(pair, q, v, dt):
    """Why the step from q, v has no result: in the words of the loop that fails, or diverged."""
    own = OwnStep(pair.step, [q, v, dt])
    _ = own.result  # which takes it
    return own.failure or "diverged"


def ladder(take, counts, digits, within):
    """The Settings that take(count) measures of a pair, from long steps to short ones.

    Longer steps are added while the longest is within; and one shorter step, where only the last
    one is within, to see whether that is luck. `digits`: those of the step of a count.
    """
    found = [take(x) for x in counts]
    first = counts[0]
    while first > 1 and any(is_within(found[0], {key: within}) for key in KEYS):
        first = fewer(first, digits)
        found.insert(0, take(first))
        if found[0].operations >= found[1].operations:  # gauss takes it in parts
            break
    for key in KEYS:
        right = [is_within(x, {key: within}) for x in found]
        if right[-1] and not right[-2]:
            found.append(take(2 * counts[-1]))
            break
    return found


def ladders(trial, pairs, counts, within):
    """The Settings of several pairs."""
    found = []
    for pair in pairs:
        take = partial(measure, trial, pair)
        found += ladder(take, counts, partial(digits, trial.seconds), within)
    return found


def fewer(count, digits):
    """Half of a count or less, down to a quarter: the one whose step has the fewest digits."""
    return min(range(count // 2, count // 4, -1), key=digits)


def is_within(setting, limits):
    """Whether a setting is not lost, and knows each {key: most} of limits to be at most that."""
    known = [(getattr(setting, key), most) for key, most in limits.items()]
    return setting.lost is None and all(x is not None and x <= most for x, most in known)


def reached(settings, limits):
    """The cheapest of a pair's settings, from long steps to short ones, that is within limits.

    It counts only if all finer ones are within, too, and there is one; else it may be luck. So a
    stricter limit never gives a longer step. None if there is none.
    """
    there = list(takewhile(lambda x: is_within(x, limits), reversed(settings)))
    return min(reversed(there[1:]), key=lambda x: x.operations, default=None)


def in_order(settings, key, cost="operations"):
    """Settings, the cheapest first; but one that is as cheap and much better comes before it."""
    left = sorted(settings, key=lambda x: getattr(x, cost))
    order = []
    while left:
        best = left[0]
        most = TIE * getattr(best, cost)
        for x in left[1:]:
            if getattr(x, cost) < most and getattr(x, key) <= BETTER * getattr(best, key):
                best = x
        order.append(best)
        left.remove(best)
    return order


def chosen(settings, key, within, sure=0.0):
    """Of each pair the cheapest setting that holds the rods to `within` for the span, in order.

    By "error" it also puts places right to it, which are known to `sure` only. By "rods" a pair
    that holds them comes last if none of its steps keeps the energy.
    """
    pairs = {}
    for x in settings:
        pairs.setdefault((x.integrator, x.method), []).append(x)
    tiers = [{"rods": within, "error": within - sure}]
    if key == "rods":
        tiers = [{"rods": within, "energy": ENERGY}, {"rods": within}]
    order = []
    for limits in tiers:
        best = [reached(pair, limits) for pair in pairs.values()]
        best = in_order([x for x in best if x], key)
        order += best
        for x in best:
            del pairs[x.integrator, x.method]
    return order


class Choice(NamedTuple):
    """All settings that were measured, and which of them are within so many metres."""

    within: float  # m
    span: float  # s, over which rods and energy are measured
    error_at: float  # s
    reference: truth.Reference
    whole: float  # s, of the run; more than the span if that would take long
    left_out: list  # what else was left out, and why, in sentences
    untried: list  # integrators that iterate, where others are right
    settings: list
    places: list  # those that put every place and all rods right to `within`, cheapest first
    rods_hold: list  # those that hold the rods to it for the whole span


def known_motion(chapter, system, dt, last, known=None):
    """The Reference after `last` steps of dt s or, if it is unknown, after half of them, and so on.

    `known` is the one after `last`, if there is one.
    """
    force = chapter.make_force(system)
    found = known or truth.true_motion(system, force, chapter.project, dt, last)
    for _ in range(HALVED):
        if found.q is not None or found.step == 1:
            break
        found = truth.true_motion(system, force, chapter.project, dt, found.step // 2)
    return found


def build(chapter, system, integrators, knobs, each):
    """The Pairs of some integrators."""
    names = {" with ".join(x): x for x in pairs_of(chapter, integrators)}
    return [Pair(chapter, system, *names[name], knobs) for name in each(names)]


def affordable(pairs, first, seconds, most):
    """Into how many steps to divide `seconds`, a list, so that they take at most so many
    operations; and how many a second of motion takes.

    Operations are counted, not timed, so that the answer is the same on every machine.
    """
    counts = [first << k for k in range(RUNGS)]

    def work():
        return sum(pair.work(seconds / x) for pair in pairs for x in counts)

    while len(counts) > LEAST and seconds * work() > most:
        counts.pop()
    return counts, work()


def affordable_span(whole, seconds, work):
    """How much of the whole time is within BUDGET, in s, in multiples of some seconds.

    `work`: how many operations a second of motion takes.
    """
    if whole * work <= BUDGET:
        return whole
    return min(whole, seconds * max(1, math.floor(BUDGET / work / seconds)))


def choose(chapter, system, args, known=None, each=iter):
    """The Choice for a system and the flags of its run: within, dt, steps and knobs.

    `known`: its reference, if there is one; each(names) gives the names, and may show them.
    Raises Untraceable where a step cannot be compiled.
    """
    force = chapter.make_force(system)
    last = truth.horizon(system, force, args.dt, args.steps)
    if known is not None and known.step != last:  # its runs ended early
        known = None
    reference = known_motion(chapter, system, args.dt, last, known)
    seconds = reference.step * args.dt
    whole = args.steps * args.dt
    explicit, iterating = worth_trying(chapter.INTEGRATORS)
    pairs = build(chapter, system, explicit, args.knobs, each)
    first = first_count(system, force, args.dt, reference.step)
    counts, work = affordable(pairs, first, seconds, BUDGET)
    span = affordable_span(whole, seconds, work)
    trial = Trial(chapter, reference, seconds, span)
    settings = ladders(trial, pairs, counts, args.within)
    sure = reference.uncertainty  # where it is not below `within`, nobody can tell
    early = seconds / counts[min(EARLY, len(counts)) - 1]
    found = chosen(settings, "error", args.within, sure)
    is_needed = reference.q is not None and not any(x.dt >= early for x in found)
    if is_needed:
        pairs = build(chapter, system, iterating, args.knobs, each)
        longer, _ = affordable(pairs, first, span, MORE)
        settings += ladders(trial, pairs, longer, args.within)
    return Choice(
        within=args.within,
        span=span,
        error_at=seconds,
        reference=reference,
        whole=whole,
        left_out=left_out(reference, last, seconds, counts),
        untried=[] if is_needed else iterating,
        settings=settings,
        places=chosen(settings, "error", args.within, sure),
        rods_hold=chosen(settings, "rods", args.within),
    )


def left_out(reference, last, seconds, counts):
    """What is not in a Choice that was asked for `last` steps, and why, in sentences."""
    found = []
    if reference.step < last and reference.q is not None:
        found.append(f"places later than at {seconds:.3g} s are not known")
    if len(counts) < RUNGS:
        finest = f"{1e3 * seconds / counts[-1]:.3g} ms"
        found.append(f"the ladder of steps ends at {finest}: more would take long")
    return found


def shortened(choice):
    """What was left out of a Choice, and why, in a sentence; or ""."""
    said = list(choice.left_out)
    if choice.span < choice.whole:
        said.append(f"rods and energy are of the first {choice.span:.3g} s")
    return "; ".join(said)


def as_metrics(choice, advice):
    """What metrics.json says of a Choice, with the sentences that were printed of it."""
    known = choice.reference.q is not None
    rows = []
    for x in choice.settings:
        row = x._asdict()
        del row["seconds"]  # it is this machine's
        rows.append(row)
    return {
        "within": choice.within,
        "span": choice.span,
        "error_at": choice.error_at,
        "uncertainty": six_digits(choice.reference.uncertainty) if known else None,
        "why": None if known else choice.reference.why,
        "shortened": shortened(choice) or None,
        "settings": rows,
        "places": [choice.settings.index(x) for x in choice.places],
        "rods_hold": [choice.settings.index(x) for x in choice.rods_hold],
        "advice": advice,
    }
