"""Functions on symbols: a Program, traced once; rows side by side in it; and its loops."""

import inspect
import os
import traceback
from itertools import islice

import numpy as np

from curriculum.common.tracing.arrays import ordered, viewed, zero
from curriculum.common.tracing.symbols import FLOATS, Symbol, operand
from curriculum.common.tracing.tape import StepFailed, Tape, Untraceable, current

LANES = 16  # rows at most, or members, that go in step: two or four registers keep a processor busy
TURNS = 2  # of a while_loop, as a guess
TAKEN = "f", "steps", "record", "state", "inf", "nan", "any", "maximum", "minimum", *FLOATS
TAKEN += "_", "range", "StepFailed"
INSIDE = os.path.dirname(__file__), os.path.dirname(np.__file__)


def flat(arrays):
    """All numbers of arrays, in one list."""
    return [x for array in arrays for x in np.asarray(array, object).flat]


def shaped(numbers, like):
    """All numbers as arrays of the shapes of others; their names as Symbols."""
    numbers, made = iter(numbers), []
    for shape in map(np.shape, like):
        array = np.empty(shape, object)
        array.flat = [Symbol(x) if type(x) is str else x for x in islice(numbers, array.size)]
        made.append(viewed(array))
    return made


def several(made):
    """What a function returns, an array or several, as a tuple."""
    return tuple(made) if isinstance(made, tuple | list) else (made,)


def traced(tape, function, arrays):
    """What a function makes of arrays, on a tape: an array or several; and the names in them."""
    made = tape.trace(function, *arrays)
    return made, tape.trace(lambda: list(map(operand, flat(several(made)))))


def parameters(function, many):
    """The names of so many arguments, as the function calls them."""
    try:
        every = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        every = []
    found = [x.name for x in every if x.kind in (x.POSITIONAL_ONLY, x.POSITIONAL_OR_KEYWORD)]
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
    all, and of the knobs. `results`: names and floats, of arrays shaped as `made`. `rows`: each
    number is that of so many side by side. Raises Untraceable, whatever it is that goes wrong.
    """

    def __init__(self, function, *live, knobs=0, rows=1, names=None):
        self.tape = Tape(used=TAKEN)
        self.tape.rows = rows
        names = names or parameters(function, len(live) + knobs)
        names = list(map(self.tape.fresh, names))
        given = names_of(names, live)
        self.places = [k for k, x in enumerate(given) if x != 0.0]
        self.inputs = [given[k] for k in self.places] + names[len(live) :]
        self.tape.nodes |= dict.fromkeys(self.inputs, ("given",))
        arrays = shaped(given, live) + list(map(Symbol, names[len(live) :]))
        try:
            made, self.results = traced(self.tape, function, arrays)
        except Exception as why:
            raise Untraceable(reason(why)) from why
        self.made = several(made)


def side_by_side(function, rows):
    """[function(*row)] of rows of arrays: when traced, once, with the rows as lanes."""
    tape, many = current.tape, len(rows)
    if tape is None or tape.rows > 1 or many == 1:
        return [several(function(*row)) for row in rows]
    if many > LANES:
        half = many // 2
        return side_by_side(function, rows[:half]) + side_by_side(function, rows[half:])
    tape.rows = many
    try:
        columns = zip(*map(flat, rows), strict=True)
        made = several(function(*shaped(map(stacked, columns), rows[0])))
    finally:
        tape.rows = 1
    return [shaped([lane(x, k) for x in flat(made)], made) for k in range(many)]


def stacked(column):
    """One number for those of several rows."""
    names = list(map(operand, column))
    return column[0] if len({*names}) == 1 else current.tape.note("stack", *names)


def lane(x, k):
    """The number in row k."""
    return Symbol(current.tape.note("lane", x.name, k), x.minus) if type(x) is Symbol else x


class Loop:
    """On a tape: arrays become body(*arrays) `most` times, or while condition(*arrays) is not 0.

    carry {name: (as it begins, what follows)} has what is not always zero, which is at `places`
    among all numbers. `most` is None for as many turns as are asked for; if it is to `record`, each
    turn hands on its row. `rows`: how many are side by side where the loop stands.
    """

    def __init__(self, body, arrays, most, condition=None, failure=None, record=False, names=None):
        outer, start = current.tape, flat(arrays)
        self.most, self.failure, self.record, self.rows = most, failure, record, outer.rows
        names = list(map(outer.fresh, names or parameters(body, len(arrays))))
        live, grown = None, [not zero(x) for x in start]
        while live != grown:  # what begins as zero need not stay zero
            live, self.tape = grown, Tape(outer)
            carry = names_of(names, shaped(live, arrays))
            self.tape.nodes |= dict.fromkeys(filter(None, carry), ("given",))
            now = shaped(carry, arrays)
            self.going = None
            if condition:
                (self.going,) = traced(self.tape, condition, now)[1]
            made, after = traced(self.tape, body, now)
            if list(map(np.shape, several(made))) != list(map(np.shape, arrays)):
                raise Untraceable("it returns other shapes than it is given")
            grown = [a or x != 0.0 for a, x in zip(live, after, strict=True)]
        self.size, self.places = len(live), [k for k, alive in enumerate(live) if alive]
        self.carry = {carry[k]: (operand(start[k]), after[k]) for k in self.places}
        self.following = [after[k] for k in self.places]
        self.single = not isinstance(made, tuple | list)
        self.tape.outer = None  # which has this loop on it: a circle would live on
        part = f"loop{next(outer.numbers)}"
        outer.nodes[part] = self, *(begin for begin, _ in self.carry.values()), *self.free_names()
        outer.nodes |= dict.fromkeys(self.carry, ("given", part))
        self.results = shaped(carry, arrays)

    def free_names(self):
        """The names from around it that it uses."""
        found, nodes = [self.going, *self.following], self.tape.nodes
        used = found + [x for name in self.tape.needed(found) for x in nodes[name][1:]]
        return [x for x in used if type(x) is str and x not in nodes]


def trace_loop(step, live, knobs=0):
    """The Program of many steps, step(*state, *knobs) -> state, and its Loop."""
    made, names = [], parameters(step, len(live) + knobs)
    own, others = names[: len(live)], names[len(live) :]

    def many(*given):
        state, known = given[: len(live)], given[len(live) :]
        made.append(Loop(lambda *now: step(*now, *known), state, None, record=True, names=own))
        return tuple(made[0].results)

    names = [f"{name}_start" for name in own] + others
    return Program(many, *live, knobs=knobs, names=names), made[0]


def work(tape, steps):
    """About how many operations a tape takes: a loop that ends by itself counts TURNS turns."""
    total = 0
    for sign, *_ in tape.nodes.values():
        if isinstance(sign, Loop):
            turns = TURNS if sign.going is not None else sign.most or steps
            total += turns * work(sign.tape, steps)
        else:
            total += 1
    return total


def while_loop(condition, body, x, most, failure):
    """Python's `while condition(x): x = body(x)` of an array x, as JAX has it, so that it compiles.

    Raises StepFailed(failure) after `most` turns.
    """
    if current.tape is not None:
        return Loop(body, [x], most, condition, failure).results[0]
    x = ordered(np.array(x))
    for _ in range(most):
        if not condition(x):
            return x
        x = ordered(body(x))
    raise StepFailed(failure)
