"""Integrators by name: those of a table, and two families of any order or number of stages."""

import math
import re
from argparse import ArgumentTypeError
from functools import lru_cache
from typing import NamedTuple

from curriculum.common.cli import meant, shorten
from curriculum.common.gauss import make_gauss
from curriculum.common.midpoint import ORDERS, make_midpoint


class Family(NamedTuple):
    """Rules that differ by one number."""

    make: object  # (number) -> rule, or (number, tol) -> rule: the same one for the same numbers
    numbers: range  # those that it may be
    what: str  # the same in words
    tried: tuple  # numbers among which `--tol` chooses
    iterated: bool = False  # whether a step ends by a tolerance, too


FAMILIES = {
    "midpoint": Family(lru_cache(make_midpoint), ORDERS, "an even order, 2 to 16", (6, 8, 10, 12)),
    "gauss": Family(lru_cache(make_gauss), range(2, 17), "2 to 16 stages", (4, 8, 16), True),
}
ITERATED = 0.1  # what an iteration may leave, as a share of the error that is asked for
LEAST, MOST = 1e-16, 1e-2  # tolerances of an iteration, as a share of the state


def named(text, table):
    """The rule that `text` names.

    A name of the `table`; `midpoint:10`, of order 10; `gauss:6`, of 6 stages; or `gauss:6:1e-9`,
    whose stages are iterated to 1e-9 of the state. ArgumentTypeError if it names none.
    """
    name, *numbers = text.split(":", 2)
    if not numbers and name in table:
        return table[name]
    if name not in FAMILIES:
        known = ", ".join([*table, *(f"{family}:N" for family in FAMILIES)])
        near = meant(name, table, f"; there are {known}")
        raise ArgumentTypeError(f"no rule is called {shorten(text)!r}{near}")
    family = FAMILIES[name]
    size = numbers[0] if numbers else ""
    if not re.fullmatch(r"\d{1,3}", size, re.ASCII) or int(size) not in family.numbers:
        raise ArgumentTypeError(f"{name}:N takes {family.what}, not {shorten(size)!r}")
    if len(numbers) == 1:
        return family.make(int(size))
    tol = numbers[1]
    if not family.iterated:
        raise ArgumentTypeError(f"{name}:N has no tolerance {shorten(tol)!r}: it does not iterate")
    whole = re.fullmatch(r"(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", tol, re.ASCII)
    if not whole or not LEAST <= float(tol) <= MOST:
        allowed = f"a tolerance from {LEAST:g} to {MOST:g}"
        raise ArgumentTypeError(f"{name}:N:TOL takes {allowed}, not {shorten(tol)!r}")
    return family.make(int(size), float(tol))


def offered(text, table, tol=None):
    """{name: rule} of the rules that `text` leaves open for an error of `tol` m.

    With `tol` a bare name of a family is all numbers that are tried, each iterated as far as that
    needs. ArgumentTypeError for rules of low order, which take too long to a small error.
    """
    if tol is None:
        return {text: named(text, table)}
    name, *numbers = text.split(":")
    if name not in FAMILIES:
        families = " or ".join(FAMILIES)
        raise ArgumentTypeError(f"{tol:g} wants --integrator {families}, not {text}")
    family = FAMILIES[name]
    names = [text] if numbers else [f"{name}:{size}" for size in family.tried]
    if family.iterated and len(numbers) < 2:
        digits = math.floor(math.log10(ITERATED * tol))
        names = [f"{each}:1e{max(digits, -16):+03d}" for each in names]
    return {each: named(each, table) for each in names}
