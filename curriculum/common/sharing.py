"""Forces that differ by a few numbers, traced once for all of them."""

from collections import deque, namedtuple
from itertools import count

from curriculum.common.programs import Routine
from curriculum.common.tape import Tape, TooLong, Untraceable, current, effort
from curriculum.common.trace import holds

import numpy as np

LENGTHY = 1000  # numbers of a state: the trace of fewer is soon made
SERIAL = count()  # of such traces: no name of one may be one of another

OPERATORS = {"__eq__", "__hash__", "__repr__", "__bool__", "__len__", "__iter__", "__contains__"}
OPERATORS |= {"__getitem__", "__call__", "__setattr__", "__delattr__"}

# a force, the shapes it was given and where they were zeros, what it became, that one's calls of
# numpy, and all that it could reach, as it was
Kept = namedtuple("Kept", "force given program calls memory")


def stand_in(x, **known):
    """An object of x's class, as far as isinstance tells, of which no more than this is known. Who
    wants more of it, if only to see whether it is there, or changes it, cannot be traced with it.
    """
    known["__class__"] = type(x)

    def refuse(*_):
        current.tape.refused.append("it asks for more than numbers")  # should the force catch this
        raise Untraceable(current.tape.refused[-1])

    def ask(_, name):
        return known[name] if name in known else refuse()

    return type("", (), dict.fromkeys(OPERATORS, refuse) | {"__getattribute__": ask})()


class Shared(Routine):
    """The routine of a force(q, v), which may be that of an earlier one with other numbers.

    Forces with the same `system` may differ by numbers of their `hold`: its fields that are
    declared as floats. Where states are long, a force is traced with these as inputs, and they are
    put in then. That will do for all forces with which comparisons of such numbers come out alike,
    while nothing changes that the first one could reach. A force that asks anything else of itself
    is traced by itself, and so is one with a loop in it.
    """

    recent = deque(maxlen=4)

    def __init__(self, force, memory):
        super().__init__(force)
        self.memory, self.made = memory, []  # what the force can reach, as it was; to be kept
        hold = getattr(force, "hold", None)
        kinds = getattr(type(hold), "__annotations__", {})
        self.names = [name for name, kind in kinds.items() if kind is float]
        given = [getattr(hold, name, None) for name in self.names]
        floats = all(type(x) in (float, np.float64) for x in given)
        self.shares = bool(self.names) and floats and hasattr(force, "system")
        # Python's own, as on all tapes
        self.numbers = list(map(float, given)) if self.shares else []

    def program(self, shapes, still):
        kept = None
        if self.shares and sum(map(len, still)) >= LENGTHY:
            near = [kept for kept in self.recent if self.near(kept, (shapes, still))]
            kept = next(filter(self.fits, near), None)
            if not near:  # one of another kind may stay the only one of its kind
                kept = self.general(shapes, still)
        if kept is None:
            return super().program(shapes, still)
        effort.numpy_calls += effort.factor * kept.calls
        return kept.program.with_numbers(self.by_name(kept.program))

    def general(self, shapes, still):
        """What can be kept: the force with any numbers, as far as it branches alike; or None."""
        tape, before, serial = Tape(), effort.numpy_calls, next(SERIAL)
        tape.numbers = (f"{serial}_{k}" for k in count())
        many = len(self.numbers)
        given = [*shapes, (many,)], [*still, (False,) * many]  # none is zero for certain
        try:
            program = self.traced(self.of_numbers, *given, tape)
        except TooLong:
            raise
        except Exception:  # a mistake of the reader's shows once more
            program = None
        calls, effort.numpy_calls = effort.numpy_calls - before, before
        self.shares = program is not None and not tape.parts
        if self.shares:
            there = self.function, (shapes, still)
            self.made.append(Kept(*there, program, calls // effort.factor, self.memory))
            return self.made[-1]
        changed = self.memory.changed()  # else it would go on from there
        if changed:
            raise Untraceable(f"it changes {changed}")
        return None

    def of_numbers(self, q, v, numbers):
        """The force, if it asks for nothing but its system and these numbers of its hold."""
        current.tape.settled = dict(zip((s.x for s in numbers), self.numbers, strict=True))
        force = self.function
        hold = stand_in(force.hold, **dict(zip(self.names, numbers, strict=True)))
        itself = stand_in(force, system=force.system, hold=hold)
        return type(force).__call__(itself, q, v)

    def by_name(self, program):
        """{the name of an input: its number here}."""
        return dict(zip(program.inputs[-len(self.numbers) :], self.numbers, strict=True))

    def near(self, kept, given):
        """Whether what is kept differs from this force by numbers alone."""
        other, force = kept.force, self.function
        same = type(other) is type(force) and type(other.hold) is type(force.hold)
        same = same and other.system is force.system and kept.given == given
        return same and not kept.memory.changed()

    def fits(self, kept):
        """Whether with the numbers of this force it branches as it did."""
        numbers = self.by_name(kept.program)
        return all(holds(node, numbers) is true for node, true in kept.program.tape.decided)

    def keep(self):
        """Let later forces use what was traced, while all is as it was."""
        self.recent.extend(self.made)
