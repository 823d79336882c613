"""Arrays whose products and sums go in one order, of floats or of symbols.

numpy hands the products of matrices to a library, which adds their terms as the processor likes
best, and sums eight numbers at a time. So the last digit differs from machine to machine, and from
the same lines where they are compiled. In an Ordered array `@`, np.dot, np.sum and np.mean add from
first to last; asked for what they do not know, they are numpy's own, and symbols refuse. What is
zero for certain is left out, which changes no digit, and makes a large sparse product short.
"""

from operator import and_, eq, ge, gt, le, lt, ne, or_

from curriculum.common.tape import effort

import numpy as np
from numpy.lib.array_utils import normalize_axis_tuple

SMALL = 1 << 18  # terms of a product that are made at once
TERMS = 1 << 22  # that are not zero: more are made in parts, or they would fill the memory
FEW = 8  # entries of an array in which zeros are not worth looking for
# what numpy calls a function of one number, or of two: its name in the C library and JavaScript
ALIKE = "sqrt", "sin", "cos", "tan", "exp", "log", "expm1", "log1p", "sinh", "cosh", "tanh"
FUNCTIONS = dict(zip(ALIKE, ALIKE, strict=True))
FUNCTIONS |= {"arcsin": "asin", "arccos": "acos", "arctan": "atan"}
BINARY = {"arctan2": "atan2"}
SPARSE = {np.add, np.subtract, np.multiply, np.divide}
NOTHING = 0  # what np.zeros fills an array of objects with: this very object


def ordered(x, shape=None):
    """x as an array whose products and sums go in order; it must have the `shape`, if one is given.

    What lacks the first axes is repeated, but no single number. Raises ValueError, for None and
    complex numbers, too.
    """
    if x is None:
        raise ValueError("None where an array must be: does a function lack its return?")
    if not isinstance(x, np.ndarray):
        x = np.asarray(x)
    if x.dtype.kind == "c":
        raise ValueError("complex numbers, where real ones must be")
    if not isinstance(x, Ordered) or x.dtype == np.float32:
        x = x.view(Symbols) if x.dtype == object else x.astype(float, copy=False).view(Ordered)
    if shape is not None and x.shape != shape:
        if not x.ndim or x.shape != shape[len(shape) - x.ndim :]:
            raise ValueError(f"an array of shape {x.shape}, must be {shape}")
        x = np.broadcast_to(x, shape, subok=True)
    return x


def viewed(made):
    """What was made of ordered arrays, as one; a single number as it is."""
    kind = Symbols if made.dtype == object else Ordered
    return made.view(kind) if made.ndim else made[()]


class Ordered(np.ndarray):
    """An array of floats; see above."""

    __array_priority__ = 1.0  # what is joined of this and others is one, too

    def __array_wrap__(self, made, context=None, return_scalar=False):
        return made.view(type(self)) if made.ndim else made[()]

    def __matmul__(self, other):
        return product(self, other)

    def __rmatmul__(self, other):
        return product(other, self)

    dot = __matmul__

    def sum(self, axis=None, dtype=None, out=None, keepdims=False, **how):
        made = np.asarray(self)
        if dtype is not None or out is not None or how:  # then numpy adds
            if made.dtype == object:
                raise TypeError("np.sum of symbols takes an axis and keepdims, and nothing else")
            return made.sum(axis, dtype, out, keepdims, **how)
        if made.dtype == object:  # truths are counted
            effort.call()
            made = np.asarray(np.frompyfunc(counted, 1, 1)(made))
        if axis is None and not keepdims and made.size:
            return made.ravel().cumsum()[-1]
        axes = range(self.ndim) if axis is None else normalize_axis_tuple(axis, self.ndim)
        if axis is None:  # one row of all entries
            made = made.reshape((1,) * (self.ndim - 1) + (made.size,))
        for one in sorted(axes, reverse=True):  # the last first
            if made.shape[one]:
                made = made.cumsum(one).take([-1], one)
            else:
                made = made.sum(one, keepdims=True)  # zeros
            made = made if keepdims else made.squeeze(one)
        return viewed(made)

    def mean(self, axis=None, dtype=None, out=None, keepdims=False, **how):
        if dtype is not None or out is not None or how:
            if self.dtype == object:
                raise TypeError("np.mean of symbols takes an axis and keepdims, and nothing else")
            return np.asarray(self).mean(axis, dtype, out, keepdims, **how)
        total = self.sum(axis, keepdims=keepdims)
        return total / (self.size // max(1, np.size(total)))

    def __array_function__(self, function, types, given, how):
        symbols = Symbols in types
        if function in UNORDERED and symbols:
            raise TypeError(f"np.{function.__name__} adds in an order of its own; use @ or np.sum")
        if function in OWN:
            try:
                return OWN[function](*given, **how)
            except (TypeError, ValueError):  # it is asked for what only numpy has
                if symbols:
                    raise
        elif symbols and function.__module__ == "numpy.linalg":
            raise TypeError(f"np.linalg.{function.__name__} cannot be compiled")
        made = super().__array_function__(function, types, given, how)
        return viewed(made) if type(made) is np.ndarray else made  # np.cross makes another kind


class Symbols(Ordered):
    """An array of objects, numbers and symbols; what numpy makes of it is one, too."""

    def __array_ufunc__(self, ufunc, method, *given, **how):
        return symbolic(ufunc, method, given, how)


def symbolic(ufunc, method, given, how):
    """What a function of numpy makes of arrays of symbols, or of a symbol."""
    effort.call()
    arrays, (out,) = [np.asarray(x) for x in given], how.pop("out", [None])
    chosen = how.pop("where", True)  # what is not stays as `out` has it
    if ufunc in LOGICAL:  # np.any asks for a truth, which is what it gets
        how.pop("dtype", None)
    refuse(ufunc, method, how, chosen)
    if method == "__call__" and ufunc in SPARSE and max(x.size for x in arrays) > FEW:
        made = sparse(ufunc, *arrays)
    elif ufunc in ENTRIES:
        made = entry_by_entry(ufunc, method, arrays, how)
    else:
        made = of_objects(ufunc, method, arrays, how)
    if out is not None:
        np.asarray(out)[...] = made if chosen is True else where(chosen, made, out)
        return out
    if isinstance(made, np.ndarray):
        return viewed(made)
    return np.bool(made) if isinstance(made, bool) else made


def refuse(ufunc, method, how, chosen):
    """Raise TypeError where symbols would not make what numpy makes of numbers."""
    if ufunc.signature or ufunc is np.add and method in ("reduce", "reduceat"):  # as np.matmul has
        raise TypeError(f"np.{ufunc.__name__} adds in an order of its own; use @ or np.sum")
    if how.get("dtype") is not None:
        raise TypeError(f"np.{ufunc.__name__} of symbols takes no dtype")
    if method == "at" or method != "__call__" and chosen is not True:
        raise TypeError(f"np.{ufunc.__name__}.{method} of symbols does all or nothing")


def entry_by_entry(ufunc, method, arrays, how):
    """What one of ENTRIES makes of arrays. Of all settings it knows `axis`: to leave out another
    in silence would make another number."""
    for key, value in how.items():
        if key != "axis" and value is not USUAL.get(key):
            raise TypeError(f"np.{ufunc.__name__} of symbols takes no {key}")
    axis = {"axis": how["axis"]} if "axis" in how else {}
    if method == "reduce" and how.get("axis", 0) is None:  # of all entries, as one row
        arrays, axis = [arrays[0].ravel()], {}
    made = getattr(ENTRIES[ufunc], method)(*arrays, **axis)
    if ufunc in COMPARED and all(isinstance(s, bool | np.bool) for s in np.ravel(made)):
        return np.asarray(made, bool)  # of numbers alone: they can choose entries
    return made


def of_objects(ufunc, method, arrays, how):
    """What numpy itself makes of objects, by their operators; of numbers alone it can do all."""
    try:
        return getattr(ufunc, method)(*arrays, **how)
    except (AttributeError, TypeError):
        if any(hasattr(s, "tape") for x in arrays for s in x.flat):
            raise TypeError(f"np.{ufunc.__name__} cannot be compiled") from None
        numbers = [x.astype(float) for x in arrays]
        return np.asarray(getattr(ufunc, method)(*numbers, **how), object)


def counted(s):
    """A truth as a number, to be counted; another number as it is."""
    return int(s) if isinstance(s, np.bool) else getattr(s, "number", s)


def places(a):
    """Where an array is not zero for certain: indices of it as one row."""
    if a.dtype != object:
        return np.flatnonzero(a != 0)  # which is quicker than of numbers
    objects = np.ascontiguousarray(a).ravel()
    objects.flags.writeable = False  # it is only looked at
    at = np.flatnonzero(np.frombuffer(objects, np.intp) != id(NOTHING))  # their addresses
    return at[[getattr(s, "x", s) != 0.0 for s in objects[at].tolist()]]


def sparse(ufunc, a, b):
    """a + b, a - b, a * b or a / b, without what a certain zero makes needless.

    That is x + 0, x - 0, 0 * x and, where no b is zero, 0 / b.
    """
    divided = ufunc is np.divide and (b.dtype == object or not np.all(b))  # maybe by zero
    a, b = np.broadcast_arrays(a, b)
    adds = ufunc in (np.add, np.subtract)
    made = np.array(a, object) if adds else np.zeros(a.shape, object)
    at = np.arange(a.size) if divided else places(b if adds else a)
    index = np.unravel_index(at, a.shape)
    if ufunc is np.multiply:
        some = places(b[index])
        index = tuple(k[some] for k in index)
    made[index] = ufunc(a[index], b[index])
    return made


def product(a, b):
    """a @ b of vectors and matrices, its terms added in order, without those that are zero."""
    if type(a) is not Ordered or type(b) is not Ordered:
        a, b = np.asarray(a), np.asarray(b)
    if a.dtype.kind == b.dtype.kind == "b":  # whether both are true anywhere: nothing is added
        return np.dot(np.asarray(a), np.asarray(b))
    if a.ndim == 1 and a.shape == b.shape and 0 < len(a) <= FEW:
        return few_terms(a.tolist(), b.tolist())
    if not a.ndim or not b.ndim:  # as np.dot has it
        return np.multiply(ordered(a), b)
    rows = a[None] if a.ndim == 1 else a
    columns = b[:, None] if b.ndim == 1 else b
    symbols = object in (a.dtype, b.dtype)
    if max(rows.ndim, columns.ndim) > 2 or rows.shape[1] != len(columns) or not len(columns):
        if symbols:
            raise TypeError("a product of symbols is one of vectors or matrices that fit")
        return np.matmul(a, b)  # which says what is wrong
    if symbols:
        effort.call()
    if symbols or len(rows) * columns.size > SMALL:
        made = sparse_product(rows, columns)
    else:
        rows, columns = np.asarray(rows), np.asarray(columns)  # which are numpy's own: quicker
        made = np.add.accumulate(rows[:, :, None] * columns, axis=1)[:, -1]
    return viewed(made.reshape(a.shape[:-1] + b.shape[1:]))


def few_terms(a, b):
    """The product of two short vectors, lists of numbers or of symbols."""
    total = a[0] * b[0]
    for k in range(1, len(a)):  # far quicker than zip
        total = total + a[k] * b[k]
    if type(total) in (float, int):
        return np.float64(total)
    effort.call()
    return total


def sparse_product(a, b):
    """a @ b of matrices, of which little is not zero for certain."""
    left, right = filled(a), filled(b)
    if a.dtype == b.dtype == float:
        return product_of_numbers(left, right, (len(a), *b.shape))
    columns = [[] for _ in b]
    for k, j, y in zip(*(x.tolist() for x in right), strict=True):
        columns[k].append((j, y))
    sums = [{} for _ in a]
    for i, k, x in zip(*(x.tolist() for x in left), strict=True):
        row = sums[i]
        for j, y in columns[k]:
            row[j] = row[j] + x * y if j in row else x * y
    made = np.zeros((len(a), b.shape[1]), np.result_type(a, b))
    for i, row in enumerate(sums):
        for j, total in row.items():
            made[i, j] = total
    return made


def product_of_numbers(left, right, shape):
    """What sparse_product makes of what is `filled`; `shape`: rows, terms and columns."""
    (i, k, x), (rows, columns, y) = left, right
    many = np.bincount(rows, minlength=shape[1])  # entries in each row on the right
    often = many[k]  # how many terms an entry on the left is in
    if np.sum(often) > TERMS and shape[0] > 1:
        half = shape[0] // 2
        cut = np.searchsorted(i, half)
        upper = (i[:cut], k[:cut], x[:cut]), right, (half, *shape[1:])
        lower = (i[cut:] - half, k[cut:], x[cut:]), right, (shape[0] - half, *shape[1:])
        return np.concatenate([product_of_numbers(*upper), product_of_numbers(*lower)])
    behind = np.cumsum(often) - often
    other = np.repeat((np.cumsum(many) - many)[k] - behind, often) + np.arange(np.sum(often))
    place = np.repeat(i * shape[2], often) + columns[other]
    places, which = np.unique(place, return_inverse=True)
    made = np.zeros(shape[::2])
    # bincount adds from first to last
    made.flat[places] = np.bincount(which, np.repeat(x, often) * y[other])
    return made


def filled(a):
    """Rows, columns and entries of what is not zero for certain in a matrix, row by row."""
    turned = a.T.flags.c_contiguous  # as J^T is: looked through as it lies in memory
    flat = np.asarray(a.T if turned else a).ravel()
    at = places(flat)
    i, k = np.divmod(at, len(a) if turned else a.shape[1])
    if turned:
        row_by_row = np.argsort(k, kind="stable")
        at, i, k = at[row_by_row], k[row_by_row], i[row_by_row]
    return i, k, flat[at]


def norm(x, ord=None, axis=None, keepdims=False):
    """np.linalg.norm of real vectors; it raises ValueError for others."""
    axes = np.ndim(x) if axis is None else np.size(axis)
    if ord is not None and (ord != 2 or axes != 1):
        raise ValueError(f"a norm of order {ord} of {axes} axes is not made here")
    return np.sqrt(np.sum(ordered(x) * ordered(x), axis=axis, keepdims=keepdims))


def clip(x, a_min=None, a_max=None):
    """np.clip."""
    x = x if a_min is None else np.maximum(x, a_min)
    return x if a_max is None else np.minimum(x, a_max)


def nan_to_num(x, copy=True, nan=0.0, posinf=None, neginf=None):
    """np.nan_to_num, always a copy."""
    most = np.finfo(float).max
    high, low = most if posinf is None else posinf, -most if neginf is None else neginf
    return where(x == x, where(x > most, high, where(x < -most, low, x)), nan)


def where(condition, *choices):
    """np.where, whose condition may be of symbols; of a condition alone the places, as numpy's."""

    def chosen(s, a, b):
        number = isinstance(s, (bool, int, float, np.generic))  # a np.bool has a `choose`, too
        return (a if s else b) if number else s.choose(a, b)

    given = [np.asarray(x) for x in (condition, *choices)]
    if object not in [x.dtype for x in given]:
        made = np.where(*given)
        return viewed(made) if choices else made
    made = np.frompyfunc(chosen, 3, 1)(*given)
    return ordered(made) if np.ndim(made) else made


def entrywise(function):
    """A function of numpy, entry by entry; where one is a symbol, its class's of that name, which
    takes them in order: the symbol may be the second."""

    def entry(*given):
        for s in given:
            if hasattr(s, "tape"):
                return getattr(type(s), function.__name__)(*given)
        return function(*given)

    return np.frompyfunc(entry, function.nin, 1)


def opposite(s):
    """What is true where s is not, which may be a truth or zero of Python's, whose ~ is another."""
    return not s if isinstance(s, int) else ~s


USUAL = {"dtype": None, "initial": np._NoValue, "keepdims": False}  # of np.max
OWN = {np.dot: product, np.linalg.norm: norm, np.where: where, np.clip: clip}
OWN[np.nan_to_num] = nan_to_num
UNORDERED = {np.einsum, np.tensordot, np.inner, np.vdot, np.trace, np.convolve, np.correlate}
ENTRIES = {getattr(np, name) for name in FUNCTIONS | BINARY} | {np.sign, np.maximum, np.minimum}
ENTRIES = {ufunc: entrywise(ufunc) for ufunc in ENTRIES}
COMPARED = {np.less: lt, np.less_equal: le, np.greater: gt, np.greater_equal: ge}
COMPARED |= {np.equal: eq, np.not_equal: ne, np.logical_and: and_, np.logical_or: or_}
ENTRIES |= {ufunc: np.frompyfunc(of_two, 2, 1) for ufunc, of_two in COMPARED.items()}
ENTRIES |= dict.fromkeys([np.logical_not, np.invert], np.frompyfunc(opposite, 1, 1))
LOGICAL = {np.logical_and, np.logical_or, np.logical_not}
