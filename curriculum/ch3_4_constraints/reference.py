"""Where the particles are before chaos decides, by ever shorter steps, and how sure that is."""

import math
from typing import NamedTuple

import numpy as np

from curriculum.common.tracing import CompiledSteps, Untraceable

HORIZON = 2.0  # s; of short rods, which swing faster, at most 20 sqrt(L/g): chaos is as fast
FIRST = 0.15  # of sqrt(L/g): how long the first steps are
HALVINGS = 4  # of these, at most
STEPS = 800  # for each rod, as a guess: many repay machine code
ENOUGH = 1e-11  # m: ends that are as near agree
KNOWN = 1e-9  # m, or a millionth of the shortest rod: what is less certain counts as unknown
MAX_RODS = 40  # for more the reference takes longer than the run


class Reference(NamedTuple):
    """Where the particles are after so many steps of the run."""

    step: int
    time_scale: float  # sqrt(L/g) of the shortest rod in s: beside it a step is short or long
    q: np.ndarray | None = None  # (N, 3) in m, if it is known
    uncertainty: float = math.inf  # m
    why: str = ""  # it is not known, in words

    def error(self, q):
        """How far the worst particle of a run q (steps + 1, N, 3) is off, in m; None if unknown."""
        if self.q is None or q is None or len(q) <= self.step:
            return None
        return float(np.max(np.linalg.norm(q[self.step] - self.q, axis=1)))

    def shown(self, error, length):
        """The error in words, by length(m), and no finer than what is known."""
        if error is None:
            return "-"
        coarse = error < self.uncertainty and self.uncertainty >= 1e-12
        return f"< {length(self.uncertainty)}" if coarse else length(error)


def find_reference(step, system, gravity, dt, steps, not_compiled=False):
    """The Reference after HORIZON or, if they end sooner, after so many steps of dt s.

    step(q, v, dt) -> (q, v) is of high order. Its steps are halved until two ends agree, or until
    rounding keeps them apart. What changes with the last digit of the start cannot be known.
    `gravity` (3,) in m/s^2; below 1 it counts as 1.
    """
    q, v, rods = system["q0"], system["v0"], len(system["pairs"])
    shortest = float(np.min(system["lengths"]))
    time_scale = math.sqrt(shortest / max(1.0, np.linalg.norm(gravity)))
    horizon = min(HORIZON, 20.0 * time_scale)
    last = min(steps, max(1, round(horizon / dt)))
    unknown = Reference(last, time_scale)
    if not_compiled:
        return unknown._replace(why="steps are not compiled, and it would take long")
    if dt > horizon:
        return unknown._replace(why=f"it reaches {horizon:.2g} s, and a step takes {dt:g} s")
    if rods > MAX_RODS:
        return unknown._replace(why=f"it would take long for more than {MAX_RODS} rods")
    try:
        run = CompiledSteps(step, [q, v], STEPS * rods, knobs=1)
    except Untraceable as why:
        return unknown._replace(why=f"its steps cannot be compiled: {why}")

    def end(count, factor=1.0):
        ends, _ = run([q * factor, v * factor], count, last * dt / count)
        return ends[-1] if len(ends) > count else np.full_like(q, np.nan)

    count, gaps = math.ceil(last * dt / (FIRST * time_scale)), [math.inf, math.inf]
    coarse = end(count)
    for _ in range(HALVINGS):
        fine = end(2 * count)
        gaps.append(float(np.max(np.abs(fine - coarse))))
        if gaps[-1] < ENOUGH or gaps[-1] >= gaps[-3]:  # one bad step is no reason to give up
            break
        coarse, count = fine, 2 * count
    known, uncertainty = min(KNOWN, 1e-6 * shortest), float(np.min(gaps[-2:]))
    if uncertainty < known:
        rounding = 1.0 + 2.0**-52 * (-1.0) ** np.arange(q.size).reshape(q.shape)
        apart = np.abs(end(count, rounding) - coarse)
        uncertainty = max(uncertainty, 4.0 * float(np.max(apart)))
    if not uncertainty < known:
        return unknown._replace(why="shorter steps do not agree to a nanometre")
    return Reference(last, time_scale, coarse, uncertainty)
