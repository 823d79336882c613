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

from curriculum.common.trace import FUNCTIONS, INLINE, Call

import numpy as np

ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
LIBRARY = {name: name for name in FUNCTIONS if name != "sqrt"} | {"**": "pow"}
LANES = 16  # doubles: two or four vector registers, which is what keeps a processor busy
CORES = os.cpu_count() or 1


def available():
    """Whether llvmlite is installed."""
    return find_spec("llvmlite") is not None


class Writer:
    """Lines of one function in LLVM's language; `routines` {id of a program: its name and lines}.

    What a loop changes is in memory, reserved at the `top`; LLVM finds registers for it. `trouble`
    is a truth value: a divisor was zero, or a result not finite, where Python would raise an error.
    With several lanes nobody asks.
    """

    def __init__(self, lanes, routines):
        self.lanes, self.routines = lanes, routines
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.top, self.lines, self.count, self.trouble = [], [], 0, "false"

    def new(self, text):
        """The name of what `text` computes."""
        self.count += 1
        self.lines.append(f"  %u{self.count} = {text}")
        return f"%u{self.count}"

    def begin(self, block, branch=None):
        """A new block; the one before ends with a branch, or goes straight on."""
        self.lines += [f"  br {branch or f'label %{block}'}", f"{block}:"]

    def memory(self, kind, many=1):
        self.top.append(f"  %memory{len(self.top)} = alloca {kind}, i64 {many}, align 64")
        return f"%memory{len(self.top) - 1}"

    def variable(self, value, kind=None):
        """Memory that holds a value."""
        place = self.memory(kind or self.type)
        self.store(value, place, kind)
        return place

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
        x, minus = (s, False) if isinstance(s, (str, float, int)) else (s.x, s.minus)
        value = env[x] if isinstance(x, str) else self.constant(x)
        return self.new(f"fneg {self.type} {value}") if minus else value

    def compare(self, how, left, right):
        return self.new(f"fcmp {how} {self.type} {left}, {right}")

    def select(self, test, yes, no):
        return self.new(f"select {self.truth} {test}, {self.type} {yes}, {self.type} {no}")

    def watch(self, trouble):
        """Note what may be trouble."""
        self.trouble = self.new(f"or i1 {self.trouble}, {trouble}")

    def operation(self, sign, values):
        """What one operation makes of values."""
        if sign in ARITHMETIC:
            if sign == "/" and self.lanes == 1 and values[1].startswith("%"):
                self.watch(self.compare("oeq", values[1], self.constant(0.0)))
            return self.new(f"{ARITHMETIC[sign]} {self.type} {', '.join(values)}")
        if sign == "abs":
            return self.intrinsic("fabs", *values)
        made = self.library(sign, values) if sign in LIBRARY else self.intrinsic(sign, *values)
        if self.lanes == 1:
            size = self.intrinsic("fabs", made)
            self.watch(self.compare("uge", size, self.constant(np.inf)))
        return made

    def intrinsic(self, function, value):
        kind = "f64" if self.lanes == 1 else f"v{self.lanes}f64"
        return self.new(f"call {self.type} @llvm.{function}.{kind}({self.type} {value})")

    def library(self, sign, values):
        """A function of the C library, lane by lane."""
        made = "poison"
        for lane in range(self.lanes):
            ones = values
            if self.lanes > 1:
                ones = [self.new(f"extractelement {self.type} {x}, i32 {lane}") for x in values]
            given = ", ".join(f"double {x}" for x in ones)
            one = self.new(f"call double @c_{LIBRARY[sign]}({given})")
            if self.lanes == 1:
                return one
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
        """A routine, which leaves its results in memory and returns its trouble."""
        key, place = id(call.program), self.memory(self.type, len(call.made))
        if key not in self.routines:
            name = f"@routine{len(self.routines)}"
            self.routines[key] = name, []  # its place, before those that it calls
            self.routines[key] = name, routine(call.program, name, self.lanes, self.routines)
        name, _ = self.routines[key]
        given = [f"{self.type} {self.value(env, s)}" for s in call.arguments]
        self.watch(self.new(f"call i1 {name}({', '.join([*given, f'ptr {place}'])})"))
        env |= {made: self.load(self.entry(place, k)) for k, made in enumerate(call.names)}

    def loop(self, loop, env):
        """A loop; lanes that are done keep their values, those that never are become NaN."""
        self.count += 1
        k, tape, truth = self.count, loop.tape, self.truth
        places = [self.variable(self.value(env, s)) for s in loop.start]
        turn, last = self.variable("0", "i64"), self.variable(self.constant(np.inf))
        done, trouble = self.variable("zeroinitializer", truth), self.variable(self.trouble, "i1")
        self.begin(f"head{k}")
        values, before = [self.load(place) for place in places], self.load(done, truth)
        inner = env | dict(zip(loop.names, values, strict=True))
        self.trouble, turns = self.load(trouble, "i1"), self.load(turn, "i64")
        more = self.new(f"icmp slt i64 {turns}, {loop.most}")
        self.begin(f"test{k}", f"i1 {more}, label %test{k}, label %lost{k}")
        test = tape.needed([loop.size])
        self.operations(tape, test, inner)
        size = self.value(inner, loop.size)
        falls = self.compare("ole", self.load(last), size)
        small = self.compare("ole", size, self.constant(loop.nearly))
        good = self.compare("ole", size, self.constant(1.0))
        for also in (self.new(f"and {truth} {falls}, {small}"), before):
            good = self.new(f"or {truth} {good}, {also}")
        self.store(size, last)
        self.store(good, done, truth)
        self.store(self.trouble, trouble, "i1")
        every = good
        if self.lanes > 1:
            every = self.new(f"call i1 @llvm.vector.reduce.and.v{self.lanes}i1({truth} {good})")
        self.begin(f"body{k}", f"i1 {every}, label %end{k}, label %body{k}")
        rest = [name for name in tape.needed(loop.following) if name not in set(test)]
        self.operations(tape, rest, inner)
        following = [self.value(inner, s) for s in loop.following]
        for place, old, new in zip(places, values, following, strict=True):
            self.store(self.select(good, old, new), place)
        self.store(self.new(f"add i64 {turns}, 1"), turn, "i64")
        self.store(self.trouble, trouble, "i1")
        self.begin(f"lost{k}", f"label %head{k}")
        for place, old in zip(places, values, strict=True):
            self.store(self.select(before, old, self.constant(np.nan)), place)
        self.store("true", trouble, "i1")
        self.begin(f"end{k}")
        env |= {name: self.load(x) for name, x in zip(loop.names, places, strict=True)}
        self.trouble = self.load(trouble, "i1")

    def function(self, head, result):
        """The lines of the whole function."""
        return [f"define {head} {{", "top:", *self.top, *self.lines, f"  ret {result}", "}"]


def routine(program, name, lanes, routines):
    """A Routine's program as a function of values, which writes its results to memory."""
    w, made = Writer(lanes, routines), [s for s in program.out if isinstance(s.x, str)]
    env = {x: f"%in{k}" for k, x in enumerate(program.inputs)}
    given = ", ".join([*(f"{w.type} {x}" for x in env.values()), "ptr %out"])
    w.operations(program.tape, program.tape.needed(made), env)
    for k, s in enumerate(made):
        w.store(w.value(env, s), w.entry("%out", k))
    inline = "alwaysinline" if len(program.tape.nodes) <= INLINE else "noinline"
    return w.function(f"internal i1 {name}({given}) {inline}", f"i1 {w.trouble}")


def assembly(program, lanes):
    """i64 run(state, count, out, members, knobs): the steps done, of `lanes` members out of many.

    state (entries, members), where they begin, and then where they end; out (count, rows,
    members), or null: every state, or what the program makes besides, if it does; knobs
    (knobs, lanes). A single member ends before a step that has trouble.
    """
    w, tape, size = Writer(lanes, {}), program.tape, len(program.inputs)
    given = [w.entry("%state", w.new(f"mul i64 %members, {k}"), "double") for k in range(size)]
    state, done = [w.variable(w.load(place)) for place in given], w.variable("0", "i64")
    env = {knob: w.load(w.entry("%knobs", k)) for k, knob in enumerate(program.knobs)}
    w.operations(tape, tape.needed(program.lasting()), env)
    silent = w.new("icmp eq ptr %out, null")
    w.begin("step")
    before = w.load(done, "i64")
    env |= {name: w.load(place) for name, place in zip(program.inputs, state, strict=True)}
    w.operations(tape, [name for name in tape.needed(program.out) if name not in env], env)
    out = [w.value(env, s) for s in program.out]
    trouble = w.trouble if lanes == 1 else "false"
    w.begin("good", f"i1 {trouble}, label %end, label %good")
    for value, place in zip(out, state, strict=False):
        w.store(value, place)
    after = w.new(f"add i64 {before}, 1")
    w.store(after, done, "i64")
    w.begin("write", f"i1 {silent}, label %next, label %write")
    rows = out[size:] or out
    row = w.new(f"mul i64 {before}, {len(rows)}")
    for k, value in enumerate(rows):
        place = w.new(f"mul i64 {w.new(f'add i64 {row}, {k}')}, %members")
        w.store(value, w.entry("%out", place, "double"))
    w.begin("next")
    more = w.new(f"icmp slt i64 {after}, %count")
    w.begin("end", f"i1 {more}, label %step, label %end")
    for place, end in zip(state, given, strict=True):
        w.store(w.load(place), end)
    pointers = "ptr noalias %state, i64 %count, ptr noalias %out, i64 %members, ptr noalias %knobs"
    main = w.function(f"i64 @run({pointers})", f"i64 {w.load(done, 'i64')}")
    texts = [
        f"declare double @c_{x}({'double, double' if x == 'pow' else 'double'})"
        for x in LIBRARY.values()
    ]
    for _, lines in w.routines.values():
        texts += lines
    return "\n".join([*texts, *main, ""])


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


class Native:
    """A Program's function, iterated: call it with where to begin, and how many times.

    `lanes` members go in step, others one after the other. `best`: LLVM takes its time to find
    what this processor does in one instruction; else the code is made a few times sooner.
    """

    def __init__(self, program, lanes=1, best=True):
        llvm = library()
        module = llvm.parse_assembly(assembly(program, lanes))
        target, host = llvm.Target.from_default_triple(), {}
        if best:
            host = {"cpu": llvm.get_host_cpu_name()}
            host["features"] = llvm.get_host_cpu_features().flatten()
        machine = target.create_target_machine(opt=2 * best, jit=True, **host)
        if best:
            options = llvm.create_pipeline_tuning_options(speed_level=1)
            options.slp_vectorization = True
            builder = llvm.create_pass_builder(machine, options)
            builder.getModulePassManager().run(module, builder)
        self.engine = llvm.create_mcjit_compiler(module, machine)
        self.engine.finalize_object()
        word, pointer = ctypes.c_int64, ctypes.c_void_p
        kind = ctypes.CFUNCTYPE(word, pointer, word, pointer, word, pointer)
        self.function = kind(self.engine.get_function_address("run"))
        self.rows, self.lanes = len(program.out[len(program.inputs) :] or program.out), lanes

    def __call__(self, state, count, out, *knobs):
        """The steps done. state (entries, members), which is part of an array, becomes the end.

        out (count, rows, members), or None, becomes all states, or what is measured of them.
        """
        members, same = state.shape[1], np.repeat(np.array(knobs, dtype=float), self.lanes)
        whole, apart, done = members - members % self.lanes, state.strides[0] // 8, count
        for first in range(0, whole, self.lanes):
            begin = state.ctypes.data + 8 * first
            place = None if out is None else out.ctypes.data + 8 * first
            done = self.function(begin, count, place, apart, same.ctypes.data)
        if whole < members:  # the last lanes are filled with the last member
            some = np.minimum(np.arange(whole, whole + self.lanes), members - 1)
            few = state[:, some].copy()
            rows = None if out is None else np.empty((count, self.rows, self.lanes))
            self(few, count, rows, *knobs)
            state[:, whole:] = few[:, : members - whole]
            if out is not None:
                out[:, :, whole:] = rows[:, :, : members - whole]
        return done
