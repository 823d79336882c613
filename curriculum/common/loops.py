"""A loop that ends when it is done, in a function that may be unrolled: on symbols it becomes a
loop of the code."""

from curriculum.common.python import write
from curriculum.common.trace import Symbol, Tape, Untraceable

import numpy as np


def repeat(body, x, most, complaint):
    """The first of x, body's x, ... whose size is at most 1, where body(x) = (following, size).

    x: an array; size: a number (or one a leading axis: the largest counts).
    FloatingPointError(complaint) after `most`.
    """
    for _ in range(most):
        following, size = body(x)
        if type(size) is Symbol:
            return Loop(
                body, np.vectorize(size.lift, otypes=[object])(x), most, complaint, size.tape
            ).result
        if np.all(size <= 1.0):
            return x
        x = following
    raise FloatingPointError(complaint)


class Loop:
    """A loop on a tape: `names` begin as `start`; until `size` <= 1 they become what `following`
    says."""

    def __init__(self, body, x, most, complaint, outer):
        self.most, self.complaint, self.inner = most, complaint, Tape(outer)
        places = [place for place in np.ndindex(x.shape) if x[place].x != 0.0]
        self.start, self.names = (
            [x[place] for place in places],
            [f"x{next(outer.numbers)}" for _ in places],
        )

        def with_names(tape):
            array = x.copy()
            for place, name in zip(places, self.names, strict=True):
                array[place] = Symbol(tape, name)
            return array

        following, self.size = body(with_names(self.inner))
        following = np.vectorize(self.size.lift, otypes=[object])(following)
        if any(following[place].x != 0.0 for place in np.ndindex(x.shape) if place not in places):
            raise Untraceable("a number that is zero when a loop begins does not stay zero")
        self.following, self.result = [following[place] for place in places], with_names(outer)
        inside = [y for node in self.inner.nodes.values() for y in node[1:]]
        inside += [s.x for s in (self.size, *self.following)]
        outside = (
            y
            for y in inside
            if isinstance(y, str) and y not in self.inner.nodes and y not in self.names
        )
        self.taken = list(dict.fromkeys(outside))
        name = f"loop{next(outer.numbers)}"
        outer.loops[name] = self
        outer.nodes[name] = (
            "loop",
            *(s.x for s in self.start),
            *self.taken,
            *self.taken,
        )  # twice: not to be inlined
        outer.nodes |= dict.fromkeys(self.names, ("of", name))

    def lines(self, text):
        """The loop in Python, on numbers; `text`(symbol) is an expression for what is computed
        before it."""
        (test, (size,)), (rest, following) = write(self.inner, [self.size], self.following)
        names = ", ".join(self.names)
        yield f"{names}, = {', '.join(map(text, self.start))},"
        yield f"for _ in range({self.most}):"
        yield from (f"    {line}" for line in [*test, f"if {size} <= 1.0:", "    break", *rest])
        yield f"    {names}, = {', '.join(following)},"
        yield from ("else:", f"    raise FloatingPointError({self.complaint!r})")

    def write_arrays(self, writer):
        """The loop on arrays, by a Writer of arrays.py: who is done waits for the others."""
        inner, wanted = self.inner, [self.size, *self.following]
        kept = {*self.names, *self.taken, *(s.x for s in wanted)}
        early, needed = inner.ancestry([self.size]), inner.ancestry(wanted)
        test = [name for name in inner.nodes if name in early]
        rest = [name for name in inner.nodes if name in needed and name not in early]
        for name, symbol in zip(self.names, self.start, strict=True):
            target = writer.buffer()
            writer.put(symbol, target)
            writer.place[name] = target
        writer.lines.append(f"for _ in range({self.most}):")
        begin, sign = len(writer.lines), "-" * self.size.minus
        writer.operations(
            inner, test, kept | {x for name in rest for x in inner.nodes[name][1:]}, {}
        )
        writer.lines += [
            f"done = {sign}{writer.text(self.size.x)} <= 1.0",
            "if done.all():",
            "    break",
        ]
        writer.operations(inner, rest, kept, {})
        writer.lines.append("more = logical_not(done)")
        targets = [writer.buffer() for _ in self.names]
        for symbol, target in zip(
            self.following, targets, strict=True
        ):  # all of them before any is replaced
            writer.put(symbol, target)
        for name, target in zip(self.names, targets, strict=True):
            writer.lines.append(f"copyto({writer.place[name]}, {target}, where=more)")
        writer.free += targets
        writer.lines[begin:] = [f"    {line}" for line in writer.lines[begin:]]
        writer.lines += ["else:", f"    raise FloatingPointError({self.complaint!r})"]
        writer.free += sorted({writer.place[s.x] for s in wanted if s.x in inner.nodes})
