"""A program as machine code, by LLVM: the operations of the tape, in their order, so the same bits.

No fast-math, nothing contracted; sin, exp and the like are the C library's, as in Python's math.
`lanes` members go in step in one vector register: the type is all that changes. llvmlite is the
extra `fast`; without it `available()` is false, and everything goes another way.
"""

import ctypes
import os
import struct
from functools import cache
from importlib.util import find_spec

from curriculum.common.arrays import FUNCTIONS
from curriculum.common.trace import INLINE, Call

import numpy as np

ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
LIBRARY = {name: name for name in FUNCTIONS if name != "sqrt"} | {"**": "pow"}
COMPARED = {"<": "olt", "<=": "ole", "max": "oge", "min": "ole", "where": "une"}
LANES = 16  # doubles: two or four vector registers, which is what keeps a processor busy
CORES = os.cpu_count() or 1
UNSETTLED = "@unsettled"  # whether a loop of a single member has come to no end
FINITE = 0x1F8  # LLVM's class of numbers: zero, subnormal or normal, of either sign


def available():
    """Whether llvmlite is installed."""
    return find_spec("llvmlite") is not None


class Writer:
    """Lines of one function in LLVM's language, and the `routines` {id of a program: lines}.

    What a loop changes is in memory, reserved at the `top`: LLVM finds registers for it.
    """

    def __init__(self, lanes, routines):
        self.lanes, self.routines, self.top, self.lines, self.count = lanes, routines, [], [], 0
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = "i1" if lanes == 1 else f"<{lanes} x i1>"

    def new(self, text):
        """The name of what `text` computes."""
        self.count += 1
        self.lines.append(f"  %u{self.count} = {text}")
        return f"%u{self.count}"

    def begin(self, block, branch=None):
        """A new block; the one before ends with a branch, or goes straight on."""
        self.lines += [f"  br {branch or f'label %{block}'}", f"{block}:"]

    def variable(self, value, kind=None):
        """Memory that holds a value."""
        place = self.memory(kind or self.type)
        self.store(value, place, kind)
        return place

    def memory(self, kind, many=1):
        self.top.append(f"  %memory{len(self.top)} = alloca {kind}, i64 {many}, align 64")
        return f"%memory{len(self.top) - 1}"

    def load(self, place, kind=None):
        return self.new(f"load {kind or self.type}, ptr {place}, align 8")

    def store(self, value, place, kind=None):
        self.lines.append(f"  store {kind or self.type} {value}, ptr {place}, align 8")

    def entry(self, place, k, kind=None):
        return self.new(f"getelementptr {kind or self.type}, ptr {place}, i64 {k}")

    def constant(self, x):
        bits = f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}"
        return bits if self.lanes == 1 else f"<{', '.join([f'double {bits}'] * self.lanes)}>"

    def value(self, env, s):
        x, minus = (s, False) if isinstance(s, (str, float)) else (s.x, s.minus)
        value = env[x] if isinstance(x, str) else self.constant(x)
        return self.new(f"fneg {self.type} {value}") if minus else value

    def operation(self, sign, values):
        """What one operation makes of values."""
        if sign in ARITHMETIC:
            return self.new(f"{ARITHMETIC[sign]} {self.type} {', '.join(values)}")
        if sign in LIBRARY:
            return self.library(f"@c_{LIBRARY[sign]}", values)
        if sign in COMPARED:
            return self.compared(sign, *values)
        function = "fabs" if sign == "abs" else sign
        kind = "f64" if self.lanes == 1 else f"v{self.lanes}f64"
        return self.new(f"call {self.type} @llvm.{function}.{kind}({self.type} {values[0]})")

    def compared(self, sign, a, b, c=None):
        """What depends on a comparison: 1 or 0, one of two numbers, or NaN if one of them is."""
        truth = self.new(
            f"fcmp {COMPARED[sign]} {self.type} {a}, {b if c is None else self.constant(0.0)}"
        )
        if sign == "where":
            chosen = b, c
        elif sign in ("max", "min"):
            odd = self.new(f"fcmp uno {self.type} {a}, {a}")
            truth, chosen = self.new(f"or {self.truth} {truth}, {odd}"), (a, b)
        else:
            chosen = self.constant(1.0), self.constant(0.0)
        first, second = (f"{self.type} {value}" for value in chosen)
        return self.new(f"select {self.truth} {truth}, {first}, {second}")

    def finite(self, value):
        return self.new(f"call i1 @llvm.is.fpclass.f64(double {value}, i32 {FINITE})")

    def library(self, function, values):
        """A function of the C library, lane by lane."""
        if self.lanes == 1:
            return self.new(f"call double {function}({', '.join(f'double {x}' for x in values)})")
        made = "poison"
        for lane in range(self.lanes):
            ones = [self.new(f"extractelement {self.type} {x}, i32 {lane}") for x in values]
            one = self.new(f"call double {function}({', '.join(f'double {x}' for x in ones)})")
            made = self.new(f"insertelement {self.type} {made}, double {one}, i32 {lane}")
        return made

    def operations(self, tape, names, env):
        """Operations of a tape; `env` {name: value} learns what they make."""
        for name in names:
            sign, *operands = tape.nodes[name]
            if sign == "part":
                part = tape.parts[name]
                (self.call if isinstance(part, Call) else self.loop)(part, env)
            elif sign != "of":
                env[name] = self.operation(sign, [self.value(env, x) for x in operands])

    def call(self, call, env):
        """A routine, which leaves its results in memory."""
        program, place = call.program, self.memory(self.type, len(call.names))
        if id(program) not in self.routines:
            self.routines[id(program)] = []  # known to those that it calls
            self.routines[id(program)] = routine(program, self.lanes, self.routines)
        given = [f"{self.type} {self.value(env, s)}" for s in call.arguments]
        self.lines.append(f"  call void @r{id(program)}({', '.join([*given, f'ptr {place}'])})")
        env |= {made: self.load(self.entry(place, k)) for k, made in enumerate(call.names)}

    def loop(self, loop, env):
        """A loop; lanes that are done keep their values, those that never are become NaN."""
        self.count += 1
        k, t, truth, tape = self.count, self.type, self.truth, loop.tape
        places = [self.variable(self.value(env, s)) for s in loop.start]
        turn, done = self.variable("0", "i64"), self.variable("zeroinitializer", truth)
        last = self.variable(self.constant(np.inf))
        self.begin(f"head{k}")
        turns, before = self.load(turn, "i64"), self.load(done, truth)
        values = [self.load(place) for place in places]
        inner = env | dict(zip(loop.names, values, strict=True))
        more = self.new(f"icmp slt i64 {turns}, {loop.most}")
        self.begin(f"test{k}", f"i1 {more}, label %test{k}, label %end{k}")
        self.operations(tape, loop.test, inner)
        size = self.value(inner, loop.size)
        good = self.new(f"fcmp ole {t} {size}, {self.constant(1.0)}")
        small = self.new(f"fcmp ole {t} {size}, {self.constant(loop.nearly)}")
        falls = self.new(f"fcmp ole {t} {self.load(last)}, {size}")
        for also in (self.new(f"and {truth} {falls}, {small}"), before):
            good = self.new(f"or {truth} {good}, {also}")
        self.store(size, last)
        self.store(good, done, truth)
        every = f"@llvm.vector.reduce.and.v{self.lanes}i1"
        ready = good if self.lanes == 1 else self.new(f"call i1 {every}({truth} {good})")
        self.begin(f"body{k}", f"i1 {ready}, label %end{k}, label %body{k}")
        self.operations(tape, loop.rest, inner)
        following = [self.value(inner, s) for s in loop.following]
        for place, old, new in zip(places, values, following, strict=True):
            self.store(self.new(f"select {truth} {good}, {t} {old}, {t} {new}"), place)
        self.store(self.new(f"add i64 {turns}, 1"), turn, "i64")
        self.begin(f"end{k}", f"label %head{k}")
        good, nan = self.load(done, truth), self.constant(np.nan)
        for name, place in zip(loop.names, places, strict=True):
            env[name] = self.new(f"select {truth} {good}, {t} {self.load(place)}, {t} {nan}")
        if self.lanes == 1:  # a size that is not finite has another cause
            never = self.new(f"select i1 {good}, i1 false, i1 {self.finite(self.load(last))}")
            self.store(self.new(f"or i1 {self.load(UNSETTLED, 'i1')}, {never}"), UNSETTLED, "i1")

    def function(self, head, result):
        """All lines of the function."""
        return [f"define {head} {{", "top:", *self.top, *self.lines, f"  ret {result}", "}"]


def routine(program, lanes, routines):
    """A Routine's program as a function of values, which writes its results to memory."""
    w = Writer(lanes, routines)
    env = {x: f"%in{k}" for k, x in enumerate(program.inputs)}
    given = ", ".join([*(f"{w.type} {x}" for x in env.values()), "ptr %out"])
    w.operations(program.tape, program.tape.needed(program.made), env)
    for k, s in enumerate(program.made):
        w.store(w.value(env, s), w.entry("%out", k))
    inline = "alwaysinline" if len(program.tape.nodes) <= INLINE else "noinline"
    return w.function(f"internal void @r{id(program)}({given}) {inline}", "void")


def assembly(program, lanes):
    """i64 run(state, count, out, members, knobs, unsettled): how many steps were done.

    Of `lanes` members out of many. state (entries, members): where they begin, and then where they
    end. out (count, rows, members), or null: every state, or what the program makes besides, if it
    does. knobs (knobs, lanes). A single member ends with a step whose end is not finite, which is
    not counted;
    `unsettled` becomes 1 if a loop that came to no end is to blame, and else 0.
    """
    w, tape, many = Writer(lanes, {}), program.tape, len(program.inputs)
    given = [w.entry("%state", w.new(f"mul i64 %members, {k}"), "double") for k in range(many)]
    state, done = [w.variable(w.load(place)) for place in given], w.variable("0", "i64")
    env = {knob: w.load(w.entry("%knobs", k)) for k, knob in enumerate(program.knobs)}
    silent = w.new("icmp eq ptr %out, null")
    w.store("false", UNSETTLED, "i1")
    w.begin("step")
    before = w.load(done, "i64")
    env |= {name: w.load(place) for name, place in zip(program.inputs, state, strict=True)}
    w.operations(tape, tape.needed(program.out), env)
    out = [w.value(env, s) for s in program.out]
    for value, place in zip(out, state, strict=False):
        w.store(value, place)
    good = "true"
    for value in out[:many] if lanes == 1 else ():
        good = w.new(f"and i1 {good}, {w.finite(value)}")
    after = w.new(f"add i64 {before}, {w.new(f'zext i1 {good} to i64')}")
    w.store(after, done, "i64")
    w.begin("write", f"i1 {silent}, label %next, label %write")
    rows = out[many:] or out
    row = w.new(f"mul i64 {before}, {len(rows)}")
    for k, value in enumerate(rows):
        place = w.new(f"mul i64 {w.new(f'add i64 {row}, {k}')}, %members")
        w.store(value, w.entry("%out", place, "double"))
    w.begin("next")
    more = w.new(f"icmp slt i64 {after}, %count")
    more = w.new(f"and i1 {more}, {good}")
    w.begin("end", f"i1 {more}, label %step, label %end")
    for place, end in zip(state, given, strict=True):
        w.store(w.load(place), end)
    pointers = "ptr noalias %state, i64 %count, ptr noalias %out, i64 %members, ptr noalias %knobs"
    pointers += ", ptr noalias %unsettled"
    never = w.new(f"zext i1 {w.load(UNSETTLED, 'i1')} to i64")
    w.store(never, "%unsettled", "i64")
    lines = w.function(f"i64 @run({pointers})", f"i64 {w.load(done, 'i64')}")
    lines.append(f"{UNSETTLED} = internal global i1 false, align 8")
    for name in LIBRARY.values():
        lines.append(f"declare double @c_{name}({'double, double' if name == 'pow' else 'double'})")
    return "\n".join(sum(w.routines.values(), lines))


@cache
def library():
    """llvmlite's binding, ready; and it knows the functions of the C library by other names."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    c = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
    for name in LIBRARY.values():  # else LLVM would put x * x for pow(x, 2)
        llvm.add_symbol(f"c_{name}", ctypes.cast(getattr(c, name), ctypes.c_void_p).value)
    return llvm


def address(array):
    """Where an array's numbers begin; None if there is none."""
    return None if array is None else array.__array_interface__["data"][0]


class Native:
    """A Program's function, iterated: call it with where to begin, and how many times.

    `lanes` members go in step, others one after the other. `best`: LLVM optimizes it; else the code
    is made a few times sooner.
    """

    def __init__(self, program, lanes=1, best=True):
        llvm = library()
        module = llvm.parse_assembly(assembly(program, lanes))
        host = {"cpu": llvm.get_host_cpu_name(), "features": llvm.get_host_cpu_features().flatten()}
        target = llvm.Target.from_default_triple()
        machine = target.create_target_machine(opt=2 * best, jit=True, **host)
        if best:
            options = llvm.create_pipeline_tuning_options(speed_level=1)
            builder = llvm.create_pass_builder(machine, options)
            builder.getModulePassManager().run(module, builder)
        self.engine = llvm.create_mcjit_compiler(module, machine)
        self.engine.finalize_object()
        word, pointer = ctypes.c_int64, ctypes.c_void_p
        kind = ctypes.CFUNCTYPE(word, pointer, word, pointer, word, pointer, pointer)
        self.function = kind(self.engine.get_function_address("run"))
        self.lanes = lanes

    def __call__(self, state, count, out, *knobs):
        """(the steps done, unsettled). state (entries, members), part of an array, becomes the end.

        Members come by `lanes`. out (count, rows, members), or None, becomes all states, or what is
        measured of them. A single member ends with a step whose end is not finite, which is not
        counted; `unsettled`: whether a loop that came to no end is to blame.
        """
        same = np.array([x for x in knobs for _ in range(self.lanes)])
        apart, done, unsettled = state.strides[0] // 8, count, np.zeros(1, np.int64)
        begin, rows, given, told = (address(x) for x in (state, out, same, unsettled))
        for first in range(0, 8 * state.shape[1], 8 * self.lanes):
            place = rows and rows + first
            done = self.function(begin + first, count, place, apart, given, told)
        return done, bool(unsettled[0])
