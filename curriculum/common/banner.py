"""The first line that a chapter prints, how long is left, and how long a default run took.

python -m curriculum.common.banner CHAPTER COMMAND ...   measures a default run, and notes it
"""

import platform
import re
import sys
import time
from pathlib import Path

from curriculum.common.files import write_whole

LEDGER = Path(__file__).with_name("wallclock.csv")
LONG, SURE = 2.0, 0.2  # s: what takes longer is shown, once so much of it is done that one can tell
PARTS = []  # of what is under way: name, how many are done, how many there are, when it all began


def banner(chapter, title, device, default=False):
    """At most 80 columns; for a default run, how long one took where it was measured."""
    line = f"{chapter} {title} | device {device}"
    for row in LEDGER.read_text(encoding="utf-8").splitlines() if default else ():
        if row.startswith(f"{chapter},"):
            line += " | a default run took {} s, {}, {}".format(*row.split(",")[1:])
    return line[:80]


def in_parts(names):
    """Each name in turn; what tells its progress meanwhile is one part of so many, by that name."""
    begin = time.monotonic()
    try:
        for done, name in enumerate(names):
            PARTS[:] = name, done, len(names), begin
            yield name
    finally:
        PARTS.clear()


def progress(what, steps):
    """tick(step) tells a terminal which share is done of all parts, and how long the rest takes."""
    if not (sys.stderr and sys.stderr.isatty()):
        return lambda step: None
    name, before, parts, begin = PARTS or ("", 0, 1, time.monotonic())
    shown = -1.0  # when a line was last written, in s after begin

    def tick(step):
        nonlocal shown
        taken, share = time.monotonic() - begin, (before + step / steps) / parts
        line, due = "", taken > max(SURE, shown + 0.1) and taken > LONG * share
        if 0 < step < steps and due:
            left = about(taken * (1.0 / share - 1.0))
            line = f"{what} {name}".rstrip() + f": {share:.0%} of all, {left} left"
        if line or (step >= steps and shown >= 0.0):
            # back to the line's start, so that whatever comes next writes over it
            print(f"{line}\033[K", end="\r", file=sys.stderr, flush=True)
            shown = taken

    return tick


def about(seconds):
    """A time in words, without more digits than an estimate has."""
    units = (3600.0, "h"), (60.0, "min"), (1.0, "s")
    size, unit = next((size, unit) for size, unit in units if seconds >= size - 1.0)
    return f"about {max(1, round(seconds / size))} {unit}"


def processor():
    """The processor's name, as the system gives it."""
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8") if info.exists() else ""
    found = re.search("^model name.*: (.+)", text, re.MULTILINE)
    return found[1] if found else platform.processor() or platform.machine()


def main():
    """Measure: the median wall-clock of five processes, to the ledger."""
    import datetime  # here: no chapter needs these
    import subprocess
    import timeit

    chapter, *command = sys.argv[1:]
    seconds = timeit.repeat(lambda: subprocess.check_output(command), number=1, repeat=5)
    row = chapter, f"{sorted(seconds)[2]:.2f}", datetime.date.today(), processor().replace(",", "")
    text = f"chapter,seconds,date,machine\n{','.join(map(str, row))}\n"
    write_whole(LEDGER, text)


if __name__ == "__main__":
    main()
