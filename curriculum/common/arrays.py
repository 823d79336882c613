"""A program as numpy calls: one call an operation, done to whole arrays, into few buffers.

A buffer is used again as soon as nobody needs what is in it. So a dozen hold what a step needs,
they stay in the processor's cache, and nothing is allocated: that, and not arithmetic, is what
costs numpy its time.
"""

from curriculum.common.trace import FUNCTIONS, Call, Program

import numpy as np

CACHE = 1 << 16  # numbers in all buffers together
UFUNCS = {"+": "add", "-": "subtract", "*": "multiply", "/": "divide", "**": "power"}
UFUNCS |= {"abs": "absolute"} | {name: name for name in FUNCTIONS}
USED = [*UFUNCS.values(), "negative", "positive", "copyto", "logical_not"]
NAMES = {name: getattr(np, name) for name in USED}


class Writer:
    """Lines of numpy calls; `place`: in which buffer, argument or constant a name is found."""

    def __init__(self, inputs):
        self.lines, self.place, self.constants = [], {name: name for name in inputs}, {}
        self.free, self.buffers = [], []

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

    def give_back(self, names):
        """The buffers of values that nobody needs any more."""
        places = {self.place.get(x) for x in names}
        self.free += sorted(places & set(self.buffers) - set(self.free))

    def operations(self, tape, names, kept, targets):
        """The operations `names` of a tape, to buffers or `targets`.

        All but `kept` give their buffers back after use.
        """
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
                target = targets.get(name) or self.buffer()
                self.lines.append(
                    f"{UFUNCS[sign]}({', '.join(map(self.text, operands))}, {target})"
                )
                self.place[name] = target

    def call(self, call):
        """A routine's lines, written out."""
        tape, outer = call.tape, dict(self.place)
        given = []
        for name, symbol in zip(call.program.inputs, call.arguments, strict=True):
            self.place[name] = self.text(symbol.x)
            if symbol.minus:
                given.append(self.buffer())
                self.put(symbol, given[-1])
                self.place[name] = given[-1]
        names, made = tape.needed(call.made), {s.x for s in call.made}
        self.operations(tape, names, {*call.program.inputs, *made}, {})
        found = []
        for symbol in call.made:
            found.append(self.buffer())
            self.put(symbol, found[-1])
        self.give_back(x for x in made if x in tape.nodes)
        self.free += given
        self.place = outer | dict(zip(call.names, found, strict=True))

    def loop(self, loop):
        """A loop; members that are done keep their values, those that never are become NaN."""
        inner, wanted = loop.tape, [loop.size, *loop.following]
        kept = {*loop.names, *loop.taken, *(s.x for s in wanted)}
        test = inner.needed([loop.size])
        rest = [name for name in inner.needed(wanted) if name not in set(test)]
        for name, symbol in zip(loop.names, loop.start, strict=True):
            target = self.buffer()
            self.put(symbol, target)
            self.place[name] = target
        last = self.buffer() if loop.nearly > 1.0 else None
        self.lines += [f"{last}.fill(inf)"] * bool(last)
        done = f"done_{loop.names[0]}"
        self.lines += [f"{done} = False", f"for _ in range({loop.most}):"]
        begin = len(self.lines)
        self.operations(inner, test, kept | {x for name in rest for x in inner.nodes[name][1:]}, {})
        size = self.text(loop.size.x)
        size = f"(-{size})" if loop.size.minus else size
        self.lines.append(f"{done} = {done} | ({size} <= 1.0)")
        if last:
            self.lines.append(f"{done} |= ({last} <= {size}) & ({size} <= {loop.nearly!r})")
            self.lines.append(f"copyto({last}, {size})")
        self.lines += [f"if {done}.all():", "    break"]
        self.operations(inner, rest, kept, {})
        targets = [self.buffer() for _ in loop.names]
        for symbol, target in zip(loop.following, targets, strict=True):  # before any is replaced
            self.put(symbol, target)
        for name, target in zip(loop.names, targets, strict=True):
            self.lines.append(f"copyto({self.place[name]}, {target}, where=logical_not({done}))")
        self.free += targets + [last] * bool(last)
        self.lines[begin:] = [f"    {line}" for line in self.lines[begin:]]
        lost = [f"    copyto({self.place[x]}, nan, where=logical_not({done}))" for x in loop.names]
        self.lines += ["else:", *lost]
        self.give_back({s.x for s in wanted if s.x in inner.nodes})


class ArrayFunction:
    """A Program's function of arrays: call it with arrays for its inputs, and for its results.

    All have one shape; `knobs` are numbers.
    """

    def __init__(self, program):
        writer, nodes, targets = Writer([*program.inputs, *program.knobs]), program.tape.nodes, {}
        out = program.out
        for k, s in enumerate(out):
            if s.x in nodes and nodes[s.x][0] not in ("part", "of") and not s.minus:
                targets.setdefault(s.x, f"o{k}")
        kept = {*program.knobs, *program.inputs, *(s.x for s in out)}
        writer.operations(program.tape, program.tape.needed(out), kept, targets)
        for k, s in enumerate(out):
            writer.put(s, f"o{k}")
        outputs = [f"o{k}" for k in range(len(out))]
        names = [*program.inputs, *program.knobs, *outputs, *writer.buffers]
        space = NAMES | {name: np.array(x) for x, name in writer.constants.items()}
        space |= {"inf": np.inf, "nan": np.nan}
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
    """function(q, v) (N, 3), which is of one state, of each of q, v (..., N, 3).

    It is traced and done to all at once; if that gives something else, it is asked one by one.
    """
    if q.ndim == 2:
        return function(q, v)
    shape = q.shape[-2:]
    states = [x.reshape(-1, *shape) for x in (q, v)]
    given = list(zip(*states, strict=True))
    try:
        free = np.zeros(shape, dtype=bool)
        program = Program(lambda q, v: (np.broadcast_to(function(q, v), shape),), free, free)
        rows = np.empty((free.size, len(given)))
        inputs = np.concatenate([x.reshape(-1, free.size) for x in states], axis=1).T
        ArrayFunction(program)(list(np.ascontiguousarray(inputs)), list(rows))
        found = rows.T.reshape(-1, *shape)
        if all(np.allclose(found[k], function(*given[k]), 1e-9, 1e-12) for k in (0, -1)):
            return found.reshape(q.shape)
    except Exception:  # what is wrong with it shows below
        pass
    return np.reshape([np.broadcast_to(function(*state), shape) for state in given], q.shape)
