"""Schemes: an integrator with a method; and what one makes of steps of different lengths."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import median
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.rods.run import average, conserves, is_good
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
        held = chapter.make_methods(dt, **knobs)[method]
        step_fn = chapter.stabilized(chapter.integrators[integrator], system, held)
        return step_fn(q, v, system["m"], held.make_force(system), dt)

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


def six_digits(x):
    """A number without its other digits: what is left is the same everywhere. None is None."""
    return None if x is None else in_digits(x, 6)


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
        self.run = CompiledSteps(self.step, self.start, MANY, knobs=1)
        self.count = Counter(self.run.program)
        self.times = []

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
        chapter = self.chapter
        system = self.system
        places = partial(path.off, dt=dt, part=part)
        dt = dt * float(part)
        steps = steps_of(span, dt)
        q, v = self.run(self.start, steps, dt)
        q = ordered(q)
        v = ordered(v)
        violations = chapter.constraint_violation(system, q)
        energies = chapter.energy(system, q, v)
        good = is_good(system, violations, energies)
        kept = len(q) if good.all() else max(1, int(np.argmin(good)))
        gone = np.abs(energies[:kept] - energies[0]) / self.scale
        violations = violations[:kept]
        is_kept = self.conserves(q[:kept], v[:kept])
        wrong = violations > within
        if is_kept:
            wrong |= gone > ENERGY
        operations = average(self.count, q[:kept], v[:kept], dt, dt)
        done = max(1, len(q) - 1) * dt * operations
        self.times.append((done, self.run.seconds / done))
        lost = None
        if kept <= steps:
            lost = f"at {(kept - 1) * dt:.3g} s: {self.why_lost(q[kept - 1], v[kept - 1], dt)}"
        held = int(np.argmax(wrong)) if wrong.any() else kept
        return Rung(
            scheme=self.scheme,
            dt=dt,
            span=span,
            places=six_digits(places(q[:kept])),
            rods=in_digits(np.max(violations), 6),
            energy=in_digits(np.max(gone), 6) if is_kept else None,
            operations=operations,
            held=span if held > steps else max(0, held - 1) * dt,
            lost=lost,
        )

    def conserves(self, q, v):
        """Whether energy should stay, in some of the states q, v (steps + 1, N, 3)."""
        every = 1 + len(q) // STATES
        chapter = self.chapter
        known = chapter.external_force, chapter.energy
        return conserves(self.system, *known, q[::every], v[::every])

    def why_lost(self, q, v, dt):
        """Why the step from q, v has no result: in the words of the loop that fails."""
        own = OwnStep(self.step, [q, v, dt])
        _ = own.result  # which takes it
        return own.failure or "diverged"
