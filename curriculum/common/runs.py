"""What a run leaves behind: a log while it goes, and a Run when it has ended."""

import math
from types import SimpleNamespace

from curriculum.common.cli import shorten
from curriculum.common.progress import work
from curriculum.common.steps import Block, alone
from curriculum.common.tape import Stop

import numpy as np


class Run(SimpleNamespace):
    """A measured run; it unpacks as the chapter has it: tip, violations, energies = simulate(...).

    These are series from the start on. It has the states that were to be kept, too, and the last.
    """

    tip: np.ndarray  # (steps + 1, 3) m, the last particle
    violations: np.ndarray  # (steps + 1,) m
    energies: np.ndarray  # (steps + 1,) J
    kept: np.ndarray  # (K,) the steps of
    q: np.ndarray  # (K, N, 3) m
    v: np.ndarray  # (K, N, 3) m/s
    stopped: str | None  # why it ended early; all before was true
    halved: int  # steps that were taken in halves
    watched: float  # the largest of what the stepper was to watch
    pace: float  # us a step, of the steps alone
    how: str  # the steps were computed, in words
    stepper: object  # what took the steps, a Plain or a Compiled

    def __iter__(self):
        return iter((self.tip, self.violations, self.energies))

    def __repr__(self):
        kept = f"{len(self.kept)} step{'' if len(self.kept) == 1 else 's'}"
        return (
            f"Run of {len(self.tip) - 1} steps, {self.stopped or 'to its end'}\n"
            f"  tip: from {self.tip[0]} to {self.tip[-1]} m\n"
            f"  violations: at most {np.max(self.violations):.3g} m\n"
            f"  energies: from {self.energies[0]:.6g} to {self.energies[-1]:.6g} J\n"
            f"  q, v: kept at {kept}; {self.pace:.3g} us a step, {self.how}"
        )

    def __reduce__(self):
        """Of what took the steps a copy has the code, and nothing else."""
        return Run, (), vars(self) | {"stepper": SimpleNamespace(source=self.source)}

    @property
    def source(self):
        """The code that a step has become."""
        return self.stepper.source

    @property
    def remark(self):
        """What is to be said of a run that did not go straight to its end."""
        many = "a step" if self.halved == 1 else f"{self.halved} steps"
        halved = f"took {many} in halves" if self.halved else ""
        return ", and ".join(filter(None, (halved, self.stopped)))

    def summary(self, scale, truth):
        """What a run came to, rounded, as metrics.json has it: in m, and energies by `scale` in J.

        `error`: how far a particle is from the Truth, if that is known. `unheld`:
        the most that was asked of the rods and left unanswered, if that was watched.
        """
        there = self.q[self.kept == truth.step]  # (1, N, 3), or none if the run did not get there
        known = truth.q is not None and len(there)
        worst = np.max(np.abs(self.energies - self.energies[0])) / scale
        jump = np.max(np.abs(np.diff(self.energies)), initial=0.0) / scale
        return {
            "max_violation": round(float(np.max(self.violations)), 12),
            "final_violation": round(float(self.violations[-1]), 12),
            "energy_rel_max": round(float(worst), 12),
            "energy_step_max": round(float(jump), 12),
            "tip_final": [round(x, 6) for x in self.tip[-1].tolist()],
            "error": round(distance(there[0], truth.q), 12) if known else None,
            "halved": self.halved,
            "stopped": self.stopped,
            "unheld": float(f"{round(self.watched, 6):.3g}"),  # the rest may be rounding
        }


def distance(a, b):
    """The largest distance in m between the same particle in positions a and b, (..., N, 3)."""
    return float(np.sqrt(np.max(np.sum(np.square(a - b), axis=-1))))


def number(name, x):
    """x, which the function of this name returned, as a float. Raises ValueError if it is none."""
    if x is None or np.shape(x):
        raise ValueError(f"{name} returned {shorten(repr(x))}, where one number must be")
    return float(x)


class Log:
    """Takes the steps of a run and notes what is measured: `start`, `step` by step, then `run`.

    As a context it takes note of a Stop, which ends the run and not the program. `stepper` makes
    Blocks, of `steps` states in all; those of `keep` are kept. What has a rod that is `far` m off
    has diverged.
    """

    def __init__(self, stepper, steps, keep, far):
        self.stepper, self.steps, self.far = stepper, steps, far
        self.keep = np.array(sorted(set(keep)), dtype=int)
        self.done, self.stopped = -1, None  # the start is step 0
        self.tip = np.empty((steps + 1, 3))
        self.violations, self.energies = np.empty((2, steps + 1))
        self.kept, self.last, self.watched, self.halved = [], None, 0.0, 0
        self.block, self.wild = None, False  # whether what follows the block has diverged
        self.latest, self.ahead = (None, None), iter(())
        self.tick = work.ticks(steps)

    def __enter__(self):
        self.quiet = np.errstate(all="ignore")  # a run that blows up is told of once, and in words
        self.quiet.__enter__()
        return self

    def __exit__(self, kind, why, trace):
        if isinstance(why, ValueError) and "read-only" in str(why):
            why.add_note("States are computed ahead, so none is changed in place: v = 0.9 * v.")
        try:
            self.close()
            self.stepper.confirm()
        finally:
            self.quiet.__exit__(kind, why, trace)
        if isinstance(why, Stop):
            self.stopped = self.stopped or f"stopped at step {self.done + 1}: {why}"
        self.tick(self.steps if self.stopped else self.done)
        return isinstance(why, Stop)

    def start(self, q, v):
        """Note the start of the run: q, v."""
        measured = [[x] for x in self.stepper.measure(q, v)]
        try:
            return self.hand_out(Block(*alone(q, v), measured, (), (q, v)))
        except Stop:
            why = "this is no start: a rod is far off, or a number is not finite"
            raise ValueError(why) from None

    def step(self, q, v):
        """The state after q, v, which may have been computed ahead; it is measured and noted."""
        latest = self.latest
        if q is latest[0] and v is latest[1]:  # else the reader has changed it
            for latest in self.ahead:  # the next, if there is one: this is quicker than next()
                self.latest = latest
                return latest
        return self.go_on(q, v)

    def go_on(self, q, v):
        """The state after q, v, which a new block begins."""
        wild = self.wild and q is self.latest[0] and v is self.latest[1]
        self.close()
        if wild:
            self.diverge()
        if self.done == self.steps:
            raise ValueError(f"the {self.steps} steps of this run are done")
        return self.hand_out(self.stepper.ahead(q, v))

    def diverge(self):
        """End the run before what has diverged."""
        self.stopped = f"diverged at step {self.done + 1}"
        raise Stop(self.stopped)

    def hand_out(self, block):
        """The first state of a block; those that have diverged, and what follows, are cut off."""
        names = "constraint_violation", "energy"
        if block.given is not None:  # it is one state, which was measured by itself
            both = zip(names, block.measured, strict=True)
            block.measured = [np.array([number(name, *x)]) for name, x in both]
        violations, energies = block.measured
        wild = ~((violations < self.far) & np.isfinite(energies))
        self.wild = bool(wild.any())
        if self.wild:
            block.cut(int(np.argmax(wild)))
        self.block, self.ahead = block, iter(block)
        self.latest, self.stopped = next(self.ahead, (None, None)), None
        if self.latest[0] is None:
            self.diverge()
        return self.latest

    def close(self):
        """Take from the block what was noted of it."""
        block, first = self.block, self.done + 1
        count = block.handed() if block else 0
        self.block, self.wild = None, False
        if not count:
            return
        noted = slice(first, first + count)
        self.tip[noted] = block.q[:count, -1]
        self.violations[noted], self.energies[noted] = (x[:count] for x in block.measured)
        low, high = np.searchsorted(self.keep, [first, first + count])
        rows = self.keep[low:high] - first
        self.kept.append((rows + first, block.q[rows], block.v[rows]))
        self.last = [first + count - 1], block.q[[count - 1]], block.v[[count - 1]]
        self.done += count
        self.halved += int(np.sum(block.halved < count))
        self.tick(self.done)
        if self.stepper.watch:
            seen = self.stepper.watch(block.q[:count], block.v[:count])
            self.watched = max(self.watched, float(np.max(seen)))

    def run(self):
        """All that was noted, as a Run."""
        steps, q, v = (np.concatenate(x) for x in zip(*self.kept, self.last, strict=True))
        once = np.flatnonzero(np.diff(steps, append=math.inf))  # the last may have been kept
        kept = {"kept": steps[once], "q": q[once], "v": v[once]}
        names, stepper = ("tip", "violations", "energies"), self.stepper
        series = {name: getattr(self, name)[: self.done + 1] for name in names}
        ended = {"stopped": self.stopped, "watched": self.watched}
        ended["halved"] = self.halved
        pace = 1e6 * stepper.seconds / max(1, stepper.taken)
        return Run(**series, **kept, **ended, pace=pace, how=stepper.how, stepper=stepper)
