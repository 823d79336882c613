"""What runs and studies print: numbers with units, tables, and the bars they are held to."""

import textwrap

import numpy as np

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


def in_turns(jobs, repeats):
    """{name: [results]}: what jobs called A B A B return; a first round warms up only."""
    found = {name: [] for name in jobs}
    for turn in range(repeats + 1):
        for name, job in jobs.items():
            result = job()
            found[name] += [result] if turn else []
    return found


def spread(samples, unit):
    """Median and quartiles of `samples` as columns of a table."""
    columns = (unit, f"{unit} q1", f"{unit} q3")
    return dict(zip(columns, np.percentile(samples, [50, 25, 75]).tolist(), strict=True))


def say(text):
    """Print a sentence, in lines that fit a page."""
    print(textwrap.fill(text, 100, subsequent_indent="  ", break_long_words=False))


def show(title, rows, bars=()):
    """Print a table and its bars; the same as a dict."""
    cells = [[f"{x:.3g}" if isinstance(x, float) else str(x) for x in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(rows[0], *cells, strict=True)]
    print(f"\n{title}")
    for row in (rows[0], *cells):
        print("  ".join(x.rjust(width) for x, width in zip(row, widths, strict=True)))
    keys = "bar", "value", "at most", "met"
    bars = [dict(zip(keys, (*bar, bool(bar[1] <= bar[2])), strict=True)) for bar in bars]
    for bar in bars:
        verdict = "met" if bar["met"] else "MISSED"
        print(f"{bar['bar']}: {bar['value']:.3g}, bar {bar['at most']:.3g}: {verdict}")
    return {"table": title, "rows": rows, "bars": bars}
