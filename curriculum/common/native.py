"""A program as machine code: the operations of the tape, in their order, so the same bits.

`lanes` members go in step in one vector register: the type is all that changes.
"""

from collections import namedtuple
from itertools import chain

from curriculum.common.llvm import POINTER, WORD, Function, machine_code
from curriculum.common.programs import INLINE, Calls
from curriculum.common.trace import Symbol

import numpy as np

LANES = 16  # doubles: two or four vector registers, which is what keeps a processor busy
LONG = 5000  # operations in a row: for more LLVM's best takes minutes, a time that grows as squares
TURNS = 10_000  # steps of groups in a call, which Ctrl-C does not reach
ENDED = "@ended"  # of a single member: whether all loops have

GIVEN = "ptr noalias {}, i64 %count, ptr noalias {}, i64 %apart, "
GIVEN += "ptr noalias %knobs, ptr noalias %ended"
ONE, ALL = GIVEN.format("%state", "%out"), GIVEN.format("%states", "%outs")
GROUPS = f"""
{ENDED} = internal global i1 false, align 8
define i64 @run({ALL}, i64 %members) {{{{
top:
  br label %next
next:
  %first = phi i64 [ 0, %top ], [ %after, %next ]
  %state = getelementptr double, ptr %states, i64 %first
  %out = getelementptr double, ptr %outs, i64 %first
  %done = call i64 @group({ONE})
  %after = add i64 %first, {{lanes}}
  %more = icmp slt i64 %after, %members
  br i1 %more, label %next, label %end
end:
  ret i64 %done
}}}}
"""

# a number in a vector, of which the first `many` count
Lane = namedtuple("Lane", "type vector number many")


class Writer(Function):
    """What a tape does, as lines of a function, and the `routines` {name: lines} that it calls.

    `alone`: of one member; else its lanes are members.
    """

    def __init__(self, lanes, routines, alone):
        super().__init__(lanes)
        self.routines, self.alone = routines, alone

    def widened(self, many):
        """A writer of the same lines whose values have at least `many` lanes; of one: this."""
        if many == 1:
            return self
        wide = Writer(max(4, 1 << (many - 1).bit_length()), self.routines, self.alone)
        wide.top, wide.lines, wide.count = self.top, self.lines, self.count
        return wide

    def value(self, env, s):
        """The value of a Symbol, a name or a number; `env` {name: value, or a Lane}."""
        x, minus = (s, False) if isinstance(s, (str, float)) else (s.x, s.minus)
        if isinstance(x, float):
            return self.constant(-x if minus else x)
        value = env[x]
        if isinstance(value, Lane):
            value = self.new(f"extractelement {value.type} {value.vector}, i32 {value.number}")
        return self.new(f"fneg {self.type} {value}") if minus else value

    def gathered(self, wide, env, symbols):
        """A value for the writer `wide`: of symbols, and copies of the last, which fill it up."""
        if wide is self:
            return self.value(env, symbols[0])
        lanes = [None if s.minus else env.get(s.x) for s in symbols]
        if all(isinstance(x, Lane) for x in lanes) and len({x.vector for x in lanes}) == 1:
            kind, made, _, many = lanes[0]
            numbers = [x.number for x in lanes]
            if numbers == [*range(many)]:
                return made
        else:
            kind, made, numbers = wide.type, "poison", [*range(len(symbols))]
            values = [f"double {self.value(env, s)}" for s in symbols]
            if all(isinstance(s.x, float) for s in symbols):
                return f"<{', '.join(values + values[-1:] * (wide.lanes - len(values)))}>"
            for k, value in enumerate(values):
                made = self.new(f"insertelement {kind} {made}, {value}, i32 {k}")
        numbers += numbers[-1:] * (wide.lanes - len(numbers))
        mask = f"<{wide.lanes} x i32> <{', '.join(f'i32 {k}' for k in numbers)}>"
        return self.new(f"shufflevector {kind} {made}, {kind} poison, {mask}")

    def spread(self, vector, many):
        """The `many` numbers that were gathered in it."""
        return [Lane(self.type, vector, k, many) for k in range(many)] if many > 1 else [vector]

    def operations(self, tape, names, env):
        """Operations of a tape; `env` {name: value} learns what they make."""
        for name in names:
            sign, *operands = tape.nodes[name]
            if name in tape.parts:
                getattr(self, sign)(tape.parts[name], env)
            elif sign != "of":
                env[name] = self.operation(sign, [self.value(env, x) for x in operands])

    def inlined(self, program, env):
        """What a program makes, written out; `env` has its inputs."""
        self.operations(program.tape, program.tape.needed(program.computed), env)
        return [self.value(env, s) for s in program.computed]

    def routine(self, program, given):
        """The same by a call: it finds its arguments in memory, and leaves its results there."""
        name, many = f"@r{id(program)}_{self.lanes}", len(program.computed)
        if name not in self.routines:
            w = Writer(self.lanes, self.routines, self.alone)
            inner = {x: w.load(w.entry("%in", k)) for k, x in enumerate(program.inputs)}
            for k, value in enumerate(w.inlined(program, inner)):
                w.store(value, w.entry("%out", k))
            inline = "alwaysinline" if len(program.tape.nodes) <= INLINE else "noinline"
            head = f"internal void {name}(ptr noalias %in, ptr noalias %out) {inline}"
            self.routines[name] = w.function(head, "void")
        arguments, place = self.memory(self.type, len(given)), self.memory(self.type, many)
        for k, value in enumerate(given):
            self.store(value, self.entry(arguments, k))
        self.lines.append(f"  call void {name}(ptr {arguments}, ptr {place})")
        return [self.load(self.entry(place, k)) for k in range(many)]

    def pieces(self, many):
        """So many rows in pieces, one a vector, about equally long; of one if lanes are members."""
        vectors = -(-many // LANES)
        size = -(-many // vectors) if self.lanes == 1 else 1
        return [slice(k, k + size) for k in range(0, many, size)]

    def calls(self, calls, env):
        """One is of a routine; rows are lanes of vectors or, where lanes are members, in turn."""
        program = calls.program
        for piece in self.pieces(len(calls.rows)):
            wide = self.widened(len(calls.rows[piece]))
            columns = zip(*calls.rows[piece], strict=True)
            given = [self.gathered(wide, env, column) for column in columns]
            if len(calls.rows) == 1:
                made = self.routine(program, given)
            else:
                inner = {x: self.gathered(wide, env, [Symbol(None, x)]) for x in calls.taken}
                made = wide.inlined(program, inner | dict(zip(program.inputs, given, strict=True)))
            for value, names in zip(made, zip(*calls.names[piece], strict=True), strict=True):
                env |= zip(names, wide.spread(value, len(names)), strict=True)

    def loop(self, loop, env):
        """A loop; lanes that are done keep their values, those that never are become NaN."""
        k, carried = next(self.count), Carried(self, loop, env)
        turn, done = self.variable("0", "i64"), self.variable("zeroinitializer", self.truth)
        self.begin(f"head{k}")
        before, values = self.load(done, self.truth), carried.load()
        inner = env | carried.named(values)
        self.operations(loop.tape, loop.test, inner)
        size = self.value(inner, loop.size)
        small = self.new(f"fcmp ole {self.type} {size}, {self.constant(1.0)}")
        good = self.new(f"or {self.truth} {small}, {before}")
        self.store(good, done, self.truth)
        ready = self.reduced("and", good)
        self.begin(f"body{k}", f"i1 {ready}, label %end{k}, label %body{k}")
        self.operations(loop.tape, loop.rest, inner)
        carried.follow(good, values, inner)
        turns = self.new(f"add i64 {self.load(turn, 'i64')}, 1")
        self.store(turns, turn, "i64")
        more = self.new(f"icmp slt i64 {turns}, {loop.most}")
        self.begin(f"end{k}", f"i1 {more}, label %head{k}, label %end{k}")
        good = self.load(done, self.truth)
        env |= carried.named(carried.ends(good))
        if self.alone:
            ended = self.new(f"and i1 {self.load(ENDED, 'i1')}, {self.reduced('and', good)}")
            self.store(ended, ENDED, "i1")


class Carried:
    """What a loop carries from turn to turn: numbers in memory, in `groups` of names.

    A group is one vector, of all rows of Calls or of a piece of them; or else a single number.
    """

    def __init__(self, writer, loop, env):
        self.writer, self.loop, self.groups = writer, loop, self.grouped(writer, loop)
        self.wide = [writer.widened(len(group)) for group in self.groups]  # what writes each
        self.places = list(map(Writer.variable, self.wide, self.values(env, loop.start)))

    @staticmethod
    def grouped(writer, loop):
        """The names that a loop changes, in groups."""
        following = zip(loop.names, loop.following, strict=True)
        at = {s.x: name for name, s in following if not s.minus}
        rows = [part.names for part in loop.tape.parts.values() if isinstance(part, Calls)]
        pieces = [names[piece] for names in rows for piece in writer.pieces(len(names))]
        columns = (column for piece in pieces for column in zip(*piece, strict=True))
        groups = [[at[x] for x in column] for column in columns if at.keys() >= {*column}]
        alone = {*loop.names}.difference(*groups)
        return groups + [[name] for name in loop.names if name in alone]

    def values(self, env, symbols):
        """A value for each group, of a symbol for each name."""
        at = dict(zip(self.loop.names, symbols, strict=True))
        return [
            self.writer.gathered(wide, env, [at[name] for name in group])
            for wide, group in zip(self.wide, self.groups, strict=True)
        ]

    def named(self, values):
        """The numbers of the groups' values, by name."""
        numbers = map(Writer.spread, self.wide, values, map(len, self.groups))
        return dict(zip(chain(*self.groups), chain(*numbers), strict=True))

    def load(self):
        """The groups' values, as they are in memory."""
        return list(map(Writer.load, self.wide, self.places))

    def follow(self, good, values, env):
        """Store what follows these values, but keep those of lanes that are `good`."""
        following = self.values(env, self.loop.following)
        for wide, place, old, new in zip(self.wide, self.places, values, following, strict=True):
            wide.store(self.writer.choice(good, wide.type, old, new), place)

    def ends(self, good):
        """The groups' values in the end: NaN in lanes that are not `good`."""
        return [
            self.writer.choice(good, wide.type, wide.load(place), wide.constant(np.nan))
            for wide, place in zip(self.wide, self.places, strict=True)
        ]


def assembly(program, lanes):
    """i64 run(states, count, outs, apart, knobs, ended, members): see Native. knobs (knobs, lanes).

    `apart`: numbers from entry to entry. `ended`: 1, or 0 if a loop came to no end. Of all states
    out may be null.
    """
    w, many, whole = Writer(lanes, {}, lanes == 1), len(program.inputs), len(program.out)
    found = [("%state", k) for k in range(many)] + [("%out", k) for k in range(whole - many)]
    ends = [w.entry(x, w.new(f"mul i64 %apart, {k}"), "double") for x, k in found]
    places = [w.variable(w.load(end)) for end in ends]
    done = w.variable("0", "i64")
    env = {knob: w.load(w.entry("%knobs", k)) for k, knob in enumerate(program.knobs)}
    w.store("true", ENDED, "i1")
    w.begin("step")
    before = w.load(done, "i64")
    env |= zip(program.inputs, map(w.load, places[:many]), strict=True)
    w.operations(program.tape, program.tape.needed(program.out), env)
    out = [w.value(env, s) for s in program.out]
    for k, (value, place) in enumerate(zip(out, places, strict=True)):
        w.store(value if k < many else w.operation("max", [w.load(place), value]), place)
    good = w.load(ENDED, "i1") if lanes == 1 else "true"
    for value in out[:many] if lanes == 1 else ():
        good = w.new(f"and i1 {good}, {w.finite(value)}")
    after = w.new(f"add i64 {before}, {w.new(f'zext i1 {good} to i64')}")
    w.store(after, done, "i64")
    if lanes == 1 and whole == many:
        silent = w.new("icmp eq ptr %out, null")  # only the end is wanted
        w.begin("write", f"i1 {silent}, label %next, label %write")
        row = w.new(f"mul i64 {before}, {many}")
        for k, value in enumerate(out):
            w.store(value, w.entry("%out", w.new(f"add i64 {row}, {k}"), "double"))
        w.begin("next")
    more = w.new(f"icmp slt i64 {after}, %count")
    more = w.new(f"and i1 {more}, {good}")
    w.begin("end", f"i1 {more}, label %step, label %end")
    for place, end in zip(places, ends, strict=True):
        w.store(w.load(place), end)
    w.store(w.new(f"zext i1 {w.load(ENDED, 'i1')} to i64"), "%ended", "i64")
    group = w.function(f"internal i64 @group({ONE})", f"i64 {w.load(done, 'i64')}")
    return "\n".join([*group, *chain(*w.routines.values()), GROUPS.format(lanes=lanes)])


class Native:
    """A Program's function, iterated: call it with where to begin, and how many times.

    `lanes` members go in step, others one after the other. `best`: LLVM optimizes it, unless it is
    LONG; else the code is made many times sooner, and may be the `best` there is. Raises
    Unavailable.
    """

    def __init__(self, program, lanes=1, best=True):
        arguments = POINTER, WORD, POINTER, WORD, POINTER, POINTER, WORD
        long = max(len(tape.nodes) for tape in program.tapes()) > LONG
        self.function = machine_code(assembly(program, lanes), arguments, best and not long)
        self.lanes, self.best = lanes, best or long

    def __call__(self, state, count, out, *knobs):
        """(the steps done, unsettled). state (entries, members), part of an array, becomes the end.

        out (numbers, members), part of an array like it, becomes the largest that the program has
        made besides, or stays what it was if that is larger. If it makes none, and of a single
        member, out is (count, entries), all states. A single member ends with a step whose
        end is not finite, which is not counted; `unsettled`: since a loop came to no end.
        """
        begin, rows, apart = state.ctypes.data, out.ctypes.data, state.strides[0] // 8
        given, ended = np.repeat(np.array(knobs, float), self.lanes), np.zeros(1, np.int64)
        some = self.lanes * max(1, TURNS // max(1, count))
        for first in range(0, state.shape[1], some):
            rest = rows + 8 * first, apart, given.ctypes.data, ended.ctypes.data
            members = min(some, state.shape[1] - first)
            done = self.function(begin + 8 * first, count, *rest, members)
        return done, not ended
