"""The reader's functions: called with what they take, and judged by what they return or raise."""

from functools import lru_cache
from inspect import signature
from pathlib import Path
from traceback import extract_tb

from curriculum.common.arrays import ordered
from curriculum.common.cli import shorten
from curriculum.common.origin import foreign
from curriculum.common.tape import TooLong


@lru_cache(256)
def wanted(function, given):
    """How many of so many arguments a function must have, and whether it takes v by its name."""
    parameters = signature(function).parameters.values()
    if any(x.kind == x.VAR_POSITIONAL for x in parameters):
        return given, False
    placed = [x for x in parameters if x.kind in (x.POSITIONAL_ONLY, x.POSITIONAL_OR_KEYWORD)]
    many = sum(x.default is x.empty for x in placed)
    if many == given - 1 and [x.name for x in placed[many:]][:1] == ["v"]:
        return given, False
    named = [x.name for x in parameters if x.kind != x.POSITIONAL_ONLY and x not in placed[:many]]
    return many, "v" in named


def called(function, *arguments):
    """function(*arguments), without the last ones if it takes fewer; the last of all is v."""
    try:
        many, by_name = wanted(function, len(arguments))
    except (TypeError, ValueError):  # it has no signature, or no hash
        many, by_name = len(arguments), False
    named = {"v": arguments[-1]} if by_name else {}
    return function(*arguments[:many], **named)


def place_of(function):
    """What a function is called and, of Python's, where it stands."""
    function = getattr(function, "func", function)  # of a partial
    name = getattr(function, "__name__", type(function).__name__)
    code = getattr(function, "__code__", None)
    return f"{name} ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code else name


def shaped(made, shape, function):
    """What a function of forces made, as an array; ValueError for another shape names its line."""
    try:
        return ordered(made, shape)
    except ValueError as why:
        raise ValueError(f"{place_of(function)}: {why}") from None


def as_state(end, step):
    """The q, v that a step returned, which may be lists, as arrays."""
    if not isinstance(end, (tuple, list)) or len(end) != 2:
        what = f"returned {shorten(repr(end))}, where a step returns q and v"
        raise ValueError(f"{place_of(step)} {what}")
    return tuple(map(ordered, end))


def explained(reason):
    """An error in words, and the line of the reader's that raised it, if one did."""
    words = str(reason) or type(reason).__name__
    frames = [x for x in extract_tb(reason.__traceback__) if not foreign(x.filename)]
    if isinstance(reason, TooLong) or not frames:
        return words
    return f"{words} ({Path(frames[-1].filename).name}, line {frames[-1].lineno})"
