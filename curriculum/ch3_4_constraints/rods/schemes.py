"""Schemes: an integrator with a method; and what one makes of steps of different lengths."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.rods.run import average, conserving, how_many_good, measures
from curriculum.ch3_4_constraints.rods.systems import energy_scale
from curriculum.ch3_4_constraints.rods.truth import WHOLE
from curriculum.common.tracing import CompiledSteps, ordered
from curriculum.common.tracing.counting import Counter
from curriculum.common.tracing.plainly import OwnStep
from curriculum.common.words import in_digits

MANY = 100_000  # steps of a scheme: they repay machine code
STATES = 1000  # at most, in which external_force is asked whether energy should stay
ENERGY = 0.05  # of the energy's scale: what is right changes it by no more


@dataclass(frozen=True)
class Scheme:
    """An integrator with a method: what an engine is, as far as rods are concerned."""

    integrator: str
    method: str
    step: Callable = field(compare=False)  # (system, q, v, dt) -> q, v

    def __str__(self):
        return f"{self.integrator} with {self.method}"


def scheme_of(chapter, integrator, method, knobs):
    """The Scheme of an integrator and a method of a chapter, by their names."""

    def step(system, q, v, dt):
        made = chapter.make_methods(dt, **knobs)[method]
        step_fn = chapter.stabilized(chapter.integrators[integrator], system, made)
        return step_fn(q, v, system["m"], made.make_force(system), dt)

    return Scheme(integrator, method, step)


def schemes(chapter, knobs):
    """The Schemes of a chapter: each integrator with each method that is made for it."""
    found = []
    for integrator in chapter.integrators:
        for name, method in chapter.make_methods(**knobs).items():
            if method.fits(integrator):
                found.append(scheme_of(chapter, integrator, name, knobs))
    return found


class Rung(NamedTuple):
    """A scheme in steps of one length, over a span; None is what is not known.

    `rods` and `energy` are the worst of all states, and so is `places`, of all times at which the
    true motion is known. Of a scheme that was lost they are of the time before.
    """

    scheme: Scheme
    dt: float  # s
    span: float  # s
    places: float | None  # m, of the worst particle; inf if it was lost before
    rods: float  # m
    energy: float | None  # the largest change, as a share of its scale; None if it need not stay
    operations: float  # for a second of motion
    held: float  # s, after which rods or energy are no longer right; the span, if they stay so
    lost: str | None  # when and why, if it did not get to the end of the span

    @property
    def steps(self):
        """How many there are in the span."""
        return steps_of(self.span, self.dt)


def steps_of(span, dt):
    """How many steps of dt s a span in s has."""
    return max(1, math.floor(span / dt + 1e-6))


class Stepper:
    """A scheme's steps of a system, compiled for steps of all lengths.

    `times` are of each run so far: its operations, and what one of them took in s.
    """

    def __init__(self, chapter, system, scheme):
        self.chapter = chapter
        self.system = system
        self.scheme = scheme
        self.scale = energy_scale(system, chapter.gravity)
        self.start = [system["q0"], system["v0"]]
        self.step = partial(scheme.step, system)
        self.run = CompiledSteps(self.step, self.start, MANY, scalars=1)
        self.count = Counter(self.run.program)
        self.times = []
        self.measure = measures(system, chapter.constraint_violation, chapter.energy)
        self.conserves = conserving(system, chapter.external_force, chapter.energy)

    @property
    def time(self):
        """The median time in s that an operation takes, on this machine, in the longer runs."""
        longer = sorted(self.times)[len(self.times) // 2 :]
        return median(pace for _, pace in longer)

    def take(self, dt, span, path, within, part=WHOLE):
        """The Rung of steps of a `part` of dt s over a span in s, whose rods are to be `within` so
        many metres.

        `path`: the Path that places are compared with.
        """
        system = self.system
        step = dt * float(part)
        steps = steps_of(span, step)
        q, v = map(ordered, self.run(self.start, steps, step))
        done = len(q) - 1
        violations, energies = self.measure(q, v)
        kept = how_many_good(system, violations, energies)
        q = q[:kept]
        v = v[:kept]
        violations = violations[:kept]
        gone = np.abs(energies[:kept] - energies[0]) / self.scale
        some = slice(None, None, 1 + kept // STATES)
        is_kept = self.conserves(q[some], v[some])
        wrong = violations > within
        if is_kept:
            wrong |= gone > ENERGY
        first_wrong = int(np.argmax(wrong)) if wrong.any() else kept
        off = path.off(q, dt, part)
        operations = average(self.count, q, v, step, step)
        work = max(1, done) * step * operations
        self.times.append((work, self.run.seconds / work))
        return Rung(
            scheme=self.scheme,
            dt=step,
            span=span,
            places=None if off is None else in_digits(off, 6),
            rods=in_digits(np.max(violations), 6),
            energy=in_digits(np.max(gone), 6) if is_kept else None,
            operations=operations,
            held=span if first_wrong > steps else max(0, first_wrong - 1) * step,
            lost=None if kept > steps else self.why_lost(q, v, step),
        )

    def why_lost(self, q, v, dt):
        """When a step of dt s from the last of the states q, v has no result, and why."""
        failed = OwnStep(self.step, [q[-1], v[-1], dt])
        _ = failed.result  # which takes it: so a loop that fails says so
        return f"at {(len(q) - 1) * dt:.3g} s: {failed.failure or 'diverged'}"
