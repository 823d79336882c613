"""Which integrator, which method, which step: the cheapest that is right at all times."""

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import takewhile
from typing import NamedTuple

from curriculum.ch3_4_constraints.rods import truth as true
from curriculum.ch3_4_constraints.rods.schemes import ENERGY, Rung, Stepper, schemes
from curriculum.common.words import in_digits, length

HALVED = 3  # times at most that the time of the true motion is halved until it is known
TIMES = 512  # of the true motion that places are compared with, at most; at least half of these
FEWEST = 4  # steps, at least, in the time of the true motion
SURE = 3  # rungs in a row that are right: shorter ones are not tried
PARTS = [Fraction(k, 16) for k in (16, 15, 14, 12, 8)]  # of a step, that have to be right, too
WORK = 2.5e7  # operations of a scheme in which places are tried
MORE = 1e8  # operations in which places of an integrator's best scheme are, where none is right
SPAN = 1.5e8  # operations of an integrator in which rods and energy are tried for long
RODS = 1e8  # operations of all schemes in which rods and energy alone are tried for long
RUN = 0.15  # of SPAN, or of RODS: one run takes no more
STALLED = 0.7  # of an error: where three halvings leave more it is the method's, not the step's
CHEAPER = 0.8  # times the verdict's work, at most, is worth a word
ABOUT = 0.8  # of the longest time is as long
NEAR = 0.1  # of the shortest rod: errors below shrink with the step as they should


class Row(NamedTuple):
    """What is advised for an integrator, and what becomes of it in steps twice as long."""

    rung: Rung
    twice: Rung
    pace: float  # s of computing for an operation, on this machine (a Run's is for a step, in us)
    ends: bool  # whether rods or energy are right for the rung's span only
    is_longest: bool  # whether it is the longest step that was tried: twice has too few of them


class Missing(NamedTuple):
    """What is known of an integrator none of whose steps is right."""

    integrator: str
    best: Rung  # the one that is least off
    shortest: float  # s: the shortest step that was tried


class Answer(NamedTuple):
    """Which scheme and step are right to so many metres."""

    within: float  # m
    why: str  # more is not known of places, or there is no answer, in words; or ""
    whole: float = 0.0  # s, of the run
    seconds: float = 0.0  # s, up to which places are compared; 0 if they are not known
    uncertainty: float | None = None  # m, of these places
    verdict: Row | None = None  # the cheapest row
    rows: Sequence = ()  # a Row for each integrator that has one, the cheapest first
    missing: Sequence = ()  # a Missing for each of the others
    rods: Row | None = None  # what is enough if only rods must be right, if that is cheaper


def choose(chapter, system, within, dt, steps, knobs, truth=None, each=iter):
    """The Answer for a chapter's integrators and methods, to so many metres `within`.

    Steps are dt s times powers of 2; rods and energy are followed for `steps` of dt s. `truth`: the
    true motion of this run, if it is known; each(names) gives the names, and may show them. Raises
    Untraceable where a step cannot be compiled. An Answer is the same everywhere, but for its
    Rows' pace.
    """
    search = Search(chapter, system, within, dt, steps, truth)
    named = {str(scheme): scheme for scheme in schemes(chapter, knobs)}
    for name in each(named):
        search.add(Stepper(chapter, system, named[name]))
    return search.answer()


def known_path(chapter, system, dt, steps, truth):
    """The true motion as a Path, and why no more of it is known, in words, or "".

    Where it is not known after the time of the run's own comparison, after half of that, and so on.
    """
    last = true.last_step(chapter, system, dt, steps)
    if truth is None or truth.step != last:
        truth = true.true_motion(chapter, system, dt, last)
    why = truth.why
    for _ in range(HALVED):
        if truth.q is not None or truth.step == 1:
            break
        truth = true.true_motion(chapter, system, dt, truth.step // 2)
    if truth.q is None:
        return true.Path(dt), f"places are not known: {why}"
    doubled = math.floor(math.log2(TIMES / truth.step))
    grid = dt / 2.0**doubled
    path = true.true_path(
        chapter, system, grid, math.floor(truth.step * dt / grid), truth.uncertainty
    )
    if path.q is None:
        return path, "places are not known: its steps do not agree at all times"
    if truth.step < last:
        return path, f"later than at {path.seconds:.3g} s places are not known: {why}"
    return path, ""


class Yardstick:
    """What rungs are measured by: places, over a short time; rods and energy, for long."""

    def __init__(self, chapter, system, within, dt, steps, truth=None):
        path, why = known_path(chapter, system, dt, steps, truth)
        if path.uncertainty >= within and not why:
            why = f"places are known to {length(path.uncertainty)} only"
            path = path._replace(q=None)
        self.within = within  # m
        self.dt = dt  # s: the steps are powers of 2 times this one
        self.whole = steps * dt  # s
        self.path = path
        self.why = why  # more is not known of places, in words; or ""
        is_known = path.q is not None
        # s: the short time
        self.seconds = path.seconds if is_known else true.horizon(chapter, system, self.whole)

    def is_right(self, rung, places=True):
        """Whether a rung is right, over its span."""
        good = not rung.lost and rung.rods <= self.within
        good = good and (rung.energy is None or rung.energy <= ENERGY)
        if not places or rung.places is None:
            return good
        return good and rung.places <= self.within - self.path.uncertainty

    def rounded_span(self, most):
        """A time in s, at most so much of the whole: two digits, but not below the short time."""
        if most >= self.whole:
            return self.whole
        unit = 10.0 ** (math.floor(math.log10(most)) - 1)
        return max(min(self.seconds, self.whole), in_digits(unit * math.floor(most / unit), 2))


class Search:
    """Looks for rungs that are right, on a Ladder of each scheme that is added."""

    def __init__(self, chapter, system, within, dt, steps, truth=None):
        self.yardstick = Yardstick(chapter, system, within, dt, steps, truth)
        self.ladders = {}  # {integrator: those of its schemes}

    def add(self, stepper):
        """Try a scheme over the short time."""
        ladder = Ladder(stepper, self.yardstick)
        self.ladders.setdefault(stepper.scheme.integrator, []).append(ladder)
        ladder.descend(WORK)

    def answer(self):
        """The Answer, of the schemes that were added."""
        rows, missing = self.rows()
        verdict = rows[0] if rows else None
        yardstick = self.yardstick
        is_known = yardstick.path.q is not None
        return Answer(
            within=yardstick.within,
            why=yardstick.why,
            whole=yardstick.whole,
            seconds=yardstick.seconds if is_known else 0.0,
            uncertainty=yardstick.path.uncertainty if is_known else None,
            verdict=verdict,
            rows=rows,
            missing=missing,
            rods=self.rods_alone(verdict),
        )

    def rows(self):
        """The Rows of integrators, the cheapest first, and what is Missing of the others."""
        rows = []
        missing = []
        for integrator, ladders in self.ladders.items():
            best = min(ladders, key=lambda x: error_of(x.nearest))
            if not any(ladder.candidates() for ladder in ladders):
                best.descend(MORE)
            row = self.row(ladders)
            if row:
                rows.append(row)
            else:
                shortest = min(rung.dt for ladder in ladders for rung in ladder.rungs)
                missing.append(Missing(integrator, best.nearest, shortest))
        longest = max((x.rung.span for x in rows), default=0.0)

        def order(row):  # first what is right for as long as was tried, or for about the longest
            return row.ends and row.rung.span < ABOUT * longest, row.rung.operations

        return sorted(rows, key=order), missing

    def row(self, ladders, places=True, most=math.inf, budget=SPAN):
        """The Row of the cheapest rung of some ladders that is right for long; None if none is.

        It has at `most` so many operations a second. Where none is right for all of its span, it is
        the one that is right for longest.
        """
        options = [(rung, x) for x in ladders for rung in x.candidates(places)]
        tried = []  # [(for how many s it is right, its dt, its ladder)], the cheapest first
        left = budget
        for rung, ladder in sorted(options, key=lambda x: x[0].operations):
            if left < 0.0 or rung.operations > most:
                break
            span = self.yardstick.rounded_span(RUN * budget / rung.operations)
            seconds, spent = ladder.right_for(rung.dt, span, places)
            left -= spent
            if seconds == span:
                for longer, dt, cheaper in tried:  # it was tried for longer, and is right as long
                    if longer >= span:
                        return cheaper.row(dt, self.yardstick.rounded_span(longer), ends=True)
                return ladder.row(rung.dt, span, ends=False)
            tried.append((seconds, rung.dt, ladder))
        longest = max((seconds for seconds, _, _ in tried), default=0.0)
        if longest == 0.0 or not places:
            return None
        seconds, dt, ladder = next(x for x in tried if x[0] >= ABOUT * longest)
        return ladder.row(dt, self.yardstick.rounded_span(seconds), ends=True)

    def rods_alone(self, verdict):
        """The Row of what is enough if only rods and energy must be right, if that is cheaper."""
        if verdict is None or verdict.rung.places is None:
            return None
        ladders = [x for ladders in self.ladders.values() for x in ladders]
        return self.row(ladders, False, CHEAPER * verdict.rung.operations, RODS)


class Ladder:
    """The rungs of a scheme over the short time of a Yardstick, from the longest step on."""

    def __init__(self, stepper, yardstick):
        longest = yardstick.seconds / FEWEST  # s
        self.stepper = stepper
        self.scheme = stepper.scheme
        self.yardstick = yardstick
        self.rungs = []
        self.spent = 0.0  # operations
        self.dt = yardstick.dt * 2.0 ** math.floor(math.log2(longest / yardstick.dt))  # of the next

    def descend(self, most):
        """Take shorter steps until some in a row are right, or for so many operations."""
        while self.is_going(most):
            rung = self.take(self.dt, self.yardstick.seconds)
            self.rungs.append(rung)
            self.spent += rung.operations * rung.span
            self.dt *= 0.5

    def is_going(self, most):
        """Whether descend goes on, where it is to do so for so many operations at `most`."""
        are_right = list(map(self.yardstick.is_right, self.rungs[-SURE:]))
        if len(are_right) < SURE:
            return True
        if all(are_right):
            return False
        if are_right[-1] and not are_right[-2]:
            return True  # or nobody knows whether it is luck
        return self.spent < most and not self.is_stalled()

    def is_stalled(self):
        """Whether shorter steps are no better: the error is the method's."""
        errors = [error_of(rung) for rung in self.rungs[-4:]]
        worst = max(errors)  # one of them may be small by luck
        near = NEAR * min(self.stepper.system["lengths"])
        return len(errors) == 4 and worst < near and errors[3] > STALLED * worst

    def take(self, dt, span, part=true.WHOLE):
        """The Rung of steps of a part of dt s over a span in s."""
        return self.stepper.take(dt, span, self.yardstick.path, self.yardstick.within, part)

    def candidates(self, places=True):
        """The rungs that are right, as are all shorter ones, of which there is one."""
        shortest_first = reversed(self.rungs)
        return [*takewhile(lambda x: self.yardstick.is_right(x, places), shortest_first)][1:]

    @property
    def nearest(self):
        """The rung that is least off."""
        return min(self.rungs, key=error_of)

    def right_for(self, dt, span, places):
        """For how long steps of dt s are right, in s, and the operations spent.

        So have to be steps a little shorter, and half as long; or it was luck. Their runs go other
        ways once chaos has spread: no single one decides.
        """
        spent = 0.0
        for part in PARTS:
            rung = self.take(dt, span, part)
            spent += rung.operations * span
            if places and rung.places is not None and rung.places > self.yardstick.within:
                return 0.0, spent
            if not self.yardstick.is_right(rung, places):
                return rung.held, spent
        return span, spent

    def row(self, dt, span, ends):
        """The Row of steps of dt s. What is twice as long is followed longer if it needs that."""
        rung = self.take(dt, span)
        twice = self.take(2.0 * dt, span)
        if self.yardstick.is_right(twice):
            twice = self.take(2.0 * dt, self.yardstick.rounded_span(2.0 * span))
        is_longest = 2.0 * dt > self.rungs[0].dt
        return Row(rung, twice, self.stepper.time, ends, is_longest)


def error_of(rung):
    """How far a rung is off, in m: its places or, if these are not known, its rods."""
    if rung.lost:
        return math.inf
    return rung.rods if rung.places is None else max(rung.places, rung.rods)
