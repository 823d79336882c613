"""What studies measure and print: jobs timed in turns, and tables with the bars they are held
to."""

import textwrap

import numpy as np


def in_turns(jobs, repeats):
    """{name: [results]}: what jobs called A B A B return, the first round, which warms up, not
    counted."""
    found = {name: [] for name in jobs}
    for turn in range(repeats + 1):
        for name, job in jobs.items():
            result = job()
            found[name] += [result] if turn else []
    return found


def spread(samples, unit):
    """Median and quartiles of `samples` as columns of a table."""
    return dict(
        zip(
            (unit, f"{unit} q1", f"{unit} q3"),
            np.percentile(samples, [50, 25, 75]).tolist(),
            strict=True,
        )
    )


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
        print(
            f"{bar['bar']}: {bar['value']:.3g}, bar {bar['at most']:.3g}: {'met' if bar['met'] else 'MISSED'}"
        )
    return {"table": title, "rows": rows, "bars": bars}
