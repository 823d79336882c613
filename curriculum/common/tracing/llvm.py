"""A program as machine code, by LLVM: the operations of its tape in their order, so the same bits.

No fast-math, nothing contracted; sin, exp and the like are the C library's, as in Python's math.
"""

import ctypes
import os
import struct
import time
from importlib.util import find_spec
from itertools import count
from typing import NamedTuple

import numpy as np

from curriculum.common.tracing.symbols import FUNCTIONS, LIBRARY
from curriculum.common.tracing.writer import Writer

ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
COMPARED = {"<": "olt", "<=": "ole"}
INTRINSIC = {"abs": "fabs", "sqrt": "sqrt", "max": "maximum", "min": "minimum"}
START = 1_500_000  # operations of Python that take as long as to load llvmlite
BUILD = 1_800  # operations of Python that take as long as to build a line that a tape counts
LONG = 10_000  # lines: more are not optimized, which takes seconds and grows as their square
MANY = 100_000  # operations a line, so many repay that it is optimized to the full
FAILED = []  # why llvmlite, though installed, cannot be used, in words


def repays(operations, lines):
    """Whether so many operations, of about so many lines of Python, repay being built, and can."""
    return operations >= START + BUILD * lines and find_spec("llvmlite") is not None


def padded(rows):
    """How many lanes hold so many rows: a power of 2, and 4 or more if not 1."""
    return 1 if rows == 1 else max(4, 1 << (rows - 1).bit_length())


def kind(lanes, of="double"):
    """LLVM's type of a number in so many lanes."""
    return of if lanes == 1 else f"<{lanes} x {of}>"


class Value(NamedTuple):
    """What LLVM calls a number, or the numbers of several rows, in so many lanes."""

    text: str
    lanes: int = 1


class Llvm(Writer):
    """Lines of a function; what changes from turn to turn is in memory, reserved at its `top`."""

    def __init__(self):
        self.top = []
        self.lines = []
        self.count = count()
        self.done = None  # where the number of turns is that have been recorded

    def new(self, text):
        """Write an instruction, and give the name of its result."""
        name = f"%u{next(self.count)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def begin(self, block, branch=None):
        """Begin a block; the one before ends in a branch, by default to it."""
        self.lines += [f"  br {branch or f'label %{block}'}", f"{block}:"]

    def variable(self, value, of):
        """Reserve memory for a value that changes, store it there, and give its place."""
        place = f"%memory{next(self.count)}"
        self.top.append(f"  {place} = alloca {of}, align 64")
        self.store(value, place, of)
        return place

    def load(self, place, of):
        """What is at a place in memory."""
        return self.new(f"load {of}, ptr {place}, align 8")

    def store(self, value, place, of):
        """Leave a value at a place in memory."""
        self.lines.append(f"  store {of} {value}, ptr {place}, align 8")

    def entry(self, place, k):
        """The place of the k-th number of an array."""
        return self.new(f"getelementptr double, ptr {place}, i64 {k}")

    def constant(self, x):
        """The Value of a float, to its last bit."""
        return Value(f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}")

    def packed(self, texts):
        """The name of a vector of these numbers, a lane each; of a single one, its own."""
        if len(texts) == 1:
            return texts[0]
        of = kind(len(texts))
        vector = "poison"
        for k, x in enumerate(texts):
            vector = self.new(f"insertelement {of} {vector}, double {x}, i32 {k}")
        return vector

    def widened(self, value, lanes):
        """The name of a Value in so many lanes, of which it may have only one."""
        return value.text if value.lanes == lanes else self.packed([value.text] * lanes)

    def lane(self, values, k):
        """The value of row k, of a vector."""
        ((text, lanes),) = values
        if lanes > 1:
            text = self.new(f"extractelement {kind(lanes)} {text}, i32 {k}")
        return [Value(text)]

    def stack(self, values):
        """A vector of these values, a row each."""
        lanes = padded(len(values))
        values = values + values[-1:] * (lanes - len(values))
        return [Value(self.packed([x.text for x in values]), lanes)]

    def operation(self, sign, operands, name):
        """Write an operation on Values, lane by lane, and give its Value."""
        lanes = max(x.lanes for x in operands)
        of = kind(lanes)
        x = [self.widened(x, lanes) for x in operands]
        if sign in LIBRARY:  # which is called lane by lane
            results = []
            for k in range(lanes):
                row = [f"double {self.lane([Value(text, lanes)], k)[0].text}" for text in x]
                results.append(self.new(f"call double @c_{sign}({', '.join(row)})"))
            return Value(self.packed(results), lanes)
        if sign == "where":
            truth, a, b = x
            truth = self.new(f"fcmp une {of} {truth}, zeroinitializer")
            return self.choice(truth, a, b, lanes)
        if sign in ARITHMETIC:
            text = f"{ARITHMETIC[sign]} {of} {', '.join(x)}"
        elif sign in COMPARED:
            truth = self.new(f"fcmp {COMPARED[sign]} {of} {', '.join(x)}")
            text = f"uitofp {kind(lanes, 'i1')} {truth} to {of}"
        else:
            suffix = "f64" if lanes == 1 else f"v{lanes}f64"
            operands = ", ".join(f"{of} {one}" for one in x)
            text = f"call {of} @llvm.{INTRINSIC[sign]}.{suffix}({operands})"
        return Value(self.new(text), lanes)

    def choice(self, truth, a, b, lanes):
        """a where that is true, else b."""
        of = kind(lanes)
        flags = kind(lanes, "i1")
        return Value(self.new(f"select {flags} {truth}, {of} {a}, {of} {b}"), lanes)

    def loops(self, loop, env):
        """Write a loop, in all rows at once: rows that are done wait; what never ends is NaN."""
        k = next(self.count)
        lanes = padded(loop.rows)
        of = kind(lanes)
        flags = kind(lanes, "i1")
        turn = self.variable("0", "i64")
        done = self.variable("zeroinitializer", flags)
        places = {}
        for name, (begin, _) in loop.carry.items():
            places[name] = self.variable(self.widened(*self.values(env, begin), lanes), of)

        def now():
            return {name: [Value(self.load(x, of), lanes)] for name, x in places.items()}

        self.begin(f"head{k}")
        turned = self.load(turn, "i64")
        inner = env | now()
        most = "%steps" if loop.most is None else loop.most
        more = self.new(f"icmp slt i64 {turned}, {most}")
        self.begin(f"test{k}", f"i1 {more}, label %test{k}, label %end{k}")
        good = None
        if loop.going is not None:
            good = self.test(loop, inner, done, lanes, k)
        row = self.walk(loop.tape, loop.following, inner)
        for (name, place), x in zip(places.items(), row, strict=True):
            x = self.widened(x, lanes)
            if good:
                (before,) = inner[name]
                x, _ = self.choice(good, before.text, x, lanes)
            self.store(x, place, of)
        if loop.most is None:
            self.record(loop, turn, turned, row, k)
        self.store(self.new(f"add i64 {turned}, 1"), turn, "i64")
        self.begin(f"end{k}", f"label %head{k}")
        ends = now()
        env |= self.finished(ends, done, lanes) if good else ends

    def test(self, loop, inner, done, lanes, k):
        """Which rows are done, and so stay as they are; the loop ends here if all are."""
        flags = kind(lanes, "i1")
        (going,) = self.walk(loop.tape, [loop.going], inner)
        good = self.new(f"fcmp oeq {kind(lanes)} {self.widened(going, lanes)}, zeroinitializer")
        self.store(good, done, flags)
        every = good
        if lanes > 1:
            every = self.new(f"call i1 @llvm.vector.reduce.and.v{lanes}i1({flags} {good})")
        self.begin(f"body{k}", f"i1 {every}, label %end{k}, label %body{k}")
        return good

    def finished(self, ends, done, lanes):
        """The ends of a loop, {name: values}; NaN in rows that have not got to it."""
        good = self.load(done, kind(lanes, "i1"))
        nan = self.widened(self.constant(np.nan), lanes)
        return {x: [self.choice(good, end.text, nan, lanes)] for x, (end,) in ends.items()}

    def record(self, loop, turn, turned, row, k):
        """Leave a row in %out if it is finite; else this was one turn too many, and the last."""
        self.done = turn
        good = "true"
        for x, _ in row:
            nothing = self.new(f"fsub double {x}, {x}")  # NaN, unless it is finite
            good = self.new(f"and i1 {good}, {self.new(f'fcmp oeq double {nothing}, 0.0')}")
        self.begin(f"write{k}", f"i1 {good}, label %write{k}, label %end{k}")
        first = self.new(f"mul i64 {turned}, {loop.size}")
        for place, (x, _) in zip(loop.places, row, strict=True):
            self.store(x, self.entry("%out", self.new(f"add i64 {first}, {place}")), "double")


def assembly(program):
    """i64 run(ptr in, ptr out, i64 steps) of inputs and the rows that it records: how many."""
    w = Llvm()
    env = {}
    for k, name in enumerate(program.inputs):
        env[name] = [Value(w.load(w.entry("%in", k), "double"))]
    w.walk(program.tape, program.results, env)
    w.lines.append(f"  ret i64 {w.load(w.done, 'i64') if w.done else 0}")  # 0: nothing changes
    head = "define i64 @run(ptr noalias %in, ptr noalias %out, i64 %steps) alignstack(64) {\ntop:"
    return [head, *w.top, *w.lines, "}"]  # vectors on its stack do not cross lines of the cache


def machine_code(lines, operations):
    """The function @run of lines in LLVM's language, optimized as so many operations repay."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    c = ctypes.cdll.ucrtbase if os.name == "nt" else ctypes.pythonapi
    for name in FUNCTIONS:  # by other names: else LLVM would know better
        types = "double, double" if name in ("atan2", "pow") else "double"
        lines.append(f"declare double @c_{name}({types})")
        llvm.add_symbol(f"c_{name}", ctypes.cast(getattr(c, name), ctypes.c_void_p).value)
    module = llvm.parse_assembly("\n".join(lines))
    level = 0 if len(lines) > LONG else 1 + (operations > MANY * len(lines))
    host = {"cpu": llvm.get_host_cpu_name(), "features": llvm.get_host_cpu_features().flatten()}
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(opt=level, jit=True, **host)
    if level == 2:
        options = llvm.create_pipeline_tuning_options(speed_level=1)
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    pointer = ctypes.c_void_p
    number = ctypes.c_int64
    prototype = ctypes.CFUNCTYPE(number, pointer, pointer, number)
    function = prototype(engine.get_function_address("run"))
    function.engine = engine  # which keeps it in memory
    return function


def written(program, operations):
    """write(numbers, rows) -> how many of the rows it has written, in how many s.

    None if llvmlite fails, or has failed before.
    """
    if FAILED:
        return None
    lines = assembly(program)
    try:
        run = machine_code(lines, operations)
    except Exception as why:
        FAILED.append(" ".join(f"{type(why).__name__}: {why}".split())[:100])
        return None

    def write(numbers, rows):
        places = numbers.ctypes.data, rows.ctypes.data, len(rows)
        clock = time.thread_time()
        return run(*places), time.thread_time() - clock

    return write
