"""Arrays whose products and sums add from first to last, of floats or of symbols.

numpy adds eight numbers at a time and leaves products of matrices to a library, which adds in
whatever order suits the processor. So the last digit differs from machine to machine; not here.
"""

import numpy as np

from curriculum.common.tracing.symbols import Symbol, Truth, operation
from curriculum.common.tracing.tape import Untraceable

TERMS = 1 << 20  # of a product that is made at once


def ordered(x):
    """x as such an array."""
    x = np.asarray(x)
    if isinstance(x, Ordered):
        return x
    return x.view(Symbols) if x.dtype == object else x.astype(float, copy=False).view(Ordered)


def viewed(made):
    """What numpy made of ordered arrays, as one; a single number, or whole ones, as they are."""
    made = np.asarray(made)
    if made.ndim == 0:
        return made[()]
    return ordered(made) if made.dtype in (float, object) else made


def zero(x):
    """Whether a number is zero for certain."""
    return type(x) is not Symbol and x == 0.0


def product(a, b):
    """a @ b of vectors and matrices, its terms added in order; what is zero may be left out."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim == 0 or b.ndim not in (1, 2) or a.shape[-1] != len(b):
        return viewed(a @ b)  # or numpy's error
    if a.ndim == b.ndim == 1 and a.dtype == b.dtype == float and len(b):
        return np.add.accumulate(a * b)[-1]  # the same, sooner
    rows, columns = a.reshape(-1, len(b)), b.reshape(len(b), -1)
    if object in (a.dtype, b.dtype):
        right = [[(j, x) for j, x in enumerate(row) if not zero(x)] for row in columns]
        made = np.zeros((len(rows), columns.shape[1]), object)
        for i, row in enumerate(rows):
            for x, others in zip(row, right, strict=True):
                for j, y in () if zero(x) else others:
                    made[i, j] = made[i, j] + x * y
    elif rows.size * columns.shape[1] > TERMS:
        made = np.zeros((len(rows), columns.shape[1]))
        for column, row in zip(rows.T, columns, strict=True):
            i, j = np.flatnonzero(column)[:, None], np.flatnonzero(row)
            made[i, j] += column[i] * row[j]
    else:
        made = np.add.accumulate(rows[:, :, None] * columns, axis=1)[:, -1]
    return viewed(made.reshape(a.shape[:-1] + b.shape[1:]))


class Ordered(np.ndarray):
    """An array of floats; see above."""

    __array_priority__ = 1.0  # what is made of this and others is one, too

    def __matmul__(self, other):
        return product(self, other)

    def __rmatmul__(self, other):
        return product(other, self)

    def dot(self, other):
        return self @ other if np.ndim(other) else self * other

    def sum(self, axis=None, dtype=None, out=None, keepdims=False, **others):
        if dtype or out is not None or others or not self.size or self.dtype == bool:
            return super().sum(axis, dtype, out, keepdims, **others)
        axes = range(self.ndim) if axis is None else np.atleast_1d(axis)
        x = np.moveaxis(np.asarray(self), axes, range(len(axes)))
        x = x.reshape(-1, *x.shape[len(axes) :])
        made = np.add.accumulate(x, axis=0)[-1]
        return viewed(np.expand_dims(made, tuple(axes)) if keepdims else made)

    def mean(self, axis=None, dtype=None, out=None, **others):
        made = self.sum(axis, dtype, out, **others)
        return made / (self.size / np.size(made))

    def __array_function__(self, function, types, given, how):
        if function in ADDING:
            return ADDING[function](*given, **how)
        made = super().__array_function__(function, types, given, how)
        return viewed(made) if isinstance(made, np.ndarray) else made


class Symbols(Ordered):
    """An array of symbols and floats."""

    def __array_function__(self, function, types, given, how):
        if function is np.zeros and len(given) == 1 and not how:  # np.zeros(shape, like=q)
            return np.zeros(given[0], object).view(Symbols)
        try:
            made = OWN.get(function, function._implementation)(*given, **how)
        except Exception as why:
            raise cannot(f"{function.__module__}.{function.__name__}") from why
        return viewed(made) if isinstance(made, np.ndarray) else made

    def __array_ufunc__(self, ufunc, method, *given, out=None, **how):
        if ufunc not in ENTRIES:
            raise cannot(f"numpy.{ufunc.__name__}")
        given = [np.asarray(x) for x in given]
        made = getattr(ENTRIES[ufunc], method)(*given, **how)
        if out is not None:
            np.asarray(out[0])[...] = made
            return out[0]
        return viewed(made) if isinstance(made, np.ndarray) else made


def cannot(name):
    return Untraceable(f"{name.replace('numpy', 'np')} cannot be compiled")


def elementwise(sign, many):
    """An operation on so many arrays, entry by entry."""
    return np.frompyfunc(lambda *given: operation(sign, *given), many, 1, identity=None)


def where(condition, *choices):
    """np.where of symbols."""
    given = [np.asarray(x) for x in (condition, *choices)]
    return viewed((WHERE if given[0].dtype == object else np.where)(*given))


def clip(x, a_min=None, a_max=None):
    """np.clip, as minimum and maximum."""
    x = x if a_min is None else np.maximum(x, a_min)
    return x if a_max is None else np.minimum(x, a_max)


def norm(x, ord=None, axis=None, keepdims=False):
    """np.linalg.norm, whose squares are added in order."""
    if ord is not None:
        return viewed(np.linalg.norm(np.asarray(x), ord, axis, keepdims))
    x = ordered(x)
    return np.sqrt(np.sum(x * x, axis=axis, keepdims=keepdims))


def power(x, y):
    """np.power, which does not ask pow for the commonest exponents."""
    usual = {2.0: np.square, 0.5: ENTRIES[np.sqrt], -1.0: lambda x: 1.0 / x}
    exponent = y[()] if y.ndim == 0 else None
    if type(exponent) is not Symbol and exponent in usual:
        return usual[exponent](x)
    return POW(x, y)


def reflected(function):
    return lambda a, b: function(b, a)


WHERE = elementwise("where", 3)
POW = elementwise("pow", 2)
LESS, LESS_EQUAL = elementwise("<", 2), elementwise("<=", 2)
OPERATORS = np.add, np.subtract, np.multiply, np.divide, np.square
OPERATORS += np.negative, np.positive, np.absolute
ENTRIES = {ufunc: ufunc for ufunc in OPERATORS}  # a Symbol has them
ENTRIES |= {getattr(np, name): elementwise(name, 1) for name in ("sin", "cos", "tan")}
ENTRIES |= {getattr(np, name): elementwise(name, 1) for name in ("sqrt", "exp", "log", "tanh")}
ENTRIES |= {np.maximum: elementwise("max", 2), np.minimum: elementwise("min", 2)}
ENTRIES |= {np.arctan2: elementwise("atan2", 2), np.power: power}
ENTRIES |= {np.less: LESS, np.less_equal: LESS_EQUAL}
ENTRIES |= {np.greater: reflected(LESS), np.greater_equal: reflected(LESS_EQUAL)}
ADDING = {np.linalg.norm: norm, np.dot: lambda a, b: ordered(a).dot(b)}
OWN = ADDING | {np.where: where, np.clip: clip}  # of symbols
for single in Symbol, Truth:
    single.__array_function__ = Symbols.__array_function__
    single.__array_ufunc__ = Symbols.__array_ufunc__
