"""A program as machine code, by LLVM: the operations of its tape in their order, so the same bits.

Rows side by side are lanes of vector registers. No fast-math, nothing contracted; sin, exp and the
like are the C library's, as in Python's math. llvmlite is the extra `fast`. Without it, or if it
ever fails, steps are compiled to Python.
"""

import ctypes
import os
import struct
from functools import partial
from importlib.util import find_spec
from itertools import count
from typing import NamedTuple

import numpy as np

from curriculum.common.tracing.symbols import FUNCTIONS
from curriculum.common.tracing.writer import Writer

ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
COMPARED = {"<": "olt", "<=": "ole"}
INTRINSIC = {"abs": "fabs", "sqrt": "sqrt", "max": "maximum", "min": "minimum"}
START, BUILD = 1_500_000, 2_000  # operations of Python that take as long as to build; for each line
LONG = 10_000  # lines: more are not optimized, which takes seconds and grows as their square
FAILED = []  # why llvmlite cannot be used though it is installed, once that has been found out


class Unavailable(Exception):
    """Machine code cannot be had: why, in words."""


def repays(operations, lines):
    """Whether so many operations, of so many lines of Python, repay being built."""
    worth = operations >= START + BUILD * lines
    return worth and not FAILED and find_spec("llvmlite") is not None


def padded(rows):
    """How many lanes so many rows take."""
    return 1 if rows == 1 else max(4, 1 << (rows - 1).bit_length())


def kind(lanes, of="double"):
    return of if lanes == 1 else f"<{lanes} x {of}>"


class Value(NamedTuple):
    """What LLVM calls a number, or the numbers of several rows, in so many lanes."""

    text: str
    lanes: int = 1


class Llvm(Writer):
    """Lines of a function.

    What changes from turn to turn is in memory, reserved at the `top`: LLVM finds registers for it.
    """

    def __init__(self):
        self.top, self.lines, self.count = [], [], count()
        self.failed = self.variable("false", "i1")  # whether a loop had too few turns
        self.done = None  # where the number of turns is that have been recorded

    def new(self, text):
        """The name of what `text` computes."""
        name = f"%u{next(self.count)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def begin(self, block, branch=None):
        """A new block; the one before ends with a branch, or goes straight on."""
        self.lines += [f"  br {branch or f'label %{block}'}", f"{block}:"]

    def variable(self, value, of):
        """Memory that holds a value."""
        place = f"%memory{next(self.count)}"
        self.top.append(f"  {place} = alloca {of}, align 64")
        self.store(value, place, of)
        return place

    def load(self, place, of):
        return self.new(f"load {of}, ptr {place}, align 8")

    def store(self, value, place, of):
        self.lines.append(f"  store {of} {value}, ptr {place}, align 8")

    def entry(self, place, k, of="double"):
        return self.new(f"getelementptr {of}, ptr {place}, i64 {k}")

    def constant(self, x):
        return Value(f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}")

    def packed(self, texts):
        """The text of a value with these lanes."""
        made, of = "poison", kind(len(texts))
        if len(texts) == 1:
            return texts[0]
        if "%" not in "".join(texts):
            return f"<{', '.join(f'double {x}' for x in texts)}>"
        for k, x in enumerate(texts):
            made = self.new(f"insertelement {of} {made}, double {x}, i32 {k}")
        return made

    def widened(self, value, lanes):
        """The text of a value with so many lanes."""
        return value.text if value.lanes == lanes else self.packed([value.text] * lanes)

    def unpacked(self, value, k):
        text, lanes = value
        return text if lanes == 1 else self.new(f"extractelement {kind(lanes)} {text}, i32 {k}")

    def lane(self, values, k):
        return [Value(self.unpacked(values[0], k))]

    def stack(self, values):
        lanes = padded(len(values))
        values = values + values[-1:] * (lanes - len(values))
        return [Value(self.packed([x.text for x in values]), lanes)]

    def operation(self, sign, given, name):
        lanes = max(x.lanes for x in given)
        of, x = kind(lanes), [self.widened(x, lanes) for x in given]
        if sign in FUNCTIONS and sign not in INTRINSIC:  # the C library's, lane by lane
            rows = [[self.unpacked(Value(one, lanes), k) for one in x] for k in range(lanes)]
            rows = [", ".join(f"double {one}" for one in row) for row in rows]
            made = [self.new(f"call double @c_{sign}({row})") for row in rows]
            return Value(self.packed(made), lanes)
        if sign in ARITHMETIC:
            made = f"{ARITHMETIC[sign]} {of} {', '.join(x)}"
        elif sign in INTRINSIC:
            suffix, x = "f64" if lanes == 1 else f"v{lanes}f64", [f"{of} {one}" for one in x]
            made = f"call {of} @llvm.{INTRINSIC[sign]}.{suffix}({', '.join(x)})"
        elif sign in COMPARED:
            truth = self.new(f"fcmp {COMPARED[sign]} {of} {', '.join(x)}")
            made = f"uitofp {kind(lanes, 'i1')} {truth} to {of}"
        else:  # where
            truth = self.new(f"fcmp une {of} {x[0]}, zeroinitializer")
            return self.choice(Value(truth, lanes), *(Value(one, lanes) for one in x[1:]))
        return Value(self.new(made), lanes)

    def choice(self, truth, a, b):
        """b, or a where that is true."""
        of = kind(a.lanes)
        text = self.new(
            f"select {kind(truth.lanes, 'i1')} {truth.text}, {of} {a.text}, {of} {b.text}"
        )
        return Value(text, a.lanes)

    def loops(self, loop, env):
        """A loop, in all rows at once: rows that are done wait, and what never ends is NaN."""
        k, lanes = next(self.count), padded(loop.rows)
        of, flags = kind(lanes), kind(lanes, "i1")
        turn = self.variable("0", "i64")
        done = self.variable("zeroinitializer", flags)
        places = {}
        for name, (one, _) in loop.carry.items():
            places[name] = self.variable(self.widened(*self.values(env, one), lanes), of)

        def now():
            return {name: [Value(self.load(x, of), lanes)] for name, x in places.items()}

        self.begin(f"head{k}")
        turns, inner = self.load(turn, "i64"), env | now()
        more = self.new(f"icmp slt i64 {turns}, {'%steps' if loop.most is None else loop.most}")
        self.begin(f"test{k}", f"i1 {more}, label %test{k}, label %end{k}")
        if loop.going is not None:
            going = self.widened(*self.walk(loop.tape, [loop.going], inner), lanes)
            good = self.new(f"fcmp oeq {of} {going}, zeroinitializer")
            good = self.new(f"or {flags} {good}, {self.load(done, flags)}")
            self.store(good, done, flags)
            every = f"call i1 @llvm.vector.reduce.and.v{lanes}i1({flags} {good})"
            every = self.new(every) if lanes > 1 else good
            self.begin(f"body{k}", f"i1 {every}, label %end{k}, label %body{k}")
        row = self.walk(loop.tape, loop.following, inner)
        for (name, place), x in zip(places.items(), row, strict=True):
            x = Value(self.widened(x, lanes), lanes)
            if loop.going is not None:
                x = self.choice(Value(good, lanes), *inner[name], x)
            self.store(x.text, place, of)
        if loop.record:
            self.record(loop, turn, turns, row, k)
        self.store(self.new(f"add i64 {turns}, 1"), turn, "i64")
        self.begin(f"end{k}", f"label %head{k}")
        ends = now()
        if loop.going is not None:
            good = Value(self.load(done, flags), lanes)
            every = f"call i1 @llvm.vector.reduce.and.v{lanes}i1({flags} {good.text})"
            every = self.new(every) if lanes > 1 else good.text
            failed = self.new(f"xor i1 {every}, true")
            failed = self.new(f"or i1 {failed}, {self.load(self.failed, 'i1')}")
            self.store(failed, self.failed, "i1")
            nan = Value(self.widened(self.constant(np.nan), lanes), lanes)
            ends = {name: [self.choice(good, *x, nan)] for name, x in ends.items()}
        env |= ends

    def record(self, loop, turn, turns, row, k):
        """Leave a row in %out if it is finite; else this was one turn too many, and the last."""
        self.done = turn
        good = self.new(f"xor i1 {self.load(self.failed, 'i1')}, true")
        for x, _ in row:
            nothing = self.new(f"fsub double {x}, {x}")  # NaN, unless it is finite
            good = self.new(f"and i1 {good}, {self.new(f'fcmp oeq double {nothing}, 0.0')}")
        self.begin(f"write{k}", f"i1 {good}, label %write{k}, label %end{k}")
        first = self.new(f"mul i64 {turns}, {loop.size}")
        for place, (x, _) in zip(loop.places, row, strict=True):
            self.store(x, self.entry("%out", self.new(f"add i64 {first}, {place}")), "double")


def assembly(program):
    """i64 run(ptr in, ptr out) of inputs and results, or of rows if it records them: how many."""
    w, lanes = Llvm(), padded(program.tape.rows)
    of, env = kind(lanes), {}
    for k, name in enumerate(program.inputs):
        env[name] = [Value(w.load(w.entry("%in", k, of), of), lanes)]
    results = w.walk(program.tape, program.results, env)
    for k, x in enumerate([] if w.done else results):
        w.store(w.widened(x, lanes), w.entry("%out", k, of), of)
    w.lines.append(f"  ret i64 {w.load(w.done, 'i64') if w.done else 0}")
    head = "define i64 @run(ptr noalias %in, ptr noalias %out, i64 %steps) alignstack(64) {\ntop:"
    return [head, *w.top, *w.lines, "}"]  # vectors on its stack do not cross lines of the cache


def machine_code(lines):
    """The function @run of lines in LLVM's language, optimized unless it is LONG.

    Whatever goes wrong is raised as Unavailable, and no further attempt is made: llvmlite may be of
    another version or for another processor, and the same steps can be had from Python.
    """
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        c = ctypes.cdll.ucrtbase if os.name == "nt" else ctypes.pythonapi
        for name in FUNCTIONS:  # by other names: else LLVM would know better
            given = "double, double" if name in ("atan2", "pow") else "double"
            lines.append(f"declare double @c_{name}({given})")
            llvm.add_symbol(f"c_{name}", ctypes.cast(getattr(c, name), ctypes.c_void_p).value)
        module, best = llvm.parse_assembly("\n".join(lines)), len(lines) <= LONG
        host = {"cpu": llvm.get_host_cpu_name(), "features": llvm.get_host_cpu_features().flatten()}
        target = llvm.Target.from_default_triple()
        machine = target.create_target_machine(opt=2 * best, jit=True, **host)
        if best:
            options = llvm.create_pipeline_tuning_options(speed_level=1)
            builder = llvm.create_pass_builder(machine, options)
            builder.getModulePassManager().run(module, builder)
        engine = llvm.create_mcjit_compiler(module, machine)
        engine.finalize_object()
    except Exception as why:
        FAILED[:] = [f"llvmlite fails: {why}"]
        raise Unavailable(FAILED[0]) from why
    function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2, ctypes.c_int64)(
        engine.get_function_address("run")
    )
    function.engine = engine  # which keeps it in memory
    return function


def single(program):
    """prepared(given, rows) -> a call of it, which returns how many of the rows are written."""
    run = machine_code(assembly(program))

    def prepared(given, rows):
        call = partial(run, given.ctypes.data, rows.ctypes.data, len(rows))
        call.arrays = given, rows  # kept as long as the call
        return call

    return prepared


def crowd(program):
    """run(columns (inputs, K)) -> (K, results) of a program of rows side by side."""
    function, lanes = machine_code(assembly(program)), program.tape.rows

    def run(columns):
        count = columns.shape[1]
        blocks = -(-count // lanes)
        given = np.pad(columns, ((0, 0), (0, blocks * lanes - count)), mode="edge")
        given = given.reshape(len(columns), blocks, lanes).transpose(1, 0, 2).copy()
        made = np.empty((len(given), len(program.results), lanes))
        source, target = given.ctypes.data, made.ctypes.data
        for k in range(len(given)):
            function(source + k * given[0].nbytes, target + k * made[0].nbytes, 1)
        return made.transpose(0, 2, 1).reshape(-1, len(program.results))[:count]

    return run
