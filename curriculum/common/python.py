"""A program as Python: a function of floats, a line an operation; what is used once, in place."""

import contextlib
import math
from collections import Counter
from functools import lru_cache

from curriculum.common.arrays import FUNCTIONS
from curriculum.common.programs import INLINE, Call, Lanes
from curriculum.common.trace import Stop

import numpy as np

NUMBERS = {name: getattr(math, name) for name in [*FUNCTIONS, "pow", "inf", "nan"]}
NUMBERS |= {"abs": abs, "Stop": Stop}
NUMBERS["largest"] = lambda a, b: a if a >= b or a != a else b  # NaN, if one of them is
NUMBERS["smallest"] = lambda a, b: a if a <= b or a != a else b
NUMBERS["where"] = lambda condition, a, b: a if condition else b
# the same names for columns of numbers, so that the same source does as many states at once
COLUMNS = {name: getattr(np, name) for name in [*FUNCTIONS, "inf", "nan", "abs", "where"]}
COLUMNS |= {"pow": np.power, "largest": np.maximum, "smallest": np.minimum}
CALLED = {"**": "pow", "max": "largest", "min": "smallest"}  # signs that are calls, by their names
BINDS = {"<": 0, "<=": 0, "+": 1, "-": 1, "*": 2, "/": 2}  # how tightly; names and calls: 4
PIECE = 1 << 13  # members at a time: a dozen columns of them stay near the processor
WIDTH = 80  # what is used once stands where it is used, up to this many characters


def write(tape, routines, *groups, given=None):
    """For each group of symbols, lines that compute what no group before has, and expressions.

    `routines`: a list of programs, to which those that are called are added. `given` {name:
    expression}: what stands for some names.
    """
    everything = tape.needed(sum(groups, []))
    used = Counter(s.x for group in groups for s in group)
    used.update(x for name in everything for x in tape.nodes[name][1:])
    for name in set(tape.parts).intersection(everything):
        used.update(tape.nodes[name][1:])  # twice: not to be inlined
    texts, done = {name: (x, 3) for name, x in (given or {}).items()}, set()

    def text(x, binds=0):
        expression, bound = texts.get(x, (str(x), 4))
        return f"({expression})" if bound < binds else expression

    def signed(s):
        return f"-{text(s.x, 2)}" if s.minus else text(s.x)

    for group in groups:
        lines = []
        for name in everything if group is groups[-1] else tape.needed(group):
            if name in done:
                continue
            done.add(name)
            sign, *operands = tape.nodes[name]
            if sign == "part":
                lines += part_lines(tape.parts[name], signed, routines)
            elif sign != "of":
                bound = BINDS.get(sign, 4)
                if sign in BINDS:
                    left, right = operands
                    expression = f"{text(left, bound or 1)} {sign} {text(right, bound + 1)}"
                else:  # ** binds to the right, and is complex for a negative base
                    expression = f"{CALLED.get(sign, sign)}({', '.join(map(text, operands))})"
                if used[name] == 1 and len(expression) < WIDTH:
                    texts[name] = expression, bound
                else:
                    lines.append(f"{name} = {expression}")
        yield lines, list(map(signed, group))


def part_lines(part, signed, routines):
    """A Call, Lanes or a Loop; `signed`(symbol) is an expression for what is computed before it."""
    if isinstance(part, Lanes):
        yield from lanes_lines(part, signed, routines)
        return
    names = ", ".join(part.names)
    if isinstance(part, Call):
        if part.program not in routines:
            routines.append(part.program)
        called = f"routine{routines.index(part.program)}"
        yield f"{names}, = {called}({', '.join(map(signed, part.arguments))})"
        return
    (test, (size,)), (rest, following) = write(part.tape, routines, [part.size], part.following)
    yield f"{names}, = {', '.join(map(signed, part.start))},"
    done = [f"if {size} <= 1.0:", "    break"]
    if part.nearly > 1.0:
        now, last = (f"{word}_{part.names[0]}" for word in ("size", "last"))
        done = [f"{now} = {size}", f"if {now} <= 1.0 or {last} <= {now} <= {part.nearly!r}:"]
        done += ["    break", f"{last} = {now}"]
        yield f"{last} = inf"
    yield f"for _ in range({part.most}):"
    yield from (f"    {line}" for line in [*test, *done, *rest])
    yield f"    {names}, = {', '.join(following)},"
    yield from ("else:", f"    raise Stop({part.complaint!r})")


def lanes_lines(lanes, signed, routines):
    """Rows in turn: written out if they are short, else a loop adds what they make to a list."""
    program, rows = lanes.program, [list(map(signed, row)) for row in lanes.rows]
    short = len(rows) * len(program.tape.nodes) <= INLINE
    if short and all(isinstance(part, Call) for part in program.tape.parts.values()):
        for row, names in zip(rows, lanes.names, strict=True):
            given = dict(zip(program.inputs, row, strict=True))
            ((lines, made),) = write(program.tape, routines, program.made, given=given)
            yield from lines
            yield f"{', '.join(names)}, = {', '.join(made)},"
        return
    ((lines, made),) = write(program.tape, routines, program.made)
    everything = f"all_{lanes.names[0][0]}"
    yield f"{everything} = []"
    tuples = ", ".join(f"({', '.join(row)},)" for row in rows)
    yield f"for {', '.join(program.inputs)}, in {tuples}:"
    yield from (f"    {line}" for line in lines)
    yield f"    {everything} += {', '.join(made)},"
    yield f"{', '.join(sum(lanes.names, []))}, = {everything}"


def source_of(program):
    """A function f(state, count, keep, *knobs) that a program is, in Python.

    It puts the first results in place of the inputs `count` times, and calls keep(results) after
    each.
    """
    routines, names = [], ", ".join(program.inputs)
    (first, _), (lines, results) = write(program.tape, routines, program.lasting(), program.out)
    rest = f"[:{len(program.inputs)}]" if len(results) > len(program.inputs) else ""
    lines += [f"state = ({', '.join(results)},)", "keep(state)"]
    lines += [f"{names}, = state{rest}"] if names else []
    source = f"def f({', '.join(['state', 'count', 'keep', *program.knobs])}):\n"
    begin = [f"{names}, = state"] if names else []
    source += "".join(f"    {line}\n" for line in [*first, *begin])
    source += "    for _ in range(count):\n" + "".join(f"        {line}\n" for line in lines)
    for k, called in enumerate(routines):  # which may call others: the list grows
        ((lines, made),) = write(called.tape, routines, called.made)
        head, body = ", ".join(called.inputs), "".join(f"    {line}\n" for line in lines)
        source = f"def routine{k}({head}):\n{body}    return {', '.join(made)},\n\n\n" + source
    return source


def compiled(source, space):
    """The function f of a source: of floats with NUMBERS, of columns of floats with COLUMNS.

    Columns go through what has no loop.
    """
    exec(source, space := dict(space))
    return space["f"]


class Columns:
    """A source without loops for many members, in numpy; called as native.Native is."""

    lanes = 1

    def __init__(self, source):
        self.function = compiled(source, COLUMNS)

    def __call__(self, state, count, out, *knobs):
        for first in range(0, state.shape[1], PIECE):
            some = slice(first, first + PIECE)
            self.piece(state[:, some], count, out[:, some], *knobs)

    def piece(self, state, count, out, *knobs):
        """Some members, whose columns stay near the processor."""
        entries, values = len(state), ()

        def keep(row):
            nonlocal values
            values = row[:entries]
            for most, made in zip(out, row[entries:], strict=True):
                np.maximum(most, made, out=most)

        with np.errstate(all="ignore"):
            self.function(tuple(state.copy()), count, keep, *knobs)
        for place, value in zip(state, values, strict=True):
            place[:] = value


class OneByOne:
    """A source for many members, in Python's floats; called as native.Native is.

    A member whose loop comes to no end is NaN from there on.
    """

    lanes = 1

    def __init__(self, source):
        self.source, self.function = source, compiled(source, NUMBERS)

    def __call__(self, state, count, out, *knobs):
        entries = len(state)
        for k, start in enumerate(state.T.tolist()):
            rows = self.rows(tuple(start), count, *knobs)
            if len(rows) < count:
                state[:, k] = out[:, k] = np.nan
                continue
            state[:, k] = rows[-1][:entries]
            made = np.reshape([row[entries:] for row in rows], (count, len(out)))
            out[:, k] = np.maximum.reduce(made, initial=-np.inf)

    def rows(self, start, count, *knobs):
        """What the program makes of a member, step by step, as far as it goes."""
        rows = []
        try:
            self.function(start, count, rows.append, *knobs)
        except Stop:
            pass
        except (ArithmeticError, ValueError):  # where numpy's floats go on
            rows = []
            with contextlib.suppress(Stop), np.errstate(all="ignore"):
                careful(self.source)(tuple(map(np.float64, start)), count, rows.append, *knobs)
        return rows


@lru_cache(8)
def careful(source):
    """The same f, for numpy's floats: it makes inf or nan where Python's raise an error."""

    def function(name):
        def of(*x):
            try:
                return np.float64(NUMBERS[name](*x))
            except (ArithmeticError, ValueError):
                return COLUMNS[name](*map(np.float64, x))

        return of

    return compiled(source, NUMBERS | {name: function(name) for name in [*FUNCTIONS, "pow"]})
