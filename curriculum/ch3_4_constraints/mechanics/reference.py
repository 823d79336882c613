"""Where the particles are before chaos decides, by ever shorter steps, and how sure that is."""

import math
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.mechanics.systems import EARTH, differences
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import CompiledSteps, Untraceable

HORIZON = 2.0  # s; of short rods, which swing faster, at most 20 sqrt(L/g): chaos is as fast
FIRST = 0.15  # of sqrt(L/g): the longest first step
TURN = 0.5  # rad: nor does anything turn by more in it
COUNTS = 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512  # times half the first
NEAR = 1e-8  # of the shortest rod: a move by which a frequency is measured
MOST_STEPS = 20_000  # of one rod at once: more take too long
STEPS = 800  # for each rod, in all: many repay machine code
ENOUGH = 1e-11  # m, or of the shortest rod: ends that are as near agree
KNOWN = 1e-9  # m, or a millionth of the shortest rod: what is less certain counts as unknown
MAX_RODS = 40  # for more the reference takes longer than the run, and browsers are too slow


class Reference(NamedTuple):
    """Where the particles are after so many steps of the run."""

    step: int
    at: str  # when that is, in words
    q: np.ndarray | None = None  # (N, 3) in m, if it is known
    uncertainty: float = math.inf  # m, of the particle that is known worst
    why: str = ""  # it is not known, in words

    def error(self, q):
        """How far the worst particle of a run q (steps + 1, N, 3) is off, in m; None if unknown."""
        if self.q is None or q is None or len(q) <= self.step:
            return None
        return distance(q[self.step], self.q)


def distance(q, other):
    """The largest of a particle, in m, between two places of all (N, 3); inf if one is NaN."""
    return float(np.nan_to_num(np.max(np.linalg.norm(q - other, axis=1)), nan=np.inf))


def find_reference(system, force, project, runs):
    """The Reference for runs of a system: after HORIZON or, if they end sooner, at their end."""
    dt = next(run.dt for run in runs)
    steps = max(1, max(len(run.q) for run in runs) - 1)
    last = horizon(system, force, dt, steps)
    return true_motion(system, force, project, dt, last, why_unknown(runs))


def why_unknown(runs):
    """Why steps of one's own would not show where runs should be, in words, or ""."""
    if any(run.step.edited for run in runs):
        return "the loop edits what its steps take"
    if not all(run.step.is_compiled for run in runs):
        return "steps are not compiled, and it would take long"
    return ""


def horizon(system, force, dt, steps):
    """After how many of `steps` of dt s places are compared."""
    swing, _ = time_scales(system, force)
    return min(steps, max(1, round(min(HORIZON, 20.0 * swing) / dt)))


def true_motion(system, force, project, dt, last, why=""):
    """The Reference after the `last` step of dt s; unknown if there is a reason `why`.

    project(system, q_start, q, v, dt) puts the end of a step back onto the rods. The steps get
    shorter until two ends agree, or until rounding keeps them apart.
    """
    shortest = float(np.min(system["lengths"]))
    unknown = Reference(last, f"at {last * dt:.3g} s")
    counts = []
    if not why:
        counts, why = step_counts(system, force, last * dt)
    if why:
        return unknown._replace(why=why)
    try:
        end = end_after(last * dt, system, force, project, counts[0])
    except Untraceable as cause:
        return unknown._replace(why=f"its steps cannot be compiled: {cause}")
    count, best, uncertainty = agreed(end, counts, ENOUGH * min(1.0, shortest))
    known = min(KNOWN, 1e-6 * shortest)
    if uncertainty < known:  # what changes with the last digit of the start cannot be known
        uncertainty += change_by_rounding(end, count, best, system)
    if not uncertainty < known:
        near = "a nanometre" if known == KNOWN else "a millionth of the shortest rod"
        return unknown._replace(why=f"shorter steps do not agree to {near}")
    return Reference(last, unknown.at, best, uncertainty)


def step_counts(system, force, seconds):
    """Into how many steps so many seconds are divided, one time after the other: a list.

    Beside it stands why that cannot be, in words, or "". Gauss's rule halves a step whose stages do
    not converge. So no count is twice the last one: both might be made of the same parts, and
    agree.
    """
    rods = len(system["pairs"])
    if rods > MAX_RODS:
        return [], f"it would take long for more than {MAX_RODS} rods"
    swing, turn = time_scales(system, force)
    if math.isnan(swing):
        return [], "the force at the start is not a number"
    least = math.ceil(seconds / min(FIRST * swing, TURN * turn) / 2.0)
    most = MOST_STEPS // rods
    counts = [least * k for k in COUNTS if least * k <= most]
    if len(counts) < 2:
        return [], f"it would take more than {most} steps"
    return counts, ""


def end_after(seconds, system, force, project, fewest):
    """end(count, q) -> (N, 3): where so many steps, at least `fewest`, of gauss and project lead.

    They begin at q, by default that of the system, and with its v. An end that is not reached is
    NaN. Raises Untraceable.
    """
    v = system["v0"]
    gauss = make_gauss(8)

    def step(q, v, dt):
        return project(system, q, *gauss(q, v, system["m"], force, dt), dt)

    steps = max(STEPS * len(system["pairs"]), 4 * fewest)  # as a guess
    run = CompiledSteps(step, [system["q0"], v], steps, knobs=1)

    def end(count, q=system["q0"]):
        ends, _ = run([q, v], count, seconds / count)
        return ends[-1] if len(ends) > count else np.full_like(q, np.nan)

    return end


def agreed(end, counts, enough):
    """The first count whose end agrees with that before it, this end, and by how much, in m.

    Or those of the last count, or of the first that rounding keeps from getting nearer.
    """
    best = end(counts[0])
    gaps = []
    for count in counts[1:]:
        before = best
        best = end(count)
        gaps.append(distance(best, before))
        if gaps[-1] < enough:
            return count, best, gaps[-1]
        if len(gaps) > 4 and not gaps[-1] < gaps[-5]:
            break  # rounding keeps them apart: these steps are four times as short
    return count, best, max(gaps[-3:])


def change_by_rounding(end, count, best, system):
    """How far an end may be off, in m, since each of its steps rounds, as steps at random do."""
    q = system["q0"]
    signs = (-1.0) ** np.arange(q.size).reshape(q.shape)
    moves = np.any([q, system["v0"]], axis=(0, 1))  # along which axes
    digit = 2.0**-52 * (np.abs(q) + np.max(system["lengths"])) * moves
    return 4.0 * math.sqrt(count) * distance(end(count, q + signs * digit), best)


def time_scales(system, force):
    """In s, sqrt(L/g) and that in which a rod or an acceleration turns by a radian, at the start.

    g is what accelerates a rod's ends apart across it, or that of the Earth. As a particle moves
    its acceleration changes by the square of a frequency, which may be much higher.
    """
    pairs = system["pairs"]
    lengths = system["lengths"]
    fixed = np.zeros_like(system["anchors"])  # of what moves, at an anchor
    q = system["q0"]
    v = system["v0"]
    m = system["m"]
    along = differences(q, system["anchors"], pairs) / lengths[:, None]
    a = force(q, v) / m
    apart = differences(a, fixed, pairs)
    across = apart - np.sum(apart * along, axis=1)[:, None] * along
    g = np.maximum(EARTH, np.linalg.norm(across, axis=1))
    rates = [np.max(np.linalg.norm(differences(v, fixed, pairs), axis=1) / lengths)]
    near = NEAR * np.min(lengths)
    for way in (a, v):
        size = np.max(np.abs(way))
        if size > 0.0:
            other = force(q + near * way / size, v) / m
            rates.append(np.sqrt(np.max(np.abs(other - a)) / near))
    return float(np.min(np.sqrt(lengths / g))), 1.0 / max(1e-9, *map(float, rates))
