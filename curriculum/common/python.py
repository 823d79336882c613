"""A program as Python: a function of floats, a line an operation; what is used once, in place."""

import math
from textwrap import indent

from curriculum.common.language import PRODUCT, Language
from curriculum.common.tape import Stop
from curriculum.common.trace import CALLED

import numpy as np

NUMBERS = CALLED | {"pow": math.pow, "inf": math.inf, "nan": math.nan, "abs": abs, "Stop": Stop}
NUMBERS["largest"] = lambda a, b: a if a >= b or a != a else b  # NaN, if one of them is
NUMBERS["smallest"] = lambda a, b: a if a <= b or a != a else b
NUMBERS["where"] = lambda condition, a, b: a if condition else b
# the same names for columns of numbers, so that the same source does as many states at once
COLUMNS = {name: getattr(np, name) for name in [*CALLED, "inf", "nan", "abs", "where"]}
COLUMNS |= {"pow": np.power, "largest": np.maximum, "smallest": np.minimum}


def block(head, lines):
    """A line with a colon, and lines below it."""
    return f"{head}:\n" + indent("\n".join(lines), "    ")


class Python(Language):
    """`routines`: the programs that are called."""

    assigned, minus, number = "{} = {}", PRODUCT, repr
    # ** binds to the right, and is complex for a negative base
    functions = {name: name for name in COLUMNS}
    functions |= {"**": "pow", "max": "largest", "min": "smallest"}

    def __init__(self):
        self.routines = []

    def operation(self, sign, operands, text):
        expression, bound = super().operation(sign, operands, text)
        if sign in ("<", "<="):  # a number: of numpy's truths 1 + 1 is 1
            return f"1.0 * ({expression})", PRODUCT
        return expression, bound

    def calls(self, calls, signed):
        """A call of a routine for each row or, where rows take numbers from around, a loop."""
        program, rows = calls.program, [", ".join(map(signed, row)) for row in calls.rows]
        if not calls.taken:
            if program not in self.routines:
                self.routines.append(program)
            routine = f"routine{self.routines.index(program)}"
            for names, row in zip(calls.names, rows, strict=True):
                yield f"{', '.join(names)}, = {routine}({row})"
            return
        ((lines, made),) = self.write(program.tape, program.computed)
        everything = f"all_{calls.names[0][0]}"
        yield f"{everything} = []"
        lines.append(f"{everything} += {', '.join(made)},")
        tuples = ", ".join(f"({row},)" for row in rows)
        yield block(f"for {', '.join(program.inputs)}, in {tuples}", lines)
        yield f"{', '.join(sum(calls.names, []))}, = {everything}"

    def loop(self, loop, signed):
        names = ", ".join(loop.names)
        (test, (now,)), (rest, following) = self.write(loop.tape, [loop.size], loop.following)
        yield f"{names}, = {', '.join(map(signed, loop.start))},"
        ends = block(f"if {now} <= 1.0", ["break"])
        turn = [*test, ends, *rest, f"{names}, = {', '.join(following)},"]
        yield block(f"for _ in range({loop.most})", turn)
        yield block("else", [f"raise Stop({loop.complaint!r})"])


def source_of(program):
    """A function f(state, count, keep, *knobs) that a program is, in Python.

    `count` times its first results become the state, and it calls keep(results).
    """
    python, entries = Python(), len(program.inputs)
    (first, _), (lines, results) = python.write(program.tape, program.lasting(), program.out)
    begin = [f"{', '.join(program.inputs)}, = state"] if entries else []
    rest = f"[:{entries}]" if len(results) > entries else ""
    lines += [f"state = ({', '.join(results)},)", "keep(state)", *(x + rest for x in begin)]
    head = f"def f({', '.join(['state', 'count', 'keep', *program.knobs])})"
    functions = [block(head, [*first, *begin, block("for _ in range(count)", lines)])]
    for k, called in enumerate(python.routines):  # which may call others: the list grows
        ((lines, made),) = python.write(called.tape, called.computed)
        head = f"def routine{k}({', '.join(called.inputs)})"
        functions.append(block(head, [*lines, f"return {', '.join(made)},"]))
    return "\n\n\n".join(functions[::-1]) + "\n"


def function_of(source, space):
    """The function f of a source: of floats with NUMBERS, of columns with COLUMNS."""
    exec(source, space := dict(space))
    return space["f"]


class Columns:
    """A source without loops for many members, as columns of numpy: called as native.Native is."""

    lanes = 1

    def __init__(self, source):
        self.function = function_of(source, COLUMNS)

    @np.errstate(all="ignore")
    def __call__(self, state, count, out, *knobs):
        last = []

        def keep(row):
            last[:] = row
            for largest, made in zip(out, row[len(state) :], strict=True):
                np.maximum(largest, made, out=largest)

        self.function(tuple(state.copy()), count, keep, *knobs)
        for end, value in zip(state, last, strict=False):
            end[:] = value
