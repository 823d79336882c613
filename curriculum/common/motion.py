"""Advance a state (q, v) step by step: in one compiled loop if the step can be unrolled, else by
its pieces.

q and v are arrays (..., N, 3). Leading axes are members that go in step, so many at a time that the
arrays they make stay in the processor's cache.
"""

import math
import time
from itertools import chain
from typing import NamedTuple

from curriculum.common.arrays import ArrayFunction, leading_first
from curriculum.common.banner import progress
from curriculum.common.python import again, number_function, once
from curriculum.common.trace import Program, Untraceable

import numpy as np

BLOCK = 1 << 17  # numbers in a block of states
HALVINGS = 8  # of a step that fails, at most
PATIENCE = 0.2  # s: a block of slow steps ends after so long, so that progress can be told


def unroll_map(function, *start):
    """The Program of a map that is iterated from `start`, and a mask an array of what is zero and
    stays zero there.

    Raises Untraceable, also if the function does not do the same thing each time, say draws random
    numbers.
    """
    still = [
        np.logical_and.reduce([np.all(a == 0.0, axis=tuple(range(a.ndim - 2))) for a in start])
    ] * len(start)
    while True:
        program = Program(function, *still)
        zero = [np.vectorize(lambda s: s.x == 0.0, otypes=[bool])(a) for a in program.results]
        stays = [mask & found for mask, found in zip(still, zero, strict=True)]
        if all(map(np.array_equal, still, stays)):
            break
        still = stays
    if Program(function, *still).tape.nodes != program.tape.nodes:
        raise Untraceable("it does not do the same thing each time")
    return program, still


class Unrolled:
    """function(*arrays (..., *shape)) -> tuple of arrays (..., *shape), compiled: all leading axes
    at once."""

    def __init__(self, function, *still):
        self.program = Program(function, *still)
        self.live, self.shapes = self.program.live, [a.shape for a in self.program.results]
        self.of_numbers = self.of_arrays = None

    def __call__(self, *arrays):
        lead = arrays[0].shape[:-2]
        if lead:
            rows = self.rows(
                [arrays[k][(..., *place)].ravel() for k, place in self.live], math.prod(lead)
            )
        else:
            self.of_numbers = self.of_numbers or number_function(self.program, once)[0]
            rows = np.array(self.of_numbers(*[arrays[k].item(place) for k, place in self.live]))
        parts, end = [], 0
        for shape in self.shapes:
            begin, end = end, end + math.prod(shape)
            parts.append(leading_first(rows[begin:end].reshape(*shape, *lead), len(shape)))
        return tuple(parts)

    def rows(self, inputs, members):
        """A row an entry of the results, from an array (members,) for each entry that is taken."""
        self.of_arrays = self.of_arrays or ArrayFunction(self.program)
        rows, size = np.empty((sum(map(math.prod, self.shapes)), members)), self.of_arrays.members()
        for first in range(0, members, size):
            piece = slice(first, first + size)
            self.of_arrays([x[piece] for x in inputs], list(rows[:, piece]))
        return rows


def each(function, q, v):
    """function(q, v) of one state (N, 3), for all of q, v (F, N, 3): traced once, or else one after
    the other."""
    free = np.zeros(q.shape[1:], dtype=bool)
    try:
        return Unrolled(lambda q, v: (function(q, v),), free, free)(q, v)[0]
    except Exception:  # what is wrong with it shows again below
        return np.stack([function(*state) for state in zip(q, v, strict=True)])


class Pieces:
    """The force of a run whose step is not unrolled as a whole: compiled, and with a memory that
    ends with the run.

    `still`: mask of the coordinates that stay zero; `places`: the others, as indices into a flat
    (N, 3); `rows` takes these of q and then of v, an array each, and arrays to write force / m to.
    """

    def __init__(self, force, m, still):
        self.still, self.memory, self.places = still, {}, np.flatnonzero(~still)
        self.force = Unrolled(lambda q, v: (force(q, v),), still, still)
        self.rows = ArrayFunction(Program(lambda q, v: ((force(q, v) / m)[~still],), still, still))

    def __call__(self, q, v):
        return self.force(q, v)[0]


def by_rows(force, m, shape):
    """(places, rows) of any force(q, v) on arrays (..., N, 3), as a Pieces has them; `shape`: that
    of q."""
    if isinstance(force, Pieces):
        return force.places, force.rows
    size = shape[-2] * shape[-1]

    def rows(inputs, results):
        q, v = (
            np.stack(x, axis=-1).reshape(-1, *shape[-2:]) for x in (inputs[:size], inputs[size:])
        )
        f = (
            force(q, v)
            if hasattr(force, "way")
            else np.stack([force(*state) for state in zip(q, v, strict=True)])
        )
        for result, row in zip(results, (f / m).reshape(-1, size).T, strict=True):
            result[...] = row.reshape(result.shape)

    return np.arange(size), rows


def followed(rule, after, system):
    """The step `rule` and then after(system, q_start, q, v, dt) -> (q, v), if there is one: a step
    like any other."""
    if after is None:
        return rule

    def compiled(force, dt):
        if ("after", dt) not in force.memory:
            piece = Unrolled(lambda start, q, v: after(system, start, q, v, dt), *[force.still] * 3)
            force.memory["after", dt] = piece
        return force.memory["after", dt]

    def step(q, v, m, force, dt):
        end = rule(q, v, m, force, dt)
        if not isinstance(force, Pieces):
            return after(system, q, *end, dt)
        return compiled(force, dt)(q, *end)

    step.halves, step.compiled = getattr(rule, "halves", False), compiled
    return step


class Run(NamedTuple):
    """A measured run: series from the start on, and the states that were to be kept, the last one
    always."""

    tip: np.ndarray  # (steps + 1, ..., 3) m, the last particle
    violations: np.ndarray  # (steps + 1, ...) m
    energies: np.ndarray  # (steps + 1, ...) J
    kept: np.ndarray  # (K,) the steps of
    q: np.ndarray  # (K, ..., N, 3) m
    v: np.ndarray  # (K, ..., N, 3) m/s
    stopped: str | None  # why it ended early; all before was true
    halved: int  # steps that were taken in halves
    seconds: float  # of the steps alone
    way: str  # how the steps were computed

    @property
    def pace(self):
        """Microseconds a step."""
        return 1e6 * self.seconds / max(1, len(self.tip) - 1)

    @property
    def note(self):
        """What is to be said of a run that did not go straight to its end."""
        halved = f"took {self.halved} steps in halves" if self.halved else ""
        return ", and ".join(filter(None, (halved, self.stopped)))

    def at(self, step):
        """Positions q (..., N, 3) at a step that was kept; None if the run did not get there."""
        there = np.flatnonzero(self.kept == step)
        return self.q[there[0]] if len(there) else None

    def summary(self, scale, truth):
        """What a run of one member came to, rounded: m; its worst energy error as a share of
        `scale` J.

        `error`: how far a particle is from the Truth, if that is known.
        """
        there = self.at(truth.step)
        known = truth.q is not None and there is not None
        return {
            "max_violation": round(float(np.max(self.violations)), 12),
            "final_violation": round(float(self.violations[-1]), 12),
            "energy_rel_max": round(
                float(np.max(np.abs(self.energies - self.energies[0])) / scale), 12
            ),
            "tip_final": [round(x, 6) for x in self.tip[-1].tolist()],
            "error": round(distance(there, truth.q), 12) if known else None,
            "halved": self.halved,
            "stopped": self.stopped,
        }


def source(step_fn, system, force, dt):
    """The code that steps of a system become, or at least their force; in a comment, why not."""
    motion = Motion(step_fn, system["m"], force, dt, system["q0"], system["v0"])
    force = (
        number_function(motion.force.force.program, once)[1]
        if isinstance(motion.force, Pieces)
        else ""
    )
    return motion.source or f"# a step is not one function: {motion.way}\n{force}"


def distance(a, b):
    """The largest distance in m between the same particle in positions a and b, (..., N, 3)."""
    return float(np.sqrt(np.max(np.sum(np.square(a - b), axis=-1))))


class Motion:
    """A run of step_fn(q, v, m, force, dt) -> (q, v) from q, v (..., N, 3) on, in whole blocks of
    steps.

    `keep`: steps whose states are kept. `way`: how it is computed, in words; `source`: the code, if
    it is one function; `done`: steps so far. A force with an attribute `way` is taken as it is: it
    knows a better one.
    """

    def __init__(self, step_fn, m, force, dt, q, v, keep=()):
        self.step_fn, self.m, self.force, self.dt = step_fn, m, force, dt
        self.state = tuple(np.array(x, dtype=float, order="F") for x in (q, v))
        self.still, self.advance = [np.zeros(q.shape[-2:], dtype=bool)] * 2, self.by_steps
        self.seconds, self.stopped, self.halved, self.source, self.done, self.taken = (
            0.0,
            None,
            0,
            "",
            -1,
            0,
        )
        self.series, self.kept, self.keep, self.last = [], [], keep, None
        self.size = max(1, min(1024, BLOCK // (2 * q.size)))
        if hasattr(force, "way"):
            self.way = force.way
            return
        try:
            self.unroll(*unroll_map(lambda q, v: step_fn(q, v, m, force, dt), q, v))
        except (
            Exception
        ) as why:  # whatever is wrong with the step itself shows again as soon as it is taken
            self.take_apart(why)

    def unroll(self, program, still):
        """The whole step, and for a single member the loop around it, as a function of what does
        not stay zero."""
        q, v = self.state
        program.results = [np.array([program.results[k][place] for k, place in program.live])]
        function, self.source = number_function(program, again)
        self.way, self.still, self.live = "unrolled", still, program.live
        if q.ndim == 2:
            self.function, self.advance = function, self.by_numbers
            self.columns = [self.state[k].item(place) for k, place in self.live]
        else:
            self.function, self.advance = ArrayFunction(program), self.by_members
            self.columns = [self.state[k][(..., *place)].ravel() for k, place in self.live]
        self.size = max(1, BLOCK * q.shape[-2] * q.shape[-1] // (len(self.live) * q.size))

    def take_apart(self, why):
        """The step as it stands, on a force that is unrolled if that can be."""
        force = self.force
        try:
            _, self.still = unroll_map(lambda q, v: (v, force(q, v)), *self.state)
            self.force = Pieces(force, self.m, self.still[0] & self.still[1])
            if hasattr(self.step_fn, "compiled"):  # before the clock runs
                q, v = self.state
                self.step_fn.compiled(self.force, self.dt)(q, q, v)
            self.way = "the force unrolled" + (f", the step not: {why}" if str(why) else "")
        except Exception as why:
            self.way = f"in plain numpy, which is slower: {why}"

    def by_numbers(self, count):
        """`count` steps, or as many as can be taken: states q, v (count, N, 3)."""
        states, shape = [], self.state[0].shape
        try:
            self.function(self.columns, count, states.append)
        except (ArithmeticError, ValueError) as reason:
            self.stopped = str(reason)
        if states:
            self.columns = states[-1]
        flat = np.fromiter(chain.from_iterable(states), float, len(states) * len(self.live))
        whole = np.zeros((2, *shape, len(states)))
        for (k, place), column in zip(
            self.live, flat.reshape(len(states), len(self.live)).T, strict=True
        ):
            whole[(k, *place)] = column
        return tuple(leading_first(a, 2) for a in whole)

    def by_members(self, count):
        """`count` steps of all members, or as many as all can take: states q, v (count, ..., N,
        3)."""
        shape, size = self.state[0].shape, self.function.members()
        whole = np.zeros((2, *shape[-2:], count, *shape[:-2]))
        columns = [whole[(k, *place)].reshape(count, -1) for k, place in self.live]
        for first in range(0, columns[0].shape[1], size):
            piece = slice(first, first + size)
            state = [column[piece] for column in self.columns]
            for step in range(count):
                following = [column[step, piece] for column in columns]
                try:
                    self.function(state, following)
                except (ArithmeticError, ValueError) as reason:
                    self.stopped, count = str(reason), step
                    break
                state = following
        if count:
            self.columns = [column[count - 1].copy() for column in columns]
        return tuple(leading_first(a[:, :, :count], 2) for a in whole)

    def by_steps(self, count):
        """`count` steps, or as many as can be taken: states (count, ..., N, 3)."""
        q, v = (
            np.empty((count, *x.shape[::-1])).transpose(0, *range(x.ndim, 0, -1))
            for x in self.state
        )
        begin = time.perf_counter()
        for done in range(count):
            if done and time.perf_counter() - begin > PATIENCE:
                return q[:done], v[:done]
            try:
                self.state = self.step(*self.state, self.dt, 0)
            except (ArithmeticError, ValueError, np.linalg.LinAlgError) as reason:
                self.stopped = str(reason)
                return q[:done], v[:done]
            q[done], v[done] = self.state
        return q, v

    def step(self, q, v, dt, level):
        """One step, or, if its rule is one that `halves`, two of half the length where it fails."""
        try:
            return self.step_fn(q, v, self.m, self.force, dt)
        except FloatingPointError:
            if level == HALVINGS or not getattr(self.step_fn, "halves", False):
                raise
        self.halved += level == 0
        return self.step(*self.step(q, v, 0.5 * dt, level + 1), 0.5 * dt, level + 1)

    def fast(self, function):
        """`function` of q and v -> tuple of arrays, compiled for states of this run."""
        try:
            return function if hasattr(self.force, "way") else Unrolled(function, *self.still)
        except Exception:  # what is wrong with it shows when it is called; or it cannot be unrolled
            return function

    def blocks(self, steps):
        """States q, v (count, ..., N, 3): the start alone, then blocks, until `steps` are done or
        the run stops."""
        self.steps = steps
        yield tuple(x[None] for x in self.state)
        tick = progress("simulating", steps)
        with np.errstate(all="ignore"):  # a run that blows up is told of once, and in words
            while self.done < steps and not self.stopped:
                clock = time.perf_counter()
                q, v = self.advance(min(self.size, steps - self.done))
                self.seconds += time.perf_counter() - clock
                self.taken += len(q)
                if self.stopped:
                    self.stopped = f"stopped at step {self.done + len(q) + 1}: {self.stopped}"
                if len(q):
                    yield q, v
                tick(steps if self.stopped else self.done)

    def note(self, sane, q, v, violations, energies):
        """Take a block of states and what was measured of it, up to the first state that is not
        `sane` (count, ...)."""
        sane = np.logical_and.accumulate(sane.reshape(len(q), -1).all(axis=1))
        count, first = int(np.sum(sane)), self.done + 1
        if first + count == 0:
            raise ValueError("this is no start: a rod is far off, or a number is not finite")
        measured = q[..., -1, :], violations, energies
        self.series = self.series or [np.empty((self.steps + 1, *x.shape[1:])) for x in measured]
        for series, x in zip(self.series, measured, strict=True):
            series[first : first + count] = x[:count]
        rows = np.flatnonzero(np.isin(np.arange(first, first + count), self.keep))
        self.kept.append((rows + first, q[rows], v[rows]))
        self.done += count
        if count:
            self.last = [self.done], q[count - 1 : count], v[count - 1 : count]
        if count < len(q):
            self.stopped = f"diverged at step {self.done + 1}"

    def run(self):
        """All that was noted, as a Run."""
        steps, q, v = (np.concatenate(x) for x in zip(*self.kept, self.last, strict=True))
        _, once = np.unique(steps, return_index=True)
        series = (x[: self.done + 1] for x in self.series)
        how = self.stopped, self.halved, self.seconds * self.done / max(1, self.taken), self.way
        return Run(*series, steps[once], q[once], v[once], *how)
