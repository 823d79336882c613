"""A program as numpy calls: a function of whole arrays, a line an operation.

What nobody needs any more is let go of at once. So a dozen arrays are alive at a time, however long
the program is, and the processor's cache holds them if they have PIECE entries each.
"""

from curriculum.common.trace import FUNCTIONS, Call, Lanes

import numpy as np

PIECE = 1 << 13
MATRICES = 1 << 23  # their entries
UFUNCS = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide", "**": "power"}
UFUNCS |= {"abs": "absolute"} | {name: name for name in FUNCTIONS}
NAMES = {name: getattr(np, name) for name in [*UFUNCS.values(), "all", "where", "inf", "nan"]}


def signed(symbol):
    """A symbol's value."""
    return f"{'-' * symbol.minus}{symbol.x}"


def listed(symbols):
    """A tuple of them."""
    return "".join(f"{signed(s)}, " for s in symbols)


class Writer:
    """Lines of numpy calls. `routines`: the programs that they call."""

    def __init__(self):
        self.routines = []

    def function(self, name, program, results):
        """A function of a program's inputs and knobs that returns some of its results."""
        tape, given = program.tape, ", ".join([*program.inputs, *program.knobs])
        lines = self.operations(tape, tape.needed(results), {s.x for s in results})
        body = "".join(f"    {line}\n" for line in lines)
        return f"def {name}({given}):\n{body}    return {listed(results)}\n"

    def operations(self, tape, names, kept):
        """The operations `names` of a tape; all but `kept` are let go of after their last use."""
        last = {x: name for name in names for x in tape.nodes[name][1:]}
        for name in names:
            sign, *operands = tape.nodes[name]
            if sign == "of":
                continue
            if sign == "part":
                part = tape.parts[name]
                write = {Call: self.call, Lanes: self.lanes}.get(type(part), self.loop)
                yield from write(part)
            else:
                yield f"{name} = {UFUNCS[sign]}({', '.join(map(str, operands))})"
            for x in dict.fromkeys(operands):
                if x in tape.nodes and x not in kept and last[x] == name:
                    yield f"del {x}"

    def call(self, call):
        """The numbers that a routine makes."""
        if call.program not in self.routines:
            self.routines.append(call.program)
        called = f"routine{self.routines.index(call.program)}"
        yield f"{', '.join(call.names)}, = {called}({listed(call.arguments)})"

    def lanes(self, lanes):
        """Rows in turn."""
        program = lanes.program
        kept, needed = {s.x for s in program.made}, program.tape.needed(program.made)
        for row, names in zip(lanes.rows, lanes.names, strict=True):
            yield f"{', '.join(program.inputs)}, = {listed(row)}"
            yield from self.operations(program.tape, needed, kept)
            yield f"{', '.join(names)}, = {listed(program.made)}"

    def loop(self, loop):
        """A loop; members that are done keep their values, those that never are become NaN."""
        tape, names, size = loop.tape, loop.names, signed(loop.size)
        last, done = f"last_{names[0]}", f"done_{names[0]}"
        kept = {s.x for s in (loop.size, *loop.following)}
        later = kept.union(*(tape.nodes[name][1:] for name in loop.rest))
        turn = [
            *self.operations(tape, loop.test, later),
            f"{done} = {done} | ({size} <= 1.0) | (({last} <= {size}) & ({size} <= {loop.nearly}))",
            f"if all({done}):",
            "    break",
            f"{last} = {size}",
            *self.operations(tape, loop.rest, kept),
            f"following = {listed(loop.following)}",
            *(f"{x} = where({done}, {x}, following[{k}])" for k, x in enumerate(names)),
        ]
        yield f"{', '.join(names)}, = {listed(loop.start)}"
        yield f"{last}, {done} = inf, False"
        yield f"for _ in range({loop.most}):"
        yield from (f"    {line}" for line in turn)
        yield "else:"
        yield from (f"    {x} = where({done}, {x}, nan)" for x in names)


class Arrays:
    """A Program's function, iterated by numpy, and called as native.Native is.

    function(*inputs, *knobs) -> tuple of results, all arrays of one shape; only knobs are numbers.
    """

    lanes = 1

    def __init__(self, program):
        writer = Writer()
        source = writer.function("f", program, program.out)
        for k, routine in enumerate(writer.routines):  # which may call others: the list grows
            source += writer.function(f"routine{k}", routine, routine.made)
        exec(source, space := dict(NAMES))
        self.function = space["f"]

    def __call__(self, state, count, out, *knobs):
        values, entries = list(state.copy()), len(state)
        for k in range(count):
            with np.errstate(all="ignore"):
                values = self.function(*values[:entries], *knobs)
            if out is not None:
                put(out[k], values[entries:] or values)
        put(state, values)


def put(places, values):
    """Put arrays, or numbers, into the rows of an array."""
    for place, value in zip(places, values, strict=False):
        place[:] = value


def each_state(function, q, v):
    """function(q, v) (N, 3), which is of one state, of each of q, v (..., N, 3)."""
    shape = q.shape[-2:]
    states = zip(q.reshape(-1, *shape), v.reshape(-1, *shape), strict=True)
    return np.reshape([np.broadcast_to(function(*state), shape) for state in states], q.shape)


def in_pieces(function, q, v):
    """function(q, v) of many states (K, N, 3), some at a time: their matrices would fill memory."""
    some = max(1, MATRICES // q[0].size ** 2)
    pieces = [slice(k, k + some) for k in range(0, len(q), some)]
    return np.concatenate([function(q[piece], v[piece]) for piece in pieces])
