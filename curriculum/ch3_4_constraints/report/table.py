"""The table that a run prints, and a sentence for what is not known."""

import re
import textwrap

import numpy as np

from curriculum.ch3_4_constraints.rods.run import moves
from curriculum.ch3_4_constraints.rods.stability import stability_limit
from curriculum.common import words

ROUNDING = 1e-9  # of the shortest rod: errors below are not of a method
WIDTH = 80  # columns of a terminal
TIED = "\N{NO-BREAK SPACE}"  # between words of one line
GAP = 2  # between two columns of the table
FEW = 3.0  # times: as much better baumgarte holds the rods than none, as a rule


def say(text, joint=""):
    """Print a sentence, in lines of 80 columns that end in `joint`.

    A path is one word, and a flag stays on the line of its value.
    """
    whole = {"break_on_hyphens": False, "break_long_words": False}
    text = re.sub(r"(?<= )(--\S+) (?!--)", rf"\1{TIED}", text)
    lines = textwrap.wrap(text, WIDTH - len(joint), subsequent_indent="  ", **whole)
    print(f"{joint}\n".join(lines).replace(TIED, " "))


def aligned(heads, rows):
    """The lines of a table: two of its heads, [(upper, lower)], and one for each row of words.

    The first column begins at its left, others end at their right, as wide as they need. What
    stands alone after the first is a sentence.
    """
    table = [*zip(*heads, strict=True), *rows]
    full = [row for row in table if len(row) == len(heads)]
    widths = [max(map(len, column)) for column in zip(*full, strict=True)]
    widths[0] = max(len(row[0]) for row in table)
    lines = []
    for row in table:
        line = row[0].ljust(widths[0])
        if len(row) < len(heads):
            line += " " * GAP + row[1]
        else:
            for x, width in zip(row[1:], widths[1:], strict=True):
                line += x.rjust(width + GAP)
        lines.append(line.rstrip())
    return lines


def print_table(asked, runs, results, truth, columns):
    """Print what was run, and how; a row for each run; and what is said of these rows.

    `runs` and `results` are {name: Run} and {name: row}; columns(run, row, truth) is a row's
    [(upper head, lower head, words)].
    """
    seconds = asked.steps * asked.dt
    span = f"{seconds:.2f}" if seconds >= 1.0 else f"{seconds:.3g}"
    what = f"integrated {asked.scene} ({asked.integrator}) for {asked.steps} steps"
    print(f"{what} of {asked.dt:g} s -> {span} s of sim time")
    how = "; ".join(dict.fromkeys(run.report.how for run in runs.values()))
    say(f"seed {asked.seed}; {how}")
    rows = []
    for name, run in runs.items():
        cells = columns(run, results[name], truth)
        rows.append([name, run.lost] if run.lost else [name, *(words for _, _, words in cells)])
    heads = [("", "method"), *((upper, lower) for upper, lower, _ in cells)]
    print()
    print("\n".join(aligned(heads, rows)))
    print_notes(asked, runs, results, truth)
    print_ratio(runs, results)


def completed(asked, run, row):
    """A row of what is known of a Run, with what the pages and files need besides.

    What would be of another run is None.
    """
    more = {
        "conserves": asked.conserves(run.q, run.v),
        "operations": run.operations,  # for a second of motion
        "stopped": run.stopped,  # when and why, if it ended early
    }
    if run.unlike:
        more |= {"energy_rel_max": None, "tension_max": None, "error": None, "unlike": run.unlike}
    return row | more


def energy(row):
    """The largest change of energy, where it is an error."""
    share = row["energy_rel_max"]
    return words.per_cent(share) if row["conserves"] and share is not None else "-"


def force(row):
    """The largest force of a row in N, in three digits."""
    most = row["tension_max"]
    if most is None:
        return "-"
    if most >= 1e5:
        return f"{most:.3g}".replace("e+0", "e")
    return words.amount(most).replace(",", "")


def print_notes(asked, runs, results, truth):
    """Print a sentence for what is missing or past its limit."""
    for name, run in runs.items():
        if run.stopped and not run.lost:
            say(f"{name}: {run.stopped}")
    unlike = dict.fromkeys(run.unlike for run in runs.values() if run.unlike)
    for why in unlike:
        say(f"- places, energy and forces are not known: {why}")
    if not unlike:
        print_unknown({name: row for name, row in results.items() if not runs[name].lost}, truth)
    if asked.left_out:
        say(f"left out, as not made for {asked.integrator}: {', '.join(asked.left_out)}")
    if "baumgarte" in results:
        limit = stability_limit(asked.chapter.integrators[asked.integrator])
        print_limit(asked.dt * asked.knobs["baumgarte"], limit)


def print_unknown(alive, truth):
    """Print why figures of rows that are shown are not known."""
    if not all(row["conserves"] for row in alive.values()):
        say("- energy off: external_force does work that energy does not count")
    hidden = [name for name, row in alive.items() if row["tension_max"] is None]
    if hidden:
        why = "all in what is done after a step, or rods so nearly in line that it is not known"
        say(f"- largest force: {why} ({', '.join(hidden)})")
    if truth.q is None:
        say(f"- places off: the true motion is not known: {truth.why}")


def print_limit(dt_w, limit):
    """Print by how much dt w is past its limit; at the limit itself an error stays as it is."""
    if dt_w > limit * (1.0 + 1e-6):
        digits = 3 if dt_w > 1.01 * limit else 6
        say(f"baumgarte: dt w = {dt_w:.{digits}g} is past its limit {limit:.{digits}g}")


def print_ratio(runs, results):
    """Print how much better baumgarte holds the rods than none, where a run has both."""
    if not {"none", "baumgarte"} <= results.keys():
        return
    if runs["none"].stopped or runs["baumgarte"].stopped:
        return
    run = runs["baumgarte"]
    worst = results["none"]["max_violation"]
    kept = results["baumgarte"]["max_violation"]
    if not moves(run.q, run.start):
        say("largest rod error: nothing moves, so none and baumgarte have nothing to hold")
    elif max(worst, kept) < ROUNDING * np.min(run.start["lengths"]):
        say("largest rod error: none and baumgarte differ by rounding only")
    elif worst > FEW * kept:
        times = f"{words.in_digits(worst / kept, 2):g} x" if kept > 0.0 else "which has none"
        say(f"largest rod error, none > {FEW:g} x baumgarte: as expected ({times})")
    else:
        ratio = words.in_digits(worst / kept, 2)
        found = f"{ratio:g}, not above {FEW:g}"
        say(f"largest rod error, none / baumgarte: {found}: try another w or step")
