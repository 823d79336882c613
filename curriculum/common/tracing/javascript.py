"""A program as JavaScript: a function of a Float64Array, with the bits of Python."""

import re
from functools import lru_cache

from curriculum.common.tracing.python import Python

NAMES = {"inf": "Infinity", "-inf": "-Infinity", "nan": "NaN"}


class JavaScript(Python):
    """The lines of Python with another grammar."""

    forms = Python.forms | {
        "define": "const {name} = {value};",
        "call": "Math.{sign}({operands})",
        "<": "{0} < {1} ? 1.0 : 0.0",
        "<=": "{0} <= {1} ? 1.0 : 0.0",
        "where": "{0} !== 0.0 ? {1} : {2}",
        "begin": "let [{names}] = [{values}], turn_{first} = 0;",
        "turns": "for (; turn_{first} < {most}; turn_{first}++) {{",
        "stop": "if ({going} === 0.0) break;",
        "keep": "state[{place}] = {x};",
        "record": "record(state);",
        "assign": "[{names}] = [{values}];",
        "end": "}}",
        "fail": "if (turn_{first} === {most}) throw new Error({failure});",
    }

    def constant(self, x):
        """The text of a float."""
        return NAMES.get(repr(x), repr(x))

    def keep(self, places, values):
        """Write that these values are left at these places of the state."""
        for place, x in zip(places, values, strict=True):
            self.write("keep", place=place, x=x)

    def record(self, loop, values):
        """Write that the state, as these values leave it, is recorded."""
        self.keep(loop.places, values)
        self.write("record")


@lru_cache(16)  # a page asks first which steps are the same
def javascript_of(program):
    """f(state, steps, record, ...scalars) of a program of arrays, all of whose numbers are `state`.

    Its results, as many, are left there; what it records is there when record(state) is called.
    Where Python's loop gives NaN since it does not end, it throws an Error, which says why.
    """
    js = JavaScript()
    scalars = program.inputs[len(program.places) :]
    js.lines.append(f"function f({', '.join(['state', 'steps', 'record', *scalars])}) {{")
    for name, place in zip(program.inputs, program.places, strict=False):
        js.write("define", name=name, value=f"state[{place}]")
    values = js.walk(program.tape, program.results, {x: [x] for x in program.inputs})
    js.keep(range(len(program.results)), values)
    text = "\n".join([*(line.strip() for line in js.lines), "}\n"])
    # a run of constants is one declaration, which is shorter
    return re.sub(r"(const .*;\n)+", lambda run: run[0].replace(";\nconst ", ",\n"), text)
