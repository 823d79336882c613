"""A program as JavaScript: a function of a Float64Array, with the bits of Python."""

import json
from contextlib import contextmanager

from curriculum.common.tracing.python import Python

NAMES = {"inf": "Infinity", "-inf": "-Infinity", "nan": "NaN"}


class JavaScript(Python):
    """The lines of Python with another grammar."""

    def constant(self, x):
        return NAMES.get(repr(x), repr(x))

    def define(self, name, made):
        self.line(f"const {name} = {made};")

    def call(self, sign, given):
        if sign in ("<", "<="):
            return f"{given[0]} {sign} {given[1]} ? 1.0 : 0.0"
        if sign == "where":
            return "{} !== 0.0 ? {} : {}".format(*given)
        return f"Math.{sign}({', '.join(given)})"

    @contextmanager
    def block(self, head):
        with self.indented(f"{head} {{"):
            yield
        self.line("}")

    def begin(self, names, values):
        self.line(
            f"let {', '.join(f'{name} = {x}' for name, x in zip(names, values, strict=True))};"
        )

    def assign(self, names, values):
        self.line(f"[{', '.join(names)}] = [{', '.join(values)}];")

    def turns(self, loop, names):
        self.line(f"let turn_{names[0]} = 0;")
        most = "steps" if loop.most is None else loop.most
        return self.block(f"for (; turn_{names[0]} < {most}; turn_{names[0]}++)")

    def stop(self, going):
        self.line(f"if ({going} === 0.0) break;")

    def fail(self, loop, going, names):
        self.line(
            f"if (turn_{names[0]} === {loop.most}) throw new Error({json.dumps(loop.failure)});"
        )

    def record(self, loop, values):
        self.keep(loop.places, values)
        self.line("record(state);")

    def keep(self, places, values):
        for place, x in zip(places, values, strict=True):
            self.line(f"state[{place}] = {x};")


def javascript_of(program):
    """f(state, steps, record, ...knobs) of a program of arrays, all of whose numbers are `state`.

    Its results, as many, are left there; what it records is there when record(state) is called.
    """
    js, knobs = JavaScript(), program.inputs[len(program.places) :]
    with js.block(f"function f({', '.join(['state', 'steps', 'record', *knobs])})"):
        for name, place in zip(program.inputs, program.places, strict=False):
            js.define(name, f"state[{place}]")
        env = {x: [x] for x in program.inputs}
        js.keep(range(len(program.results)), js.walk(program.tape, program.results, env))
    return "\n".join(js.lines) + "\n"
