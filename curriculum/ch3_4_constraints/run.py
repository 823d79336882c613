"""What simulate hands over."""

import math

import numpy as np

from curriculum.common.tracing import vmap

FAR = 100.0  # of all rods together: beyond, a run has diverged


class Run:
    """A run, measured at each of its states, up to the last before it diverged.

    It unpacks as the chapter has it: tip, violations, energies = simulate(...).
    """

    def __init__(
        self, tip, violations, energies, system, dt, q=None, v=None, stopped=None, step=None
    ):
        self.tip = np.asarray(tip)  # (steps + 1, 3) in m: the last particle's path
        self.violations = np.asarray(violations)  # (steps + 1,) in m
        self.energies = np.asarray(energies)  # (steps + 1,) in J
        self.dt = dt  # s
        self.q, self.v = q, v  # (steps + 1, N, 3) in m and m/s, or None: not known
        self.stopped = stopped  # why it ended early, in words, or None
        self.how = step.how if step else "a simulate without compiled steps"
        self.not_compiled = self.how.startswith("plain numpy")
        self.source = step.source if step else ""  # of one step, as Python
        self.pace = 1e6 * step.seconds / max(1, len(tip) - 1) if step else math.nan  # us a step
        self.cut_where_diverged(FAR * np.sum(system["lengths"]))

    @classmethod
    def of(cls, made, system, dt):
        """What a simulate made, as a Run: it may be chapter 3.3's three arrays."""
        return made if isinstance(made, cls) else cls(*made, system, dt)

    def __iter__(self):
        return iter((self.tip, self.violations, self.energies))

    def largest(self, function):
        """The largest function(q, v) of its states; None if they are not known."""
        return None if self.q is None else np.max(vmap(function)(self.q, self.v))

    def cut_where_diverged(self, far):
        """Keep the states whose energy is finite, and whose rods are off by less than `far` m."""
        good = np.isfinite(self.energies) & (self.violations < far)
        if not good.all():
            k = max(1, int(np.argmin(good)))
            never_written = np.isnan(self.tip[k]).all()
            if not (never_written and self.stopped):
                why = "it ended there" if never_written else "diverged"
                self.stopped = f"lost at {(k - 1) * self.dt:.3g} s: {why}"
            self.tip, self.violations, self.energies = (x[:k] for x in self)
            if self.q is not None:
                self.q, self.v = self.q[:k], self.v[:k]
