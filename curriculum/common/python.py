"""A program as Python: a function of floats, an operation a line, what is used once where it is
used."""

import math
from collections import Counter

from curriculum.common.trace import FUNCTIONS

NUMBERS = {name: getattr(math, name) for name in [*FUNCTIONS, "pow"]} | {
    "abs": abs,
    "inf": math.inf,
    "nan": math.nan,
}
BINDS = {"+": 1, "-": 1, "*": 2, "/": 2}  # how tightly; names, numbers and calls: 4
WIDTH = 80  # what is used once stands where it is used, up to this many characters


def write(tape, *groups):
    """For each group of symbols, the lines that compute what no group before it has, and an
    expression each."""
    used = Counter(s.x for group in groups for s in group)
    used.update(x for operands in tape.ancestry(sum(groups, [])).values() for x in operands)
    texts, done = {}, set()

    def text(x, binds=0):
        expression, bound = texts.get(x, (str(x), 4))
        return f"({expression})" if bound < binds else expression

    def signed(s):
        return f"-{text(s.x, 2)}" if s.minus else text(s.x)

    for group in groups:
        lines, found = [], tape.ancestry(group)
        for name in [name for name in tape.nodes if name in found and name not in done]:
            sign, left, *right = tape.nodes[name]
            if sign in ("loop", "of"):
                lines += tape.loops[name].lines(signed) if sign == "loop" else ()
                continue
            bound, expression = BINDS.get(sign, 4), f"{sign}({text(left)})"
            if right:
                expression = f"{text(left, bound)} {sign} {text(right[0], bound + 1)}"
            if sign == "**":  # the operator is right-associative, and complex for a negative base
                expression = f"pow({text(left)}, {text(right[0])})"
            if used[name] == 1 and len(expression) < WIDTH:
                texts[name] = expression, bound
            else:
                lines.append(f"{name} = {expression}")
        done.update(found)
        yield lines, list(map(signed, group))


def number_function(program, frame):
    """The function f of numbers that `frame` makes of inputs, lines and results; and its source."""
    ((lines, results),) = write(program.tape, [s for a in program.results for s in a.flat])
    source = frame(", ".join(program.inputs), lines, ", ".join(results))
    space = dict(NUMBERS)
    exec(source, space)  # made of the names of operations and of floats, and of nothing else
    return space["f"], source


def once(inputs, lines, results):
    """A function of the inputs."""
    body = "".join(f"    {line}\n" for line in lines)
    return f"def f({inputs}):\n{body}    return ({results},)\n"


def again(inputs, lines, results):
    """A loop that puts the results in place of the inputs `count` times, and keeps them."""
    lines = [*lines, f"state = ({results},)", "keep(state)", f"{inputs}, = state"]
    body = "".join(f"        {line}\n" for line in lines)
    return f"def f(state, count, keep):\n    {inputs}, = state\n    for _ in range(count):\n{body}"
