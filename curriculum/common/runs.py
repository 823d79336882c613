"""What a run leaves behind: a log while it goes, and a Run when it has ended."""

import math
from typing import NamedTuple

from curriculum.common.banner import progress
from curriculum.common.trace import Stop

import numpy as np


class Run(NamedTuple):
    """A measured run: series from the start on, the states that were to be kept, and the last."""

    tip: np.ndarray  # (steps + 1, ..., 3) m, the last particle
    violations: np.ndarray  # (steps + 1, ...) m
    energies: np.ndarray  # (steps + 1, ...) J
    kept: np.ndarray  # (K,) the steps of
    q: np.ndarray  # (K, ..., N, 3) m
    v: np.ndarray  # (K, ..., N, 3) m/s
    stopped: str | None  # why it ended early; all before was true
    kind: str | None  # in a word: "diverged", or that of a Stop
    halved: int  # steps that were taken in halves
    seconds: float  # of the steps alone
    way: str  # how the steps were computed
    source: str  # the code that a step has become

    @property
    def pace(self):
        """Microseconds a step."""
        return 1e6 * self.seconds / max(1, len(self.tip) - 1)

    @property
    def note(self):
        """What is to be said of a run that did not go straight to its end."""
        many = "a step" if self.halved == 1 else f"{self.halved} steps"
        halved = f"took {many} in halves" if self.halved else ""
        return ", and ".join(filter(None, (halved, self.stopped)))

    def every(self, steps):
        """The kept states q, v (K, ..., N, 3) of each so many steps."""
        return self.q[self.kept % steps == 0], self.v[self.kept % steps == 0]

    def summary(self, scale, truth, left=0.0):
        """What a run of one member came to, rounded: m; its worst energy error as a share of scale.

        `scale` in J. `error`: how far a particle is from the Truth, if that is known. `left`: how
        much of what was asked of the force it left unanswered.
        """
        there = self.q[self.kept == truth.step]  # (1, N, 3), or none if the run did not get there
        known = truth.q is not None and len(there)
        worst = np.max(np.abs(self.energies - self.energies[0])) / scale
        return {
            "max_violation": round(float(np.max(self.violations)), 12),
            "final_violation": round(float(self.violations[-1]), 12),
            "energy_rel_max": round(float(worst), 12),
            "tip_final": [round(x, 6) for x in self.tip[-1].tolist()],
            "error": round(distance(there[0], truth.q), 12) if known else None,
            "halved": self.halved,
            "stopped": self.stopped,
            "unheld": float(f"{round(float(left), 6):.3g}"),  # the rest may be rounding
        }


def distance(a, b):
    """The largest distance in m between the same particle in positions a and b, (..., N, 3)."""
    return float(np.sqrt(np.max(np.sum(np.square(a - b), axis=-1))))


class Log:
    """What a run is measured to be: `note` what is seen, and `run` is all of it.

    As a context it takes note of a Stop, which ends the run and not the program. `steps`: how many
    are to come; `keep`: those whose states are kept; `far` m: what is off by more has flown apart.
    """

    def __init__(self, steps, keep, far):
        self.steps, self.far = steps, far
        self.keep = np.array(sorted(set(keep)), dtype=int)
        self.done, self.stopped, self.kind = -1, None, None  # the start is step 0
        self.series, self.kept = [], []

    def __enter__(self):
        self.quiet = np.errstate(all="ignore")  # a run that blows up is told of once, and in words
        self.quiet.__enter__()
        return self

    def __exit__(self, kind, why, trace):
        self.quiet.__exit__(kind, why, trace)
        if isinstance(why, Stop):
            self.stopped, self.kind = f"stopped at step {self.done + 1}: {why}", why.kind
        return isinstance(why, Stop)

    def turns(self):
        """Again and again, until all steps are done or the run has ended."""
        tick = progress("simulating", self.steps)
        while self.done < self.steps and not self.stopped:
            yield self.done
            tick(self.steps if self.stopped else self.done)

    def note(self, q, v, violations, energies):
        """Take a state, or a block of them, and what was measured of it, as far as it is sane."""
        measured = [q[..., -1, :], violations, energies]
        if not self.series:
            self.series = [np.empty((self.steps + 1, *x.shape)) for x in measured]
        if q.ndim == self.series[0].ndim:  # one state
            q, v, *measured = (np.asarray(x)[None] for x in (q, v, *measured))
        _, violations, energies = measured
        sane = (violations < self.far) & np.isfinite(energies)
        sane = np.logical_and.accumulate(sane.reshape(len(q), -1).all(axis=1))
        count, first = int(np.sum(sane)), self.done + 1
        if first + count == 0:
            raise ValueError("this is no start: a rod is far off, or a number is not finite")
        for series, x in zip(self.series, measured, strict=True):
            series[first : first + count] = x[:count]
        self.done += count
        low, high = np.searchsorted(self.keep, [first, first + count])
        rows = self.keep[low:high] - first
        self.kept.append((rows + first, q[rows], v[rows]))
        if count:
            self.last = [self.done], q[count - 1 : count], v[count - 1 : count]
        if count < len(q):
            self.stopped, self.kind = f"diverged at step {self.done + 1}", "diverged"

    def run(self, stepper):
        """All that was noted, as a Run; `stepper` knows how the steps were done."""
        steps, q, v = (np.concatenate(x) for x in zip(*self.kept, self.last, strict=True))
        once = np.flatnonzero(np.diff(steps, append=math.inf))  # the last may have been kept
        series = [x[: self.done + 1] for x in self.series]
        ended = self.stopped, self.kind, stepper.halved
        seconds = stepper.seconds * self.done / max(1, stepper.taken)
        how = seconds, stepper.way, stepper.source
        return Run(*series, steps[once], q[once], v[once], *ended, *how)
