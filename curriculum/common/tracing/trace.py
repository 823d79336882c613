"""Functions on symbols: a Program, traced once; rows side by side in it; and its loops."""

import inspect
import math
import os
import traceback
from itertools import islice

import numpy as np

from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.symbols import FLOATS, Symbol, operand, viewed
from curriculum.common.tracing.tape import Op, Tape, Untraceable, current, note

LANES = 16  # rows at most that go in step
TURNS = 2  # of a while_loop, as a guess
TAKEN = "f", "steps", "record", "state", "inf", "nan", "any", "_", "range", *FLOATS
INSIDE = os.path.dirname(__file__), os.path.dirname(np.__file__)


def flat(arrays):
    return [x for array in arrays for x in np.asarray(array, object).flat]


def shaped(numbers, like):
    """All numbers as arrays of the shapes of others; their names as Symbols."""
    numbers, arrays = iter(numbers), []
    for shape in map(np.shape, like):
        array = np.empty(shape, object)
        array.flat = [Symbol(x) if type(x) is str else x for x in islice(numbers, array.size)]
        arrays.append(viewed(array))
    return arrays


def split(rows, shapes):
    """Rows of numbers as arrays of these shapes, with one axis more in front."""
    arrays = []
    end = 0
    for shape in shapes:
        begin = end
        end += math.prod(shape)
        arrays.append(rows[:, begin:end].reshape(len(rows), *shape))
    return arrays


def several(result):
    return tuple(result) if isinstance(result, tuple | list) else (result,)


def one_or_several(arrays):
    return tuple(arrays) if len(arrays) > 1 else arrays[0]


def traced(tape, function, arrays):
    """Trace function(*arrays) on a tape -> its arrays, and the names in them."""
    result = several(tape.trace(function, *arrays))
    return result, tape.trace(lambda: list(map(operand, flat(result))))


def parameters(function, many):
    """The names of so many arguments, as the function calls them."""
    try:
        found = inspect.signature(function).parameters
    except (TypeError, ValueError):  # it is not Python's
        found = ()
    found = [x + "_" * x[-1].isdigit() for x in found]  # x_1 is an entry of x, and t1 an operation
    return (found + ["x"] * many)[:many]


def names_of(names, live):
    """The names of the numbers of arrays, as q_0_1; and 0.0 where they are not live."""
    return [
        "_".join([name, *map(str, k)]) if alive else 0.0
        for name, mask in zip(names, live, strict=False)
        for k, alive in np.ndenumerate(mask)
    ]


def reason(why):
    """What went wrong, and in which line of the reader's."""
    frames = traceback.extract_tb(why.__traceback__)
    theirs = [x for x in frames if not x.filename.startswith(INSIDE)]
    if not theirs:
        return str(why)
    return f"{why} ({os.path.basename(theirs[-1].filename)}, line {theirs[-1].lineno})"


class Program:
    """function(*arrays, *knobs) -> array or arrays, traced where entries `live` are not zero.

    `live`: a mask an array. `inputs`: the names of the live numbers, which stand at `places` among
    all, and of the knobs. `outputs`: the arrays, made of the `results`. Raises Untraceable.
    """

    def __init__(self, function, *live, knobs=0, names=None):
        self.tape = Tape(used=TAKEN)
        names = list(map(self.tape.fresh, names or parameters(function, len(live) + knobs)))
        numbers = names_of(names, live)
        self.places = [k for k, x in enumerate(numbers) if x != 0.0]
        self.inputs = [numbers[k] for k in self.places] + names[len(live) :]
        self.tape.nodes |= dict.fromkeys(self.inputs, Op("input"))
        arrays = shaped(numbers, live) + list(map(Symbol, names[len(live) :]))
        try:
            self.outputs, self.results = traced(self.tape, function, arrays)
        except Exception as why:
            raise Untraceable(reason(why)) from why


def side_by_side(function, rows):
    """[function(*row)] of rows of arrays: when traced, once, with the rows as lanes."""
    tape, many = current.tape, len(rows)
    if tape is None or tape.rows > 1 or not 1 < many <= LANES:
        return [several(function(*row)) for row in rows]
    tape.rows = many
    try:
        columns = zip(*map(flat, rows), strict=True)
        results = several(function(*shaped(map(stacked, columns), rows[0])))
    finally:
        tape.rows = 1
    return [shaped([lane(x, k) for x in flat(results)], results) for k in range(many)]


def stacked(column):  # one name for a number in each of several rows
    names = list(map(operand, column))
    return column[0] if len({*names}) == 1 else note("stack", *names)


def lane(x, k):  # the number in row k
    return Symbol(note("lane", x.name, k), x.minus) if type(x) is Symbol else x


class Loop:
    """The operation that repeats body(*arrays) `most` times, or while `going`: else it has failed.

    carry {name: (as it begins, what follows)} has what is not always zero, at `places` among all
    `size` numbers of the arrays, the `outputs`. If `most` is None, it takes as many turns as are
    asked for, and records the row of each. It stands where so many `rows` are side by side.
    """

    sign = "loop"

    def __init__(self, body, arrays, most, condition=None, failure=None, names=None):
        outer, start = current.tape, flat(arrays)
        names = list(map(outer.fresh, names or parameters(body, len(arrays))))
        live, grown = None, [not zero(x) for x in start]
        while live != grown:  # what begins as zero need not stay zero
            live, tape, going = grown, Tape(outer), None
            numbers = names_of(names, shaped(live, arrays))
            tape.nodes |= dict.fromkeys(filter(None, numbers), Op("carried"))
            now = shaped(numbers, arrays)
            if condition:
                _, (going,) = traced(tape, condition, now)
            result, after = traced(tape, body, now)
            if list(map(np.shape, result)) != list(map(np.shape, arrays)):
                raise Untraceable("it returns other shapes than it takes")
            grown = [a or x != 0.0 for a, x in zip(live, after, strict=True)]
        tape.outer = None  # which will have this loop on it: a circle would live on
        self.tape, self.rows, self.outputs = tape, tape.rows, shaped(numbers, arrays)
        self.most, self.going, self.failure = most, going, failure
        self.size, self.places = len(live), [k for k, alive in enumerate(live) if alive]
        self.carry = {numbers[k]: (operand(start[k]), after[k]) for k in self.places}
        self.following = [after[k] for k in self.places]
        found = [going, *self.following]
        used = found + [x for name in tape.needed(found) for x in tape.nodes[name].operands]
        free = [x for x in used if type(x) is str and x not in tape.nodes]  # names from around it
        self.operands = (*(begin for begin, _ in self.carry.values()), *free)
        name = f"loop{next(outer.numbers)}"
        outer.nodes[name] = self
        outer.nodes |= dict.fromkeys(self.carry, Op("carried", (name,)))


def trace_loop(step, live, knobs=0, others=()):
    """The Program of many steps, step(*state, *others, *knobs) -> state, and its Loop."""
    many, loops = len(live), []
    names = parameters(step, many + len(others) + knobs)
    own, known = names[:many], names[many + len(others) :]

    def steps(*numbers):
        def body(*state):
            return step(*state, *others, *numbers[many:])

        loops.append(Loop(body, numbers[:many], None, names=own))
        return tuple(loops[0].outputs)

    names = [f"{name}_start" for name in own] + known
    return Program(steps, *live, knobs=knobs, names=names), loops[0]


def work(tape, steps):
    """About how many operations a tape takes."""
    total = len(tape.nodes)
    for node in tape.nodes.values():
        if isinstance(node, Loop):
            turns = TURNS if node.going is not None else node.most or steps
            total += turns * work(node.tape, steps)
    return total


def fori_loop(steps, body, *carry):
    """carry = body(*carry), so many times: an array or several."""
    if current.tape is not None:
        return one_or_several(Loop(body, carry, steps).outputs)
    for _ in range(steps):
        carry = several(body(*carry))
    return one_or_several(carry)


def while_loop(condition, body, *carry, most, failure):
    """Python's `while condition(*carry): carry = body(*carry)`, in a form that can be compiled.

    `carry` and what the body returns are an array, or several; so is the result. It is NaN if the
    condition still holds after `most` turns, and a compiled step says `failure` then.
    """
    if current.tape is not None:
        return one_or_several(Loop(body, carry, most + 1, condition, failure).outputs)
    for _ in range(most + 1):
        carry = [viewed(np.array(x, float)) for x in carry]
        if not condition(*carry):
            return one_or_several(carry)
        carry = several(body(*carry))
    current.failure = current.failure or failure
    return one_or_several([viewed(np.full(np.shape(x), np.nan)) for x in carry])
