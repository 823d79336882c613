"""A step of one state, or a function of one, for many states: each as if it were alone."""

import contextlib
import os
from collections import deque
from copy import copy
from functools import cache
from types import FunctionType, SimpleNamespace

from curriculum.common import llvm
from curriculum.common.arrays import ordered
from curriculum.common.bytecode import LARGE, Bytecode
from curriculum.common.callbacks import called
from curriculum.common.native import LANES, Native
from curriculum.common.pure import Memory, content
from curriculum.common.python import Columns
from curriculum.common.tape import Stop, Tape, Untraceable
from curriculum.common.traced import Traced, moves

import numpy as np

CORES = os.cpu_count() or 1
REPAID = 3_000_000  # operations: from so many on machine code is worth its making
OFTEN = 4  # times as many states: then what is made of them is compared again
PIECE = 1 << 13  # members at a time in Python: a dozen columns of them stay near the processor
LENGTHY = 1000  # numbers of a state, with which a call of numpy takes twice as long
MANY = 20_000_000  # operations: from so many on those of columns take longer than it
EVERY = 2.0**53  # up to here every whole number is a float
NARROW = 8  # lanes of it: more would be far from the processor


@cache
def pool(process):
    """Threads of a process, a processor each: a child by fork has none of its parent's."""
    from concurrent.futures import ThreadPoolExecutor  # here: it takes its time to load

    return ThreadPoolExecutor(CORES)


def kernel_of(traced, kind, lanes):
    """A kernel, which does a Traced step for many members: machine code, `lanes` at a time.

    `kind`: Native, or Bytecode, which is made sooner. Where it is None, or machine code cannot be
    had, members go as columns of numpy or, with a loop, one by one.
    """
    if kind and llvm.available():
        with contextlib.suppress(llvm.Unavailable):
            return kind(traced.program, lanes)
    return OneByOne(traced) if traced.program.loops() else Columns(traced.source)


class OneByOne:
    """A Traced step of many members, in Python's floats; called as Columns are.

    A member whose loop comes to no end is NaN in all that it made.
    """

    lanes = 1

    def __init__(self, traced):
        self.traced = traced

    @np.errstate(all="ignore")
    def __call__(self, state, count, out, dt):
        entries = len(state)
        for end, most in zip(state.T, out.T, strict=True):
            rows = []
            with contextlib.suppress(Stop):
                try:
                    self.traced.function(end.tolist(), count, rows.append, dt)
                except Stop:
                    raise
                except (ArithmeticError, ValueError):  # where numpy's floats go on
                    while len(rows) < count:
                        last = rows[-1][:entries] if rows else end
                        rows.append(self.traced.plain(np.array(last), dt))
            if len(rows) < count:
                rows = [[np.nan] * (entries + len(out))]
            end[:] = rows[-1][:entries]
            made = np.reshape([row[entries:] for row in rows], (len(rows), len(out)))
            most[:] = np.max(np.vstack([most, made]), axis=0)


def iterated(kernel, traced, state, count, *knobs):
    """`count` steps of members by its kernel, from `state` (entries, members): ends like it, made.

    What is `made` (numbers, members) is, of all that the program makes beside the state, the
    largest at any step; after one step just that.
    """
    entries, members = state.shape
    beside = kernel.lanes > 1  # threads run side by side: ctypes lets go of the interpreter
    some = -(-members // (CORES * kernel.lanes)) * kernel.lanes if beside else PIECE
    filled = -(-members // kernel.lanes) * kernel.lanes
    ends = np.empty((entries, filled))
    ends[:, :members], ends[:, members:] = state, state[:, -1:]  # copies fill the last register
    made = np.full((len(traced.program.out) - entries, filled), -np.inf)
    if not count:
        return state.copy(), made[:, :members]

    def advance(first):
        piece = slice(first, first + some)
        kernel(ends[:, piece], count, made[:, piece], *knobs)

    each = pool(os.getpid()).map if beside and some < filled else map
    list(each(advance, range(0, members, some)))
    return ends[:, :members], made[:, :members]


class Crowd:
    """Many members q, v (R, N, 3): `advance` them, look at their `states`, `put` others.

    One that cannot go on is NaN. `measure`: a function of one state, (q, v) -> tuple of arrays,
    asked at every step. Raises Untraceable.
    """

    def __init__(self, step_fn, m, force, dt, q, v, measure=None):
        self.traced, self.dt = Traced(step_fn, m, force, moves(q, v), measure), float(dt)
        self.kernel = kernel_of(self.traced, Native, LANES)
        self.put(q, v)
        self.moved = False
        self.compare()

    def compare(self):
        """Raise Untraceable if the lines as they stand take the first member elsewhere."""
        first = self.columns[:, :1]
        made = iterated(self.kernel, self.traced, first, 1, self.dt)
        if differs(self.traced, first, made, self.dt):
            raise Untraceable("it does something else when it is compiled")

    def put(self, q, v):
        """Go on from q, v (R, N, 3)."""
        if not self.traced.fits(q, v):
            raise ValueError("q or v is not zero where the first ones were: make another Crowd")
        self.columns = self.traced.columns(q, v)

    def states(self):
        """q, v (R, N, 3)."""
        return self.traced.states(self.columns.T)

    def advance(self, count):
        """Take `count` steps; (numbers, R): the largest that was measured at any of them."""
        changed = self.traced.changed()
        if changed:
            raise ValueError(f"{changed} was changed: make another Crowd, which knows of it")
        self.columns, most = iterated(self.kernel, self.traced, self.columns, count, self.dt)
        if count and not self.moved:  # a start may be at rest, of which a step tells little
            self.compare()
            self.moved = True
        return most


def differs(traced, columns, made, dt):
    """Whether the lines as they stand take a member of columns (entries, members) elsewhere than in
    `made`: the ends, and what is measured, (entries, members) each.

    Compared are the last and the one with the most zeros, whose signs symbols do not keep.
    """
    zeros = np.count_nonzero(columns == 0.0, axis=0)
    last = len(zeros) - 1
    made = np.concatenate(made)
    some = {last, last - int(np.argmax(zeros[::-1]))}
    return any(traced.differs(columns[:, k], made[:, k], dt) for k in some)


def alike(x, y):
    """Whether functions have the same lines about alike things; or these are alike."""
    if x is y or type(x) is not type(y):
        return x is y
    if isinstance(x, FunctionType):
        kept = [[f.__defaults__, f.__kwdefaults__, vars(f)] for f in (x, y)]
        held = [[*map(content, f.__closure__ or ())] for f in (x, y)]
        same = x.__code__ is y.__code__ and x.__globals__ is y.__globals__
        return same and alike(*kept) and alike(*held)
    if isinstance(x, dict):
        return alike([*x], [*y]) and alike([*x.values()], [*y.values()])
    if isinstance(x, list | tuple):
        return len(x) == len(y) and all(map(alike, x, y))
    if isinstance(x, np.ndarray):
        same = x.dtype == y.dtype and x.shape == y.shape
        return same and x.dtype != object and x.tobytes() == y.tobytes()
    return type(x) in (str, int, float) and repr(x) == repr(y)  # 0.0 is not -0.0


class mapped:  # noqa: N801 - it is called as a function is
    """function(q, v) of one state (N, 3), or function(q), for many: q, v (K, N, 3).

    What the function makes of one state, a number, an array, or a tuple of these, comes with a
    leading axis (K, ...). It is traced once, and of the first K the last is compared, and the one
    with the most zeros, and whenever states are OFTEN times as many, and when those come that are
    the last, as far as is known by `uses`, how many are to come. Or it is done one by one if it
    cannot be traced, or while that is soon done, as for few states and few calls of numpy on long
    arrays. `again`: what an alike function has become is used again.
    """

    recent = deque(maxlen=4)  # (function, key, what it has become), of all that ask again

    def __init__(self, function, uses=0, again=False):
        self.function, self.uses, self.asked, self.again = function, uses, 0, again
        self.entries = {}  # by shape and what moves: a namespace, see below, or None
        self.kinds, self.single = [], False  # dtypes of results; whether the one is in no tuple

    def measure(self, q, v):
        """The function's results, as a tuple."""
        made = called(self.function, q, v)
        self.single = not isinstance(made, tuple)
        made = (made,) if self.single else made
        if q.dtype != object:
            self.kinds = [np.asarray(x).dtype for x in made]
        elif not self.kinds:  # no numbers were asked for yet
            self.kinds = [float] * len(made)
        return made

    def __call__(self, q, v, moving=None, columns=None):
        """The results. What is known by now: `moving` (2, N, 3), what of q, v need not be zero, and
        its `columns` (entries, K)."""
        self.asked += len(q)
        moving = moves(q, v) if moving is None else moving
        key, made = (q.shape[1:], moving.tobytes()), None
        entry = self.entries.get(key)
        if entry and entry.traced.changed():
            self.entries.pop(key, None)
        if key not in self.entries and len(q) > 1 and not (self.again and self.borrow(key)):
            self.entries[key] = None
            how = {"measure": self.measure, "uses": max(self.uses, len(q))}
            with contextlib.suppress(Untraceable):  # as a step that leaves all where it is
                traced = Traced(lambda q, v, *_: (q, v), None, None, moving, **how)
                # `states` so far, and at how many the next comparison is `due`
                self.entries[key] = SimpleNamespace(traced=traced, kernel=None, states=0, due=0)
                self.recent.append((self.function, key, self.entries[key]))
        entry = self.entries.get(key)  # none for a single state: to trace it would take longer
        kernel = self.choose(entry, len(q)) if entry else None
        if kernel is not None:
            columns = entry.traced.columns(q, v) if columns is None else columns
            made = self.by_kernel(entry, kernel, columns)
            if made is None:  # a symbol has answered it wrongly
                self.entries[key] = None
        if made is None:
            states = zip(ordered(q.copy()), ordered(v.copy()), strict=True)  # it may work in place
            # copies, at once: the function may fill one array again and again
            rows = [tuple(map(np.array, self.measure(*state))) for state in states]
            made = [np.array(x) for x in zip(*rows, strict=True)]
        return made[0] if self.single else tuple(made)

    def borrow(self, key):
        """Whether an alike function was asked a short time ago, and nothing has changed since. Its
        code is used again; what that is compared with, and what may change, are this one's own."""
        with Tape.lock:  # while others trace, nothing is as it is
            for function, other, entry in tuple(self.recent):
                with contextlib.suppress(RecursionError):  # of what leads to itself
                    found = other == key and alike(function, self.function)
                    if found and not entry.traced.changed():
                        traced = copy(entry.traced)
                        traced.measure, traced.memory = self.measure, Memory(self.function)
                        own = SimpleNamespace(traced=traced, kernel=entry.kernel, states=0, due=0)
                        self.entries[key] = own
                        return True
        return False

    def choose(self, entry, many):
        """A kernel: None as long as that costs more than it saves; machine code where there is much
        to do or, if there is a loop in it, where there are many states."""
        entry.states += many
        if isinstance(entry.kernel, (Columns, Bytecode, Native)):
            return entry.kernel
        program, states = entry.traced.program, max(self.uses, entry.states)
        size = program.size()
        calls = entry.traced.numpy_calls * (1 + entry.traced.moving.size / LENGTHY)
        if calls * states < size:  # for an operation, its code takes as long to make as a call
            return None
        repaid = size > LARGE or (program.loops() and states * size > REPAID)
        kind = Native if size <= LARGE and states * size > MANY else Bytecode if repaid else None
        entry.kernel = kernel_of(entry.traced, kind, NARROW)
        return entry.kernel

    def by_kernel(self, entry, kernel, columns):
        """What a kernel makes of all states; None if the lines make something else."""
        traced, made, first = entry.traced, [], 0
        ends, rows = iterated(kernel, traced, columns, 1, 0.0)
        if not np.isfinite(rows).all():
            for k in np.flatnonzero(~np.isfinite(rows).all(axis=0)):  # those go by themselves
                rows[:, k] = traced.plain(columns[:, k], 0.0)[len(ends) :]
        if entry.states >= entry.due or self.asked >= self.uses:
            if differs(traced, columns, (ends, rows), 0.0):
                return None
            entry.due = OFTEN * entry.states
        for x, kind in zip(traced.program.results[1:], self.kinds, strict=True):
            part = rows[first : first + x.size].T.reshape(columns.shape[1], *x.shape)
            if np.issubdtype(kind, np.integer) and np.any(np.abs(part) > EVERY):
                return None  # a float may be the next whole number
            made.append(part.astype(kind, copy=False))
            first += x.size
        return made
