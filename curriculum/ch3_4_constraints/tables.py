"""What runs and studies print: numbers with units, tables, and the bars they are held to."""

import math
import textwrap
from itertools import product

from curriculum.common.progress import work
from curriculum.common.ruler import KNOWN

import numpy as np

WIDTH = 80  # columns of what is printed
JUMP = 0.1  # of m g L: by so much energy may change in a step without a word
UNHELD = 1e-3  # m/s^2: so much may stay unanswered without a word
UNITS = (1.0, 1.0, "m"), (1e-3, 0.01, "cm"), (1e-6, 1e-6, "um"), (1e-9, 1e-9, "nm")


def length(x):
    """Metres x in two digits and a unit, 0.384 as "38 cm"; below Newton's tolerance "< 1 pm"."""
    if x < 1e-12:
        return "< 1 pm"
    x = float(f"{x:.2g}")
    size, unit = next(((size, unit) for least, size, unit in UNITS if x >= least), (1e-12, "pm"))
    return f"{x / size:g} {unit}"


def per_cent(share):
    """A share in per cent, two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def show_comparison(comparison):
    """Print the table of a Comparison, and a sentence for each mark in it."""
    rows, runs, truth, tol = comparison.rows, comparison.runs, comparison.truth, comparison.args.tol
    at, notes = f"{truth.step * comparison.dt:.3g} s", []
    wide = max(10, *(len(mode) + 1 for mode in rows))  # a row of the reader's own may be longer
    print(f"\n{'':{wide}}     rods off by      energy off  from the truth    a step")
    print(f"{'mode':{wide}}    worst     at end    of m g L  {f'at {at}':>14}        us")
    for (mode, row), run in zip(rows.items(), runs.values(), strict=True):
        worst, end = (length(x) for x in (np.max(run.violations), run.violations[-1]))
        energy, error = per_cent(row["energy_rel_max"]), "-"
        if len(run.tip) == 1:  # not a single step
            worst = end = energy = "-"
        if row["error"] is not None:  # no finer than what is known
            coarse = row["error"] < truth.uncertainty and truth.uncertainty >= 1e-12
            error = f"< {length(truth.uncertainty)}" if coarse else length(row["error"])
        said = [f" {run.remark}"] if run.remark else []
        if row["unheld"] > UNHELD:
            left = f"{row['unheld']:.2g} m/s^2 unanswered"
            said.append(f": tensions leave an acceleration of {left}")
        if row["energy_step_max"] > JUMP and not run.stopped:
            jump = f"{per_cent(row['energy_step_max'])} of m g L in one step"
            said.append(f": energy jumps by {jump}: too long a step")
        name = mode + "*" * bool(said)
        print(f"{name:<{wide}}{worst:>9}  {end:>9}  {energy:>10}  {error:>14}  {run.pace:8.3g}")
        notes += [f"* {mode}{words}" for words in said]
    for note in notes:
        say(note)
    lost = [mode for mode, row in rows.items() if row["error"] is None]
    if lost:
        why = f"the truth at {at} is {truth.unsought or f'not known to {length(KNOWN)}'}"
        why = why if truth.q is None else f"stopped before {at}"
        say(f"- {', '.join(lost)}: {why}")
    aim = math.inf if tol is None else tol
    over = [mode for mode in rows if mode in lost or rows[mode]["error"] > aim]
    if tol is not None and over:
        say(f"--tol {tol:g} is the aim of the best mode; not met by {', '.join(over)}")


def verdict(rows):
    """Print how much further `none` drifts than `baumgarte`, if both got to the end."""
    drift = {mode: row["max_violation"] for mode, row in rows.items() if not row["stopped"]}
    if "baumgarte" in drift and drift.get("none", 0.0) > 1e-9:
        ratio = drift["none"] / max(drift["baumgarte"], 1e-12)
        words = "as expected, over 3" if ratio > 3.0 else "UNEXPECTED, not over 3"
        print(f"verdict: worst rod error, none / baumgarte = {ratio:.1f}: {words}")


def in_turns(jobs, repeats):
    """{name: [results]}: what jobs called A B A B return; a first round warms up only."""
    found = {name: [] for name in jobs}
    for turn, name in work.through("timing", list(product(range(repeats + 1), jobs))):
        result = jobs[name]()
        if turn > 0:
            found[name].append(result)
    return found


def spread(samples, unit):
    """Median and quartiles of `samples` as columns of a table."""
    columns = (unit, f"{unit} q1", f"{unit} q3")
    return dict(zip(columns, np.percentile(samples, [50, 25, 75]).tolist(), strict=True))


def say(text):
    """Print a sentence, in lines that fit a terminal."""
    whole = {"break_on_hyphens": False, "break_long_words": False}  # a path is one word
    print(textwrap.fill(text, WIDTH, subsequent_indent="  ", **whole))


def show(title, rows, bars=()):
    """Print a table, and of each bar (what, value, the most it may be) whether it is met."""
    cells = [[f"{x:.3g}" if isinstance(x, float) else str(x) for x in row.values()] for row in rows]
    heads = [list(rows[0])]

    def widths():
        return [max(map(len, column)) for column in zip(*heads, *cells, strict=True)]

    gaps = 2 * len(rows[0]) - 2
    if sum(widths()) + gaps > WIDTH:  # a line for each word of the longest header
        words = [header.split() for header in rows[0]]
        most = max(map(len, words))
        heads = list(zip(*([""] * (most - len(x)) + x for x in words), strict=True))
    gap = "  " if sum(widths()) + gaps <= WIDTH else " "
    print(f"\n{title}")
    for row in (*heads, *cells):
        print(gap.join(x.rjust(width) for x, width in zip(row, widths(), strict=True)))
    for bar, value, most in bars:
        print(f"{bar}: {value:.3g}, bar {most:.3g}: {'met' if value <= most else 'MISSED'}")
