"""Symbols: numbers that are not known yet. Every operator notes what it is asked for on a tape.

What is multiplied by zero vanishes, and repeated operations are done once. What is left has the
operands and the order that the function gave it: the same bits, but for the sign of a zero.
"""

import math

import numpy as np

from curriculum.common.tracing.tape import Untraceable, current

# As C, Python's math and JavaScript's Math call them. The last digit of all but sqrt is the C
# library's: numpy or a browser may round it another way.
FUNCTIONS = "sqrt", "sin", "cos", "tan", "exp", "log", "tanh", "atan2", "pow"
FLOATS = {name: getattr(math, name) for name in FUNCTIONS}  # what an operation makes of floats
FLOATS |= {"abs": abs, "<": lambda a, b: a < b, "<=": lambda a, b: a <= b}
FLOATS["max"] = lambda a, b: a if a >= b or a != a else b  # NaN, if one of them is
FLOATS["min"] = lambda a, b: a if a <= b or a != a else b
FLOATS["where"] = lambda condition, a, b: a if condition else b


def size_and_sign(x):
    """The size of a number, a float >= 0 or a Symbol's name, and whether it is minus that."""
    if isinstance(x, np.ndarray):  # of no axes
        x = x[()]
    if type(x) is Symbol:
        return x.name, x.minus
    x = float(x)
    return abs(x), x < 0.0


def operand(x):
    """A Symbol's or a Truth's name, or a float, with its sign written out."""
    if type(x) is Truth:
        return x.name
    name, minus = size_and_sign(x)
    if type(name) is float:
        return -name if minus else name
    return current.tape.note("-", 0.0, name) if minus else name


def operation(sign, *given):
    """What an operation makes of numbers, whose signs are written out first."""
    given = list(map(operand, given))
    if all(type(x) is float for x in given):
        return FLOATS[sign](*given)
    if sign == "where" and given[1] == given[2]:
        return signed(given[1], False)
    kind = Truth if sign in ("<", "<=") else Symbol
    return kind(current.tape.note(sign, *given))


def signed(size, minus):
    """The number of a size, a float or a name."""
    return Symbol(size, minus) if type(size) is str else -size if minus else size


def add(a, b):
    (x, minus), (y, other) = size_and_sign(a), size_and_sign(b)
    if x == 0.0 or y == 0.0:
        return b if x == 0.0 else a
    if minus == other:
        return signed(current.tape.note("+", x, y), minus)
    if x == y:
        return 0.0
    return Symbol(current.tape.note("-", *((y, x) if minus else (x, y))))


def multiply(a, b):
    (x, minus), (y, other) = size_and_sign(a), size_and_sign(b)
    if x == 0.0 or y == 1.0:
        size = x
    else:
        size = y if y == 0.0 or x == 1.0 else current.tape.note("*", x, y)
    return signed(size, minus != other)


def divide(a, b):
    (x, minus), (y, other) = size_and_sign(a), size_and_sign(b)
    size = x if x == 0.0 or y == 1.0 else current.tape.note("/", x, y)
    return signed(size, minus != other)


def operators(rule):
    """An operator of Symbols and its reflection; arrays are left to numpy."""

    def operator(a, b):
        return NotImplemented if isinstance(b, np.ndarray) and b.ndim else rule(a, b)

    return operator, lambda a, b: rule(b, a)


def refusal(why):
    """A method that cannot be."""

    def refuse(*_):
        raise Untraceable(why)

    return refuse


class Symbol:
    """A number on a tape, by the name of its operation, or minus that."""

    __slots__ = "name", "minus"
    __hash__ = None

    def __init__(self, name, minus=False):
        self.name, self.minus = name, minus

    def __repr__(self):
        return "-" * self.minus + self.name

    def __neg__(self):
        return Symbol(self.name, not self.minus)

    def __abs__(self):
        return operation("abs", Symbol(self.name))

    __add__, __radd__ = operators(add)
    __sub__, __rsub__ = operators(lambda a, b: add(a, -b))
    __mul__, __rmul__ = operators(multiply)
    __truediv__, __rtruediv__ = operators(divide)
    __pow__, __rpow__ = operators(lambda a, b: operation("pow", a, b))
    __lt__, __gt__ = operators(lambda a, b: operation("<", a, b))
    __le__, __ge__ = operators(lambda a, b: operation("<=", a, b))
    __bool__ = refusal("it branches on a value; np.where, np.maximum and np.minimum do not")
    __eq__ = __ne__ = refusal("it asks whether numbers are equal; < and <= can be compiled")
    __float__ = __int__ = refusal("it wants a plain number; np.zeros(shape, like=q) takes symbols")


class Truth:
    """What a comparison of symbols gives: on the tape 1 or 0."""

    __slots__ = ("name",)
    __hash__ = None
    __bool__ = Symbol.__bool__
    __float__ = refusal("a comparison is good inside np.where and as a loop's condition only")
    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __float__
    __and__ = __rand__ = __or__ = __ror__ = __invert__ = __neg__ = __eq__ = __float__

    def __init__(self, name):
        self.name = name
