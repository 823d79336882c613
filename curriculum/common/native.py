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
    """Lines of one function in LLVM's language, and the functions that it calls.

    `trouble` is a truth value: a divisor was zero, or a result not finite, where Python would
    raise an error. With several lanes nobody asks.
    """

    def __init__(self, lanes, routines):
        self.lanes, self.routines = lanes, routines
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = "i1" if lanes == 1 else f"<{lanes} x i1>"
        self.lines, self.top, self.count, self.block, self.trouble = [], [], 0, "top", "false"

    def name(self):
        self.count += 1
        return f"%u{self.count}"

    def line(self, text):
        name = self.name()
        self.lines.append(f"  {name} = {text}")
        return name

    def begin(self, block):
        self.lines.append(f"{block}:")
        self.block = block

    def constant(self, x):
        bits = f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}"
        return bits if self.lanes == 1 else f"<{', '.join([f'double {bits}'] * self.lanes)}>"

    def value(self, env, s):
        x, minus = (s, False) if isinstance(s, (str, float, int)) else (s.x, s.minus)
        value = env[x] if isinstance(x, str) else self.constant(x)
        return self.line(f"fneg {self.type} {value}") if minus else value

    def watch(self, text):
        """Note the trouble that a comparison finds."""
        if self.lanes == 1:
            self.trouble = self.line(f"or i1 {self.trouble}, {self.line(text)}")

    def operation(self, sign, values):
        """What one operation makes of values."""
        if sign in ARITHMETIC:
            left, right = values
            if sign == "/" and right.startswith("%"):
                self.watch(f"fcmp oeq {self.type} {right}, {self.constant(0.0)}")
            return self.line(f"{ARITHMETIC[sign]} {self.type} {left}, {right}")
        kind = "f64" if self.lanes == 1 else f"v{self.lanes}f64"
        if sign in ("sqrt", "abs"):
            function = "sqrt" if sign == "sqrt" else "fabs"
            made = self.line(f"call {self.type} @llvm.{function}.{kind}({self.type} {values[0]})")
        else:
            made = self.library(f"c_{LIBRARY[sign]}", values)
        if sign != "abs" and self.lanes == 1:
            size = self.line(f"call double @llvm.fabs.f64(double {made})")
            self.watch(f"fcmp uge double {size}, {self.constant(np.inf)}")
        return made

    def library(self, function, values):
        """A function of the C library, lane by lane."""
        if self.lanes == 1:
            return self.line(f"call double @{function}({', '.join(f'double {x}' for x in values)})")
        made = "poison"
        for lane in range(self.lanes):
            ones = [self.line(f"extractelement {self.type} {x}, i32 {lane}") for x in values]
            one = self.line(f"call double @{function}({', '.join(f'double {x}' for x in ones)})")
            made = self.line(f"insertelement {self.type} {made}, double {one}, i32 {lane}")
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
        program = call.program
        if id(program) not in self.routines:
            name = f"routine{len(self.routines)}"
            self.routines[id(program)] = name, ""
            self.routines[id(program)] = name, routine(program, name, self.lanes, self.routines)
        name, place = self.routines[id(program)][0], f"%memory{len(self.top)}"
        self.top.append(f"  {place} = alloca {self.type}, i64 {len(call.made)}, align 64")
        given = [f"{self.type} {self.value(env, s)}" for s in call.arguments]
        failed = self.line(f"call i1 @{name}({', '.join([*given, f'ptr {place}'])})")
        if self.lanes == 1:
            self.trouble = self.line(f"or i1 {self.trouble}, {failed}")
        for k, made in enumerate(call.names):
            at = self.line(f"getelementptr {self.type}, ptr {place}, i64 {k}")
            env[made] = self.line(f"load {self.type}, ptr {at}")

    def loop(self, loop, env):
        """A loop; lanes that are done keep their values, those that never are become NaN."""
        self.count += 1
        k, t, many = self.count, self.type, self.lanes > 1
        start = [self.value(env, s) for s in loop.start]
        before, outside, trouble = self.trouble, self.block, f"%trouble{k}"
        self.lines.append(f"  br label %head{k}")
        self.begin(f"head{k}")
        at, turn, last, done = len(self.lines), f"%turn{k}", f"%last{k}", f"%done{k}"
        names = [f"%v{k}_{n}" for n in range(len(loop.names))]
        inner = env | dict(zip(loop.names, names, strict=True))
        self.trouble = self.trouble if many else trouble
        more = self.line(f"icmp slt i64 {turn}, {loop.most}")
        self.lines.append(f"  br i1 {more}, label %test{k}, label %fail{k}")
        self.begin(f"test{k}")
        tape = loop.tape
        test = tape.needed([loop.size])
        rest = [name for name in tape.needed(loop.following) if name not in set(test)]
        self.operations(tape, test, inner)
        size = self.value(inner, loop.size)
        good = self.line(f"fcmp ole {t} {size}, {self.constant(1.0)}")
        if loop.nearly > 1.0:
            falls = self.line(f"fcmp ole {t} {last}, {size}")
            small = self.line(f"fcmp ole {t} {size}, {self.constant(loop.nearly)}")
            low = self.line(f"and {self.truth} {falls}, {small}")
            good = self.line(f"or {self.truth} {good}, {low}")
        ready = good
        if many:
            good = self.line(f"or {self.truth} {done}, {good}")
            every = f"llvm.vector.reduce.and.v{self.lanes}i1"
            ready = self.line(f"call i1 @{every}({self.truth} {good})")
        self.lines.append(f"  br i1 {ready}, label %end{k}, label %body{k}")
        tested, known = self.block, self.trouble
        self.begin(f"body{k}")
        self.operations(tape, rest, inner)
        following = [self.value(inner, s) for s in loop.following]
        if many:
            both = zip(names, following, strict=True)
            following = [
                self.line(f"select {self.truth} {good}, {t} {old}, {t} {new}") for old, new in both
            ]
        after = self.line(f"add i64 {turn}, 1")
        self.lines.append(f"  br label %head{k}")
        bodied, again = self.block, self.trouble
        phis = [(t, n, s, f) for n, s, f in zip(names, start, following, strict=True)]
        phis += [("i64", turn, "0", after), ("i1", trouble, before, again)]
        phis += [(t, last, self.constant(np.inf), size)] * (loop.nearly > 1.0)
        phis += [(self.truth, done, "zeroinitializer", good)] * many
        self.lines[at:at] = [
            f"  {name} = phi {kind} [{first}, %{outside}], [{next_}, %{bodied}]"
            for kind, name, first, next_ in phis
        ]
        self.begin(f"fail{k}")
        nan = self.constant(np.nan)
        lost = names
        if many:
            lost = [self.line(f"select {self.truth} {done}, {t} {n}, {t} {nan}") for n in names]
        self.lines.append(f"  br label %end{k}")
        self.begin(f"end{k}")
        for made, name, other in zip(loop.names, names, lost, strict=True):
            env[made] = self.line(f"phi {t} [{name}, %{tested}], [{other}, %fail{k}]")
        if not many:
            self.trouble = self.line(f"phi i1 [{known}, %{tested}], [true, %fail{k}]")


def stores(w, values, place):
    """Write values to place(k)."""
    for k, value in enumerate(values):
        w.lines.append(f"  store {w.type} {value}, ptr {place(k)}, align 8")


def routine(program, name, lanes, routines):
    """A Routine's program as a function of values, which writes its results to memory."""
    w, made = Writer(lanes, routines), [s for s in program.out if isinstance(s.x, str)]
    env = {x: f"%in{k}" for k, x in enumerate(program.inputs)}
    w.operations(program.tape, program.tape.needed(made), env)
    values = [w.value(env, s) for s in made]
    stores(w, values, lambda k: w.line(f"getelementptr {w.type}, ptr %out, i64 {k}"))
    given = ", ".join([*(f"{w.type} {env[x]}" for x in program.inputs), "ptr %out"])
    inline = "alwaysinline" if len(program.tape.nodes) <= INLINE else "noinline"
    head = f"define internal i1 @{name}({given}) {inline} {{"
    return "\n".join([head, "top:", *w.top, *w.lines, f"  ret i1 {w.trouble}", "}", ""])


def assembly(program, lanes):
    """i64 run(state, count, out, members, knobs): the steps done, of `lanes` members out of many.

    state (entries, members), where they begin, and then where they end; out (count, rows,
    members), or null: every state, or what the program makes besides, if it does. A single member
    ends before a step that has trouble.
    """
    routines, tape = {}, program.tape
    w, n = Writer(lanes, routines), range(len(program.inputs))
    t = w.type
    for k in n:
        w.lines.append(f"  %at{k} = mul i64 %members, {k}")
        w.lines.append(f"  %p{k} = getelementptr double, ptr %state, i64 %at{k}")
        w.lines.append(f"  %s{k} = load {t}, ptr %p{k}, align 8")
    env = {name: f"%in{k}" for k, name in enumerate(program.inputs)}
    for k, knob in enumerate(program.knobs):
        env[knob] = w.line(
            f"load double, ptr {w.line(f'getelementptr double, ptr %knobs, i64 {k}')}"
        )
        if lanes > 1:
            one = w.line(f"insertelement {t} poison, double {env[knob]}, i32 0")
            env[knob] = w.line(
                f"shufflevector {t} {one}, {t} poison, <{lanes} x i32> zeroinitializer"
            )
    w.operations(tape, tape.needed(program.lasting()), env)
    w.lines += ["  %silent = icmp eq ptr %out, null", "  br label %step"]
    w.begin("step")
    at = len(w.lines)
    w.operations(tape, [name for name in tape.needed(program.out) if name not in env], env)
    out = [w.value(env, s) for s in program.out]
    w.lines.append(f"  br i1 {w.trouble}, label %trouble, label %good")
    w.begin("good")
    w.lines.append("  br i1 %silent, label %next, label %write")
    w.begin("write")
    rows = out[len(n) :] or out
    row = w.line(f"mul i64 %done, {len(rows)}")

    def place(k):
        entry = w.line(f"mul i64 {w.line(f'add i64 {row}, {k}')}, %members")
        return w.line(f"getelementptr double, ptr %out, i64 {entry}")

    stores(w, rows, place)
    w.lines.append("  br label %next")
    w.begin("next")
    w.lines += ["  %after = add i64 %done, 1", "  %more = icmp slt i64 %after, %count"]
    w.lines.append("  br i1 %more, label %step, label %whole")
    w.lines[at:at] = [f"  %in{k} = phi {t} [%s{k}, %top], [{out[k]}, %next]" for k in n]
    w.lines.insert(at, "  %done = phi i64 [0, %top], [%after, %next]")
    for block, values, done in ("whole", out, "%after"), ("trouble", [*env.values()], "%done"):
        w.begin(block)
        stores(w, [values[k] for k in n], "%p{}".format)
        w.lines.append(f"  ret i64 {done}")
    pointers = "ptr noalias %state, i64 %count, ptr noalias %out, i64 %members, ptr noalias %knobs"
    body = [f"define i64 @run({pointers}) {{", "top:", *w.top, *w.lines, "}", ""]
    declared = [
        f"declare double @c_{name}({'double, double' if name == 'pow' else 'double'})"
        for name in LIBRARY.values()
    ]
    return "\n".join([*declared, *(text for _, text in routines.values()), *body])


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
        members, knobs = state.shape[1], np.array(knobs, dtype=float)
        whole, apart, done = members - members % self.lanes, state.strides[0] // 8, count
        for first in range(0, whole, self.lanes):
            place = None if out is None else out.ctypes.data + 8 * first
            begin = state.ctypes.data + 8 * first
            done = self.function(begin, count, place, apart, knobs.ctypes.data)
        if whole < members:  # the last lanes are filled with the last member
            some = np.minimum(np.arange(whole, whole + self.lanes), members - 1)
            few = state[:, some].copy()
            rows = None if out is None else np.empty((count, self.rows, self.lanes))
            self(few, count, rows, *knobs)
            state[:, whole:] = few[:, : members - whole]
            if out is not None:
                out[:, :, whole:] = rows[:, :, : members - whole]
        return done
