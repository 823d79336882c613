"""A program as Python: a function of floats, or of columns of numpy; a line an operation."""

import math
from contextlib import contextmanager, suppress

import numpy as np

from curriculum.common.tracing.symbols import FLOATS
from curriculum.common.tracing.tape import StepFailed
from curriculum.common.tracing.writer import Writer, numbered

CALLS = {"max": "maximum", "min": "minimum"}  # as numpy calls them
NUMBERS = {CALLS.get(name, name): function for name, function in FLOATS.items()}
NUMBERS |= {"inf": math.inf, "nan": math.nan, "StepFailed": StepFailed}
COLUMNS = NUMBERS | {name: getattr(np, name) for name in NUMBERS if hasattr(np, name)}
COLUMNS |= {"any": np.any, "atan2": np.arctan2, "pow": np.power}


def tuple_of(texts):
    return f"({', '.join(texts)}{',' * (len(texts) == 1)})"


class Python(Writer):
    """Lines of Python. The methods before `line` are its grammar; another language has others."""

    def __init__(self):
        self.lines, self.margin = [], ""

    def constant(self, x):
        return repr(x)

    def define(self, name, made):
        self.line(f"{name} = {made}")

    def call(self, sign, given):
        if sign in ("<", "<="):
            return f"1.0 * ({given[0]} {sign} {given[1]})"
        return f"{CALLS.get(sign, sign)}({', '.join(given)})"

    def block(self, head):
        return self.indented(f"{head}:")

    def assign(self, names, values):
        self.line(f"{', '.join(names)} = {', '.join(values)}")

    begin = assign

    def turns(self, loop, names):
        return self.block(f"for _ in range({'steps' if loop.most is None else loop.most})")

    def stop(self, going):
        self.line(f"if not {going}: break")

    def follow(self, going, names, values):
        self.assign(names, values)

    def fail(self, loop, going, names):
        with self.block("else"):
            self.line(f"raise StepFailed({loop.failure!r})")

    def record(self, loop, values):
        self.line(f"record({tuple_of(values)})")

    def line(self, text):
        self.lines.append(self.margin + text)

    @contextmanager
    def indented(self, head):
        self.line(head)
        self.margin += "    "
        yield
        self.margin = self.margin[4:]

    def operation(self, sign, given, name):
        self.define(name, f" {sign} ".join(given) if sign in "+-*/" else self.call(sign, given))
        return name

    def loop(self, loop, env, k):
        own = {x: numbered(x, loop.rows)[k] for x in loop.carry}
        names, going = [*own.values()], None
        self.begin(names, [self.values(env, begin)[0] for begin, _ in loop.carry.values()])
        env |= {x: [name] for x, name in own.items()}
        with self.turns(loop, names):
            if loop.going is not None:
                (going,) = self.walk(loop.tape, [loop.going], env)
                self.stop(going)
            values = self.walk(loop.tape, loop.following, env)
            if loop.record:
                self.record(loop, values)
            self.follow(going, names, values)
        if loop.going is not None:
            self.fail(loop, going, names)
        return own


class Columns(Python):
    """The same where a number is a column of numpy, some of whose entries leave a loop earlier."""

    def stop(self, going):
        self.line(f"if not any({going}): break")

    def follow(self, going, names, values):
        if going:
            values = [f"where({going}, {x}, {old})" for x, old in zip(values, names, strict=True)]
        self.assign(names, values)

    def fail(self, loop, going, names):
        with self.block("else"):
            self.follow(going, names, ["nan"] * len(names))


def source_of(program, language=Python):
    """f(*inputs, steps, record), a program in Python, which returns its results."""
    python = language()
    with python.block(f"def f({', '.join([*program.inputs, 'steps=1', 'record=None'])})"):
        env = {x: [x] for x in program.inputs}
        python.line(f"return {tuple_of(python.walk(program.tape, program.results, env))}")
    return "\n".join(python.lines) + "\n"


def function_of(source, space):
    """The function f of a source: of floats with NUMBERS, of columns with COLUMNS."""
    exec(source, space := dict(space))
    return space.pop("f")  # which has this space: left in it, both would live on


def single(source, places):
    """prepared(given, rows) -> a call of it, which returns how many of the rows are written."""
    function = function_of(source, NUMBERS)

    def prepared(given, rows):
        def call():
            made = []
            with suppress(ArithmeticError, ValueError):  # the step as it stands will show why
                function(*given.tolist(), len(rows), made.append)
            if made:
                rows[: len(made), places] = made
            return len(made)

        return call

    return prepared
