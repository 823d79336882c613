"""A tape: operations in the order in which a function did them, each with a name of its own.

What writes on it is in trace.py. What stands there already is not noted again.
"""

import gc
import math
from contextlib import contextmanager
from itertools import count
from threading import RLock, local

PRICE = 3  # calls of numpy take as long as it takes to compile an operation


class Untraceable(Exception):
    """The function asks of a symbol what cannot be written down; the message says what."""


class NoNumber(Untraceable):
    """A symbol was to be a plain number, say in an array of numbers."""


class TooLong(Untraceable):
    """To compile it would cost more than it saves."""


class Stop(ArithmeticError):
    """A run cannot go on; the message says why."""


class Current(local):
    """Of each thread: the tape that it writes, and a hand's force(q, v) (N, 3) in N, or None."""

    tape = hand = None

    def tapes(self):
        """The tapes whose numbers can be used: the one that is written, and those around it."""
        return self.tape.around if self.tape else ()


current = Current()


class Effort:
    """How much a trace has noted, and how much work that is in plain numpy.

    `noted`: operations written down. `numpy_calls`: in one use of what is traced, where loops and
    rows count as often as they turn. `uses`: how many are to come, a step's or a function's.
    `factor`: how often what is traced now turns in one.
    """

    def __init__(self):
        self.uses = math.inf
        self.begin()

    def begin(self):
        self.noted, self.numpy_calls, self.factor = 0, 0, 1

    def call(self):
        """One more call of numpy."""
        self.numpy_calls += self.factor

    def check(self):
        """Raise Untraceable where compiling what is `noted` would cost more than it saves."""
        if self.numpy_calls * self.uses < PRICE * self.noted:
            raise TooLong("it is too long to be compiled for so few steps")

    @contextmanager
    def repeated(self, times):
        """What is traced meanwhile is done so many times."""
        before, self.factor = self.factor, self.factor * times
        try:
            yield
        finally:
            self.factor = before


effort = Effort()  # of the one thread that traces


@contextmanager
def uncollected():
    """No garbage is looked for meanwhile: there is little, and a long tape to be looked through."""
    with Tape.lock:  # else two threads might each leave it as the other had it meanwhile
        before = gc.isenabled()
        try:
            gc.disable()
            yield
        finally:
            if before:
                gc.enable()


class Tape:
    """Operations in order, nodes {name: (sign, *operands)}; an operand is a name or a float.

    Three signs are no arithmetic: a "loop" and "calls" are parts, found in `parts`, whose operands
    are all that they need from this tape; and ("of", part) is one of the numbers that one makes.
    `outer`: the tape on which a loop or rows stand, whose names its body may use; `around`: this
    and all such. `open`: whether something is traced on it. `names`: what an operation is called
    that is there already. `numbers`, of new names, `refused`, why all this cannot be traced, and
    `knobs`, which are never zero, are those of the tapes around it, too. `settled`: {an input: its
    number} of those by which a branch may be decided, and `decided` [(node, whether it is true)].
    """

    lock = RLock()  # one thread traces at a time: what a function keeps is put back

    def __init__(self, outer=None):
        self.nodes, self.names, self.parts = {}, {}, {}
        self.outer, self.numbers, self.refused, self.knobs = outer, count(), [], ()
        self.around = (self, *outer.around) if outer else (self,)
        self.open = False
        self.settled, self.decided = {}, []
        if outer:
            self.numbers, self.refused, self.knobs = outer.numbers, outer.refused, outer.knobs

    def trace(self, function, *args):
        """function(*args), whose operations come onto this tape."""
        with Tape.lock:
            before, current.tape = current.tape, self
            if before is None:
                effort.begin()
            self.open = True
            try:
                return function(*args)
            finally:
                self.open, current.tape = False, before

    def add_part(self, part, operands, names):
        """Note a Loop or Calls, which makes numbers of these names."""
        name = f"part{next(self.numbers)}"
        self.parts[name] = part
        self.nodes[name] = part.sign, *operands
        self.nodes |= dict.fromkeys(names, ("of", name))

    def new_names(self, many):
        return [f"x{next(self.numbers)}" for _ in range(many)]

    def taken(self, symbols, inputs):
        """The names from around this tape that it uses, or that the symbols are; not its inputs."""
        needed = self.needed(symbols)
        used = [x for name in needed for x in self.nodes[name][1:]] + [s.x for s in symbols]
        mine = {*self.nodes, *inputs}
        return [x for x in dict.fromkeys(used) if isinstance(x, str) and x not in mine]

    def needed(self, symbols):
        """The names of the operations that the symbols come from, in order."""
        found, names = {s.x for s in symbols}, []
        for name, node in reversed(self.nodes.items()):
            if name in found:
                found.update(node)  # its sign is no name
                names.append(name)
        names.reverse()
        return names
