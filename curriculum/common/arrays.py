"""A program as numpy calls: one call an operation, done to whole arrays, into few buffers.

A buffer is used again as soon as nobody needs what is in it. So a dozen hold what a step needs,
they stay in the processor's cache, and nothing is allocated: that, and not arithmetic, is what
costs numpy its time.
"""

from curriculum.common.trace import FUNCTIONS, Call

import numpy as np

CACHE = 1 << 16  # numbers in all buffers together
UFUNCS = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide", "**": "power"}
UFUNCS |= {"abs": "absolute"} | {name: name for name in FUNCTIONS}
USED = [*UFUNCS.values(), "negative", "positive", "copyto", "logical_not", "inf", "nan"]
NAMES = {name: getattr(np, name) for name in USED}


class Writer:
    """Lines of numpy calls; `place`: in which buffer, argument or constant a name is found.

    `targets`: {name: where its value is wanted} of operations.
    """

    def __init__(self, inputs, targets):
        self.lines, self.constants, self.free, self.buffers = [], {}, [], []
        self.place, self.targets = {name: name for name in inputs}, targets

    def buffer(self):
        if not self.free:
            self.buffers.append(f"b{len(self.buffers)}")
            self.free.append(self.buffers[-1])
        return self.free.pop()

    def text(self, x):
        if isinstance(x, str):
            return self.place[x]
        return self.constants.setdefault(x, f"k{len(self.constants)}")

    def put(self, symbol, target):
        """Write a symbol's value, already computed, to `target`."""
        if symbol.minus or self.text(symbol.x) != target:
            sign = "negative" if symbol.minus else "positive"
            self.lines.append(f"{sign}({self.text(symbol.x)}, {target})")

    def copy(self, symbol):
        """A buffer with a symbol's value."""
        target = self.buffer()
        self.put(symbol, target)
        return target

    def give_back(self, names):
        """The buffers of values that nobody needs any more."""
        places = {self.place.get(x) for x in names}
        self.free += sorted(places & set(self.buffers) - set(self.free))

    def operations(self, tape, names, kept):
        """The operations `names` of a tape; all but `kept` give their buffers back after use."""
        users = [tape.nodes[name][1:] for name in names]
        last = {x: k for k, operands in enumerate(users) for x in operands if isinstance(x, str)}
        for k, name in enumerate(names):
            sign, *operands = tape.nodes[name]
            gone = [x for x in operands if last.get(x) == k and x not in kept]
            if sign == "part":
                part = tape.parts[name]
                (self.call if isinstance(part, Call) else self.loop)(part)
            self.give_back(gone)
            if sign not in ("part", "of"):
                self.place[name] = self.targets.get(name) or self.buffer()
                given = [*map(self.text, operands), self.place[name]]
                self.lines.append(f"{UFUNCS[sign]}({', '.join(given)})")

    def call(self, call):
        """A routine's lines, written out."""
        tape, outer, made = call.tape, dict(self.place), {s.x for s in call.made}
        given = dict(zip(call.program.inputs, call.arguments, strict=True))
        copies = {name: self.copy(symbol) for name, symbol in given.items() if symbol.minus}
        self.place |= {name: self.text(symbol.x) for name, symbol in given.items()} | copies
        self.operations(tape, tape.needed(call.made), {*given, *made})
        found = [self.copy(symbol) for symbol in call.made]
        self.give_back(made & set(tape.nodes))
        self.free += copies.values()
        self.place = outer | dict(zip(call.names, found, strict=True))

    def loop(self, loop):
        """A loop; members that are done keep their values, those that never are become NaN."""
        inner, wanted, last = loop.tape, [loop.size, *loop.following], self.buffer()
        kept = {*loop.names, *loop.taken, *(s.x for s in wanted)}
        test = inner.needed([loop.size])
        rest = [name for name in inner.needed(wanted) if name not in set(test)]
        places = [self.copy(symbol) for symbol in loop.start]
        self.place |= dict(zip(loop.names, places, strict=True))
        done = f"done_{loop.names[0]}"
        self.lines += [f"{last}.fill(inf)", f"{done} = False", f"for _ in range({loop.most}):"]
        begin = len(self.lines)
        self.operations(inner, test, kept | {x for name in rest for x in inner.nodes[name][1:]})
        size = f"{'-' * loop.size.minus}{self.text(loop.size.x)}"
        self.lines += [
            f"{done} = {done} | ({size} <= 1.0) | (({last} <= {size}) & ({size} <= {loop.nearly}))",
            f"copyto({last}, {size})",
            f"if {done}.all():",
            "    break",
        ]
        self.operations(inner, rest, kept)
        following = [self.copy(symbol) for symbol in loop.following]  # before any is replaced
        for place, target in zip(places, following, strict=True):
            self.lines.append(f"copyto({place}, {target}, where=logical_not({done}))")
        self.free += [*following, last]
        self.lines[begin:] = [f"    {line}" for line in self.lines[begin:]]
        lost = [f"    copyto({place}, nan, where=logical_not({done}))" for place in places]
        self.lines += ["else:", *lost]
        self.give_back({s.x for s in wanted} & set(inner.nodes))


class ArrayFunction:
    """A Program's function of arrays: call it with arrays for its inputs, and for its results.

    All have one shape; `knobs` are numbers.
    """

    def __init__(self, program):
        out, nodes = program.out, program.tape.nodes
        given, results = [*program.inputs, *program.knobs], [f"o{k}" for k in range(len(out))]
        targets = {}
        for s, result in zip(out, results, strict=True):
            if nodes.get(s.x, ["of"])[0] not in ("part", "of") and not s.minus:
                targets.setdefault(s.x, result)
        writer = Writer(given, targets)
        writer.operations(program.tape, program.tape.needed(out), {*given, *(s.x for s in out)})
        for s, result in zip(out, results, strict=True):
            writer.put(s, result)
        names = [*given, *results, *writer.buffers]
        space = NAMES | {name: np.array(x) for x, name in writer.constants.items()}
        exec(f"def f({', '.join(names)}):\n    " + "\n    ".join(writer.lines or ["pass"]), space)
        self.function, self.count, self.buffers = space["f"], len(writer.buffers), {}

    def members(self):
        """How many entries to do at once, so that what is in the buffers stays in the cache."""
        return max(256, CACHE // max(1, self.count))

    def __call__(self, inputs, results, *knobs):
        shape = results[0].shape
        if shape not in self.buffers:
            self.buffers = {shape: [np.empty(shape) for _ in range(self.count)]}
        self.function(*inputs, *knobs, *results, *self.buffers[shape])


def each_state(function, q, v):
    """function(q, v) (N, 3), which is of one state, of each of q, v (..., N, 3)."""
    shape = q.shape[-2:]
    states = zip(q.reshape(-1, *shape), v.reshape(-1, *shape), strict=True)
    return np.reshape([np.broadcast_to(function(*state), shape) for state in states], q.shape)
