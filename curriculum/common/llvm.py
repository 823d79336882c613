"""LLVM's language: a function written line by line, and what is written made into machine code.

No fast-math, nothing contracted; sin, exp and the like are the C library's, as in Python's math.
llvmlite is the extra `fast`. Without it, and once it has failed, steps are compiled to Python.
"""

import ctypes
import os
import struct
from importlib.util import find_spec
from itertools import count

from curriculum.common.arrays import BINARY, FUNCTIONS
from curriculum.common.cli import in_a_line, shorten

ARITHMETIC = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
OF_TWO = BINARY | {"**": "pow"}
LIBRARY = {name: c for name, c in FUNCTIONS.items() if name != "sqrt"} | OF_TWO
COMPARED = {"<": "olt", "<=": "ole", "max": "oge", "min": "ole", "where": "une"}
WORD, POINTER = ctypes.c_int64, ctypes.c_void_p
FAILED = []  # why llvmlite cannot be used though it is installed, once that has been found out


class Unavailable(Exception):
    """Machine code cannot be had: why, in words."""


def available():
    """Whether llvmlite is installed, and has not failed yet."""
    return not FAILED and find_spec("llvmlite") is not None


class Function:
    """Lines of one function; a value is one number, or `lanes` of them in a vector register.

    What changes from turn to turn is in memory, reserved at the `top`: LLVM finds registers for it.
    A `kind` is a type, in LLVM's words; without one it is that of a value.
    """

    def __init__(self, lanes):
        self.lanes = lanes
        self.type = "double" if lanes == 1 else f"<{lanes} x double>"
        self.truth = self.type.replace("double", "i1")
        self.top, self.lines, self.count = [], [], count()

    def new(self, text):
        """The name of what `text` computes."""
        name = f"%u{next(self.count)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def reduced(self, how, value):
        """One truth of all lanes: "and" or "or"."""
        if self.lanes == 1:
            return value
        function = f"@llvm.vector.reduce.{how}.v{self.lanes}i1"
        return self.new(f"call i1 {function}({self.truth} {value})")

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

    def operation(self, sign, values):
        """What one operation makes of values; max and min make NaN if one of them is."""
        if sign in ARITHMETIC:
            return self.new(f"{ARITHMETIC[sign]} {self.type} {', '.join(values)}")
        if sign in LIBRARY:
            return self.library(f"@c_{LIBRARY[sign]}", values)
        if sign not in COMPARED:
            function = "fabs" if sign == "abs" else sign
            suffix = "f64" if self.lanes == 1 else f"v{self.lanes}f64"
            return self.new(f"call {self.type} @llvm.{function}.{suffix}({self.type} {values[0]})")
        a, b, *_ = values
        chosen = (a, b) if sign in ("max", "min") else (self.constant(1.0), self.constant(0.0))
        if sign == "where":
            b, chosen = self.constant(0.0), values[1:]
        truth = self.new(f"fcmp {COMPARED[sign]} {self.type} {a}, {b}")
        if sign in ("max", "min"):
            odd = self.new(f"fcmp uno {self.type} {a}, {a}")
            truth = self.new(f"or {self.truth} {truth}, {odd}")
        return self.choice(truth, self.type, *chosen)

    def choice(self, truth, kind, a, b):
        return self.new(f"select {self.truth} {truth}, {kind} {a}, {kind} {b}")

    def finite(self, value):
        """Whether it is a number, and not infinite: then less itself it is zero, and else NaN."""
        nothing = self.new(f"fsub {self.type} {value}, {value}")
        return self.new(f"fcmp oeq {self.type} {nothing}, {self.constant(0.0)}")

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

    def function(self, head, result):
        """All lines of the function; vectors on its stack do not cross lines of the cache."""
        start = f"define {head} alignstack(64) {{"
        return [start, "top:", *self.top, *self.lines, f"  ret {result}", "}"]


def machine_code(text, arguments, best=True):
    """The function @run of a text in LLVM's language, (*arguments) -> WORD, optimized if `best`.

    Whatever goes wrong is raised as Unavailable, and no further attempt is made: llvmlite may be of
    another version or for another processor, and the same steps can be had from Python.
    """
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        c = ctypes.CDLL("ucrtbase" if os.name == "nt" else None)
        for name in LIBRARY.values():  # by other names: else LLVM would put x * x for pow(x, 2)
            kinds = "double, double" if name in OF_TWO.values() else "double"
            text += f"\ndeclare double @c_{name}({kinds})"
            llvm.add_symbol(f"c_{name}", ctypes.cast(getattr(c, name), ctypes.c_void_p).value)
        module = llvm.parse_assembly(text)
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
        FAILED[:] = [f"llvmlite fails: {shorten(in_a_line(why))}"]
        raise Unavailable(FAILED[0]) from why
    function = ctypes.CFUNCTYPE(WORD, *arguments)(engine.get_function_address("run"))
    function.engine = engine  # which keeps it in memory
    return function
