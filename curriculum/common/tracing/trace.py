"""Functions on symbols: a Program, traced once; rows side by side in it; and its loops."""

import inspect
import math
import traceback
from itertools import chain, islice

import numpy as np

from curriculum.common.tracing.arrays import zero
from curriculum.common.tracing.symbols import FLOATS, LIBRARY, Symbol, operand, viewed
from curriculum.common.tracing.tape import Op, Tape, Untraceable, current, in_line, note

LANES = 16  # rows at most that go in step
TURNS = 2  # of a while_loop, as a guess
# Names for which what is written has a use, and words that JavaScript keeps for itself
TAKEN = {"f", "steps", "record", "state", "inf", "nan", "any", "_", "range", *FLOATS}
WORDS = """
    Error Infinity Math NaN arguments case catch const debugger default delete do enum eval export
    extends false function implements instanceof interface let new null package private protected
    public static super switch this throw true typeof undefined var void
"""
TAKEN |= {*WORDS.split()}


def flat(arrays):
    """All numbers of arrays."""
    return list(chain.from_iterable(np.asarray(array, object).flat for array in arrays))


def shaped(numbers, like):
    """All numbers as arrays of the shapes of others; their names as Symbols."""
    numbers = map(symbol, numbers)
    arrays = []
    for shape in map(np.shape, like):
        array = np.empty(shape, object)
        array.flat = list(islice(numbers, array.size))
        arrays.append(viewed(array))
    return arrays


def symbol(x):
    return Symbol(x) if type(x) is str else x


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
    """The arrays of a result, which is one or several, as a tuple."""
    return tuple(result) if isinstance(result, tuple | list) else (result,)


def one_or_several(arrays):
    """Several arrays as a tuple; one, by itself."""
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
    return [*map(unlike_ours, found), *["x"] * many][:many]


def unlike_ours(name):  # x_1 is an entry of x, t1 and loop2 are operations
    return f"{name}_" if name[-1].isdigit() or name in ("t", "loop") else name


def names_of(names, live):
    """The names of the numbers of arrays, as q_0_1; and 0.0 where they are not live."""
    numbers = []
    for name, mask in zip(names, live, strict=False):
        for k, alive in np.ndenumerate(mask):
            numbers.append("_".join([name, *map(str, k)]) if alive else 0.0)
    return numbers


def reason(why):
    """What went wrong, and in which line of the reader's."""
    return in_line(str(why), traceback.extract_tb(why.__traceback__))


class Program:
    """function(*arrays, *scalars) -> array or arrays, traced where entries `live` are not zero.

    `live`: a mask an array. `inputs`: the names of the live numbers, which stand at `places` among
    all, and of the scalars. `outputs`: the arrays, made of the `results`. Raises Untraceable.
    """

    def __init__(self, function, *live, scalars=0, names=None):
        self.tape = Tape(used=TAKEN)
        names = list(map(self.tape.fresh, names or parameters(function, len(live) + scalars)))
        numbers = names_of(names, live)
        self.places = [k for k, x in enumerate(numbers) if x != 0.0]
        self.inputs = [numbers[k] for k in self.places] + names[len(live) :]
        self.tape.nodes |= dict.fromkeys(self.inputs, Op("input"))
        arrays = shaped(numbers, live) + list(map(Symbol, names[len(live) :]))
        try:
            with np.errstate(all="ignore"):
                self.outputs, self.results = traced(self.tape, function, arrays)
        except Exception as why:
            raise Untraceable(*self.tape.refused or [reason(why)]) from why
        if self.tape.refused:
            raise Untraceable(*self.tape.refused)

    @property
    def exact(self):
        """Whether its code has the bits of the function: sines of a library may be others."""
        return self.tape.signs.isdisjoint(LIBRARY)


def side_by_side(function, rows):
    """[function(*row)] of rows of arrays: when traced, once, with the rows as lanes."""
    tape = current.tape
    many = len(rows)
    if tape is None or tape.rows > 1 or not 1 < many <= LANES:
        return [several(function(*row)) for row in rows]
    tape.rows = many
    try:
        columns = zip(*map(flat, rows), strict=True)
        results = several(function(*shaped(map(stacked, columns), rows[0])))
    finally:
        tape.rows = 1
    return [row_of(results, k) for k in range(many)]


def row_of(results, k):
    return shaped([lane(x, k) for x in flat(results)], results)


def stacked(column):  # one name for a number in each of several rows
    names = list(map(operand, column))
    return column[0] if len({*names}) == 1 else note("stack", *names)


def lane(x, k):
    """A number of row k, of one that may differ from row to row."""
    return Symbol(note("lane", x.name, k), x.minus) if type(x) is Symbol else x


class Turn:
    """A turn of a loop, traced with arrays of such shapes: (condition and) body of what is live."""

    def __init__(self, outer, names, live, arrays, body, condition):
        self.tape = Tape(outer)
        self.live = live
        self.numbers = names_of(names, shaped(live, arrays))  # as they are when it begins
        self.tape.nodes |= dict.fromkeys(filter(None, self.numbers), Op("carried"))
        now = shaped(self.numbers, arrays)
        self.going = None  # the name of what the condition says
        if condition:
            _, (self.going,) = traced(self.tape, condition, now)
        result, self.after = traced(self.tape, body, now)
        self.tape.outer = None  # which will have the loop on it: a circle would live on
        if list(map(np.shape, result)) != list(map(np.shape, arrays)):
            raise Untraceable("it returns other shapes than it takes")


def trace_turn(outer, names, arrays, body, condition):
    """The Turn that fits all turns: what begins as zero need not stay zero."""
    live = None
    grown = [not zero(x) for x in flat(arrays)]
    while live != grown:
        live = grown
        turn = Turn(outer, names, live, arrays, body, condition)
        grown = [a or x != 0.0 for a, x in zip(live, turn.after, strict=True)]
    return turn


class Loop:
    """The operation that repeats body(*arrays) `most` times, or while `going`: else it has failed.

    carry {name: (as it begins, what follows)} has what is not always zero, at `places` among all
    `size` numbers of the arrays, the `outputs`. If `most` is None, it takes as many turns as are
    asked for, and records the row of each. It stands where so many `rows` are side by side.
    """

    sign = "loop"

    def __init__(self, body, arrays, most, condition=None, failure=None, names=None):
        outer = current.tape
        names = list(map(outer.fresh, names or parameters(body, len(arrays))))
        turn = trace_turn(outer, names, arrays, body, condition)
        self.tape = turn.tape
        self.rows = turn.tape.rows
        self.outputs = shaped(turn.numbers, arrays)
        self.most = most
        self.going = turn.going
        self.failure = failure
        self.size = len(turn.live)
        self.places = np.flatnonzero(turn.live).tolist()
        self.following = [turn.after[k] for k in self.places]
        begins = list(map(operand, flat(arrays)))
        self.carry = {turn.numbers[k]: (begins[k], turn.after[k]) for k in self.places}
        self.operands = [begins[k] for k in self.places] + self.names_from_around()
        name = f"loop{next(outer.numbers)}"
        outer.nodes[name] = self
        outer.lines += self.tape.lines
        outer.nodes |= dict.fromkeys(self.carry, Op("carried", (name,)))

    def names_from_around(self):
        found = [self.going, *self.following]
        nodes = self.tape.nodes
        used = [found, *(nodes[name].operands for name in self.tape.needed(found))]
        return [x for x in chain.from_iterable(used) if type(x) is str and x not in nodes]


def trace_loop(step, live, scalars=0, others=()):
    """The Program of many steps, step(*state, *others, *scalars) -> state, and its Loop."""
    many = len(live)
    names = parameters(step, many + len(others) + scalars)
    own = names[:many]
    loops = []

    def steps(*numbers):
        def body(*state):
            return step(*state, *others, *numbers[many:])

        loops.append(Loop(body, numbers[:many], None, names=own))
        return tuple(loops[0].outputs)

    names = [f"{name}_start" for name in own] + names[many + len(others) :]
    return Program(steps, *live, scalars=scalars, names=names), loops[0]


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
