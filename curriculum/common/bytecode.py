"""A program as rows of numbers, which one small function of machine code reads: soon made.

A row is an operation: what to do, the register of its result, and those of its operands. However
long a program is, only its reader is compiled, once for all. A register has `lanes` numbers, of as
many members that go in step. Operations and their order are the tape's, and so are the bits.
"""

import math
from array import array
from collections import defaultdict
from functools import cache
from itertools import chain, count

from curriculum.common import llvm
from curriculum.common.tape import uncollected

import numpy as np

# How many operands there are. Besides the tape's operations: minus a; a itself; go on elsewhere if
# a is zero in all lanes; go on where a says; the end of a step.
OPERANDS = dict.fromkeys(["+", "-", "*", "/", "<", "<=", "max", "min"], 2) | {"where": 3}
OPERANDS |= dict.fromkeys(["abs", "sqrt", *llvm.LIBRARY], 1) | dict.fromkeys(llvm.OF_TWO, 2)
OPERANDS |= {"minus": 1, "copy": 1, "unless": 1, "go": 1, "end": 0}  # "end" is the last
NUMBER = {sign: k for k, sign in enumerate(OPERANDS)}
WIDTH = 5  # numbers in a row
LARGE = 5000  # operations: so many are sooner rows than Python, though llvmlite has to be loaded
UNUSED = [(0,) * (WIDTH - 2 - many) for many in range(WIDTH - 1)]  # behind so many operands


class Assembler:
    """The `rows` of a Program, and the registers that it needs: `register`(x) of a name or number.

    First come the state, the largest of what else is made, and the knobs. Numbers are preset.
    """

    def __init__(self, program):
        self.rows = array("i")
        self.numbers = count()  # of registers
        # {a name or a number: its own}; a sign has its NUMBER there, to look nodes up as they are
        self.registers = defaultdict(self.numbers.__next__, NUMBER)
        self.register = self.registers.__getitem__
        self.routines = []  # programs that are called
        self.leaps = []  # (a row that goes on at the first of a routine, which)
        state = [self.register(name) for name in program.inputs]
        most = [self.register(f"most {k}") for k in range(len(program.out) - len(state))]
        for name in [*program.knobs, "endless", "trouble"]:
            self.register(name)
        self.operations(program.tape, program.tape.needed(program.out))
        self.end(state, most, [self.number(s) for s in program.out])
        first = []
        for k, routine in enumerate(self.routines):  # which may call others: the list grows
            first.append(self.here())
            self.operations(routine.tape, routine.tape.needed(routine.computed))
            self.row("go", 0, self.register(f"back {k}"))
        for row, k in self.leaps:
            self.go_on(row, first[k])

    def row(self, sign, result, *operands):
        """One more row; its number."""
        self.rows.extend((NUMBER[sign], result, *operands, *UNUSED[len(operands)]))
        return self.here() - 1

    def row_by_row(self, sign, results, *operands):
        """Rows of one sign, with lists of registers, or one that is the same in all."""
        columns = NUMBER[sign], results, *operands
        many = next(len(x) for x in columns if isinstance(x, list))
        rows = np.zeros((many, WIDTH), np.intc)
        for k, column in enumerate(columns):
            rows[:, k] = column
        self.rows.frombytes(rows.tobytes())

    def here(self):
        """The number of the row that comes next."""
        return len(self.rows) // WIDTH

    def go_on(self, leap, row):
        """Where a leap, by the number of its row, leads."""
        self.rows[WIDTH * leap + 1] = row

    def new(self, sign, *operands):
        """The register, a new one, of what an operation makes."""
        result = next(self.numbers)
        self.row(sign, result, *operands)
        return result

    def number(self, s):
        """The register of a Symbol."""
        return self.new("minus", self.register(s.x)) if s.minus else self.register(s.x)

    def end(self, state, most, ends):
        """The registers of a step's ends become its state; what else it makes is compared."""
        ends, others = ends[: len(state)], ends[len(state) :]
        # not zero if an end is infinite or no number, or if a loop came to no end
        trouble, differences = self.register("trouble"), [next(self.numbers) for _ in ends]
        self.row("copy", trouble, self.register("endless"))
        self.row_by_row("-", differences, ends, ends)
        self.row_by_row("+", trouble, trouble, differences)
        self.row_by_row("max", most, most, others)
        self.exchange(state, ends)
        self.row("end", 0)

    def exchange(self, registers, following):
        """Copy all of `following` to these, even if some are among these registers."""
        if not set(registers).isdisjoint(following):
            kept = [next(self.numbers) for _ in following]
            self.row_by_row("copy", kept, following)
            following = kept
        self.row_by_row("copy", registers, following)

    def operations(self, tape, names):
        simple = names
        if tape.parts:
            simple = []
            for name in names:
                sign = tape.nodes[name][0]
                if name in tape.parts:
                    self.simple(tape, simple)
                    simple = []
                    getattr(self, sign)(tape.parts[name])
                elif sign != "of":
                    simple.append(name)
        self.simple(tape, simple)

    def simple(self, tape, names):
        """Rows of operations that are no parts, all at once: there may be very many."""
        nodes = [tape.nodes[name] for name in names]
        many = np.fromiter(map(len, nodes), int, len(nodes))  # a sign, and operands
        at = np.cumsum(many) - many
        entries = np.fromiter(map(self.register, chain.from_iterable(nodes)), int, many.sum())
        rows = np.zeros((len(nodes), WIDTH), np.intc)
        rows[:, 0] = entries[at]
        rows[:, 1] = list(map(self.register, names))
        for k in range(1, WIDTH - 1):
            some = np.flatnonzero(many > k)
            rows[some, k + 1] = entries[at[some] + k]
        self.rows.frombytes(rows.tobytes())

    def calls(self, calls):
        """Calls of a program, one after the other."""
        program = calls.program
        if program not in self.routines:
            self.routines.append(program)
        k = self.routines.index(program)
        for arguments, names in zip(calls.rows, calls.names, strict=True):
            given = [self.number(s) for s in arguments]
            self.row_by_row("copy", [self.register(name) for name in program.inputs], given)
            back = float(self.here() + 2)  # the row after these two
            self.row("copy", self.register(f"back {k}"), self.register(back))
            self.leaps.append((self.row("unless", 0, self.register(0.0)), k))
            made = [self.number(s) for s in program.computed]
            self.row_by_row("copy", [self.register(name) for name in names], made)

    def loop(self, loop):
        """A loop; lanes that are done keep their values, those that never are become NaN."""
        names = [self.register(name) for name in loop.names]
        turn, done = (self.register(f"{x} {loop.names[0]}") for x in ("turn", "done"))
        zero, one = self.register(0.0), self.register(1.0)
        start = [self.number(s) for s in loop.start]
        self.exchange([*names, turn, done], [*start, zero, zero])
        head = self.here()
        more = self.new("<", turn, self.register(float(loop.most)))
        leave = [self.row("unless", 0, more)]
        self.row("+", turn, turn, one)
        self.operations(loop.tape, loop.test)
        self.row("max", done, done, self.new("<=", self.number(loop.size), one))
        leave.append(self.row("unless", 0, self.new("-", one, done)))
        self.operations(loop.tape, loop.rest)
        following = [self.number(s) for s in loop.following]
        kept = [self.new("where", done, *x) for x in zip(names, following, strict=True)]
        self.exchange(names, kept)
        self.row("unless", head, zero)
        for row in leave:
            self.go_on(row, self.here())
        self.row_by_row("where", names, done, names, self.register(math.nan))
        endless = self.register("endless")
        self.row("max", endless, endless, self.new("-", one, done))


def reader_lines(lanes):
    """i64 run(registers, rows, out, count, many, trouble): how many steps were done.

    The first `many` registers are the state. out (count, many): every state, or null. With a single
    lane a step after which register `trouble` is not zero is the last, and is not counted.
    """
    w = llvm.Function(lanes)
    done, at = w.variable("0", "i64"), w.variable("0", "i64")
    silent = w.new("icmp eq ptr %out, null")
    w.begin("step")
    w.store("0", at, "i64")
    w.begin("next")
    here = w.load(at, "i64")
    after = w.new(f"add i64 {here}, 1")
    w.store(after, at, "i64")
    row = w.new(f"getelementptr [{WIDTH} x i32], ptr %rows, i64 {here}")
    sign, *numbers = [w.load(w.entry(row, k, "i32"), "i32") for k in range(WIDTH)]
    numbers = [w.new(f"zext i32 {x} to i64") for x in numbers]
    result, *given = [w.entry("%registers", x, w.type) for x in numbers]
    cases = " ".join(f"i32 {k}, label %do{k}" for k in NUMBER.values())
    w.lines.append(f"  switch i32 {sign}, label %do{NUMBER['end']} [{cases}]")
    for sign, k in NUMBER.items():
        w.lines.append(f"do{k}:")
        values = [w.load(x) for x in given[: OPERANDS[sign]]]
        if sign == "end":
            break
        if sign == "unless":
            some = w.reduced("or", w.new(f"fcmp une {w.type} {values[0]}, {w.constant(0.0)}"))
            w.store(w.new(f"select i1 {some}, i64 {after}, i64 {numbers[0]}"), at, "i64")
        elif sign == "go":  # all lanes have the same
            place = w.load(given[0], "double")
            w.store(w.new(f"fptosi double {place} to i64"), at, "i64")
        elif sign == "copy":
            w.store(values[0], result)
        elif sign == "minus":
            w.store(w.new(f"fneg {w.type} {values[0]}"), result)
        else:
            w.store(w.operation(sign, values), result)
        w.lines.append("  br label %next")
    before, good = w.load(done, "i64"), "true"  # from here on: what "end" does
    if lanes == 1:
        trouble = w.load(w.entry("%registers", "%trouble"))
        good = w.new(f"fcmp oeq double {trouble}, {w.constant(0.0)}")
    now = w.new(f"add i64 {before}, {w.new(f'zext i1 {good} to i64')}")
    w.store(now, done, "i64")
    w.begin("write", f"i1 {silent}, label %following, label %write")
    place = w.entry("%out", w.new(f"mul i64 {before}, %many"), "double")
    size = w.new("mul i64 %many, 8")
    copied = f"ptr {place}, ptr %registers, i64 {size}, i1 false"
    w.lines.append(f"  call void @llvm.memcpy.p0.p0.i64({copied})")
    w.begin("following")
    more = w.new(f"and i1 {w.new(f'icmp slt i64 {now}, %count')}, {good}")
    w.begin("finish", f"i1 {more}, label %step, label %finish")
    pointers = [f"ptr noalias %{x}" for x in ("registers", "rows", "out")]
    head = f"i64 @run({', '.join(pointers)}, i64 %count, i64 %many, i64 %trouble)"
    return w.function(head, f"i64 {w.load(done, 'i64')}")


@cache
def reader(lanes):
    """What reads rows, for so many lanes."""
    arguments = [llvm.POINTER] * 3 + [llvm.WORD] * 3
    return llvm.machine_code("\n".join(reader_lines(lanes)), arguments)


class Bytecode:
    """A Program's function, iterated: as native.Native, and called as that, but made much sooner.

    Raises llvm.Unavailable.
    """

    def __init__(self, program, lanes=1):
        self.function = reader(lanes)
        with uncollected():
            found = Assembler(program)
        self.rows, self.lanes = np.frombuffer(found.rows, np.intc), lanes
        self.register_count = next(found.numbers)
        numbers = [x for x in found.registers if type(x) is float]
        self.constants = [found.register(x) for x in numbers], np.array(numbers)
        self.state = slice(0, len(program.inputs))
        self.most = slice(len(program.inputs), len(program.out))
        self.knobs = [found.register(name) for name in program.knobs]
        self.endless = found.register("endless")
        self.trouble = found.register("trouble")

    def __call__(self, state, count, out, *knobs):
        """See native.Native."""
        registers = np.empty((self.register_count, self.lanes))
        places, constants = self.constants
        registers[places] = constants[:, None]
        registers[self.knobs] = np.reshape(knobs, (-1, 1))
        registers[self.endless] = 0.0
        entries, measured = len(state), self.most.stop > self.most.start
        rows = None if measured or self.lanes > 1 else out.ctypes.data
        given = self.rows.ctypes.data, rows, count, entries, self.trouble
        for first in range(0, state.shape[1], self.lanes):
            members = slice(first, first + self.lanes)
            registers[self.state] = state[:, members]
            if measured:
                registers[self.most] = out[:, members]
            done = self.function(registers.ctypes.data, *given)
            state[:, members] = registers[self.state]
            if measured:
                out[:, members] = registers[self.most]
        return done, bool(registers[self.endless, 0])
