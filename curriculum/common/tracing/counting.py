"""How many operations a step takes, counted as it takes them: the same on every machine."""

from contextlib import suppress

import numpy as np

from curriculum.common.tracing.python import NUMBERS, Python, function_of, source_of
from curriculum.common.tracing.trace import Loop


class Counting(Python):
    """The lines of Python, which also add to record[0] what each turn of a loop takes.

    An operation is a sum, a product, a root, a comparison or the like of two numbers. What is done
    side by side in several rows is one, as in machine code: so of a loop in rows that one counts
    which takes most, as the others wait. The operations of a loop's test and of the rest of its
    body are added where they are done, so turns need no guess. What is done once, before all steps,
    is not counted.
    """

    forms = Python.forms | {
        "record": "",
        "count": "record[0] += {many}",
        "rows": "record.extend((record[0], 0))",  # what was there before, and the most of a row
        "row": "record[-1] = max(record[-1], record[0] - record[-2])\nrecord[0] = record[-2]",
        "most": "record[0] += record.pop()\nrecord.pop()",
    }

    def __init__(self):
        super().__init__()
        self.waiting = [0]  # written but not yet added, of each loop around this line

    def operation(self, sign, operands, name):
        """Write and count it, once for all rows."""
        _, _, row = name.partition("_")
        self.waiting[-1] += row in ("", "0")
        return super().operation(sign, operands, name)

    def write(self, form, **words):
        """Write one of the `forms`, and add what is waiting where a test or a turn ends."""
        if form in ("stop", "assign"):  # the last line of a test, and of a turn
            super().write("count", many=self.waiting[-1])
            self.waiting[-1] = 0
        super().write(form, **words)
        if form == "turns":
            self.waiting.append(0)
        elif form == "end":
            self.waiting.pop()

    def loops(self, loop, env):
        """Write a loop, which counts as its longest row does."""
        self.write("rows")
        super().loops(loop, env)
        self.write("most")

    def loop(self, loop, env, k):
        """Write row k of it, and what this row takes."""
        ends = super().loop(loop, env, k)
        self.write("row")
        return ends


class Counter:
    """count(state, *scalars) -> how many operations the step of a program takes from there.

    `program`: that of trace_loop. `varies`: whether it has loops that end when they may, so that
    the number depends on the state.
    """

    def __init__(self, program):
        self.places = program.places
        self.function = function_of(source_of(program, Counting), NUMBERS)
        (loop,) = [node for node in program.tape.nodes.values() if isinstance(node, Loop)]
        self.varies = any(isinstance(node, Loop) for node in loop.tape.nodes.values())

    def __call__(self, state, *scalars):
        record = [0]
        live = np.concatenate([np.ravel(x) for x in state])[self.places]
        with suppress(ArithmeticError, ValueError):  # a step that fails has taken some, too
            self.function(*live.tolist(), *scalars, 1, record)
        return record[0]
