"""What a program does to numbers, done to whole arrays of them: one numpy call an operation, into
few buffers.

A buffer is used again as soon as nobody needs what is in it. So a dozen hold what a step needs,
they stay in the processor's cache, and nothing is allocated: that, and not arithmetic, is what
costs numpy its time.
"""

from curriculum.common.trace import FUNCTIONS

import numpy as np

CACHE = 1 << 16  # numbers in all buffers together
UFUNCS = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    "**": "power",
    "abs": "absolute",
}
UFUNCS |= {name: name for name in FUNCTIONS}
NAMES = {
    name: getattr(np, name)
    for name in [*UFUNCS.values(), "negative", "positive", "copyto", "logical_not"]
}


def leading_first(a, axes):
    """The array with its first `axes` axes last: a view."""
    return a.transpose(*range(axes, a.ndim), *range(axes))


class Writer:
    """Lines of numpy calls; `place`: in which buffer, argument or constant each name on the tape is
    found."""

    def __init__(self, inputs):
        self.lines, self.place, self.constants = [], {name: name for name in inputs}, {}
        self.free, self.buffers = [], []

    def buffer(self):
        if not self.free:
            self.buffers.append(f"b{len(self.buffers)}")
            self.free.append(self.buffers[-1])
        return self.free.pop()

    def text(self, x):
        return (
            self.place[x]
            if isinstance(x, str)
            else self.constants.setdefault(x, f"k{len(self.constants)}")
        )

    def put(self, symbol, target):
        """Write a symbol's value, already computed, to `target`."""
        if symbol.minus or self.text(symbol.x) != target:
            self.lines.append(
                f"{'negative' if symbol.minus else 'positive'}({self.text(symbol.x)}, {target})"
            )

    def operations(self, tape, names, kept, targets):
        """The operations `names` of a tape, to buffers or `targets`; all but `kept` give theirs
        back after use."""
        users = [tape.nodes[name][1:] for name in names]
        last = {x: k for k, operands in enumerate(users) for x in operands if isinstance(x, str)}
        for k, name in enumerate(names):
            sign, *operands = tape.nodes[name]
            gone = {self.place.get(x) for x in operands if last.get(x) == k and x not in kept}
            if sign == "loop":
                tape.loops[name].write_arrays(self)
            self.free += sorted(gone & set(self.buffers))
            if sign not in ("loop", "of"):
                target = targets.get(name) or self.buffer()
                self.lines.append(
                    f"{UFUNCS[sign]}({', '.join(map(self.text, operands))}, {target})"
                )
                self.place[name] = target


class ArrayFunction:
    """A Program's function of arrays: call it with lists of arrays, its inputs and its results, all
    of one shape."""

    def __init__(self, program):
        writer, nodes, targets = Writer(program.inputs), program.tape.nodes, {}
        results = [s for a in program.results for s in a.flat]
        for k, s in enumerate(results):
            if s.x in nodes and nodes[s.x][0] not in ("loop", "of") and not s.minus:
                targets.setdefault(s.x, f"o{k}")
        needed = program.tape.ancestry(results)
        order = [name for name in nodes if name in needed]
        writer.operations(program.tape, order, {s.x for s in results}, targets)
        for k, s in enumerate(results):
            writer.put(s, f"o{k}")
        names = [*program.inputs, *(f"o{k}" for k in range(len(results))), *writer.buffers]
        space = NAMES | {name: np.array(x) for x, name in writer.constants.items()}
        exec(f"def f({', '.join(names)}):\n    " + "\n    ".join(writer.lines or ["pass"]), space)
        self.function, self.count, self.buffers = space["f"], len(writer.buffers), {}

    def members(self):
        """How many entries to do at once, so that what is in the buffers stays in the cache."""
        return max(256, CACHE // max(1, self.count))

    def __call__(self, inputs, results):
        shape = results[0].shape
        if shape not in self.buffers:
            self.buffers = {shape: [np.empty(shape) for _ in range(self.count)]}
        self.function(*inputs, *results, *self.buffers[shape])
