"""What functions remember: a trace keeps what they did once, which may be otherwise each time."""

import ctypes
import gc
import pickle
import random
import sys
from array import array
from collections import deque
from contextvars import ContextVar
from dis import get_instructions
from functools import lru_cache, partial
from operator import delitem, setitem
from types import CellType, CodeType, FunctionType, MappingProxyType, ModuleType
from weakref import ReferenceType, WeakKeyDictionary  # in this singledispatch keeps what it finds

from curriculum.common.origin import of_reader

import numpy as np

PLAIN = {int, float, complex, bool, str, bytes, type(None)}
ASKED = {"time": "the time", "datetime": "the time", "random": "chance", "secrets": "chance"}
ASKED |= {"open": "a file", "input": "a line", "eval": "lines of a text", "exec": "lines of a text"}
# where partials, methods, wrappers and generators keep what they lead to
INSIDE = "func", "args", "keywords", "pyfunc", "fget", "bit_generator"
INSIDE += "__func__", "__self__", "__wrapped__", "function"
# what is made by a class itself, or only to be read
UNASKED = {"__init__", "__new__", "__post_init__", "__repr__", "__str__"}
EVERY = {"globals", "vars", "getattr", "setattr", "__dict__"}  # by which all can be reached
UNSEEN = bytearray, memoryview, array, ContextVar, np.void  # what these hold is not looked at
UNSEEN += (ctypes.c_double.__mro__[-2],)  # the class of all that C reads: other processes write it
VIEWS = MappingProxyType, *(type(view) for view in ({}.keys(), {}.values(), {}.items()))
LINES = "__code__", "__defaults__", "__kwdefaults__"  # of a function, as a notebook reloads it
GENERATORS = np.random.BitGenerator, np.random.RandomState, random.Random


# put(names, x, old): have x hold again what a dict says, at least of these names
def put_names(names, x, old):
    put, drop = (setitem, delitem) if isinstance(x, dict) else (setattr, delattr)
    for name in names:
        if name in old:
            put(x, name, old[name])
        else:
            drop(x, name)


def put_keys(_, x, old):
    x.clear()
    x.update(old)


def put_items(_, x, old):
    x.clear()
    x.extend(old.values())


def put_entries(_, x, old):
    objects = x.dtype == object
    x.flat[:] = np.fromiter(old.values(), object) if objects else np.frombuffer(old[0], x.dtype)


def entries(x):
    return dict(enumerate(x.flat)) if x.dtype == object else {0: x.tobytes()}


def content(x):  # a variable may have none yet
    return {} if x == CellType() else {"cell_contents": x.cell_contents}


def put_state(_, x, old):
    x.__setstate__(pickle.loads(old[0]))


def put_class(_, x, old):
    (x.__class__,) = old.values()


# what holds something: what it is called, what it holds, as a dict, and its put
KINDS = {
    dict: ("the dict {}", dict, put_keys),
    type: ("the global {}", lambda x: dict(vars(x)), put_names),
    set: ("the set {}", lambda x: {y: y for y in x}, put_keys),
    (list, deque): ("the list {}", lambda x: dict(enumerate(x)), put_items),
    np.ndarray: ("the array {}", entries, put_entries),
    CellType: ("the variable {}", content, put_names),
    FunctionType: ("the function {}", lambda x: {n: getattr(x, n) for n in LINES}, put_names),
    GENERATORS: (
        "the random generator {}",
        lambda x: {0: pickle.dumps(x.__getstate__())},
        put_state,
    ),
}
CLASS = ("the class {}", lambda x: {type(x).__name__: type(x)}, put_class)  # of an object


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


def is_plain(x):
    """Whether it is a number, a text or the like, or a tuple of these, as a pair: never changed."""
    return type(x) in PLAIN or (type(x) is tuple and PLAIN.issuperset(map(type, x)))


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
        self.parts = {}  # {id: (its words, x, what holds, put, what it held)}
        # of modules, classes and objects: (a dict, or vars of a class; the names in it that matter;
        # whether it is an object's or a class's, of which getattr and the like reach all)
        self.spaces, self.asks = {}, []
        self.attributes = {"__call__", "__getitem__"}  # that are named, or used without
        todo = [(np.random.get_state.__self__, "of numpy"), (random.getstate.__self__, "of Python")]
        for x in functions:
            name = getattr(x, "__qualname__", type(x).__name__)
            todo.append((x, name.split("<locals>.")[-1]))
        todo += [(x, name) for name, x in others.items()]
        seen = {}
        while todo := [(x, n) for x, n in todo if not is_plain(x) and id(x) not in seen]:
            seen |= {id(x): x for x, _ in todo}  # kept alive, so that no other object has its id
            todo = [pair for x, name in todo for pair in self.look(x, name)]
            for space, names, own in self.spaces.values():
                reached = [*space] if own and names & EVERY else sorted(names & space.keys())
                todo += [(space[name], name) for name in reached]

    def look(self, x, name):
        """Note x, and yield (y, name) of all that it leads to."""
        if isinstance(x, FunctionType):
            yield from self.of_function(x, name)
        elif isinstance(x, ModuleType):
            if self.is_readers(x.__name__):
                self.open_space(vars(x), self.attributes)
        elif isinstance(x, type):
            yield from self.of_class(x, name)
        else:
            yield from self.note(x, name)
            yield from self.inside(x, name)

    def of_function(self, x, name):
        """What a function closes over and, if it is the reader's, names, or has from the start."""
        for n, cell in zip(x.__code__.co_freevars, x.__closure__ or (), strict=True):
            yield from self.note(cell, n)
        space = x.__globals__
        if not self.is_readers(space.get("__name__", "")):
            return
        globals_named, attributes = named(x.__code__)
        names = self.open_space(space, set())
        names |= globals_named
        self.note(x, name, f"the attribute {{}} of {name}")
        self.attributes |= attributes | (globals_named & EVERY)
        imported = globals_named - space.keys()  # in its own lines, or Python's own
        self.asks += [f"it asks for {ASKED[module]}" for module in ASKED.keys() & imported]
        yield from ((sys.modules[n], n) for n in sorted(imported & sys.modules.keys()))
        arguments = x.__code__.co_varnames[: x.__code__.co_argcount]
        yield from zip((x.__defaults__ or ())[::-1], arguments[::-1], strict=False)
        yield from ((y, n) for n, y in (x.__kwdefaults__ or {}).items())
        self.open_space(x.__dict__, self.attributes, name)

    def of_class(self, x, name):
        """What a class inherits from; of the reader's, what is named as an attribute matters."""
        if self.is_readers(x.__module__):
            self.open_space(x, self.attributes)
            methods = {n for n, y in vars(x).items() if isinstance(y, FunctionType)}
            # operators and the like, which no code names
            self.attributes |= {n for n in methods - UNASKED if n.startswith("__")}
        yield from ((kind, name) for kind in x.__mro__[1:] if of_reader(kind.__module__))
        yield from self.inside(x, name)

    def inside(self, x, name):
        """What an object keeps: the reader's in its attributes, others' where INSIDE says."""
        kept, words = getattr(x, "__dict__", None), f"the attribute {{}} of {name}"
        if of_reader(type(x).__module__):
            yield type(x), name
            words, held, put = CLASS
            self.parts["class", id(x)] = words, x, held, put, held(x)
            if kept is not None:
                self.open_space(kept, self.attributes, name)
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
                yield from self.note(kept, name, words)
        elif not isinstance(x, WeakKeyDictionary):  # a Namespace, a UserDict
            yield from self.note(kept, name, words)

    def note(self, x, name, words=None):
        """(y, name) of all that x holds; noted, if x is of one of KINDS."""
        if isinstance(x, UNSEEN):
            self.asks.append(f"it uses {name}, which cannot be put back")
        if isinstance(x, (tuple, frozenset)):  # what it holds may change, but not it
            return list(zip(x, getattr(x, "_fields", [name] * len(x)), strict=True))
        kind = next((KINDS[known] for known in KINDS if isinstance(x, known)), None)
        if kind is None:
            return []
        called, held, put = kind
        try:
            if id(x) not in self.parts:
                self.parts[id(x)] = words or called.format(name), x, held, put, held(x)
        except Exception:  # a generator without a state
            self.asks.append(f"it uses {name}, which cannot be put back")
            return []
        keys = x if isinstance(x, dict) else ()
        return [(y, name) for y in (*keys, *self.parts[id(x)][-1].values())]

    def is_readers(self, module):
        """Whether a module of this name is the reader's; if it is one of ASKED, that is told."""
        if module in ASKED:
            self.asks.append(f"it asks for {ASKED[module]}")
        return of_reader(module)

    def open_space(self, x, names, owner=None):
        """Note a class or a dict, of which only what is named matters: the `names`, a set.

        `owner`: what the object is called whose attributes they are; else they are globals.
        """
        self.note(x, owner, "the global {}" if owner is None else f"the attribute {{}} of {owner}")
        of_class = isinstance(x, type)
        space = vars(x) if of_class else x
        key = id(space), names is self.attributes
        own = of_class or owner is not None
        return self.spaces.setdefault(key, (space, names, own))[1]

    def changes(self, besides=()):
        """[(what is not as it was, in words; what puts it back)].

        `besides`: types of what may have changed.
        """
        found, spaces = [], {}
        for (place, _), (_, names, _) in self.spaces.items():
            spaces[place] = spaces.get(place, set()) | names
        for place, (words, x, held, put, old) in self.parts.items():
            if isinstance(x, besides):
                continue
            now, names = held(x), spaces.get(place, EVERY)
            every = names & EVERY  # else other threads may use the other names
            asked = old | now if every else [k for k in old | now if k in names]
            new = [k for k in asked if not same(old.get(k, self), now.get(k, self))]
            if new:
                back = partial(put if every else put_names, new, x, old)
                found.append((words.format(new[0]), back))
        return found

    def restore(self):
        """Put back, in place, what has changed; what was first, in words, or None."""
        found = self.changes()
        for _, put_back in found:
            put_back()
        return f"it changes {found[0][0]}" if found else None

    def changed(self):
        """What has changed, in words, or None; generators of random numbers may be used."""
        found = self.changes(GENERATORS)
        return found[0][0] if found else None
