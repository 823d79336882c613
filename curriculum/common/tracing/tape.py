"""A tape: operations in the order in which a function did them, each with a name of its own."""

from contextlib import contextmanager
from itertools import count
from threading import local


class Untraceable(Exception):
    """The function asks of a symbol what cannot be written down; the message says what."""


class StepFailed(ArithmeticError):
    """A step has no result; the message says why."""


class Current(local):
    """In this thread: the tape that is being written, and whether nothing is to be compiled."""

    tape = None
    plain = False


current = Current()


@contextmanager
def plain(really=True):
    """A block in which nothing is compiled: every line of a function meets numbers."""
    before, current.plain = current.plain, current.plain or really
    try:
        yield
    finally:
        current.plain = before


class Tape:
    """Operations in order: nodes {name: (sign, *operands)}; an operand is a name or a float.

    The sign "given" is of what comes from elsewhere, and a Loop is its own. ("stack", *operands) is
    one name for a number in each of several `rows`, and ("lane", name, k) the one in row k.
    """

    def __init__(self, outer=None, used=()):
        self.nodes, self.known, self.outer = {}, {}, outer  # outer: around this one, a loop's body
        self.numbers, self.used, self.rows = count(), {*used}, 1
        if outer:
            self.numbers, self.used, self.rows = outer.numbers, outer.used, outer.rows

    def trace(self, function, *args):
        """function(*args), whose operations come onto this tape."""
        before, current.tape = current.tape, self
        try:
            return function(*args)
        finally:
            current.tape = before

    def note(self, sign, *operands):
        """The name of an operation: reused if the operation is there already."""
        if self.outer and not any(x in self.nodes for x in operands):
            return self.outer.note(sign, *operands)  # the same in every turn: done once
        key = (sign, *operands)
        name = self.known.get(key)
        if name is None and sign in "+*":
            name = self.known.get((sign, *operands[::-1]))
        if name is None:
            name = self.known[key] = f"t{next(self.numbers)}"
            self.nodes[name] = key
        return name

    def fresh(self, name):
        """The name, with a number if it is in use: q, q2, q3."""
        found, number = name, 2
        while found in self.used:
            found, number = f"{name}{number}", number + 1
        self.used.add(found)
        return found

    def needed(self, names):
        """Those and the operations that they come from, in order."""
        found, order = {*names}, []
        for name, node in reversed(self.nodes.items()):
            if name in found or getattr(node[0], "failure", None):  # which may end the run
                found.update(node[1:])
                order.append(name)
        return order[::-1]
