"""What functions remember: a trace keeps what they did once, which may be otherwise each time."""

import ctypes
import gc
import os
import pickle
import random
import sys
import sysconfig
from array import array
from collections import deque
from contextvars import ContextVar
from dis import get_instructions
from functools import lru_cache
from operator import delitem, setitem
from pathlib import Path
from types import CellType, CodeType, FunctionType, MappingProxyType, ModuleType
from weakref import ReferenceType, WeakKeyDictionary  # in this singledispatch keeps what it finds

import numpy as np

PLAIN = {int, float, complex, bool, str, bytes, type(None)}
ASKED = {"time": "the time", "datetime": "the time", "random": "chance", "secrets": "chance"}
ASKED |= {"open": "a file", "input": "a line", "eval": "lines of a text", "exec": "lines of a text"}
# where partials, methods, wrappers and generators keep what they lead to
INSIDE = "func", "args", "keywords", "pyfunc", "fget", "bit_generator"
INSIDE += "__func__", "__self__", "__wrapped__", "function"
# of Python's own modules, of installed ones, and of numpy, which may be anywhere
PLACES = {sysconfig.get_path(key) for key in ("stdlib", "platstdlib", "purelib", "platlib")}
PLACES = {Path(place).resolve() for place in (*PLACES, os.path.dirname(np.__file__))}
CURRICULUM = Path(__file__).resolve().parents[1]  # of which exercises are the reader's
FILE = CURRICULUM.with_name("constraints.py")  # which leads to forces of theirs, installed or not


@lru_cache
def of_reader(module):
    """Whether the reader may have written the module of this name: it is no part of Python, of an
    installed package, or of the curriculum but its exercises."""
    if not isinstance(module, str):  # as of what Cython makes
        return False
    file, name = getattr(sys.modules.get(module), "__file__", None), module.partition(".")[0]
    if module == "__main__" or file is None:
        return name not in sys.stdlib_module_names
    if foreign(file):
        return False
    path = Path(file)  # beside a package lies a folder that tells of it, if pip put it there
    beside = path.parents[module.count(".") + (path.stem == "__init__")]
    return not any(beside.glob(f"{name}-*.dist-info"))


def foreign(file):
    """Whether a file of code is Python's, an installed package's, or the curriculum's without its
    exercises; or is none."""
    path = Path(file).resolve()
    if path == FILE:
        return False
    installed = {"site-packages", "dist-packages"} & {*path.parts}
    ours = CURRICULUM in path.parents and "exercises" not in path.relative_to(CURRICULUM).parts
    return bool(installed or PLACES & {*path.parents}) or ours or file.startswith("<")


@lru_cache
def named(code):
    """{globals}, {attributes} that a function's code names, and the functions in it."""
    found = set(), set()
    for step in get_instructions(code):
        if step.opname.endswith(("_GLOBAL", "_NAME")):
            found[0].add(step.argval)
        elif step.opname.endswith(("_ATTR", "_METHOD", "_FROM")):
            found[1].add(step.argval)
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            found = [names | more for names, more in zip(found, named(inner), strict=True)]
    return found


def refill(_, x, old):
    """Have an array hold again what a dict says."""
    objects = x.dtype == object
    x.flat[:] = np.fromiter(old.values(), object) if objects else np.frombuffer(old[0], x.dtype)


def put_names(names, x, old):
    """Have a dict, or a class, hold again what a dict says of some names."""
    put, drop = (setattr, delattr) if isinstance(x, type) else (setitem, delitem)
    for name in names:
        if name in old:
            put(x, name, old[name])
        else:
            drop(x, name)


def class_of(x):
    """The class of an object, as a dict by its name."""
    return {type(x).__name__: type(x)}


def turn_into(_, x, old):
    """Have an object be of the class that a dict has."""
    (x.__class__,) = old.values()


UNSEEN = bytearray, memoryview, array, ContextVar, np.void  # what these hold is not looked at
UNSEEN += (ctypes.c_double.__mro__[-2],)  # the class of all that C reads: other processes write it
VIEWS = MappingProxyType, *(type(view) for view in ({}.keys(), {}.values(), {}.items()))
LINES = "__code__", "__defaults__", "__kwdefaults__"  # of a function, as a notebook reloads it
GENERATORS = np.random.BitGenerator, np.random.RandomState, random.Random
# what holds something: its name, what that is, as a dict, and how some names in it are put back
KINDS = {
    dict: ("the dict {}", dict, lambda _, x, old: (x.clear(), x.update(old))),
    type: ("the global {}", lambda x: dict(vars(x)), put_names),
    set: ("the set {}", lambda x: {y: y for y in x}, lambda _, x, old: (x.clear(), x.update(old))),
    (list, deque): ("the list {}", lambda x: dict(enumerate(x)),
        lambda _, x, old: (x.clear(), x.extend(old.values()))),
    np.ndarray: ("the array {}",
        lambda x: dict(enumerate(x.flat)) if x.dtype == object else {0: x.tobytes()}, refill),
    CellType: ("the variable {}", lambda x: {} if x == CellType() else {0: x.cell_contents},
        lambda _, x, old: setattr(x, "cell_contents", old[0])),
    FunctionType: ("the function {}", lambda x: {n: getattr(x, n) for n in LINES},
        lambda _, x, old: [setattr(x, n, old[n]) for n in LINES]),
    GENERATORS: ("the random generator {}",
        lambda x: {0: pickle.dumps(x.__getstate__())},
        lambda _, x, old: x.__setstate__(pickle.loads(old[0]))),
}  # fmt: skip


# what is made by a class itself, or only to be read
UNASKED = {"__init__", "__new__", "__post_init__", "__repr__", "__str__"}
EVERY = {"globals", "vars", "getattr", "setattr", "__dict__"}  # by which all can be reached


def same(x, y):
    """Whether this is one object, or one plain value: a symbol must not be asked for ==."""
    if x is y or type(x) is not type(y):
        return x is y
    return (type(x) in PLAIN or isinstance(x, np.generic)) and x == y


class Memory:
    """What some functions can reach and change, as it is now.

    Globals, closure cells, defaults and attributes, what these lead to through functions, methods,
    partials, objects and containers; and the global random generators of Python and numpy.
    `asks`: why a trace cannot stand for them in any case, in words.
    """

    def __init__(self, *functions, **others):
        self.parts, self.asks, self.spaces, seen = {}, [], {}, {}
        self.attributes = {"__call__", "__getitem__"}  # that are named, or used without
        todo = [(np.random.get_state.__self__, "of numpy"), (random.getstate.__self__, "of Python")]
        for x in functions:
            name = getattr(x, "__qualname__", type(x).__name__)
            todo.append((x, name.split("<locals>.")[-1]))
        todo += [(x, name) for name, x in others.items()]
        while todo:
            seen |= {id(x): x for x, _ in todo}  # kept alive, so that no other object has its id
            found = [pair for x, name in todo for pair in self.look(x, name)]
            for (_, kind), (space, names) in self.spaces.items():  # only what is named
                own = kind == "own" or isinstance(space, MappingProxyType)  # an object's, a class's
                asked = [*space] if own and names & EVERY else sorted(names & space.keys())
                found += [(space[name], name) for name in asked]
            todo = [(x, n) for x, n in found if type(x) not in PLAIN and id(x) not in seen]

    def note(self, x, name, words=None):
        """(y, name) of all that x holds; noted, if x is of one of KINDS. `words` as there."""
        if isinstance(x, UNSEEN):
            self.asks.append(f"it uses {name}, which cannot be put back")
        if isinstance(x, (tuple, frozenset)):  # what it holds may change, but not it
            return list(zip(x, getattr(x, "_fields", [name] * len(x)), strict=True))
        kind = next((KINDS[known] for known in KINDS if isinstance(x, known)), None)
        if kind is None:
            return []
        try:
            if id(x) not in self.parts:
                self.parts[id(x)] = words or kind[0].format(name), x, *kind[1:], kind[1](x)
        except Exception:  # a generator without a state
            self.asks.append(f"it uses {name}, which cannot be put back")
            return []
        keys = x if isinstance(x, dict) else ()
        return [(y, name) for y in (*keys, *self.parts[id(x)][-1].values())]

    def look(self, x, name):
        """Note x, and yield (y, name) of all that it leads to."""
        if isinstance(x, FunctionType):
            yield from self.of_function(x, name)
        elif isinstance(x, ModuleType):
            self.space(vars(x), vars(x), x.__name__, self.attributes)
        elif isinstance(x, type):
            self.space(x, vars(x), x.__module__, self.attributes)
            if of_reader(x.__module__):  # operators and the like, which no code names
                own = {n for n, y in vars(x).items() if isinstance(y, FunctionType)}
                self.attributes |= {n for n in own - UNASKED if n.startswith("__")}
            yield from ((kind, name) for kind in x.__mro__[1:] if of_reader(kind.__module__))
            yield from self.inside(x, name)
        else:
            yield from self.note(x, name)
            yield from self.inside(x, name)

    def space(self, x, space, module, names):
        """The names that are asked of a space; None if it is none of the reader's modules."""
        if module in ASKED:
            self.asks.append(f"it asks for {ASKED[module]}")
        if not of_reader(module):
            return None
        self.note(x, "", "the global {}")
        kind = names is self.attributes  # functions name globals
        return self.spaces.setdefault((id(space), kind), (space, names))[1]

    def of_function(self, x, name):
        """What a function closes over and, if it is the reader's, names, or has from the start."""
        for n, cell in zip(x.__code__.co_freevars, x.__closure__ or (), strict=True):
            yield from self.note(cell, n)
        space = x.__globals__
        names = self.space(space, space, space.get("__name__", ""), set())
        if names is None:
            return
        self.note(x, name, f"the attribute {{}} of {name}")
        globals_named, attributes = named(x.__code__)
        names |= globals_named
        self.attributes |= attributes | (globals_named & EVERY)
        imported = globals_named - space.keys()  # in its own lines, or Python's own
        self.asks += [f"it asks for {ASKED[module]}" for module in ASKED.keys() & imported]
        yield from ((sys.modules[n], n) for n in sorted(imported & sys.modules.keys()))
        arguments = x.__code__.co_varnames[: x.__code__.co_argcount]
        yield from zip((x.__defaults__ or ())[::-1], arguments[::-1], strict=False)
        yield from ((y, n) for n, y in (x.__kwdefaults__ or {}).items())
        self.attributes_of(x.__dict__, name)

    def attributes_of(self, kept, name):
        """Note what an object keeps in a dict; of that, what is named as an attribute matters."""
        self.note(kept, name, f"the attribute {{}} of {name}")
        self.spaces[id(kept), "own"] = kept, self.attributes

    def inside(self, x, name):
        """What an object keeps: the reader's in its attributes, others' where INSIDE says."""
        kept = getattr(x, "__dict__", None)
        if of_reader(type(x).__module__):
            yield type(x), name
            self.parts["class", id(x)] = "the class {}", x, class_of, turn_into, class_of(x)
            if kept is not None:
                self.attributes_of(kept, name)
            if any(vars(kind).get("__slots__") for kind in type(x).__mro__):
                self.asks.append(f"it uses {name}, which cannot be put back")
        elif hasattr(type(x), "__next__"):  # an iterator, not a class of them
            self.asks.append(f"it takes from {name}, which cannot be put back")
        elif isinstance(x, VIEWS):
            yield from ((y, name) for y in gc.get_referents(x))
        elif isinstance(x, ReferenceType):
            yield x(), name
        elif callable(x) or isinstance(x, np.random.Generator | property | classmethod):
            yield from ((getattr(x, inside, None), name) for inside in INSIDE)
            traced = str(type(x).__module__).startswith("curriculum.")  # a Routine keeps a trace
            if type(x).__dictoffset__ and not traced:  # as a polynomial's; a method has none
                yield from self.note(kept, name, f"the attribute {{}} of {name}")
        elif not isinstance(x, WeakKeyDictionary):  # a Namespace, a UserDict
            yield from self.note(kept, name, f"the attribute {{}} of {name}")

    def changes(self, besides=()):
        """What is not as it was: [(what, in words; how it is put back; which names, x, its old)].

        `besides`: types of what may have changed.
        """
        found, spaces = [], {}
        for (place, _), (_, names) in self.spaces.items():
            spaces[place] = spaces.get(place, set()) | names
        for place, (words, x, take, put, old) in self.parts.items():
            if isinstance(x, besides):
                continue
            now, names = take(x), spaces.get(place, {"globals"})
            every = names & EVERY  # else other threads may use the other names
            asked = old | now if every else [k for k in old | now if k in names]
            new = [k for k in asked if not same(old.get(k, self), now.get(k, self))]
            if new:
                found.append((words.format(new[0]), put if every else put_names, new, x, old))
        return found

    def restore(self):
        """Put back, in place, what has changed; what was first, in words, or None."""
        found = self.changes()
        for _, put, *given in found:
            put(*given)
        return f"it changes {found[0][0]}" if found else None

    def changed(self):
        """What has changed, in words, or None; generators of random numbers may be used."""
        found = self.changes(GENERATORS)
        return found[0][0] if found else None
