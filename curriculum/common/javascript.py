"""A program as JavaScript, whose numbers are the same IEEE doubles: functions for a page.

What is `EXACT` (trace.py) makes Python's bits in every browser. Other functions need not: the
standard leaves their last digits open, and Program.inexact names those that a program uses.
"""

import json
import re

from curriculum.common.arrays import BINARY, FUNCTIONS
from curriculum.common.language import CHOICE, MINUS, Language

# What a page has to define before the functions that are written here.
PRELUDE = """class Stop extends Error {}
const max = (a, b) => (a >= b || a !== a ? a : b);
const min = (a, b) => (a <= b || a !== a ? a : b);
"""
WORD = re.compile(r"(?<![\w.])[A-Za-z]\w*")


def words(texts):
    """The words of texts, each once, in order: {word: None}."""
    return dict.fromkeys(word for text in texts for word in WORD.findall(text))


class Writer(Language):
    """Functions of JavaScript, `names` {text: name}; those with the same text are one function."""

    assigned, minus, number = "const {} = {};", MINUS, staticmethod(json.dumps)
    functions = {name: f"Math.{called}" for name, called in (FUNCTIONS | BINARY).items()}
    functions |= {"abs": "Math.abs", "**": "Math.pow", "max": "max", "min": "min"}

    def __init__(self):
        self.names = {}
        self.inner = {}  # {a program that others call: its function's name, what that needs}
        self.given = {}  # the inputs and knobs of the program that is written: {name: expression}

    def source(self):
        """All functions, those that are called before those that call them."""
        return "".join(f"function {name}{text}\n" for text, name in self.names.items())

    def function(self, parameters, lines, results):
        """The name of a function that returns an array of `results`, which are expressions."""
        body = "".join(f"{line}\n" for line in lines)
        text = f"({', '.join(parameters)}) {{\n{body}return [{', '.join(results)}];\n}}"
        return self.names.setdefault(text, f"F{len(self.names)}")

    def program(self, program, parameters, given):
        """The name of a function (*parameters) -> array that does what a program does.

        `given`: an expression for each input and knob of the program, {name: expression}.
        """
        self.given = dict.fromkeys(parameters) | given
        ((lines, results),) = self.write(program.tape, program.out)
        used = words([*lines, *results])
        head = [self.assigned.format(x, given[x]) for x in given if x in used and x != given[x]]
        return self.function(parameters, head + lines, results)

    def calls(self, calls, signed):
        """Calls of a function, one a row of arguments. What one returns is named one by one: a
        browser makes ten times as much of `const [a, b, c] = ...`, and runs it slowly."""
        program = calls.program
        if program not in self.inner:
            ((lines, results),) = self.write(program.tape, program.computed)
            used = words([*lines, *results])
            knobs = (x for x in self.given if x in used and x not in calls.taken)
            around = [*calls.taken, *knobs]
            name = self.function([*program.inputs, *around], lines, results)
            self.inner[program] = name, around
        name, around = self.inner[program]
        for names, row in zip(calls.names, calls.rows, strict=True):
            whole = f"all_{names[0]}"
            yield f"const {whole} = {name}({', '.join([*map(signed, row), *around])});"
            yield from (f"const {x} = {whole}[{k}];" for k, x in enumerate(names))

    def loop(self, loop, signed):
        """A loop, which throws a Stop if it comes to no end."""
        names, turn = loop.names, f"turn_{loop.names[0]}"
        (test, (now,)), (rest, following) = self.write(loop.tape, [loop.size], loop.following)
        changed = {name: x for name, x in zip(names, following, strict=True) if x != name}
        return [
            *(f"let {name} = {x};" for name, x in zip(names, map(signed, loop.start), strict=True)),
            f"for (let {turn} = 0; ; {turn}++) {{",
            f"if ({turn} === {loop.most}) throw new Stop({json.dumps(loop.complaint)});",
            *test,
            f"if ({now} <= 1) break;",
            *rest,
            *(f"const next_{name} = {x};" for name, x in changed.items()),
            *(f"{name} = next_{name};" for name in changed),
            "}",
        ]

    def operation(self, sign, operands, text):
        if sign != "where":
            return super().operation(sign, operands, text)
        test, yes, no = (text(x, 1) for x in operands)
        return f"{test} != 0 ? {yes} : {no}", CHOICE  # NaN is not 0, as in numpy
