"""What simulate returns."""

from functools import cached_property

import numpy as np

FAR = 100.0  # of all rods together: beyond, a run has diverged
MOVES = 1e-9  # of the shortest rod: what moves by less, stands still


class Run:
    """Every state of a run, what was measured in each, and how its steps were taken.

    It unpacks as the chapter has it: tip, violations, energies = simulate(...). It ends with the
    last state before a step failed or diverged, or with the last that its loop has reached.
    """

    def __init__(self, tip, violations, energies, system, dt, q, v, step):
        far = FAR * np.sum(system["lengths"])
        good = np.isfinite(energies) & (violations < far)
        count = len(q) if good.all() else max(1, int(np.argmin(good)))
        self.dt, self.step = dt, step.report  # s; how its steps were taken
        self.m, self.shortest = system["m"], np.min(system["lengths"])  # kg, m
        self.q, self.v = q[:count], v[:count]  # (count, N, 3) in m and m/s
        self.tip = tip[:count]  # (count, 3) in m: the last particle's path
        self.violations, self.energies = violations[:count], energies[:count]  # (count,) in m, J
        self.pace = self.step.pace  # us a step
        self.lost = self.stopped = None  # why there is no row for it; why it ended early
        if count < len(q):
            end, loop_ended = f"{(count - 1) * dt:.3g} s", np.isnan(q[count:]).all()
            if self.step.failure or not loop_ended:
                self.lost = f"lost at {end}: {self.step.failure or 'diverged'}"
            self.stopped = self.lost or f"its loop ended at {end}"

    def __iter__(self):
        return iter((self.tip, self.violations, self.energies))

    @cached_property
    def time_scale(self):
        """The shortest time in s in which a particle's place changes by its own size.

        That is half of how far it has been from its start, if it has come back since, over its top
        speed; or sqrt(L/g) of the shortest rod, if that is less.
        """
        reach = np.max(np.linalg.norm(self.q - self.q[0], axis=2), axis=0)
        path = np.sum(np.linalg.norm(np.diff(self.q, axis=0), axis=2), axis=0)
        returns = (path > 2.0 * reach) & (reach > MOVES * self.shortest)
        speed = np.max(np.linalg.norm(self.v, axis=2), axis=0)
        times = 0.5 * reach[returns] / speed[returns]
        return np.min(times, initial=np.sqrt(self.shortest / 9.81))

    @cached_property
    def load(self):
        """The largest sum of weights, of centripetal loads m |v|^2 / L, and of m |a|, in N."""
        m, speed = self.m[:, 0], np.linalg.norm(self.v, axis=2)
        a = np.linalg.norm(np.diff(self.v, axis=0), axis=2) / self.dt
        driven = np.max(np.sum(m * a, axis=1), initial=0.0)
        return 9.81 * np.sum(m) + np.max(np.sum(m * speed**2, axis=1)) / self.shortest + driven
