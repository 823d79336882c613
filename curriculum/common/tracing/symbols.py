"""Symbols: numbers that are not known yet. Every operator notes what it is asked for on a tape.

What is multiplied by zero vanishes, x - x is zero, and repeated operations are done once. What is
left has the operands and the order of the function's own lines, and so the same bits.
"""

import math
import sys
from types import BuiltinFunctionType

import numpy as np

from curriculum.common.tracing import arrays
from curriculum.common.tracing.tape import INSIDE, Untraceable, note, refuse

# As C, Python's math and JavaScript's Math call them. The last digit of those in LIBRARY is the C
# library's: numpy or a browser may round it another way.
FUNCTIONS = "sqrt", "sin", "cos", "tan", "exp", "log", "tanh", "atan2", "pow"
LIBRARY = {*FUNCTIONS} - {"sqrt"}
FLOATS = {name: getattr(math, name) for name in FUNCTIONS}  # what an operation makes of floats
FLOATS |= {"abs": abs, "<": lambda a, b: a < b, "<=": lambda a, b: a <= b}
FLOATS["max"] = lambda a, b: a if a >= b or a != a else b  # NaN, if one of them is
FLOATS["min"] = lambda a, b: a if a <= b or a != a else b
FLOATS["where"] = lambda condition, a, b: a if condition else b


def size_and_sign(x):
    """The size of a number, a float >= 0 or a Symbol's name, and whether it is minus that."""
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
    return note("-", 0.0, name) if minus else name


def operation(sign, *numbers):
    """The result of an operation on numbers, whose signs are written out first."""
    operands = list(map(operand, numbers))
    if all(type(x) is float for x in operands):
        return FLOATS[sign](*operands)
    if sign == "where" and operands[1] == operands[2]:
        return signed(operands[1], False)
    kind = Truth if sign in ("<", "<=") else Symbol
    return kind(note(sign, *operands))


def signed(size, minus):
    """The number of a size, a float >= 0 or the name of a Symbol, or minus that."""
    if type(size) is str:
        return Symbol(size, minus)
    return -size if minus else size


def add(a, b):
    """a + b, where zeros, and what cancels, vanish."""
    x, minus = size_and_sign(a)
    y, other = size_and_sign(b)
    if x == 0.0:
        return b
    if y == 0.0:
        return a
    if minus == other:
        return signed(note("+", x, y), minus)
    if x == y:
        return 0.0
    return Symbol(note("-", y, x) if minus else note("-", x, y))


def multiply(a, b):
    """a * b, where zeros and ones vanish."""
    x, minus = size_and_sign(a)
    y, other = size_and_sign(b)
    if x == 0.0 or y == 0.0:
        size = 0.0
    elif x == 1.0:
        size = y
    elif y == 1.0:
        size = x
    else:
        size = note("*", x, y)
    return signed(size, minus != other)


def divide(a, b):
    """a / b, where a zero above and a one below vanish."""
    x, minus = size_and_sign(a)
    y, other = size_and_sign(b)
    size = x if x == 0.0 or y == 1.0 else note("/", x, y)
    return signed(size, minus != other)


def cannot(function):
    """Refuse a function of numpy's that has no operation."""
    module = getattr(function, "__module__", None) or "numpy"
    refuse(f"{module.replace('numpy', 'np')}.{function.__name__} cannot be compiled")


class Traced:
    """Symbols, single or in an array: what numpy's functions do to them."""

    __slots__ = ()

    def __array_function__(self, function, types, args, how):
        try:
            return applied(function, OWN, args, how)
        except Untraceable:
            raise
        except Exception:
            return cannot(function)

    def __array_ufunc__(self, ufunc, method, *args, out=None, **how):
        if ufunc not in ENTRIES:
            return cannot(ufunc)
        if (ufunc, method) == (np.add, "reduce"):
            return refuse("np.add.reduce adds in another order; np.sum can be compiled")
        result = getattr(ENTRIES[ufunc], method)(*map(np.asarray, args), **how)
        if out is not None:
            np.asarray(out[0])[...] = result
            return out[0]
        return viewed(result)


def operators(rule):
    """A rule(a, b) for numbers as the two methods of an operator, such as __sub__ and __rsub__."""

    def of_numbers(rule):  # arrays are left to numpy
        def operator(a, b):
            return NotImplemented if isinstance(b, np.ndarray) and b.ndim else rule(a, b)

        return operator

    return of_numbers(rule), of_numbers(lambda a, b: rule(b, a))


def refusal(why):
    """A function that takes anything and refuses it."""
    return lambda *_, **__: refuse(why)


class Symbol(Traced):
    """A number on a tape, by the name of its operation, or minus that."""

    __slots__ = "name", "minus"

    def __init__(self, name, minus=False):
        self.name = name
        self.minus = minus

    def __neg__(self):
        return Symbol(self.name, not self.minus)

    def __pos__(self):
        return self

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
    __eq__ = refusal("it asks whether numbers are equal; < and <= can be compiled")
    __ne__ = __eq__
    __float__ = refusal(
        "it wants a plain number; an array that takes others begins as np.zeros(shape, like=q) or "
        "with + 0.0 * q, as f = m * g + 0.0 * q"
    )
    __int__ = __index__ = __complex__ = __round__ = __trunc__ = __floor__ = __ceil__ = __float__
    __floordiv__ = __rfloordiv__ = __mod__ = __rmod__ = __divmod__ = __rdivmod__ = __float__
    __hash__ = __iter__ = __len__ = __float__

    @property
    def __class__(self):
        """A reader's isinstance(x, float) would find none here, where steps find one."""
        return refuse("it asks what kind of number it has") if is_asked("isinstance") else Symbol

    def __getattr__(self, name):
        if is_asked(name):
            refuse(f"it asks a number for its .{name}")
        raise AttributeError(name)


def is_asked(name):
    """Whether the line that asks is a reader's that has this name in it, and not numpy's."""
    code = sys._getframe(2).f_code
    return name in code.co_names and not code.co_filename.startswith(INSIDE)


class Truth(Traced):
    """What a comparison of symbols gives, on the tape 1 or 0: for np.where and loops only."""

    __slots__ = ("name",)
    __bool__ = Symbol.__bool__
    __eq__ = Symbol.__eq__
    __add__ = __sub__ = __mul__ = __truediv__ = __pow__ = __neg__ = refusal(
        "it computes with a comparison; np.where(condition, 1.0, 0.0) can be compiled"
    )
    __radd__ = __rsub__ = __rmul__ = __rtruediv__ = __rpow__ = __invert__ = __add__
    __and__ = __rand__ = __or__ = __ror__ = __xor__ = __rxor__ = __float__ = __int__ = __add__

    def __init__(self, name):
        self.name = name


class Ordered(np.ndarray):
    """An array of floats whose products and sums add from first to last."""

    __slots__ = ()
    __array_priority__ = 1.0  # what is computed of this and others is one, too

    def __matmul__(self, other):
        if self.ndim == 1 and type(other) is Ordered and self.shape == other.shape:
            return arrays.dot(self, other)  # what follows does the same, only later
        return product(self, other)

    def __rmatmul__(self, other):
        return product(other, self)

    def dot(self, other):
        return self @ other if np.ndim(other) else self * other

    def sum(self, axis=None, dtype=None, out=None, keepdims=False, **others):
        """np.sum, from first to last."""
        if dtype or out is not None or others or not self.size or self.dtype == bool:
            return super().sum(axis, dtype, out, keepdims, **others)
        return viewed(arrays.total(np.asarray(self), axis, keepdims))

    def mean(self, axis=None, dtype=None, out=None, **others):
        sums = self.sum(axis, dtype, out, **others)
        return sums / (self.size / np.size(sums))

    def __array_function__(self, function, types, args, how):
        return applied(function, ADDING, args, how)


class Symbols(Traced, Ordered):
    """An array of symbols and floats."""

    __slots__ = ()


def ordered(x):
    """x as an array whose products and sums add from first to last."""
    x = np.asanyarray(x)
    if x.dtype.char not in ARRAYS:
        x = x.astype(float)
    return x if isinstance(x, Ordered) else x.view(ARRAYS[x.dtype.char])


def viewed(x):
    """What numpy computed of ordered arrays, as one; a number, or whole ones, as they are."""
    if not isinstance(x, np.ndarray):
        return x
    if x.ndim == 0:
        return x[()]
    return x.view(ARRAYS[x.dtype.char]) if x.dtype.char in ARRAYS else x


def applied(function, own, args, how):
    """What a function of numpy gives, or one of our `own` that takes its place."""
    if function in own:
        return viewed(own[function](*args, **how))
    if isinstance(function, BuiltinFunctionType):  # as np.array(..., like=x)
        return viewed(function(*args, **how))
    # numpy's own way, whatever the class of the arguments
    return viewed(np.ndarray.__array_function__(NO_NUMBERS, function, (), args, how))


def product(a, b):
    """a @ b."""
    return viewed(arrays.product(np.asarray(a), np.asarray(b)))


def solve(a, b):
    """np.linalg.solve."""
    return ordered(arrays.solve(np.asarray(a), np.asarray(b)))


def norm(x, ord=None, axis=None, keepdims=False):
    """np.linalg.norm."""
    if ord is not None:
        return viewed(np.linalg.norm(np.asarray(x), ord, axis, keepdims))
    x = ordered(x)
    return np.sqrt(np.sum(x * x, axis=axis, keepdims=keepdims))


def add_up(a, *args, **how):
    """np.sum."""
    return ordered(a).sum(*args, **how)


def in_order(function):
    """A function of numpy's that adds from first to last, as it does if arrays are of objects."""

    def own(*args, **how):
        kind = np.result_type(*(x for x in args if isinstance(x, np.ndarray)))
        args = [np.asarray(x).astype(object) if isinstance(x, np.ndarray) else x for x in args]
        return np.asarray(function(*args, **how), kind)[()]

    return own


def zeros_like(a, *args, **how):
    """np.zeros_like, sooner than by numpy's own way."""
    return np.zeros_like(np.asarray(a), *args, **how)


def elementwise(sign, many):
    """An operation on so many numbers, as a ufunc of arrays."""
    return np.frompyfunc(lambda *numbers: operation(sign, *numbers), many, 1, identity=None)


def where(condition, *choices):
    """np.where."""
    condition = np.asarray(condition)
    choices = list(map(np.asarray, choices))
    choose = WHERE if condition.dtype == object else np.where
    return viewed(choose(condition, *choices))


def power(x, y):
    """np.power, which does not ask pow for the commonest exponents."""
    usual = {2.0: np.square, 0.5: ENTRIES[np.sqrt], -1.0: lambda x: 1.0 / x}
    exponent = y[()] if y.ndim == 0 else None
    if type(exponent) is not Symbol and exponent in usual:
        return usual[exponent](x)
    return POW(x, y)


WHERE = elementwise("where", 3)
POW = elementwise("pow", 2)
OPERATORS = np.add, np.subtract, np.multiply, np.divide, np.square
OPERATORS += np.negative, np.positive, np.absolute
ENTRIES = {ufunc: ufunc for ufunc in OPERATORS}  # a Symbol has them
ENTRIES |= {getattr(np, name): elementwise(name, 1) for name in FUNCTIONS[:7]}
ENTRIES |= {np.maximum: elementwise("max", 2), np.minimum: elementwise("min", 2)}
ENTRIES |= {np.arctan2: elementwise("atan2", 2), np.power: power}
ENTRIES |= {np.less: elementwise("<", 2), np.less_equal: elementwise("<=", 2)}
ENTRIES[np.greater] = lambda a, b: ENTRIES[np.less](b, a)
ENTRIES[np.greater_equal] = lambda a, b: ENTRIES[np.less_equal](b, a)
ARRAYS = {"d": Ordered, "O": Symbols}  # by the character that numpy has for what is in them
NO_NUMBERS = np.zeros(0)
ADDING = {np.linalg.norm: norm, np.linalg.solve: solve, np.dot: lambda a, b: ordered(a).dot(b)}
ADDING |= {np.sum: add_up, np.zeros_like: zeros_like}
ADDING |= {one: in_order(one) for one in (np.inner, np.tensordot, np.einsum, np.trace)}
OWN = ADDING | {np.where: where}
OWN |= {np.zeros: lambda shape, dtype=object: np.zeros(shape, dtype)}  # np.zeros(shape, like=q)
OWN |= {np.nan_to_num: refusal("np.nan_to_num cannot be compiled")}  # numpy's overlooks symbols
