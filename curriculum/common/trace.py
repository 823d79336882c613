"""Run a function of small arrays once, on symbols, and write down what it did as straight-line
code.

A `Symbol` is a number that is not known yet. numpy carries symbols in object arrays, so lines
written for arrays of floats run on them as they stand, and every operator notes an operation
instead of doing it. What is multiplied by zero vanishes, what stands there twice is done once, what
nobody asks for is left out. Exact: what is left has the operands and the order that the function
gave it, so it computes what the same lines compute of Python's floats, to the last bit (but for the
sign of a zero, 0 * inf and inf - inf). Nothing here knows what the function is about.
"""

from itertools import count

import numpy as np

FUNCTIONS = (
    "sqrt",
    "sin",
    "cos",
    "tan",
    "exp",
    "log",
    "expm1",
    "log1p",
    "sinh",
    "cosh",
    "tanh",
)  # numpy's and math's


class Untraceable(Exception):
    """The function asks of a symbol what cannot be written down; the message says what."""


class Tape:
    """Operations: nodes {name: (sign, *operands)}, an operand being a name or a float; and the
    loops among them."""

    def __init__(self, outer=None):
        self.nodes, self.names, self.loops = {}, {}, {}
        self.depth, self.numbers = (outer.depth + 1, outer.numbers) if outer else (0, count())

    def ancestry(self, symbols):
        """{name: operands} of all operations that the symbols come from."""
        found, stack = {}, [s.x for s in symbols]
        while stack:
            x = stack.pop()
            if x in self.nodes and x not in found:
                found[x] = self.nodes[x][1:]
                stack += found[x]
        return found


def operators(rule, zero=False):
    """A Symbol's operator, what `rule` makes of it and a number, and the reflected one; whole
    arrays are numpy's.

    `zero`: a plain 0 makes a plain 0, which costs numpy's long sums of nothing less than a symbol
    would.
    """

    def operator(a, b, swapped=False):
        if type(b) is not Symbol:
            if isinstance(b, np.ndarray) and b.ndim:
                return NotImplemented
            if zero and b == 0:
                return 0
            b = a.lift(b)
        return rule(b, a) if swapped else rule(a, b)

    return operator, lambda a, b: operator(a, b, True)


class Symbol:
    """A number on a tape: x is a float >= 0, or the name of an input or of an operation; or it is
    minus that."""

    __slots__ = ("tape", "x", "minus")

    def __init__(self, tape, x, minus=False):
        self.tape, self.x, self.minus = tape, x, minus

    def __repr__(self):
        return "-" * self.minus + str(self.x)

    def lift(self, number):
        number = number.item() if isinstance(number, np.ndarray) else number
        return (
            number
            if type(number) is Symbol
            else Symbol(self.tape, abs(float(number)), bool(number < 0))
        )

    def note(self, sign, other=None, minus=False):
        """The symbol of an operation on x, or on x and another's; asked for again, the same one."""
        tape = other.tape if other is not None and other.tape.depth > self.tape.depth else self.tape
        key = (sign, self.x) if other is None else (sign, self.x, other.x)
        key = (sign, *key[:0:-1]) if sign in "+*" and (sign, *key[:0:-1]) in tape.names else key
        if key not in tape.names:
            tape.names[key] = f"t{next(tape.numbers)}"
            tape.nodes[tape.names[key]] = key
        return Symbol(tape, tape.names[key], minus)

    def plain(self):
        return self.lift(0.0).note("-", self) if self.minus else self

    def add(self, b):
        if self.x == 0.0 or b.x == 0.0:
            return b if self.x == 0.0 else self
        if self.minus == b.minus:
            return self.note("+", b, self.minus)
        left, right = (b, self) if self.minus else (self, b)
        return self.lift(0.0) if left.x == right.x else left.note("-", right)

    def multiply(self, b):
        if self.x == 0.0 or b.x == 1.0:
            return Symbol(self.tape, self.x, self.minus != b.minus)
        if b.x == 0.0 or self.x == 1.0:
            return Symbol(b.tape, b.x, self.minus != b.minus)
        return self.note("*", b, self.minus != b.minus)

    def divide(self, b):
        minus = self.minus != b.minus
        return (
            Symbol(self.tape, self.x, minus)
            if self.x == 0.0 or b.x == 1.0
            else self.note("/", b, minus)
        )

    def refuse(self, *_):
        raise Untraceable("it branches on a value, or wants one as a plain number")

    def __neg__(self):
        return Symbol(self.tape, self.x, not self.minus)

    def __abs__(self):
        return self.note("abs")

    __add__, __radd__ = operators(add)
    __sub__, __rsub__ = operators(lambda a, b: a.add(-b))
    __mul__, __rmul__ = operators(multiply, zero=True)
    __truediv__, __rtruediv__ = operators(divide)
    __pow__, __rpow__ = operators(lambda a, b: a.plain().note("**", b.plain()))
    __bool__ = __float__ = __int__ = __eq__ = __ne__ = __lt__ = __le__ = __gt__ = __ge__ = refuse
    __hash__ = None


for name in FUNCTIONS:  # np.sin asks each entry of an object array for its method sin
    setattr(Symbol, name, lambda symbol, name=name: symbol.plain().note(name))


class Program:
    """function(*arrays) -> tuple of arrays, traced; entries marked in `still`, a mask an array, are
    zero.

    `live`: (argument, place) of the others, in the order of `inputs`, their names; `results`:
    arrays of symbols.
    """

    def __init__(self, function, *still):
        self.tape, names = Tape(), function.__code__.co_varnames
        arrays = [np.full(mask.shape, Symbol(self.tape, 0.0)) for mask in still]
        self.live = [
            (k, tuple(place))
            for k, mask in enumerate(still)
            for place in np.argwhere(~mask).tolist()
        ]
        self.inputs = ["_".join(map(str, (names[k], *place))) for k, place in self.live]
        for (k, place), name in zip(self.live, self.inputs, strict=True):
            arrays[k][place] = Symbol(self.tape, name)
        lift = np.vectorize(Symbol(self.tape, 0.0).lift, otypes=[object])
        self.results = [lift(a) for a in function(*arrays)]
