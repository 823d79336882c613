"""A tape: operations in the order in which a function did them, each with a name of its own."""

import gc
import os
import traceback
from contextlib import contextmanager
from threading import local
from typing import NamedTuple

import numpy as np

INSIDE = os.path.dirname(__file__), os.path.dirname(np.__file__)
MANY = 10**9  # names of a tape: a range, as Python 3.14 pickles no itertools.count


class Untraceable(Exception):
    """The function asks of a symbol what cannot be written down; the message says what."""


class NotAState(TypeError):
    """A step returns other arrays than a state has; the message says which."""


class StepChanged(Exception):
    """A step does not depend on its arguments alone; the message says what to do."""


class Current(local):
    """Of this thread: the tape that is written, if nothing is to be compiled, what has failed.

    A thread that begins to work while a block of `plain` is open works plainly, too.
    """

    tape = None
    blocks = []  # of all threads, those of `plain` that are open
    alike = None  # in a block, whether its steps are machine code: [], as soon as one is, [answer]
    failure = None  # of the first loop that did not end, since a step began

    def __init__(self):
        self.plain = bool(self.blocks)


current = Current()


@contextmanager
def plain(really=True):
    """A block in which nothing is compiled: every line of a function meets numbers.

    If not `really`, all that is compiled in it is of one kind, that of the first: Python or machine
    code. So what steps take in the same block can be compared.
    """
    before = current.plain, current.alike
    current.plain = current.plain or really
    current.alike = [] if current.alike is None else current.alike
    opened = [True] * current.plain
    current.blocks.extend(opened)
    try:
        yield
    finally:
        del current.blocks[: len(opened)]
        current.plain, current.alike = before


@contextmanager
def collector_off():
    """A block that makes many objects which stay: Python does not look them through for garbage."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()


class Op(NamedTuple):
    """An operation on operands, each a name or a float; "input" and "carried" are not computed."""

    sign: str
    operands: tuple = ()


class Tape:
    """Operations in order: nodes {name: Op or Loop}, in so many `rows` side by side."""

    def __init__(self, outer=None, used=()):
        self.nodes = {}
        self.known = {}  # {(sign, operands): name}
        self.outer = outer  # the tape around this one, which is of a loop's body
        self.numbers = outer.numbers if outer else iter(range(MANY))  # of the names that it gives
        self.used = outer.used if outer else {*used}  # other names
        self.signs = outer.signs if outer else set()  # of all operations
        self.refused = outer.refused if outer else []  # what could not be written, in words
        self.rows = outer.rows if outer else 1
        self.lines = 0  # of Python, a few too many: an operation has one for each row

    def trace(self, function, *args):
        """What a function gives while its operations are noted here."""
        before = current.tape
        current.tape = self
        try:
            return function(*args)
        finally:
            current.tape = before

    def note(self, sign, *operands):
        """The name of an operation: reused if the operation is there already."""
        if self.outer and self.nodes.keys().isdisjoint(operands):
            return self.outer.note(sign, *operands)  # the same in every turn: done once
        name = self.known.get((sign, operands))
        if name is None and sign in "+*":
            name = self.known.get((sign, operands[::-1]))
        if name is None:
            name = f"t{next(self.numbers)}"
            self.nodes[name] = Op(sign, operands)
            self.known[sign, operands] = name
            self.signs.add(sign)
            self.lines += self.rows
        return name

    def fresh(self, name):
        """The name, with a number if it is in use: q, q2, q3."""
        found = name
        number = 2
        while found in self.used:
            found = f"{name}{number}"
            number += 1
        self.used.add(found)
        return found

    def needed(self, names):
        """Those and the operations that they come from, in order."""
        found = {*names}
        order = []
        for name, node in reversed(self.nodes.items()):
            if name in found:
                found.update(node.operands)
                order.append(name)
        return order[::-1]


def note(sign, *operands):
    """The name of an operation on the tape that is being written."""
    tape = current.tape
    if tape is None:  # a symbol outlived its tape
        raise StepChanged(
            "a step keeps something from call to call, so it cannot be compiled: "
            "run it plainly (--plain, or `with plain():`)"
        )
    return tape.note(sign, *operands)


def refuse(why):
    """Raise Untraceable, and mark the tape: a reader's `except` may take the error."""
    tape = current.tape
    if tape is not None and not tape.refused:
        tape.refused.append(in_line(why, traceback.extract_stack()))
    raise Untraceable(why)


def in_line(why, frames):
    """A reason, and in which line of the reader's it is the last of so many frames."""
    theirs = [x for x in frames if not x.filename.startswith(INSIDE)]
    if not theirs:
        return why
    return f"{why} ({os.path.basename(theirs[-1].filename)}, line {theirs[-1].lineno})"
