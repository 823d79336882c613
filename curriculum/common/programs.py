"""A function of small arrays as a Program, traced once; and what in it is a routine or a loop.

On a tape of operations (tape.py) stand parts, too, which are more than an operation: Calls of a
program, one or several side by side, and a Loop. Each has a tape of its own. Writers turn a program
into Python (python.py), rows of numbers (bytecode.py), machine code (native.py) or JavaScript.
"""

from copy import copy
from operator import index

from curriculum.common.arrays import ordered
from curriculum.common.tape import Stop, Tape, Untraceable, current, effort
from curriculum.common.trace import EXACT, METHODS, Symbol, lift, lifted

import numpy as np

ROUNDS = 5  # of a loop, when work is guessed
INLINE = 160  # operations of a routine that is written out where it is called


class Program:
    """function(*arrays, *knobs) -> tuple of arrays, traced; entries marked in `still` are zero.

    `still`: a mask an array. `knobs`: names of numbers that last; where they divide, not zero.
    `inputs`: the names of the entries that are not still, `live` their (argument, place).
    `results`: arrays of Symbols; `out`: them all in one list.
    """

    def __init__(self, function, *still, knobs=(), tape=None):
        self.tape, self.knobs = tape or Tape(), list(knobs)
        self.tape.knobs = self.knobs or self.tape.knobs
        masks = list(enumerate(still))
        self.live = [(k, tuple(at)) for k, mask in masks for at in np.argwhere(~mask).tolist()]
        if tape:  # of a routine or of rows: no other names may be the same
            self.inputs = [f"a{next(tape.numbers)}" for _ in self.live]
        else:
            names = function.__code__.co_varnames
            self.inputs = ["_".join(map(str, (names[k], *place))) for k, place in self.live]
        nothing = Symbol(self.tape, 0.0)
        arrays = [ordered(np.full(mask.shape, nothing)) for mask in still]
        for (k, place), name in zip(self.live, self.inputs, strict=True):
            arrays[k][place] = Symbol(self.tape, name)
        knobs = [Symbol(self.tape, name) for name in self.knobs]
        self.results = self.tape.trace(lambda: [lifted(a) for a in function(*arrays, *knobs)])
        if self.tape.refused:
            raise Untraceable(self.tape.refused[0])

    @property
    def out(self):
        return [s for array in self.results for s in array.flat]

    @property
    def computed(self):
        """Those of its results that are no constants."""
        return [s for s in self.out if isinstance(s.x, str)]

    def tapes(self):
        """Its tape, and those of the loops and routines in it."""
        todo, found = [self.tape], []
        while todo:
            tape = todo.pop()
            if tape in found:  # a routine may be called from several places
                continue
            found.append(tape)
            todo += [x.tape if isinstance(x, Loop) else x.program.tape for x in tape.parts.values()]
        return found

    def innermost(self):
        """The program that this one calls and hands on what it makes, or else this one."""

        def signed(*arrays):
            return [(np.shape(x), [(s.x, s.minus) for s in np.ravel(x)]) for x in arrays]

        mine = signed([Symbol(self.tape, name) for name in self.inputs], *self.results)
        parts = [x for x in self.tape.parts.values() if isinstance(x, Calls) and not x.taken]
        alike = (x.program for x in parts if signed(x.rows[0], *x.results[0]) == mine)
        return next(alike, self)

    def loops(self):
        """How many loops there are in it."""
        return sum(isinstance(part, Loop) for x in self.tapes() for part in x.parts.values())

    def size(self):
        """How many operations, each counted once."""
        return sum(len(tape.nodes) for tape in self.tapes())

    def inexact(self):
        """The functions in it whose last digits may differ from machine to machine, by name."""
        return {node[0] for tape in self.tapes() for node in tape.nodes.values()} - EXACT

    def lasting(self):
        """Operations on knobs and constants alone: to be done once."""
        known, lasting = set(self.knobs), []
        for name in self.tape.needed(self.out):
            sign, *operands = self.tape.nodes[name]
            lasts = all(x in known or isinstance(x, float) for x in operands)
            if lasts and name not in self.tape.parts:
                known.add(name)
                lasting.append(Symbol(self.tape, name))
        return lasting

    def shaped(self, symbols):
        """Arrays like the results, of other Symbols."""
        symbols = iter(symbols)
        return [lifted([next(symbols) for _ in x.flat]).reshape(x.shape) for x in self.results]

    def renamed(self, names, tape):
        """The results where what the program makes is called `names`, on a tape around it."""
        names = iter(names)
        here = [Symbol(tape, next(names)) if isinstance(s.x, str) else s for s in self.out]
        return self.shaped(here)

    def with_numbers(self, values):
        """This program, without parts, where inputs are the numbers `values` {name: number}: as if
        it had been traced with them, but that a sum may be minus the sum of its terms' opposites,
        and what is alike only now may be done twice."""
        known = {name: Symbol(self.tape, abs(x), x < 0.0) for name, x in values.items()}
        tape = Tape()
        tape.numbers, nodes = self.tape.numbers, tape.nodes

        def symbol(x):
            return known[x] if x in known else Symbol(tape, x)

        def put():
            for name, node in self.tape.nodes.items():
                if known.keys().isdisjoint(node):  # as nearly all of them
                    nodes[name] = node
                    continue
                before, (sign, *operands) = len(nodes), node
                made = METHODS[sign](*map(symbol, operands))
                if made.minus or len(nodes) == before:
                    known[name] = made
                else:  # one operation is another: it keeps its name
                    _, nodes[name] = nodes.popitem()
                    tape.names[nodes[name]] = name
            return self.shaped(-symbol(s.x) if s.minus else symbol(s.x) for s in self.out)

        found = copy(self)
        found.tape, found.results = tape, tape.trace(put)
        found.inputs = [name for name in self.inputs if name not in values]
        found.live = self.live[: len(found.inputs)]
        return found

    def replay(self, arguments):
        """The results for other inputs, noted on the tape that is current."""
        known = dict(zip(self.inputs, arguments, strict=True))

        def symbol(x, minus=False):
            s = known[x] if isinstance(x, str) else lift(x)
            return -s if minus else s

        for name in self.tape.needed(self.out):
            sign, *operands = self.tape.nodes[name]
            known[name] = METHODS[sign](*map(symbol, operands))
        return [symbol(s.x, s.minus) for s in self.out]


class Routine:
    """function(*arrays) -> array, traced once for each pattern of zeros, and called often.

    On arrays of floats it is just the function. What is short is written out at each call, but not
    in a loop, nor what is called so `often` that there would be much to write.
    """

    def __init__(self, function, often=False):
        self.function, self.often, self.programs = function, often, {}

    def __call__(self, *arrays):
        if current.tape is None or not any(np.asarray(a).dtype == object for a in arrays):
            return self.function(*arrays)
        given = [[lift(s) for s in np.asarray(a, dtype=object).flat] for a in arrays]
        still = [tuple(s.x == 0.0 for s in symbols) for symbols in given]
        shapes = [np.shape(a) for a in arrays]
        key = current.tape.numbers, *zip(shapes, still, strict=True)
        if key not in self.programs:
            before = effort.numpy_calls
            program = self.program(shapes, still)
            self.programs[key] = program, (effort.numpy_calls - before) // effort.factor
            effort.numpy_calls = before
        program, calls = self.programs[key]
        effort.numpy_calls += effort.factor * calls
        arguments = [s for symbols in given for s in symbols if s.x != 0.0]
        short = len(program.tape.nodes) <= INLINE and not program.tape.parts
        if short and not (self.often or current.tape.outer):
            return program.shaped(program.replay(arguments))[0]
        return Calls(program, [arguments]).results[0][0]

    def program(self, shapes, still):
        """The Program that it is for arrays of these shapes that are zero where `still` says so."""
        tape = Tape()
        tape.numbers, tape.refused = current.tape.numbers, current.tape.refused
        return self.traced(self.function, shapes, still, tape)

    def traced(self, function, shapes, still, tape):
        """The Program of a function of such arrays, on a tape."""
        masks = (np.array(x, bool).reshape(y) for x, y in zip(still, shapes, strict=True))
        return Program(lambda *given: (function(*given),), *masks, tape=tape)


def side_by_side(function, *arrays):
    """function(row, ...) for the rows of the arrays, stacked: one array, or a tuple of arrays.

    On symbols it is traced once for all rows that are zero in the same places.
    """
    rows, several = list(zip(*arrays, strict=True)), False

    def as_tuple(*row):
        nonlocal several
        found = function(*row)
        several = isinstance(found, tuple)
        return found if several else (found,)

    if current.tape is None:
        made = [as_tuple(*row) for row in rows]
    else:
        made = traced_rows(as_tuple, [list(map(lifted, row)) for row in rows])
    stacked = tuple(ordered(np.stack(part)) for part in zip(*made, strict=True))
    return stacked if several else stacked[0]


def traced_rows(function, rows):
    """What function(*row) returns for each of the rows, lists of arrays of Symbols."""
    outer, alike, made = current.tape, {}, [None] * len(rows)
    for k, row in enumerate(rows):
        zero = tuple(s.x == 0.0 for array in row for s in array.flat)
        alike.setdefault(zero, []).append(k)
    for zero, places in alike.items():
        first = rows[places[0]]
        if all(zero) or len(places) == 1:
            results = [function(*first)] * len(places)
        else:
            masks = [np.array([s.x == 0.0 for s in x.flat], bool).reshape(x.shape) for x in first]
            with effort.repeated(len(places)):
                program = Program(function, *masks, tape=Tape(outer)).innermost()
            given = [[s for x in rows[k] for s in x.flat if s.x != 0.0] for k in places]
            results = Calls(program, given).results
        for k, result in zip(places, results, strict=True):
            made[k] = result
    return made


class Calls:
    """A program called with each of `rows` of Symbols: they can be lanes of one vector register.

    Its tape may use names from around it, those `taken`. `names`: how what it computes is called
    here, row by row. `results`: the arrays that it returns, row by row.
    """

    sign = "calls"  # of its node: what writes it has a method of that name

    def __init__(self, program, rows):
        self.program, self.rows, tape = program, rows, current.tape
        computed, inner = program.computed, program.tape
        self.names = [tape.new_names(len(computed)) for _ in rows]
        self.taken = inner.taken(computed, program.inputs) if inner.outer else []
        operands = [s.x for row in rows for s in row]
        tape.add_part(self, operands + self.taken, sum(self.names, []))
        self.results = [program.renamed(names, tape) for names in self.names]


def repeat(body, x, most, complaint):
    """The first of x, body's x, ... whose size is at most 1, where body(x) = (following, size).

    It is a while loop that can be compiled: on symbols it becomes a loop of the code, which is left
    out like all that no result needs, so use what it returns. Raises Stop(complaint) after `most`
    turns.
    """
    x = ordered(np.array(x))
    if current.tape is not None and x.dtype == object:
        return Loop(body, lifted(x), most, complaint).result
    for _ in range(most):
        following, size = body(x.copy())
        if type(size) is Symbol:
            return Loop(body, lifted(x), most, complaint).result
        if size <= 1.0:
            return x
        x = following
    raise Stop(complaint)


class Loop:
    """A loop on a tape: `names` begin as `start`; until it ends they become what `following` says.

    It ends where size <= 1. Its body has a tape of its own, and needs the numbers `taken` from
    around it. `test` names the operations that size comes from, `rest` those besides that
    `following` comes from.
    """

    sign = "loop"

    def __init__(self, body, x, most, complaint):
        self.most, self.complaint, outer = index(most), complaint, current.tape
        places = [place for place in np.ndindex(x.shape) if x[place].x != 0.0]
        while True:
            self.tape, self.names = Tape(outer), outer.new_names(len(places))
            named = self.put(x, places, self.tape)
            with effort.repeated(ROUNDS):
                following, size = self.tape.trace(lambda x=named: [lifted(y) for y in body(x)])
            grown = [place for place in np.ndindex(x.shape) if following[place].x != 0.0]
            if set(grown) <= set(places):
                break
            places = sorted({*places, *grown})  # what begins as zero does not stay zero
        self.start, self.size = [x[place] for place in places], size.item()
        self.following = [following[place] for place in places]
        self.test = self.tape.needed([self.size])
        begun = set(self.test)
        self.rest = [y for y in self.tape.needed(self.following) if y not in begun]
        self.taken = self.tape.taken([self.size, *self.following], self.names)
        outer.add_part(self, [*(s.x for s in self.start), *self.taken], self.names)
        self.result = self.put(x, places, outer)

    def put(self, x, places, tape):
        """x with this loop's names at its places, as Symbols on a tape."""
        named = x.copy()
        for place, name in zip(places, self.names, strict=True):
            named[place] = Symbol(tape, name)
        return named
