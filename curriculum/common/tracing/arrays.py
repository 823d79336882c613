"""Sums and products whose terms are added from first to last, and what is made of them.

numpy adds eight numbers at a time and leaves products of matrices to a library, which adds in
whatever order suits the processor. So the last digit differs from machine to machine; not here.
What comes in are plain arrays, of floats or of symbols, and so is what goes out.
"""

from functools import reduce

import numpy as np

TERMS = 1 << 20  # of a product that is computed at once
LARGE = 1 << 17  # numbers of a matrix: of so many, most are zero
SHORT = 8  # numbers: such a sum is done sooner by Python
LONG = 100  # sums: so many are added sooner row by row
PLAIN = {float, int, np.float64, np.int64}  # types of numbers that are no symbols


def zero(x):
    """Whether a number is 0 for certain, which no symbol is."""
    return type(x) in PLAIN and x == 0.0


def nonzero(x):
    """Where an array may have other numbers than 0: bools of its shape."""
    x = np.asarray(x)
    if x.dtype != object:
        return x != 0.0
    found = [type(y) not in PLAIN or y != 0.0 for y in x.ravel().tolist()]
    return np.array(found, bool).reshape(x.shape)


def total(x, axis=None, keepdims=False):
    """np.sum of an array that is not empty."""
    if axis is None:
        sums = np.add.accumulate(x.ravel())[-1]
        return np.reshape(sums, (1,) * x.ndim) if keepdims else sums
    axes = np.atleast_1d(axis)
    x = np.moveaxis(x, axes, range(len(axes)))
    x = x.reshape(-1, *x.shape[len(axes) :])
    if x.size > LONG * len(x):
        sums = reduce(np.add, x[1:], x[0].copy())
    else:
        sums = np.add.accumulate(x, axis=0)[-1]
    return np.expand_dims(sums, tuple(axes)) if keepdims else sums


def dot(a, b):
    """a @ b of two vectors of floats, equally long."""
    if a.size > SHORT:
        return np.add.accumulate(np.asarray(a) * np.asarray(b))[-1]
    sums = np.float64(0.0)
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        sums += x * y
    return sums


def product(a, b):
    """a @ b of vectors and matrices; terms that are zero may be left out."""
    fit = a.ndim > 0 and 0 < b.ndim < 3 and a.shape[-1] == len(b)
    if not fit or not a.size or not b.size:
        return a @ b  # or numpy's error
    if a.dtype.char == "O" or b.dtype.char == "O":
        return by_matrices(product_of_symbols, a, b)
    if a.size > LARGE or a.size * b.size > TERMS * len(b):
        return by_matrices(product_of_few, a, b)
    if b.ndim == 1:
        return np.add.accumulate(a * b, axis=-1)[..., -1]
    terms = a[..., None] * np.ascontiguousarray(b)
    return np.add.accumulate(terms, axis=-2)[..., -1, :]


def by_matrices(product, a, b):
    """The product of vectors and matrices, by one for matrices only."""
    sums = product(a.reshape(-1, len(b)), b.reshape(len(b), -1))
    return sums.reshape(a.shape[:-1] + b.shape[1:])


def product_of_symbols(rows, columns):
    sums = np.zeros((len(rows), columns.shape[1]), object)
    right = list(map(entries, columns.tolist()))
    for i, row in enumerate(rows.tolist()):
        for k, x in entries(row):
            for j, y in right[k]:
                sums[i, j] = sums[i, j] + x * y
    return sums


def entries(row):
    """[(place, number)] of what is not zero in a row."""
    return [(k, x) for k, x in enumerate(row) if type(x) not in PLAIN or x != 0.0]


def product_of_few(rows, columns):
    """The same as the others in less memory and, where most numbers are zero, sooner."""
    sums = np.zeros((len(rows), columns.shape[1]))
    i, k = np.nonzero(rows)  # in each row term after term, as sums are added
    block = max(1, TERMS // columns.shape[1])
    for first in range(0, len(i), block):
        part = slice(first, first + block)
        np.add.at(sums, i[part], rows[i[part], k[part], None] * columns[k[part]])
    return sums


def solve(a, b):
    """np.linalg.solve, by `eliminated`: A (n, n), b (n,) or (n, columns)."""
    if a.ndim != 2 or a.shape != (len(b), len(b)) or b.ndim > 2:
        raise ValueError(f"solve takes A (n, n), b (n,) or (n, columns), not {a.shape}, {b.shape}")
    return eliminated(a)(b)


def eliminated(a, order=None):
    """The function b (n,) or (n, columns) -> x with A x = b of A (n, n): Gaussian elimination.

    It does not pivot: its accuracy is promised for positive definite matrices only, such as
    J M^-1 J^T. (A round of Newton's method may have one that is near to that but not symmetric; its
    next round takes back what this one gets wrong.) A pivot of zero leaves nothing finite. What is
    zero costs nothing, and the `order` says how much stays so.
    """
    kind = np.result_type(a, 1.0)
    rows = np.array(a, kind).tolist()  # numbers, which Python handles sooner than numpy
    filled = nonzero(a)
    near = [set() for _ in rows]  # of each unknown, those that it is coupled with
    for i, j in zip(*np.nonzero(filled | filled.T), strict=True):
        near[i].add(int(j))
    done = []  # of each pivot, the rows and columns that are changed by it
    for k in order or range(len(rows)):
        pivot = rows[k]
        near[k].discard(k)
        rest = sorted(near[k])
        for i in rest:
            near[i] |= near[k]  # which are coupled from now on, through this one
            near[i] -= {i, k}
            row = rows[i]
            row[k] = divide(row[k], pivot[k])  # minus so much of row k, row i is free of x[k]
            for j in rest:
                row[j] = row[j] - row[k] * pivot[j]
        done.append((k, rest))

    def solve(b):
        x = np.array(b, np.result_type(kind, b))
        x = x.tolist() if x.ndim == 1 else list(x)
        for k, rest in done:
            for i in rest:
                x[i] = x[i] - rows[i][k] * x[k]
        for k, rest in reversed(done):
            for j in rest:
                x[k] = x[k] - rows[k][j] * x[j]
            x[k] = divide(x[k], rows[k][k])
        return np.array(x, np.result_type(kind, b))

    return solve


def divide(x, y):
    """x / y, which is not finite where Python would refuse."""
    return x / np.float64(y) if type(y) is float and y == 0.0 else x / y
