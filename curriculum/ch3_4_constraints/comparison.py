"""What a run of the program has found: one record for its table, metrics, picture and recording."""

import re
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from curriculum.ch3_4_constraints.tables import length
from curriculum.common.ruler import Truth
from curriculum.common.runs import Run

import numpy as np

FRAME_RATE = 60.0  # states shown in a simulated second
FRAMES = 3600  # at most, in all
POSITIONS = 300_000  # of particles, at most, in all frames of a mode
FEW = 50  # steps in which a short run is shown step by step
NO_TEXT = r"[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"  # what XML cannot hold


class Comparison(NamedTuple):
    """One scene and one rule, held by several modes."""

    args: Namespace  # the flags
    system: dict
    rule: str  # its name
    dt: float  # s
    steps: int  # that were to be taken
    truth: Truth
    runs: dict[str, Run]  # by mode
    scale: float  # J, the unit of energy errors: sum m |g| sum L
    tensions: dict[str, Callable]  # by mode: of states q, v (F, N, 3), newtons (F, C)
    shown: np.ndarray  # (F,) the steps to be shown, as `frames` has them
    motion: np.ndarray  # (T, N, 3) m: the true motion at the first T of these

    @property
    def rows(self):
        """By mode: the summary of a run, as in metrics.json."""
        return {mode: run.summary(self.scale, self.truth) for mode, run in self.runs.items()}

    @property
    def scene(self):
        """The system's name, without what is no text: a file may be called anything."""
        return re.sub(NO_TEXT, "?", Path(self.args.system).stem)

    @property
    def title(self):
        """What was run, in words."""
        return f"{self.scene}, {self.rule}, steps of {self.dt:.4g} s"

    def outcome(self, mode):
        """What became of a mode, in a few words."""
        run = self.runs[mode]
        lost = f"lost at {run.kept[-1] * self.dt:.3g} s"
        return lost if run.stopped else f"off {length(np.max(run.violations))}"

    def states(self, mode, steps):
        """The steps (F,) among `steps` that a mode got to, and q, v (F, N, 3) there."""
        run = self.runs[mode]
        there = np.isin(run.kept, steps)
        return run.kept[there], run.q[there], run.v[there]


def frames(steps, dt, particles, wanted=True):
    """The steps (F,) of a run that are shown, multiples of the first that is not 0; if `wanted`.

    They are FRAME_RATE a simulated second, or more so that there are FEW, or every one. If that is
    too many, the first third and the last keep that rate, and those in between are few.
    """
    every = max(1, min(round(1.0 / (FRAME_RATE * dt)), steps // FEW))
    numbers = np.arange(steps // every + 1 if wanted else 0)
    third = max(2, min(FRAMES, POSITIONS // particles) // 3)
    if len(numbers) > 3 * third:
        between = np.linspace(third, len(numbers) - third, third, endpoint=False).astype(int)
        numbers = np.concatenate([numbers[:third], between, numbers[-third:]])
    return every * numbers
