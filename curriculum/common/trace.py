"""Run a function of small arrays once, on symbols, and write down on a tape what it did.

A `Symbol` is a number that is not known yet. numpy carries symbols in object arrays, so lines
written for arrays of floats run on them as they stand, and every operator notes an operation
instead of doing it. What is multiplied by zero vanishes, what stands there twice is done once, what
no result needs is left out. Exact: what is left has the operands and the order that the function
gave it, so it computes what the same lines compute of ordered arrays of floats (arrays.py), to the
last bit (but for the sign of a zero, 0 * inf and inf - inf). Powers, sines and what else is not in
EXACT may differ in the last digits. Nothing here knows what the function is about.
"""

import math
import sys

from curriculum.common.arrays import BINARY, FUNCTIONS, OWN, ordered, symbolic
from curriculum.common.tape import NoNumber, Untraceable, current, effort

import numpy as np

LONG = 60_000  # operations noted: a longer trace goes on only if its steps repay the compiling
KEPT = "it keeps a number from an earlier call"
UFUNCS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "**": np.power}
UFUNCS |= {"abs": np.absolute, "max": np.maximum, "min": np.minimum, "where": np.where}
UFUNCS |= {"<": np.less, "<=": np.less_equal}
EXACT = set(UFUNCS) - {"**"} | {"sqrt", "calls", "loop", "of"}  # so far all are rounded alike
UFUNCS |= {name: getattr(np, name) for name in FUNCTIONS | BINARY}
CALLED = {name: getattr(math, c) for name, c in (FUNCTIONS | BINARY).items()}


def operators(rule, zero=None):
    """A Symbol's operator, what `rule` makes of it and a number, and the reflected one.

    Whole arrays are numpy's. `zero`: what it makes of a Symbol and of a plain 0, of which matrices
    are full, and long sums: that must cost little.
    """

    def operator(a, b, swapped=False):
        if type(b) is not Symbol:
            if zero and type(b) in (int, float) and b == 0:
                return zero(a)
            if type(b) is float:  # as nearly always
                b = Symbol(a.tape, abs(b), b < 0.0)
            elif isinstance(b, np.ndarray) and b.ndim:
                return NotImplemented
            else:
                b = lift(b)
        return rule(b, a) if swapped else rule(a, b)

    return operator, lambda a, b: operator(a, b, True)


def lift(number):
    """A number as a Symbol; one that is a Symbol stays as it is."""
    if type(number) is Symbol:
        return number
    if type(number) is Truth:
        return number.number
    if isinstance(number, (np.ndarray, np.generic)):
        return lift(number.item())
    if isinstance(number, complex):
        current.tape.refused.append("it makes a complex number")
        number = number.real
    return Symbol(current.tape, abs(float(number)), bool(number < 0))


def constant(sign, numbers, minus=False):
    """The symbol of what an operation makes of numbers alone."""
    try:
        made = CALLED[sign](*numbers)  # as where it is not known before
    except (KeyError, ArithmeticError, ValueError):
        with np.errstate(all="ignore"):
            made = UFUNCS[sign](*map(np.float64, numbers))
    return -lift(float(made)) if minus else lift(float(made))


def holds(node, settled):
    """Whether a comparison (sign, *operands) is true of numbers that are `settled`, {name: it}."""
    sign, *operands = node
    return bool(UFUNCS[sign](*(settled.get(x, x) for x in operands)))


def new(tape, key, minus):
    """The symbol of an operation that is new on a tape, by its sign and operands; or minus that."""
    # as "0.0 - x" numbers below zero are written
    known = type(key[1]) is float and all(type(x) is float for x in key[2:])
    if known and key[:2] != ("-", 0.0):
        return constant(key[0], key[1:], minus)
    name = tape.names[key] = f"t{next(tape.numbers)}"
    tape.nodes[name] = key
    effort.noted += 1
    if effort.noted > LONG:
        effort.check()
    return Symbol(tape, name, minus)


class Symbol:
    """A number on a tape: x is a float >= 0, or the name of an input or of an operation.

    Or it is minus that.
    """

    __slots__ = ("tape", "x", "minus")
    told = False

    def __init__(self, tape, x, minus=False):
        self.tape, self.x, self.minus = tape, x, minus

    def __repr__(self):
        if not Symbol.told:
            Symbol.told = True
            print("(a tracing run: numbers have no values yet; --plain has)", file=sys.stderr)
        return "-" * self.minus + str(self.x)

    def __format__(self, spec):
        return repr(self)

    def note(self, sign, *others):
        """The symbol of an operation on x and others'; asked for again, the same one."""
        tape, key = self.inner(others), (sign, self.x, *(s.x for s in others))
        name = tape.names.get(key)
        return new(tape, key, False) if name is None else Symbol(tape, name)

    def with_one(self, sign, b, minus=False):
        """note(sign, b), or minus that: as nearly always, so in the shortest way."""
        tape = self.tape
        if tape is not b.tape or not tape.open:
            tape = self.inner((b,))
        key = sign, self.x, b.x
        name = tape.names.get(key)
        if name is None and sign in ("+", "*"):
            name = tape.names.get((sign, b.x, self.x))
        return new(tape, key, minus) if name is None else Symbol(tape, name, minus)

    def inner(self, others):
        """The tape of an operation on numbers of several tapes: the innermost."""
        given = {s.tape for s in (self, *others) if type(s.x) is str}
        tapes = current.tapes()
        if not given.issubset(tapes):
            raise Untraceable(KEPT)
        for tape in tapes:
            if tape in given:
                return tape
        return current.tape

    def plain(self):
        """This number with its minus carried out, as 0 - x on the tape."""
        return lift(0.0).note("-", self) if self.minus else self

    def carried(self, sign, *others):
        """note() of numbers whose minuses are carried out first."""
        numbers = self, *map(lift, others)
        if all(type(s.x) is float for s in numbers):
            return constant(sign, [0.0 - s.x if s.minus else s.x for s in numbers])
        first, *rest = [s.plain() for s in numbers]
        return first.note(sign, *rest)

    def add(self, b):
        if self.x == 0.0 or b.x == 0.0:
            return b if self.x == 0.0 else self
        if self.minus == b.minus:
            return self.with_one("+", b, self.minus)
        return b.less(self) if self.minus else self.less(b)

    def subtract(self, b):
        if self.x == 0.0 or b.x == 0.0:
            return -b if self.x == 0.0 else self
        if self.minus != b.minus:
            return self.with_one("+", b, self.minus)
        return b.less(self) if self.minus else self.less(b)

    def less(self, b):
        """What |x| is more than that of b."""
        return lift(0.0) if self.x == b.x else self.with_one("-", b)

    def multiply(self, b):
        minus = self.minus != b.minus
        if self.x == 0.0 or b.x == 1.0:
            return Symbol(self.tape, self.x, minus)
        if b.x == 0.0 or self.x == 1.0:
            return Symbol(b.tape, b.x, minus)
        return self.with_one("*", b, minus)

    def divide(self, b):
        safe = b.x in b.tape.knobs if isinstance(b.x, str) else b.x > 0.0  # 0 / 0 is not 0
        nothing = self.x == 0.0 and safe
        minus = self.minus != b.minus
        same = Symbol(self.tape, self.x, minus)
        return same if nothing or b.x == 1.0 else self.with_one("/", b, minus)

    def maximum(self, b):
        """The larger of two numbers, or NaN if one of them is."""
        return extreme("max", self, b)

    def minimum(self, b):
        return extreme("min", self, b)

    def choose(self, a, b):
        """a where this is not zero, and else b."""
        return like(self.carried("where", a, b), a, b)

    def __array_ufunc__(self, ufunc, method, *given, **how):
        return symbolic(ufunc, method, given, how=how)

    def __array_function__(self, function, types, given, how):
        return OWN.get(function, function._implementation)(*given, **how)

    def __eq__(self, b):
        return (self <= b) & (self >= b)

    def __ne__(self, b):
        return ~(self == b)

    def sign(self):
        """1, 0, -1 or NaN, as np.sign says."""
        return (self > 0.0).choose(1.0, (self < 0.0).choose(-1.0, self))

    def arctan2(self, b):
        """The angle of a point at this height and b across."""
        height = lift(self)
        if height.x == 0.0:
            height.refuse("np.arctan2 of a zero is decided by its sign, which is not kept")
        return height.carried("arctan2", b)

    def refuse(self, why, kind=Untraceable):
        self.tape.refused.append(why)  # should the function catch this
        raise kind(why)

    def branch(self, *_):
        """Whether this is true, if numbers that are settled decide it."""
        node, settled = self.tape.nodes.get(self.x, ()), self.tape.settled
        if not (node and settled and all(type(x) is float or x in settled for x in node[1:])):
            self.refuse("it branches on a value; np.where, np.maximum and np.minimum do not")
        true = holds(node, settled)
        self.tape.decided.append((node, true))
        return true

    def no_number(self):
        why = "it wants a plain number, as math.sin does and np.sin does not"
        why += "; np.zeros_like(q) makes an array that takes others"
        self.refuse(why, NoNumber)

    def truth(self):
        """This number, which a comparison made, as what is true or not."""
        return Truth(self.tape, self.x, self.minus)

    def __neg__(self):
        return Symbol(self.tape, self.x, not self.minus)

    def __pos__(self):  # as where a minus has been turned round, to see what it does
        return self

    def __abs__(self):
        return self.note("abs")

    __add__, __radd__ = operators(add, lambda a: a)
    __sub__, __rsub__ = operators(subtract)
    __mul__, __rmul__ = operators(multiply, lambda a: 0)
    __truediv__, __rtruediv__ = operators(divide)
    __pow__, __rpow__ = operators(lambda a, b: a.carried("**", b))
    __lt__, __gt__ = operators(lambda a, b: a.carried("<", b).truth())
    __le__, __ge__ = operators(lambda a, b: a.carried("<=", b).truth())
    __bool__ = branch
    __float__ = __int__ = no_number
    __hash__ = None


def of_truths(rule):
    """An operator of a truth and another, or a 0 or 1 that stands for one: of other numbers numpy
    asks for each bit."""

    def operator(a, b):
        fits = isinstance(b, TRUTHS) or (type(b) is int and b in (0, 1))
        return rule(a, b) if fits else NotImplemented

    return operator


class Truth(Symbol):
    """What a comparison made: 1 or 0, and a number to all but its like, since in numpy true + true
    is true. `number`: it as a number, to be counted."""

    __slots__ = ()

    @property
    def number(self):
        return Symbol(self.tape, self.x, self.minus)

    def __add__(self, other):
        if isinstance(other, TRUTHS):  # numpy does not count them, and has no difference of them
            self.refuse("it adds what comparisons made; np.sum counts them")
        return Symbol.__add__(self, other)

    def __mul__(self, other):
        return like(Symbol.__mul__(self, other), self, other)

    def __invert__(self):
        return (1.0 - self.number).truth()

    def __abs__(self):
        return self

    __radd__, __rmul__ = __add__, __mul__
    __and__ = __rand__ = of_truths(__mul__)
    __or__ = __ror__ = of_truths(Symbol.maximum)


TRUTHS = Truth, bool, np.bool


def like(made, *given):
    """The number that was made of others; of truths alone a truth."""
    return made.truth() if all(isinstance(x, TRUTHS) for x in given) else made


def extreme(sign, a, b):
    """What "max" or "min" makes of two numbers. One is a Symbol: it comes first."""
    first, second = (a, b) if isinstance(a, Symbol) else (b, a)
    return like(first.carried(sign, second), a, b)


for name in FUNCTIONS:  # np.sin asks each entry of an object array for its method sin
    setattr(Symbol, name, lambda symbol, name=name: symbol.carried(name))

METHODS = {"+": Symbol.add, "*": Symbol.multiply, "/": Symbol.divide, "abs": Symbol.__abs__}
METHODS |= {"-": lambda a, b: a.add(-b), "**": Symbol.__pow__, "where": Symbol.choose}
METHODS |= {"max": Symbol.maximum, "min": Symbol.minimum, "<": Symbol.__lt__, "<=": Symbol.__le__}
METHODS |= {name: getattr(Symbol, name) for name in FUNCTIONS | BINARY}


def lifted(array):
    """An array of Symbols, of an array of numbers and Symbols."""
    array = np.asarray(array, dtype=object)
    made = np.empty(array.size, object)
    made[:] = symbols = [lift(s) for s in array.ravel().tolist()]
    if any(type(s.x) is str and not s.tape.open for s in symbols):
        raise Untraceable(KEPT)
    return ordered(made.reshape(array.shape))
