"""A step of one state, or a function of one, for many states: each as if it were alone."""

import contextlib
import os
from functools import cache, partial
from types import SimpleNamespace

from curriculum.common import llvm
from curriculum.common.arrays import CALLS, ordered
from curriculum.common.bytecode import LARGE, Bytecode
from curriculum.common.native import LANES, Native
from curriculum.common.python import Columns, OneByOne
from curriculum.common.steps import Traced
from curriculum.common.tape import Stop, Untraceable

import numpy as np

CORES = os.cpu_count() or 1
REPAID = 3_000_000  # operations: from so many on machine code is worth its making
PRICE = 3  # calls of numpy take as long as it takes to compile an operation
NARROW = 8  # lanes of it: more would be far from the processor


@cache
def pool():
    """Threads, a processor each."""
    from concurrent.futures import ThreadPoolExecutor  # here: it takes its time to load

    return ThreadPoolExecutor(CORES)


if hasattr(os, "register_at_fork"):  # a child has none of its parent's threads, and makes its own
    os.register_at_fork(after_in_child=pool.cache_clear)


def in_machine_code(kind, traced, lanes):
    """A Traced step for many members, side by side in vector registers; None if it cannot be.

    `kind`: Native, or Bytecode, which is made sooner.
    """
    if llvm.available():
        with contextlib.suppress(llvm.Unavailable):
            return kind(traced.program, lanes)
    return None


def in_python(traced):
    """The same without machine code: members as columns of numpy or, with a loop, one by one."""
    return OneByOne(traced.source) if traced.program.loops() else Columns(traced.source)


def run(code, program, state, count, *knobs):
    """`count` steps of members: their ends (entries, members), from `state`, and what was made.

    That is (numbers, members): the largest that the program has made beside the state at any step;
    after one step just what it makes.
    """
    entries, members = state.shape
    some = -(-members // (CORES * code.lanes)) * code.lanes if code.lanes > 1 else members
    filled = -(-members // code.lanes) * code.lanes
    ends = np.empty((entries, filled))
    ends[:, :members], ends[:, members:] = state, state[:, -1:]  # copies fill the last register
    made = np.full((len(program.out) - entries, filled), -np.inf)

    def advance(first):  # threads run side by side: ctypes lets go of the interpreter
        piece = slice(first, first + some)
        code(ends[:, piece], count, made[:, piece], *knobs)

    if some < filled:
        list(pool().map(advance, range(0, members, some)))
    else:
        advance(0)
    return ends[:, :members], made[:, :members]


class Crowd:
    """Many members q, v (R, N, 3): `advance` them, look at their `states`, `put` others.

    One that cannot go on is NaN. `measure`: a function of one state, (q, v) -> tuple of arrays,
    asked at every step. Raises Untraceable.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        self.traced, self.dt = Traced(step_fn, m, force, q, v, measure), dt
        made = in_machine_code(Native, self.traced, LANES)
        self.code = made or in_python(self.traced)
        self.put(q, v)
        if self.differs():
            raise Untraceable("it does something else when it is compiled")

    def differs(self):
        """Whether the first step of the first member is not that of the lines as they stand."""
        start = self.columns[:, :1]
        ends, _ = run(self.code, self.traced.program, start, 1, self.dt)
        try:
            expected = self.traced.plain(start[:, 0], self.dt)
        except Stop:
            return False
        except Untraceable:
            return True
        same = comparison(self.traced)
        return bool(np.isfinite(expected).all()) and not same(ends[:, 0], expected)

    def put(self, q, v):
        """Go on from q, v (R, N, 3)."""
        self.columns = self.traced.columns(q, v)

    def states(self):
        """q, v (R, N, 3)."""
        return self.traced.states(self.columns.T)

    def advance(self, count):
        """Take `count` steps; (numbers, R): the largest that was measured at any of them."""
        self.columns, most = run(self.code, self.traced.program, self.columns, count, self.dt)
        return most


def comparison(traced):
    """What says whether two arrays are what the same lines make: to the bit, where promised."""
    alike = np.array_equal if traced.exact else partial(np.allclose, rtol=1e-9, atol=1e-9)
    return partial(alike, equal_nan=True)


def stay(q, v, m, force, dt):
    """A step that leaves everything where it is."""
    return q, v


class mapped:  # noqa: N801 - it is called as a function is
    """function(q, v) of one state (N, 3), for many: q, v (K, N, 3).

    What the function makes of one state, a number, an array, or a tuple of these, comes with a
    leading axis (K, ...). It is traced once, and the last state of each K compared; or done one by
    one if it cannot be, or while that is soon done, as for few states and few calls of numpy on
    long arrays. `turns`: how many states are to come, if that is known.
    """

    def __init__(self, function, turns=0):
        self.function, self.turns, self.known, self.single = function, turns, {}, False

    def measure(self, q, v):
        """The function's results, as a tuple."""
        made = self.function(q, v)
        self.single = not isinstance(made, tuple)
        return (made,) if self.single else made

    def __call__(self, q, v):
        resting = np.all((q == 0.0) & (v == 0.0), axis=0)  # and so it stays zero in what is traced
        key = q.shape[1:], resting.tobytes()
        if key not in self.known and len(q) > 1:
            self.known[key] = self.traced(q, v)
        entry = self.known.get(key)  # none for a single state: to trace it would take longer
        code = self.choose(entry, len(q)) if entry else None
        if code is None:
            made = self.one_by_one(q, v)
        else:
            made = self.by_code(entry.traced, code, q, v)
            if self.differs(made, entry.traced, q, v):  # a symbol has answered it wrongly
                self.known[key] = None
                made = self.one_by_one(q, v)
        return made[0] if self.single else tuple(made)

    def traced(self, q, v):
        """The function on symbols, of states that are zero in the same places; or None."""
        turns, calls = max(self.turns, len(q)), CALLS[0]
        try:
            traced = Traced(stay, None, None, q, v, self.measure, turns=turns)
        except Untraceable:
            return None
        return SimpleNamespace(traced=traced, code=None, asked=0, calls=CALLS[0] - calls)

    def choose(self, entry, many):
        """What runs it: None as long as that costs more than it saves; where there is a loop,
        machine code if there are many states."""
        entry.asked += many
        if isinstance(entry.code, (Columns, Bytecode)):
            return entry.code
        program, states = entry.traced.program, max(self.turns, entry.asked)
        size = program.size()
        if entry.calls * states < PRICE * size:
            return None
        if program.loops() and (size > LARGE or states * size > REPAID):
            entry.code = in_machine_code(Bytecode, entry.traced, NARROW) or entry.code
        entry.code = entry.code or in_python(entry.traced)
        return entry.code

    def by_code(self, traced, code, q, v):
        """All at once; a state that has trouble by itself."""
        _, rows = run(code, traced.program, traced.columns(q, v), 1, 0.0)
        for k in np.flatnonzero(~np.isfinite(rows).all(axis=0)):
            rows[:, k] = np.concatenate([np.ravel(x) for x in self.measure(*self.state(q, v, k))])
        made, first = [], 0
        for x in traced.program.results[1:]:
            made.append(rows[first : first + x.size].T.reshape(len(q), *x.shape))
            first += x.size
        return made

    def differs(self, made, traced, q, v):
        """Whether what was made of the last state is not what the lines make as they stand."""
        same = comparison(traced)
        expected = self.measure(*self.state(q, v, -1))
        pairs = zip(made, expected, strict=True)
        return not all(same(rows[-1], x) for rows, x in pairs)

    def one_by_one(self, q, v):
        made = [self.measure(*self.state(q, v, k)) for k in range(len(q))]
        return [np.array(x) for x in zip(*made, strict=True)]

    def state(self, q, v, k):
        return ordered(q[k]), ordered(v[k])
