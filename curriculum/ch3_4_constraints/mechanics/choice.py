"""Which method, at which step: what each costs and how far it is off, on a ladder of steps.

A `chapter` is whatever has the chapter's INTEGRATORS, make_methods, make_force, project,
stabilized, constraint_violation, energy and GRAVITY, as its reader has edited them.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.mechanics import reference as truth
from curriculum.ch3_4_constraints.mechanics.outcome import FAR
from curriculum.ch3_4_constraints.mechanics.systems import m_g_L
from curriculum.common.tracing import CompiledSteps, Untraceable, ordered
from curriculum.common.tracing.counting import Counter, counter_of
from curriculum.common.tracing.tape import current

LEFT_OUT = ("euler",)  # semi_implicit costs as much and is better
LAST = ("gauss",)  # integrators that are tried where no other is right: a step costs so much
SWING = 0.2  # of sqrt(L/g): the longest step that is tried
RUNGS = 6  # steps of different lengths, each half of the one before
LEAST = 2  # rungs: of a single one nothing can be said
MANY = 30_000  # steps of a pair: they repay machine code
BUDGET = 4e8  # operations of all pairs: some 5 s without llvmlite
QUICK, TURNS = 2e-3, 3  # s: what took less is timed as often again
SAMPLE = 32  # states of a run whose steps are counted
TIE, BETTER = 1.05, 0.1  # so much more work is as cheap; an error so much smaller comes first
SHORTER = 3  # times that the time of the reference is halved until there is one
ROUNDING = 1e-12  # m: smaller errors are as good


class Setting(NamedTuple):
    """An integrator and a method at one step, over the span; None is what is not known."""

    integrator: str
    method: str
    dt: float  # s
    rods: float | None  # m, the worst, over the span
    energy: float | None  # the largest change, as a share of m g L
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


def operations_of(chapter, system, integrator, method, dt, knobs, q, v):
    """Operations for a second of motion in a run q, v (steps + 1, N, 3); None if not traceable."""
    step = step_of(chapter, system, integrator, method, knobs)
    try:
        count = counter_of(step, [system["q0"], system["v0"]], knobs=1)
    except Untraceable:
        return None
    return average(count, q, v, dt)


def average(count, q, v, dt):
    """Operations for a second of motion, as SAMPLE steps of a run take on average."""
    steps = max(1, len(q) - 1)
    many = min(steps, SAMPLE if count.varies else 1)
    total = 0
    for k in range(many):
        at = (2 * k + 1) * steps // (2 * many)
        total += count([q[at], v[at]], dt)
    return rounded(total / many / dt)


def count_operations(chapter, args, system, runs, results):
    """Add to each row of results the operations for a second of motion; None if not compiled."""
    for name, row in results.items():
        row["operations"] = None
        if not args.plain:
            run = runs[name]
            what = chapter, system, args.integrator, name, args.dt, args.knobs
            row["operations"] = operations_of(*what, run.q, run.v)


def rounded(x):
    """Six digits of a number: what is left is the same everywhere."""
    return float(f"{float(x):.6g}")


def pairs_of(chapter, integrators):
    """[(integrator, method)] of the chapter that go together."""
    found = []
    for integrator in integrators:
        for name, method in chapter.make_methods().items():
            if method.integrator in (None, integrator):
                found.append((integrator, name))
    return found


def first_count(system, force, dt, last):
    """Into how many steps the time of `last` steps of dt s is divided first.

    A step may be SWING of sqrt(L/g), with the mean length, and turn what moves at the start by
    TURN. Of the counts that allow it, below twice the least, it is one whose step is dt times a
    power of 2, or else has the fewest digits.
    """
    _, turn = truth.time_scales(system, force)
    lengths = system["lengths"].tolist()
    swing = math.sqrt(sum(lengths) / len(lengths) / 9.81)
    seconds = last * dt
    least = max(1, math.ceil(seconds / min(SWING * swing, truth.TURN * turn)))

    def digits(count):
        ratio = math.log2(last / count)
        return ratio != round(ratio), len(f"{seconds / count:.9e}".split("e")[0].rstrip("0"))

    return min(range(least, 2 * least), key=digits)


def measure(chapter, pair, count, reference, seconds, span):
    """The Setting of a pair whose steps divide the reference's `seconds` into `count`."""
    system = pair.system
    dt = seconds / count
    steps = max(count, math.floor(span / dt + 1e-6))
    q, v = pair.run(pair.start, steps, dt)
    spent = pair.run.seconds
    for _ in range(TURNS if spent < QUICK else 0):  # a short time is that of others, too
        pair.run(pair.start, steps, dt)
        spent = min(spent, pair.run.seconds)
    spent = spent / max(1, len(q) - 1) / dt
    q = ordered(q)
    v = ordered(v)
    violations = chapter.constraint_violation(system, q)
    far = violations > FAR * np.sum(system["lengths"])
    good = int(np.argmax(far)) if far.any() else len(q)
    operations = average(pair.count, q[:good], v[:good], dt)
    error = None
    if reference.q is not None and good > count:
        error = rounded(truth.distance(q[count], reference.q))
    if good <= steps:
        lost = f"at {(good - 1) * dt:.3g} s: {why_lost(pair, q[good - 1], v[good - 1], dt)}"
        return Setting(pair.integrator, pair.method, dt, None, None, error, operations, spent, lost)
    energies = chapter.energy(system, q, v)
    energy = np.max(np.abs(energies - energies[0])) / m_g_L(system, chapter.GRAVITY)
    rods = np.max(violations)
    row = rounded(rods), rounded(energy), error, operations, spent, None
    return Setting(pair.integrator, pair.method, dt, *row)


def why_lost(pair, q, v, dt):
    """Why the step from q, v has no result: in the words of the loop that fails, or diverged."""
    current.failure = None
    with np.errstate(all="ignore"):
        pair.step(ordered(q), ordered(v), dt)
    return current.failure or "diverged"


def ladder(chapter, pair, counts, reference, seconds, span, within):
    """The Settings of a pair from long steps to short ones.

    One more is taken where only the last one is within: it shows whether that is luck.
    """
    found = [measure(chapter, pair, x, reference, seconds, span) for x in counts]
    for key in ("error", "rods"):
        right = [is_within(x, key, within) for x in found]
        if right[-1] and not any(a and b for a, b in pairwise(right)):
            found.append(measure(chapter, pair, 2 * counts[-1], reference, seconds, span))
            break
    return found


def is_within(setting, key, within):
    x = getattr(setting, key)
    return setting.lost is None and x is not None and x <= within


def reached(settings, key, within):
    """The cheapest of a pair's settings, from long steps to short ones, whose `key` is within.

    It counts only if the next finer one is within, too; else it may be luck. None if there is none.
    """
    there = []
    for x, finer in pairwise(settings):
        if is_within(x, key, within) and is_within(finer, key, within):
            there.append(x)
    return min(there, key=lambda x: x.operations, default=None)


def in_order(settings, key):
    """Settings, the cheapest first; but one that is as cheap and much better comes before it."""
    left = sorted(settings, key=lambda x: x.operations)
    order = []
    while left:
        cheapest = left[0]
        enough = BETTER * max(getattr(cheapest, key), ROUNDING)
        for x in left[1:]:
            tied = x.operations < TIE * cheapest.operations
            if tied and getattr(x, key) <= enough:
                cheapest = x
                enough = BETTER * max(getattr(x, key), ROUNDING)
        order.append(cheapest)
        left.remove(cheapest)
    return order


def chosen(settings, key, within):
    """Of each pair the cheapest setting whose `key` is within, in order."""
    pairs = {}
    for x in settings:
        pairs.setdefault((x.integrator, x.method), []).append(x)
    best = [reached(x, key, within) for x in pairs.values()]
    return in_order([x for x in best if x], key)


class Choice(NamedTuple):
    """All settings that were measured, and which of them are within so many metres."""

    within: float  # m
    span: float  # s, over which rods and energy are measured
    error_at: float  # s
    reference: truth.Reference
    coarser: str | None  # that the ladder ends early, in words
    shorter: str | None  # that the span does
    settings: list
    places: list  # those that put every place right to `within`, the cheapest first
    rods_hold: list  # those that hold the rods to it for the whole span


def known_motion(chapter, system, dt, steps, known):
    """The reference for so many steps, or for half or a quarter of them, and its time in s.

    `known` is one that was found already, if it is of that time.
    """
    force = chapter.make_force(system)
    swing, _ = truth.time_scales(system, force)
    last = truth.horizon(swing, dt, steps)
    found = known
    for k in range(SHORTER):
        part = max(1, last >> k)
        if found is None or found.step != part:
            found = truth.true_motion(system, force, chapter.project, dt, part)
        if found.q is not None or not found.why.startswith("shorter steps") or part == 1:
            break
    return found


def choose(chapter, system, within, dt, steps, knobs, known=None, each=iter):
    """The Choice for a system that is run for `steps` of dt s.

    `known`: its reference, if there is one; each(names) gives the names, and may show them.
    Raises Untraceable where a step cannot be compiled.
    """
    reference = known_motion(chapter, system, dt, steps, known)
    seconds = reference.step * dt
    usual = [x for x in chapter.INTEGRATORS if x not in LEFT_OUT + LAST]
    last = [x for x in chapter.INTEGRATORS if x in LAST]
    first = first_count(system, chapter.make_force(system), dt, reference.step)
    counts = [first << k for k in range(RUNGS)]
    built = {}

    def build(integrators):
        names = {" with ".join(x): x for x in pairs_of(chapter, integrators)}
        for name in each(names):
            built[names[name]] = Pair(chapter, system, *names[name], knobs)

    def work(counts):
        return sum(pair.work(seconds / x) for pair in built.values() for x in counts)

    build(usual)
    while len(counts) > LEAST and seconds * work(counts) > BUDGET:
        counts.pop()
    whole = dt * steps
    span = whole
    if span * work(counts) > BUDGET:
        span = seconds * max(1, math.floor(BUDGET / work(counts) / seconds))
    settings = []
    for pair in built.values():
        settings += ladder(chapter, pair, counts, reference, seconds, span, within)
    coarser = None
    shorter = None
    if len(counts) < RUNGS:
        finest = f"{1e3 * seconds / counts[-1]:.3g} ms"
        coarser = f"steps below {finest} are left out: they would take long"
    if span < whole:
        what = f"rods and energy are those of the first {span:.3g} s of {whole:.3g}"
        shorter = f"{what}: more would take long"
    if reference.q is not None and not chosen(settings, "error", within) and last:
        usual_pairs = dict(built)
        built.clear()
        build(last)
        rungs = [first << k for k in range(RUNGS)]
        while len(rungs) > LEAST and span * work(rungs) > BUDGET:
            rungs.pop()
        for pair in built.values():
            settings += ladder(chapter, pair, rungs, reference, seconds, span, within)
        built |= usual_pairs
    places = chosen(settings, "error", within)
    rods_hold = chosen(settings, "rods", within)
    return Choice(within, span, seconds, reference, coarser, shorter, settings, places, rods_hold)


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
        "uncertainty": rounded(choice.reference.uncertainty) if known else None,
        "why": None if known else choice.reference.why,
        "shortened": "; ".join(filter(None, [choice.coarser, choice.shorter])) or None,
        "settings": rows,
        "places": [choice.settings.index(x) for x in choice.places],
        "rods_hold": [choice.settings.index(x) for x in choice.rods_hold],
        "advice": advice,
    }
