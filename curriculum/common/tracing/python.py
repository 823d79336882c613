"""A program as Python: a function of floats, or of columns of numpy; a line an operation."""

import json
import math
import time
from contextlib import suppress

import numpy as np

from curriculum.common.tracing.symbols import FLOATS
from curriculum.common.tracing.writer import Writer, numbered

NUMBERS = FLOATS | {"inf": math.inf, "nan": math.nan}
COLUMNS = NUMBERS | {name: getattr(np, name) for name in NUMBERS if hasattr(np, name)}
COLUMNS |= {"max": np.maximum, "min": np.minimum, "any": np.any}
COLUMNS |= {"atan2": np.arctan2, "pow": np.power}


class Python(Writer):
    """Lines of Python, whose grammar is its `forms`; another language has others."""

    forms = {
        "define": "{name} = {value}",
        "call": "{sign}({operands})",
        "<": "1.0 * ({0} < {1})",
        "<=": "1.0 * ({0} <= {1})",
        "begin": "{names} = {values}",
        "turns": "for _ in range({most}):",
        "stop": "if not {going}: break",
        "record": "record({row})",
        "assign": "{names} = {values}",
        "end": "",
        "fail": "else:\n    {names} = {values}",
    }

    def __init__(self):
        self.lines = []
        self.margin = ""

    def constant(self, x):
        """The text of a float."""
        return repr(x)

    def write(self, form, **words):
        """Write one of the `forms`, indented, with these words in its blanks."""
        for line in self.forms[form].format(**words).splitlines():
            self.lines.append(self.margin + line)

    def operation(self, sign, operands, name):
        """Write an operation on operands, as text, and give its name."""
        if sign in "+-*/":  # the commonest by far
            value = f"{operands[0]} {sign} {operands[1]}"
        else:
            form = self.forms.get(sign, self.forms["call"])
            value = form.format(*operands, sign=sign, operands=", ".join(operands))
        self.lines.append(self.margin + self.forms["define"].format(name=name, value=value))
        return name

    def following(self, going, names, values):
        """What the names of a loop become after a turn, as text; `going` may be None."""
        return ", ".join(values)

    def record(self, loop, values):
        """Write that the values of this turn are to be recorded."""
        self.write("record", row=tuple_of(values))

    def loop(self, loop, env, k):
        """Write row k of a Loop; {name: what it is called in this row, when it has ended}."""
        own = {x: numbered(x, loop.rows)[k] for x in loop.carry}
        names = [*own.values()]
        going = None
        words = {"names": ", ".join(names), "first": names[0], "failure": json.dumps(loop.failure)}
        words["most"] = "steps" if loop.most is None else loop.most
        begins = [self.values(env, begin)[0] for begin, _ in loop.carry.values()]
        env |= {x: [name] for x, name in own.items()}
        self.write("begin", values=", ".join(begins), **words)
        self.write("turns", **words)
        self.margin += "    "
        if loop.going is not None:
            (going,) = self.walk(loop.tape, [loop.going], env)
            self.write("stop", going=going)
        values = self.walk(loop.tape, loop.following, env)
        if loop.most is None:
            self.record(loop, values)
        self.write("assign", values=self.following(going, names, values), **words)
        self.margin = self.margin[4:]
        self.write("end")
        if loop.going is not None:
            nothing = ["nan"] * len(names)
            self.write("fail", values=self.following(going, names, nothing), **words)
        return own


class Columns(Python):
    """Lines of Python whose numbers are columns of numpy; some entries leave a loop earlier."""

    forms = Python.forms | {"stop": "if not any({going}): break"}

    def following(self, going, names, values):
        """What the names become after a turn; an entry that has left the loop stays as it is."""
        if going:
            pairs = zip(values, names, strict=True)
            values = [f"where({going}, {x}, {before})" for x, before in pairs]
        return ", ".join(values)


def tuple_of(texts):
    """The text of a tuple, which may be of one."""
    return f"({', '.join(texts)}{',' * (len(texts) == 1)})"


def source_of(program, language=Python):
    """f(*inputs, steps, record), a program in Python, which returns its results."""
    python = language()
    python.lines.append(f"def f({', '.join([*program.inputs, 'steps=1', 'record=None'])}):")
    python.margin = "    "
    values = python.walk(program.tape, program.results, {x: [x] for x in program.inputs})
    return "\n".join([*python.lines, f"    return {tuple_of(values)}\n"])


def function_of(source, space):
    """The function f of a source: of floats with NUMBERS, of columns with COLUMNS."""
    space = dict(space)
    exec(source, space)
    return space.pop("f")  # which has this space: left in it, both would live on


def written(source, places):
    """write(numbers, rows) -> how many of the rows it has written, at these places of each, in how
    many s."""
    function = function_of(source, NUMBERS)

    def write(numbers, rows):
        taken = []
        clock = time.thread_time()
        with suppress(ArithmeticError, ValueError):  # the step as it stands will show why
            function(*numbers.tolist(), len(rows), taken.append)
        seconds = time.thread_time() - clock
        if taken:
            rows[: len(taken), places] = taken
        return len(taken), seconds

    return write
