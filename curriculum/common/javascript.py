"""A program as JavaScript, whose numbers are the same IEEE doubles: functions for a page.

What `EXACT` lists makes Python's bits in every browser. Other functions need not: the
standard leaves their last digits open, and `inexact` names those that a program uses.
"""

import json
import re
from collections import Counter

from curriculum.common.programs import Call, Lanes

# What a page has to define before the functions that are written here.
PRELUDE = """class Stop extends Error {}
const max = (a, b) => (a >= b || a !== a ? a : b);
const min = (a, b) => (a <= b || a !== a ? a : b);
"""
# How tightly an operator binds; unary minus: MINUS; names, numbers and calls: ATOM.
BINDS = {"<": 1, "<=": 1, "+": 2, "-": 2, "*": 3, "/": 3}
CHOICE, MINUS, ATOM = 0.5, 4, 5
NAMED = {"**": "Math.pow", "max": "max", "min": "min"}  # the rest are Math's by their own names
EXACT = {*BINDS, "sqrt", "abs", "max", "min", "where", "part", "of"}
SHORT = 80  # what is used once stands where it is used, up to this many characters
LONG = 40_000  # characters of a function: browsers do not optimize those that are twice as long
# Names of numbers on a tape, of all words, and of what a text declares.
MADE_UP = re.compile(r"(?<![A-Za-z0-9.])[a-z]+[0-9]+\b")
WORD = re.compile(r"[A-Za-z]\w*")
DECLARED = re.compile(r"\b(?:const|let) (\w+)")


def inexact(program):
    """The functions that a program uses and that need not have Python's bits, a set of names."""
    used = {node[0] for tape in program.tapes() for node in tape.nodes.values()}
    return used - EXACT


def literal(x):
    """A float >= 0 or the name of a number, as JavaScript has it."""
    return x if isinstance(x, str) else repr(float(x)).replace("inf", "Infinity")


def words(texts):
    """The words of texts, each once, in order: {word: None}."""
    return dict.fromkeys(word for text in texts for word in WORD.findall(text))


def called(names, call):
    """Lines that name the numbers of the array which a call returns.

    One by one: a browser makes ten times as much of `const [a, b, c] = ...`, and runs it slowly.
    """
    if not names:
        return ""
    whole = f"all_{names[0]}"
    each = (f"const {name} = {whole}[{k}];" for k, name in enumerate(names))
    return "\n".join([f"const {whole} = {call};", *each])


class Expressions:
    """Texts of symbols: the names of what is computed before, or how to compute it in place."""

    def __init__(self):
        self.inline = {}  # {name: (expression, how tightly it binds)}

    def of(self, x, binds=0):
        expression, bound = self.inline.get(x, (literal(x), ATOM))
        return f"({expression})" if bound < binds else expression

    def signed(self, s):
        return f"-{self.of(s.x, MINUS)}" if s.minus else self.of(s.x)

    def operation(self, sign, operands):
        """(expression, how tightly it binds) of an operation."""
        if sign in BINDS:
            bound = BINDS[sign]
            left, right = operands
            return f"{self.of(left, bound)} {sign} {self.of(right, bound + 1)}", bound
        if sign == "where":
            test, yes, no = (self.of(x, 1) for x in operands)
            return f"{test} ? {yes} : {no}", CHOICE
        name = NAMED.get(sign, f"Math.{sign}")
        return f"{name}({', '.join(map(self.of, operands))})", ATOM


class Writer:
    """Functions of JavaScript, {text: name}; those whose text is the same are one function.

    A statement is a pair: the names that it defines, and its text.
    """

    def __init__(self):
        self.functions = {}
        self.routines = {}  # {id of a program: (program, its function's name, its knobs)}
        self.given = {}  # the inputs and knobs of the program that is written: {name: expression}

    def source(self):
        """All functions, those that are called before those that call them."""
        return "".join(f"function {name}{text}\n" for text, name in self.functions.items())

    def function(self, parameters, statements, results):
        """The name of a function that returns an array of `results`, which are expressions."""
        body = "".join(f"{text}\n" for _, text in statements)
        text = f"({', '.join(parameters)}) {{\n{body}return [{', '.join(results)}];\n}}"
        known = {}  # what the tape calls t831 is t0 here, so that equal functions look equal

        def renamed(match):
            return known.setdefault(match[0], f"t{len(known)}")

        return self.functions.setdefault(MADE_UP.sub(renamed, text), f"F{len(self.functions)}")

    def program(self, program, parameters, given):
        """The name of a function (*parameters) -> array that does what a program does.

        `given`: an expression for each input and knob of the program, {name: expression}.
        """
        self.given = dict.fromkeys(parameters) | given
        statements, (results,) = self.statements(program.tape, program.out)
        used = words([*(text for _, text in statements), *results])
        taken = {x: text for x, text in given.items() if x in used and x != text}
        head = [([x], f"const {x} = {text};") for x, text in taken.items()]
        whole = self.split(head + statements, results)
        return self.function(parameters, whole, results)

    def routine(self, program):
        """The name of the function for a program that others call, and the knobs that it needs."""
        if id(program) not in self.routines:
            self.routines[id(program)] = program, *self.inner(program)
        return self.routines[id(program)][1:]

    def inner(self, program, taken=()):
        """The name of a function for a program inside another, and what it needs from around it."""
        statements, (results,) = self.statements(program.tape, program.made)
        used = words([*(text for _, text in statements), *results])
        around = [*taken, *(x for x in self.given if x in used and x not in taken)]
        whole = self.split(statements, results)
        return self.function([*program.inputs, *around], whole, results), around

    def statements(self, tape, *groups):
        """Statements that compute groups of symbols, and for each group its expressions."""
        found, texts = [], []
        for statements, results in self.in_groups(tape, *groups):
            found += statements
            texts.append(results)
        return found, texts

    def in_groups(self, tape, *groups):
        """For each group of symbols what no group before has computed, and its expressions."""
        needed = tape.needed([s for group in groups for s in group])
        used = Counter(s.x for group in groups for s in group)
        for name in needed:
            times = 2 if name in tape.parts else 1  # what a part needs is to have a name
            for x in tape.nodes[name][1:]:
                used[x] += times
        expressions, done = Expressions(), set()
        for group in groups:
            statements = []
            for name in tape.needed(group):
                if name in done:
                    continue
                done.add(name)
                sign, *operands = tape.nodes[name]
                if sign == "part":
                    statements.append(self.part(tape.parts[name], expressions))
                elif sign != "of":
                    text, bound = expressions.operation(sign, operands)
                    if used[name] == 1 and len(text) < SHORT:
                        expressions.inline[name] = text, bound
                    else:
                        statements.append(([name], f"const {name} = {text};"))
            yield statements, list(map(expressions.signed, group))

    def part(self, part, expressions):
        """The statement of a Call, of Lanes or of a Loop."""
        if isinstance(part, Lanes):
            return sum(part.names, []), self.lanes(part, expressions)
        if isinstance(part, Call):
            name, knobs = self.routine(part.program)
            given = ", ".join([*map(expressions.signed, part.arguments), *knobs])
            return part.names, called(part.names, f"{name}({given})")
        return part.names, self.loop(part, expressions)

    def lanes(self, lanes, expressions):
        """Rows in turn, by one function."""
        name, around = self.inner(lanes.program, lanes.taken)
        lines = []
        for row, names in zip(lanes.rows, lanes.names, strict=True):
            given = ", ".join([*map(expressions.signed, row), *around])
            lines.append(called(names, f"{name}({given})"))
        return "\n".join(lines)

    def loop(self, loop, expressions):
        """A loop, which throws a Stop if it comes to no end."""
        names = loop.names
        size, last, turn = (f"{word}_{names[0]}" for word in ("size", "last", "turn"))
        starts = zip(names, map(expressions.signed, loop.start), strict=True)
        groups = self.in_groups(loop.tape, [loop.size], loop.following)
        (test, (now,)), (rest, following) = groups
        ends = f"{size} <= 1 || ({last} <= {size} && {size} <= {literal(loop.nearly)})"
        test = self.split(test, [now, *following, *(text for _, text in rest)])
        following = [x if x != name else "" for x, name in zip(following, names, strict=True)]
        changed = [(name, x) for name, x in zip(names, following, strict=True) if x]
        lines = [
            *(f"let {name} = {start};" for name, start in starts),
            f"let {last} = Infinity;",
            f"for (let {turn} = 0; ; {turn}++) {{",
            f"if ({turn} === {loop.most}) throw new Stop({json.dumps(loop.complaint)});",
            *(text for _, text in test),
            f"const {size} = {now};",
            f"if ({ends}) break;",
            f"{last} = {size};",
            *(text for _, text in self.split(rest, following)),
            *(f"const next_{name} = {x};" for name, x in changed),
            *(f"{name} = next_{name};" for name, _ in changed),
            "}",
        ]
        return "\n".join(lines)

    def split(self, statements, later):
        """Statements that do the same; where they are too long, by calling functions of them.

        `later`: texts of what follows, which tell what is still wanted.
        """
        if sum(len(text) for _, text in statements) <= LONG:
            return statements
        pieces = [[]]
        for statement in statements:
            if sum(len(text) for _, text in pieces[-1]) > LONG // 2:
                pieces.append([])
            pieces[-1].append(statement)
        wanted, calls = words(later), []
        for piece in reversed(pieces):
            text = "\n".join(text for _, text in piece)
            makes = [name for names, _ in piece for name in names if name in wanted]
            inside = set(DECLARED.findall(text))
            takes = [x for x in words([text]) if self.is_number(x) and x not in inside]
            name = self.function(takes, piece, makes)
            calls.append((makes, called(makes, f"{name}({', '.join(takes)})")))
            wanted |= words([text])
        return calls[::-1]

    def is_number(self, word):
        """Whether a word is the name of a number of the program, and not of a function."""
        return word in self.given or MADE_UP.fullmatch(word) is not None
