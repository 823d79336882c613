"""vmap: a function of one, for many."""

import numpy as np

from curriculum.common.tracing.compare import changed, same
from curriculum.common.tracing.plainly import copied
from curriculum.common.tracing.python import COLUMNS, Columns, function_of, source_of
from curriculum.common.tracing.symbols import ordered
from curriculum.common.tracing.tape import Untraceable, collector_off, current
from curriculum.common.tracing.trace import Program, one_or_several, several, side_by_side, split

BLOCK = 1024  # states that are mapped at once: their columns stay in the cache
FEW = 100  # states: for fewer a function is just called


def vmap(function):
    """The function of many: of arrays with one axis more, in front, and so are those it returns."""

    compiled = {}  # by the numbers that are not zero in all of what is mapped

    def mapped(*arrays):
        if current.plain or current.tape is not None or len(arrays[0]) < FEW:
            return one_by_one(function, arrays)
        arrays = [np.asarray(x, float) for x in arrays]
        live = [np.any(x, axis=0) for x in arrays]
        key = tuple(x.tobytes() for x in live)
        try:
            if key not in compiled:
                compiled[key] = compiled_map(function, live)
        except Untraceable:
            return one_by_one(function, arrays)
        run, program = compiled[key]
        with np.errstate(all="ignore"):
            results = run(arrays)
            for k in 0, -1:
                compare(function, [x[k] for x in arrays], [x[k] for x in results], program.exact)
        return one_or_several(results)

    return mapped


def compare(function, row, results, exact):
    """Raise StepChanged unless the results of one row are those of the function's own lines."""
    own = several(function(*map(copied, map(ordered, row))))
    own = list(map(np.asarray, own))
    if not same(results, own, [np.zeros(x.shape) for x in own], exact):
        raise changed("a function of many")


def one_by_one(function, arrays):
    copies = [ordered(np.array(x)) for x in arrays]  # the function may edit what it gets
    rows = side_by_side(function, list(zip(*copies, strict=True)))
    columns = [list(map(np.asarray, x)) for x in zip(*rows, strict=True)]
    return one_or_several([ordered(np.stack(column)) for column in columns])


def compiled_map(function, live):
    """run(arrays) -> the arrays of vmap, block by block; and the Program that it is made of."""
    with collector_off():
        program = Program(function, *live)
        of_columns = function_of(source_of(program, Columns), COLUMNS)

    def run(arrays):
        count = len(arrays[0])
        flat = [x.reshape(count, -1) for x in arrays]
        rows = np.empty((count, len(program.results)))
        for first in range(0, count, BLOCK):
            part = slice(first, first + BLOCK)
            columns = np.concatenate([x[part] for x in flat], axis=1).T[program.places].copy()
            for k, column in enumerate(of_columns(*columns)):
                rows[part, k] = column
        return split(rows, list(map(np.shape, program.outputs)))

    return run, program
