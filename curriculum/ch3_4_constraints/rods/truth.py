"""The true motion: where the particles are before chaos decides, and how sure that is."""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from curriculum.ch3_4_constraints.rods.singular import is_undecided
from curriculum.ch3_4_constraints.rods.systems import distances, rod_rates, rod_vectors, tolerance
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import CompiledSteps, Untraceable
from curriculum.common.words import length, milliseconds

HORIZON = 2.0  # s; of short rods, which swing faster, at most 20 sqrt(L/g): chaos is as fast
EARTH = 9.81  # m/s^2: the scale of what is fast, whatever GRAVITY is
FIRST = 0.15  # of sqrt(L/g): the longest first step
TURN = 0.5  # rad: nor does anything turn by more in it
COUNTS = 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512  # times half the first
NEAR = 1e-8  # of the shortest rod: a move by which a frequency is measured
MOST_STEPS = 20_000  # of one rod at once: more take too long
STEPS = 800  # for each rod, in all: many repay machine code
ENOUGH = 1e-11  # m, or of the shortest rod: ends that are as near agree
KNOWN = 1e-9  # m, or a millionth of the shortest rod: what is less certain counts as unknown
FITS = 1e-3  # of the shortest rod: so far places may be off as rods do not fit them
DIVIDED = 16  # parts of a step, at most: shorter steps come anyway
PARTS = 2, 3, 4, 6, 8  # steps, after one, from a time of a path to the next
WHOLE = Fraction(1)
MAX_RODS = 60  # for more it takes long


class Truth(NamedTuple):
    """Where the particles are after so many steps of the run."""

    step: int
    at: str  # when that is, in words
    q: np.ndarray | None = None  # (N, 3) in m, if it is known
    uncertainty: float = math.inf  # m, of the particle that is known worst
    why: str = ""  # it is not known, in words

    def error(self, q):
        """How far the worst particle of a run q (steps + 1, N, 3) is off, in m; None if unknown."""
        if self.q is None or len(q) <= self.step:
            return None
        return distance(q[self.step], self.q)


def distance(q, other):
    """The largest of a particle, in m, between two places of all (..., N, 3); inf if one is NaN."""
    return float(np.nan_to_num(np.max(np.linalg.norm(q - other, axis=-1)), nan=np.inf))


def find_truth(chapter, system, runs):
    """The Truth for runs of a system: after HORIZON or, if they end sooner, at their end."""
    dt = next(run.dt for run in runs)
    steps = max(1, max(len(run.q) for run in runs) - 1)
    last = last_step(chapter, system, dt, steps)
    return true_motion(chapter, system, dt, last, why_unknown(runs))


def why_unknown(runs):
    """Why steps of one's own would not show where runs should be, in words, or ""."""
    for run in runs:
        if run.unlike:
            return run.unlike
        if not run.report.is_compiled:
            return "steps are not compiled, and it would take long"
    return ""


def horizon(chapter, system, whole):
    """Up to when places are compared, in s, of a run of so many s."""
    swing, _ = time_scales(system, chapter.make_force(system))
    return min(whole, HORIZON, 20.0 * swing)


def last_step(chapter, system, dt, steps):
    """After how many of `steps` of dt s places are compared."""
    return max(1, round(horizon(chapter, system, steps * dt) / dt))


def true_motion(chapter, system, dt, last, why=""):
    """The Truth after the `last` step of dt s; unknown if there is a reason `why`.

    The steps get shorter until two ends agree, or until rounding keeps them apart.
    """
    seconds = last * dt
    shortest = float(np.min(system["lengths"]))
    unknown = Truth(last, f"at {seconds:.3g} s")
    counts = []
    if not why and len(system["pairs"]) > MAX_RODS:
        why = f"it would take long for more than {MAX_RODS} rods"
    if not why:
        counts, why = step_counts(system, chapter.make_force(system), seconds)
    if why:
        return unknown._replace(why=why)
    try:
        exact = Exact(chapter, system, counts[0])
    except Untraceable as cause:
        return unknown._replace(why=f"its steps cannot be compiled: {cause}")
    if not np.isfinite(exact.start).all():
        return unknown._replace(why="no places near those of the start give all rods their lengths")
    count, best, gap = agreed(exact, seconds, counts, ENOUGH * min(1.0, shortest))
    known = limit(system)
    if not gap < known:
        return unknown._replace(why=why_apart(seconds, count, counts, gap))
    rounding = change_by_rounding(exact, seconds, count, best, system)
    if not gap + rounding < known:
        return unknown._replace(why=f"rounding changes it by {length(rounding)}")
    if is_undecided(system, exact, seconds, count):
        return unknown._replace(why="rods lie in line, and could go on in more than one way")
    misfit = change_by_misfit(chapter, system, seconds, count, best)
    if not misfit < FITS * shortest:
        return unknown._replace(why=f"its rods do not fit its places, which means {length(misfit)}")
    return Truth(last, unknown.at, best, gap + rounding + misfit)


def limit(system):
    """How sure places must be to count as known, in m."""
    return min(KNOWN, 1e-6 * float(np.min(system["lengths"])))


def why_apart(seconds, count, counts, gap):
    """Why ends that differ by a gap, in m, after so many steps are not known, in words."""
    if not math.isfinite(gap):
        return f"its steps do not converge, down to {milliseconds(seconds / count)}"
    more = ", the most that are tried," if count == counts[-1] else ""
    return f"with {count:,} steps{more} it is known to {length(gap)} only"


def step_counts(system, force, seconds):
    """Into how many steps so many seconds are divided, one time after the other: a list.

    Beside it stands why that cannot be, in words, or "". Gauss's rule halves a step whose stages do
    not converge. So no count is twice the last one: both might be made of the same parts, and
    agree.
    """
    swing, turn = time_scales(system, force)
    if math.isnan(swing):
        return [], "the force at the start is not a number"
    least = math.ceil(seconds / min(FIRST * swing, TURN * turn) / 2.0)
    most = MOST_STEPS // len(system["pairs"])
    counts = [least * k for k in COUNTS if least * k <= most]
    if len(counts) < 2:
        return [], f"it would take more than {most:,} steps"
    return counts, ""


class Exact:
    """Steps of Gauss's rule and project, whose ends agree if they are short enough."""

    def __init__(self, chapter, system, fewest):
        q = system["q0"]
        v = system["v0"]
        if is_off(system):
            q, v = chapter.project(system, q, q, v, math.inf)
        gauss = make_gauss(8, parts=DIVIDED)
        force = chapter.make_force(system)

        def step(q, v, dt):
            return chapter.project(system, q, *gauss(q, v, system["m"], force, dt), dt)

        steps = max(STEPS * len(system["pairs"]), 4 * fewest)  # as a guess
        self.start = [q, v]
        self.run = CompiledSteps(step, self.start, steps, knobs=1)

    def states(self, seconds, count, q=None):
        """All places of `count` steps, (count + 1, N, 3) in m, from q or the start's.

        They are NaN from a step on that fails.
        """
        at, v = self.start
        found, _ = self.run([at if q is None else q, v], count, seconds / count)
        failed = np.full((count + 1 - len(found), *at.shape), np.nan)
        return np.concatenate([found, failed])

    def end(self, seconds, count, q=None):
        """The last places, (N, 3) in m; NaN where a step fails."""
        return self.states(seconds, count, q)[-1]


def agreed(exact, seconds, counts, enough):
    """The first count whose end agrees with that before it, this end, and by how much, in m.

    Or those of the last count, or of the first that rounding keeps from getting nearer.
    """
    best = exact.end(seconds, counts[0])
    gaps = []
    for count in counts[1:]:
        before = best
        best = exact.end(seconds, count)
        gaps.append(distance(best, before))
        if gaps[-1] < enough:
            return count, best, gaps[-1]
        if len(gaps) > 4 and not gaps[-1] < gaps[-5]:
            break  # rounding keeps them apart: these steps are four times as short
    return count, best, max(gaps[-3:])


def change_by_rounding(exact, seconds, count, best, system):
    """How far an end may be off, in m, since each of its steps rounds, as steps at random do."""
    q = exact.start[0]
    signs = (-1.0) ** np.arange(q.size).reshape(q.shape)
    moves = np.any([q, system["v0"]], axis=(0, 1))  # along which axes
    digit = 2.0**-52 * (np.abs(q) + np.max(system["lengths"])) * moves
    return 4.0 * math.sqrt(count) * distance(exact.end(seconds, count, q + signs * digit), best)


class Path(NamedTuple):
    """The true motion at times that are `grid` s apart."""

    grid: float  # s
    q: np.ndarray | None = None  # (times, N, 3) in m, from the start on; None if it is not known
    uncertainty: float = math.inf  # m

    @property
    def seconds(self):
        """Up to when it is known, in s."""
        return self.grid * (len(self.q) - 1)

    def off(self, q, dt, part=WHOLE):
        """How far places q (steps + 1, N, 3) are off at the worst time that both have, in m.

        The steps are a `part` of dt s, and dt is the grid times a power of 2. None if nothing is
        known, inf if q ends before.
        """
        if self.q is None:
            return None
        ratio = dt / self.grid
        mine = q[:: part.denominator * max(1, round(1.0 / ratio))]
        true = self.q[:: part.numerator * max(1, round(ratio))]
        return distance(mine[: len(true)], true) if len(mine) >= len(true) else math.inf


def change_by_misfit(chapter, system, seconds, count, best):
    """How far an end may be off, in m, since rods do not fit the places of the start.

    Lengths may be right, and places be moved; or places, and lengths are as they say.
    """
    if not is_off(system):
        return 0.0
    measured = system | {"lengths": distances(system)}
    return distance(Exact(chapter, measured, count).end(seconds, count), best)


def is_off(system):
    """Whether rods are off their lengths at the start, by more than rounding."""
    q = system["q0"]
    found = distances(system)
    g = 0.5 * (found * found - system["lengths"] ** 2)
    return bool(np.any(np.abs(g) > tolerance(system, q, len(found))))


def true_path(chapter, system, grid, count, uncertainty):
    """The Path of `count` times, whose last places are known to `uncertainty`, in m.

    It is not known where finer steps do not agree with coarser ones at all of these times.
    """
    exact = Exact(chapter, system, count)
    coarse = exact.states(count * grid, count)
    for parts in PARTS:
        fine = exact.states(count * grid, count * parts)[::parts]
        apart = distance(fine, coarse)
        if apart < limit(system):
            return Path(grid, fine, apart + uncertainty)
        coarse = fine
    return Path(grid)


def time_scales(system, force):
    """In s, sqrt(L/g) and that in which a rod or an acceleration turns by a radian, at the start.

    g is what accelerates a rod's ends apart across it, or that of the Earth. As a particle moves
    its acceleration changes by the square of a frequency, which may be much higher.
    """
    lengths = system["lengths"]
    q = system["q0"]
    v = system["v0"]
    m = system["m"]
    along = rod_vectors(system, q) / lengths[:, None]
    a = force(q, v) / m
    apart = rod_rates(system, a)
    across = apart - np.sum(apart * along, axis=1)[:, None] * along
    g = np.maximum(EARTH, np.linalg.norm(across, axis=1))
    rates = [np.max(np.linalg.norm(rod_rates(system, v), axis=1) / lengths)]
    near = NEAR * np.min(lengths)
    for way in (a, v):
        size = np.max(np.abs(way))
        if size > 0.0:
            other = force(q + near * way / size, v) / m
            rates.append(np.sqrt(np.max(np.abs(other - a)) / near))
    return float(np.min(np.sqrt(lengths / g))), 1.0 / max(1e-9, *map(float, rates))
