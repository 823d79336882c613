"""A run: up to where it is good, why it ended, and whether it can be taken again."""

from copy import deepcopy
from functools import cached_property, partial

import numpy as np

from curriculum.ch3_4_constraints.rods.systems import check_measure
from curriculum.common.tracing import vmap
from curriculum.common.tracing.ahead import Step
from curriculum.common.tracing.counting import Counter
from curriculum.common.words import in_digits

FAR = 100.0  # of all rods together: beyond, a run has diverged
NOTHING = 1e-9  # of all other forces: what is less is rounding
MOVES = 1e-9  # of the shortest rod: what moves by less, stands still
SAMPLE = 16  # states of a run whose steps are counted
COUNTED = 400_000  # operations, of all of these steps: if one takes many, they are fewer
AGAIN = 24  # steps, and calls of a force, that are taken again
ROWS = 600  # of J in all steps that are taken again: of more than 25 rods they are fewer
INSTANT = 1e-3  # s: of a difference in time
SAME = 1e-9  # of an energy
UNKNOWN = 1e-3  # of the states of a run: so many may have forces that are not known


class FastStep(Step):
    """A step of a system that is compiled for about so many steps, and sees what a run is made of.

    It copies the system, and notes external_force in some of the states.
    """

    def __init__(self, step, steps, system, external_force):
        super().__init__(step, steps, notes=partial(external_force, system))
        self.system = system
        self.start = deepcopy(system)  # as it was before the run


class Run:
    """The states of a run of dt s a step, as far as they are good, and what was measured in them.

    `step` is the FastStep that its loop has called under a force(q, v); q and v are (steps + 1, N,
    3) in m and m/s; constraint_violation(system, q) is in m, energy(system, q, v) in J. It can be
    pickled.
    """

    def __init__(self, step, force, dt, q, v, constraint_violation, energy):
        system = step.system
        violations, energies = measures(system, constraint_violation, energy)(q, v)
        self.report = step.done()  # how its steps were taken: a Report
        self.dt = dt  # s
        self.start = step.start  # its system, as it was before it
        count = how_many_good(system, violations, energies)
        self.q = q[:count]  # (steps + 1, N, 3) in m
        self.v = v[:count]  # (steps + 1, N, 3) in m/s
        self.tip = self.q[:, -1]  # (steps + 1, 3) in m: the path of the last particle
        self.violations = violations[:count]  # (steps + 1,) in m
        self.energies = energies[:count]  # (steps + 1,) in J
        self.pulls = None  # (steps + 1,) in N: of each state the largest, once they are measured
        self.lost = None  # why there is no row for it: a step failed, or its rods are FAR off
        self.stopped = None  # why it ended early
        if count < len(q):
            end = f"{(count - 1) * dt:.3g} s"
            if self.report.failure or not np.isnan(q[count]).all():
                self.lost = f"lost at {end}: {self.report.failure or 'diverged'}"
            self.stopped = self.lost or f"its loop kept no state after {end}"
        # Why places, energy and forces are not measured, in words: the run is not what its system,
        # force and dt make of it. None if it is.
        self.unlike = why_unlike(step, force, dt, self.q, self.v, len(q))

    @property
    def pace(self):
        """Microseconds a step, of computing."""
        return self.report.pace

    @cached_property
    def operations(self):
        """Sums, products and the like for a second of motion, the same on every machine.

        None if its steps are not compiled.
        """
        if not self.report.program:
            return None
        return average(Counter(self.report.program), self.q, self.v, self.dt)


def measures(system, constraint_violation, energy):
    """f(q, v): of each of many states (S, N, 3), the worst rod error in m and the energy in J."""

    def of_a_state(q, v):
        worst = constraint_violation(system, q)
        check_measure("constraint_violation", worst)
        joules = energy(system, q, v)
        check_measure("energy", joules)
        return worst, joules

    return vmap(of_a_state)


def how_many_good(system, violations, energies):
    """Up to which state a run is not lost; the first always counts. Pages have their own test.

    `violations` in m and `energies` in J are (steps + 1,).
    """
    good = np.isfinite(energies) & (violations < FAR * np.sum(system["lengths"]))
    return len(good) if good.all() else max(1, int(np.argmin(good)))


def why_unlike(step, force, dt, q, v, many):
    """Why a run is not what its system, a force and dt make of it, in words; None if it is.

    q, v are the states that it has kept, of `many` at most. Some steps are taken again, and some
    calls of the force made again.
    """
    report = step.report
    system = step.system
    start = step.start
    for key in start.keys() | system.keys():
        if not np.array_equal(start.get(key), system.get(key)):
            return f"its loop changes {key} of the system"
    if step.first is None:
        return "its loop takes steps of its own"
    begun = {"q": start["q0"], "v": start["v0"], "m": start["m"], "force": force, "dt": dt}
    for (name, wanted), found in zip(begun.items(), step.first, strict=False):
        if found is not wanted and not np.array_equal(found, wanted):
            return f"its loop begins with another {name}"
    if report.change:
        number, name = report.change
        return f"its loop changes {name} from step {number} on"
    kept = len(q) - 1
    number = step.differing([q, v], max(2, min(AGAIN, ROWS // len(start["pairs"]))))
    if number is None and report.steps < many:
        return None
    if report.steps > kept + 1 or number is None:
        return f"its loop takes {report.steps} steps for {kept} states"
    return f"a step depends on more than its arguments: taken again, step {number} is another"


def conserving(system, external_force, energy):
    """f(q, v): whether in many states (S, N, 3) external_force does only what `energy` counts.

    Free particles under it would then keep their energy: its rate along q_dot = v, v_dot = f / m
    is 0, here by central differences.
    """
    step = INSTANT

    def gain(q, v):
        f = external_force(system, q, v)
        after = energy(system, q + step * v, v + step * f / system["m"])
        before = energy(system, q - step * v, v - step * f / system["m"])
        return after - before, 2.0 * step * np.sum(np.abs(f * v)) + np.abs(after)

    gains = vmap(gain)

    def conserves(q, v):
        with np.errstate(all="ignore"):
            gained, allowed = gains(q, v)
            return bool(np.all(np.abs(gained) <= SAME * allowed))

    return conserves


def average(count, q, v, dt, *scalars):
    """Operations for a second of motion, as SAMPLE steps of a run take on average.

    `count`: the Counter of its step; q and v (steps + 1, N, 3).
    """
    steps = max(1, len(q) - 1)
    first = count([q[0], v[0]], *scalars)
    many = min(SAMPLE, steps, 1 + COUNTED // max(1, first)) if count.varies else 1
    middles = (2 * np.arange(many) + 1) * steps // (2 * many)  # of so many parts of the run
    found = [count([q[k], v[k]], *scalars) for k in middles]
    return in_digits(sum(found) / many / dt, 6)


def moves(q, system):
    """Whether places q (..., N, 3), in m, are off those at the start by more than rounding."""
    return np.max(np.abs(q - system["q0"])) >= MOVES * np.min(system["lengths"])


def largest_force(system, run, tensions, force, external_force):
    """The largest force of a rod in the states of a Run, in N: of `tensions`, where NaN is unknown.

    None where the forces of more than one state in a thousand are unknown, and where `force` never
    has anything beside external_force, so that something else holds the rods. Rounding is 0. The
    run has its `pulls` from then on.
    """
    pulls = vmap(partial(tensions, system, force=force))(run.q, run.v)  # (steps + 1, C)
    run.pulls = np.max(np.abs(pulls), axis=1)
    q = system["q0"]
    turning = np.random.default_rng(0).normal(size=q.shape) * system["lengths"][0]  # m/s
    alone = external_force(system, q, turning)
    known = run.pulls[np.isfinite(run.pulls)]
    is_unknown = len(run.pulls) - len(known) > UNKNOWN * len(run.pulls)
    if is_unknown or np.array_equal(force(q, turning), alone):
        return None
    most = np.max(known)
    return most if most > NOTHING * np.max(np.abs(alone)) else 0.0
