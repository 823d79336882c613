"""Arrays whose products and sums add from first to last, of floats or of symbols.

numpy adds eight numbers at a time and leaves products of matrices to a library, which adds in
whatever order suits the processor. So the last digit differs from machine to machine; not here.
"""

import numpy as np

TERMS = 1 << 20  # of a product that is computed at once
KINDS = {}  # {dtype: the class of ordered arrays of it}


def ordered(x):
    """x as such an array."""
    x = np.asarray(x)
    if isinstance(x, Ordered):
        return x
    x = x if x.dtype == object else x.astype(float, copy=False)
    return x.view(KINDS[x.dtype.type])


def viewed(x):
    """What numpy computed of ordered arrays, as one; a number, or whole ones, as they are."""
    if not isinstance(x, np.ndarray):
        return x
    if x.ndim == 0:
        return x[()]
    return ordered(x) if x.dtype in (float, object) else x


def zero(x):  # for certain, which no symbol is
    return isinstance(x, (float, int)) and x == 0.0


def nonzero(x):
    x = np.asarray(x)
    if x.dtype != object:
        return x != 0.0
    return np.array([not zero(entry) for entry in x.flat], bool).reshape(x.shape)


def product(a, b):
    """a @ b of vectors and matrices, its terms added in order; what is zero may be left out."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim == 0 or b.ndim not in (1, 2) or a.shape[-1] != len(b) or not a.size * b.size:
        return viewed(a @ b)  # or numpy's error
    if a.ndim == b.ndim == 1 and a.dtype == b.dtype == float:
        return np.add.accumulate(a * b)[-1]  # the same, sooner
    rows, columns = a.reshape(-1, len(b)), b.reshape(len(b), -1)
    if object in (a.dtype, b.dtype):
        right = [[(j, x) for j, x in enumerate(row) if not zero(x)] for row in columns]
        sums = np.zeros((len(rows), columns.shape[1]), object)
        for i, row in enumerate(rows):
            for x, others in zip(row, right, strict=True):
                for j, y in () if zero(x) else others:
                    sums[i, j] = sums[i, j] + x * y
    elif rows.size * columns.shape[1] > TERMS:
        sums = np.zeros((len(rows), columns.shape[1]))
        for column, row in zip(rows.T, columns, strict=True):
            i, j = np.flatnonzero(column)[:, None], np.flatnonzero(row)
            sums[i, j] += column[i] * row[j]
    else:
        sums = np.add.accumulate(rows[:, :, None] * columns, axis=1)[:, -1]
    return viewed(sums.reshape(a.shape[:-1] + b.shape[1:]))


def solve(a, b):
    """np.linalg.solve of ordered arrays, by `eliminated`: A (n, n), b (n,) or (n, columns)."""
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim != 2 or a.shape != (len(b), len(b)) or b.ndim > 2:
        raise ValueError(f"solve takes A (n, n), b (n,) or (n, columns), not {a.shape}, {b.shape}")
    return eliminated(a)(b)


def eliminated(a, order=None):
    """The function b (n,) or (n, columns) -> x with A x = b of A (n, n): Gaussian elimination.

    It does not pivot: its accuracy is promised for positive definite matrices only, and a pivot of
    zero leaves nothing finite. What is zero costs nothing, and the `order` says how much stays so.
    """
    a, left, done = np.array(a, np.result_type(a, 1.0)), np.arange(len(a)), []
    for k in order or range(len(a)):
        left = left[left != k]
        rest = left[nonzero(a[left, k]) | nonzero(a[k, left])].tolist()
        for i in rest:
            a[i, k] = a[i, k] / a[k, k]  # minus so much of row k, row i is free of x[k]
            a[i, rest] = a[i, rest] - a[i, k] * a[k, rest]
        done.append((k, rest))

    def solve(b):
        x = np.array(b, np.result_type(a, b))
        for k, rest in done:
            for i in rest:
                x[i] = x[i] - a[i, k] * x[k]
        for k, rest in reversed(done):
            for j in rest:
                x[k] = x[k] - a[k, j] * x[j]
            x[k] = x[k] / a[k, k]
        return ordered(x)

    return solve


def implementation(function):  # of numpy's, whatever the class of its arguments
    return getattr(function, "_implementation", function)


def norm(x, ord=None, axis=None, keepdims=False):
    """np.linalg.norm, whose squares are added in order."""
    if ord is not None:
        return viewed(np.linalg.norm(np.asarray(x), ord, axis, keepdims))
    x = ordered(x)
    return np.sqrt(np.sum(x * x, axis=axis, keepdims=keepdims))


class Ordered(np.ndarray):
    __array_priority__ = 1.0  # what is computed of this and others is one, too

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
        total = np.add.accumulate(x, axis=0)[-1]
        return viewed(np.expand_dims(total, tuple(axes)) if keepdims else total)

    def mean(self, axis=None, dtype=None, out=None, **others):
        total = self.sum(axis, dtype, out, **others)
        return total / (self.size / np.size(total))

    def __array_function__(self, function, types, args, how):
        return viewed(ADDING.get(function, implementation(function))(*args, **how))


KINDS[np.float64] = Ordered
ADDING = {np.linalg.norm: norm, np.linalg.solve: solve, np.dot: lambda a, b: ordered(a).dot(b)}
