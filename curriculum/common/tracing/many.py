"""vmap and fori_loop: a function of one, for many."""

import contextlib
from functools import partial

import numpy as np

from curriculum.common.tracing import llvm
from curriculum.common.tracing.arrays import ordered
from curriculum.common.tracing.python import COLUMNS, Columns, function_of, source_of
from curriculum.common.tracing.tape import Untraceable, current
from curriculum.common.tracing.trace import LANES, Loop, Program, several, side_by_side, work

BLOCK = 4096  # states that are mapped at once: their columns stay in the cache
FEW = 100  # states: for fewer a function is just called
QUICKER = 50  # a number of a column than one by one


def fori_loop(steps, body, *carry):
    """carry = body(*carry), so many times: an array or several. The body may be vmapped."""
    if current.tape is not None:
        carry = Loop(body, carry, steps).results
    elif hasattr(body, "of_one"):  # each goes its way
        return vmap(partial(fori_loop, steps, body.of_one))(*carry)
    else:
        for _ in range(steps):
            carry = several(body(*carry))
    return tuple(carry) if len(carry) > 1 else carry[0]


def vmap(function):
    """function(*state) -> array, or a tuple of several, for many: all have one axis more, in front.

    Many are compiled. In a function that is traced itself, they are lanes side by side.
    """

    known = {}  # what is compiled, by which entries of the states are not zero

    def mapped(*states):
        made = None
        if not current.plain and current.tape is None and len(states[0]) >= FEW:
            states = [np.asarray(x, float) for x in states]
            live = [np.any(x, axis=0) for x in states]
            key = tuple((x.shape, x.tobytes()) for x in live)
            with contextlib.suppress(Untraceable), np.errstate(all="ignore"):
                known[key] = known.get(key) or compiled_map(function, live, len(states[0]))
                made = known[key](states)
        if made is None:
            copies = [ordered(np.array(x)) for x in states]  # a function may edit what it is given
            rows = side_by_side(function, list(zip(*copies, strict=True)))
            made = [ordered(np.stack(list(map(np.asarray, x)))) for x in zip(*rows, strict=True)]
        return tuple(made) if len(made) > 1 else made[0]

    mapped.of_one = function
    return mapped


def compiled_map(function, live, many):
    """run(states) -> the arrays of vmap: in machine code, if so `many` repay that, or by numpy."""
    program = Program(function, *live)
    ends = np.cumsum(list(map(np.size, program.made)))[:-1]
    source, crowd = source_of(program, Columns), None
    if llvm.repays(many * work(program.tape, 1) / QUICKER, source.count("\n")):
        with contextlib.suppress(llvm.Unavailable):
            crowd = llvm.crowd(Program(function, *live, rows=LANES))
    crowd = crowd or in_columns(function_of(source, COLUMNS), len(program.results))

    def run(states):
        count = len(states[0])
        columns = np.concatenate([x.reshape(count, -1) for x in states], axis=1).T
        columns = columns[program.places].copy()
        parts = np.split(crowd(columns), ends, axis=1)
        return [x.reshape(count, *np.shape(y)) for x, y in zip(parts, program.made, strict=True)]

    return run


def in_columns(function, results):
    """run(columns (inputs, K)) -> (K, results) of a function of columns, block by block."""

    def run(columns):
        made = np.empty((columns.shape[1], results))
        for first in range(0, len(made), BLOCK):
            part = slice(first, first + BLOCK)
            for k, column in enumerate(function(*columns[:, part])):
                made[part, k] = column
        return made

    return run
