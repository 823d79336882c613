"""What runs and studies print: numbers with units, tables, and the bars they are held to."""

import textwrap

import numpy as np


def length(metres):
    """Two digits and a unit, as 0.384 -> "38 cm"; what `project` takes for nothing is < 1 pm."""
    x = float(f"{metres:.2g}")
    if x < 1e-12:
        return "< 1 pm"
    units = (1.0, "m"), (0.01, "cm"), (1e-3, "mm"), (1e-6, "um"), (1e-9, "nm"), (1e-12, "pm")
    size, unit = next((size, unit) for size, unit in units if x >= 0.1 * size or size == 1e-12)
    return f"{x / size:g} {unit}"


def per_cent(share):
    """Two digits of a share in per cent."""
    return f"{100.0 * float(f'{share:.2g}'):.6g} %"


def in_turns(jobs, repeats):
    """{name: [results]}: what jobs called A B A B return; the first round, a warm-up, is left out."""
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
    bars = [
        {"bar": text, "value": x, "at most": limit, "met": bool(x <= limit)}
        for text, x, limit in bars
    ]
    for bar in bars:
        verdict = "met" if bar["met"] else "MISSED"
        print(f"{bar['bar']}: {bar['value']:.3g}, bar {bar['at most']:.3g}: {verdict}")
    return {"table": title, "rows": rows, "bars": bars}
