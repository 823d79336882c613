"""An Answer in words, for terminal and page: they differ in the cells for work only."""

from typing import NamedTuple

from curriculum.ch3_4_constraints.rods.schemes import ENERGY
from curriculum.common.words import (
    LENGTHS,
    amount,
    as_given,
    in_digits,
    length,
    milliseconds,
    per_cent,
    sentence,
)

LARGE = 0.1  # of the shortest rod: a tolerance as large says little
MARK = "!"  # of a cell that is not right


class Line(NamedTuple):
    """A row of the table of an Answer."""

    name: str
    cells: list  # words: step, places, rods, energy, work; or when and why it was lost
    rung: object  # the Rung that it is of


class Advice(NamedTuple):
    """An Answer in words."""

    verdict: str
    heads: list  # [(over it, head)] of the cells
    lines: list  # [Line]
    alone: list  # [Line]: what is enough if only rods must be right
    missing: list  # a sentence for each integrator that has no line
    notes: list  # sentences


def advice(asked, answer):
    """The Advice of an Answer to a Request."""
    unit = as_given(answer.within).split()[-1]
    lines = [line for row in answer.rows for line in lines_of(answer, row, unit)]
    alone = []
    if answer.rods:
        first = lines_of(answer, answer.rods, unit)[0]
        alone = [first._replace(cells=[x.removesuffix(MARK) for x in first.cells])]
    return Advice(
        verdict=verdict(answer),
        heads=heads(answer, unit),
        lines=lines,
        alone=alone,
        missing=[missing(answer, x) for x in answer.missing],
        notes=notes(asked, answer),
    )


def verdict(answer):
    """The first sentence."""
    within = as_given(answer.within)
    if answer.verdict:
        rung = answer.verdict.rung
        span = f", for {rung.span:.3g} s" if rung.span < answer.whole else ""
        places = ", rods and energy only"
        if answer.seconds:
            places = f", places to {answer.seconds:.3g} s" if answer.seconds < rung.span else ""
        what = f"{rung.scheme}, in steps of {milliseconds(rung.dt)}"
        return f"Right to {within}{span}{places}: {what}."
    if answer.missing:
        return f"Right to {within}: no step that was tried."
    return f"No answer to --within {within.replace(' ', '')}: {answer.why}."


def heads(answer, unit):
    """[(name, unit)] of the columns behind a row's name, where lengths are in such a unit."""
    places = f"to {answer.seconds:.3g} s, {unit}" if answer.seconds else unit
    return [
        ("step", "ms"),
        ("for", "s"),
        ("places", places),
        ("rods", unit),
        ("energy", ""),
        ("work", "us/s"),
    ]


def lines_of(answer, row, unit):
    """The two Lines of a Row: its step, and what becomes of it in twice that."""
    first = Line(str(row.rung.scheme), cells(answer, row.rung, unit, row.pace), row.rung)
    if row.ends:
        first.cells[1] += MARK
    twice = row.twice
    shown = cells(answer, twice, unit, row.pace)
    if twice.lost:
        return [first, Line("  twice: lost", [twice.lost], twice)]
    if any(MARK in x for x in shown):
        what = "fails"
    else:
        what = "too few steps" if row.is_longest else "right by luck"
    return [first, Line(f"  twice: {what}", shown, twice)]


def cells(answer, rung, unit, pace):
    """step, span, places, rods, energy and work of a Rung, in words."""
    most = answer.within
    return [
        f"{in_digits(1e3 * rung.dt, 3):g}",
        f"{rung.span:.3g}",
        in_unit(rung.places, unit, most),
        in_unit(rung.rods, unit, most),
        energy(rung),
        amount(1e6 * rung.operations * pace, 2),
    ]


def energy(rung):
    """The energy of a Rung in words, marked if it is not right."""
    if rung.energy is None:
        return "-"
    if rung.energy < 1e-4:
        return "< 0.01 %"
    return per_cent(rung.energy) + MARK * (rung.energy > ENERGY)


def in_unit(x, unit, most):
    """A length of x m in a unit, marked if it is more than most."""
    if x is None:
        return "-"
    digits = 2 if x > 1e-3 * most else 1
    size = in_digits(x / 10.0 ** LENGTHS[unit], digits)
    said = f"{size:.1f}" if digits == 2 and 1.0 <= size < 10.0 else f"{size:g}"
    return said.replace("e-0", "e-") + MARK * (x > most)


def missing(answer, x):
    """A sentence on an integrator none of whose steps is right."""
    rung = x.best
    said = f"{x.integrator}: no step down to {milliseconds(x.shortest)} is right"
    if rung.lost:
        return f"{said}: all are lost"
    best = f"{said}; the best, {rung.scheme.method} at {milliseconds(rung.dt)}, is"
    if rung.places is not None and rung.places > answer.within:
        return f"{best} {length(rung.places)} off"
    if rung.rods > answer.within:
        return f"{best} {length(rung.rods)} off in its rods"
    if rung.energy is not None and rung.energy > ENERGY:
        return f"{best} {per_cent(rung.energy)} off in its energy"
    return f"{best} right by luck: steps a little shorter are wrong"


def notes(asked, answer):
    """What else has to be said, in sentences."""
    said = []
    if not answer.rows:
        return said
    places = f"places to {answer.seconds:.3g} s; " if answer.seconds else ""
    counts = f"{places}rods and energy (to {per_cent(ENERGY)}) as long as shown."
    ends = f" After a time with {MARK} it is wrong." if any(row.ends for row in answer.rows) else ""
    said.append(f"All times count: {counts}{ends}")
    if answer.why:
        said.append(sentence(answer.why))
    shortest = min(asked.system["lengths"])
    if answer.within >= LARGE * shortest:
        said.append(f"The shortest rod is {length(shortest)}: this tolerance says little.")
    return said


def command(asked, answer):
    """The command that runs the verdict, for as long as it was measured."""
    row = answer.verdict
    flags = {
        "--integrator": row.rung.scheme.integrator,
        "--stabilization": row.rung.scheme.method,
        "--dt": f"{row.rung.dt:.9g}",
        "--steps": str(row.rung.steps),
    }
    return asked.command(flags)
