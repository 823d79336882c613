"""The first line that a chapter prints, what is under way, and how long a default run took.

python -m curriculum.common.banner CHAPTER COMMAND ...   measures a default run, and notes it
"""

import math
import platform
import re
import sys
import time
from pathlib import Path

from curriculum.common.files import check_writable, write_whole

LEDGER = Path(__file__).with_name("wallclock.csv")
SOON, OFTEN = 0.5, 0.1  # s: what takes longer is told of, and no more often than that


def banner(chapter, title, device, default=False):
    """At most 80 columns; for a default run, how long one took where it was measured."""
    line = f"{chapter} {title} | device {device}"
    measured = re.search(f"^{chapter},(.*),(.*),(.*)", LEDGER.read_text(encoding="utf-8"), re.M)
    if default and measured:
        line += " | a default run took {} s, {}, {}".format(*measured.groups())
    return line[:80]


class Work:
    """What a program does, part by part, in a line on a terminal that is gone in the end.

    plan(names) what is to come, and begin(name) each part; or go through `each` of them. What has
    one part goes `through` the items of that.
    """

    def __init__(self):
        self.plan()

    def plan(self, *names):
        """Now begins a program of these parts."""
        self.names, self.name, self.runs = names, "", False
        self.begun, self.told, self.visible = time.monotonic(), -math.inf, False

    def begin(self, name, runs=False):
        """Now begins a part; `runs`: it is a single run, so that the steps of that are its own."""
        self.name, self.runs, self.told = name, runs, -math.inf
        self.names = self.names or (name,)
        self.tell()

    def each(self, names):
        """Each name in turn, as a part that is a run."""
        for name in names:
            self.begin(name, runs=True)
            yield name
        self.wipe()

    def tell(self, what=""):
        """Show which part is under way and, in words, what is known of it."""
        seen = bool(sys.stderr) and sys.stderr.isatty()  # somebody may be looking on
        now = time.monotonic()
        if not seen or now < max(self.begun + SOON, self.told + OFTEN):
            return
        line = f"{self.name}{what}"
        if len(self.names) > 1:
            line = f"{self.names.index(self.name) + 1} of {len(self.names)}, {line}"
        # back to the line's start, so that an error writes over it
        print(f"{line[:79]}\033[K", end="\r", file=sys.stderr, flush=True)
        self.told, self.visible = now, True

    def wipe(self):
        """Leave no line: something is to be printed."""
        if self.visible:
            print("\033[K", end="\r", file=sys.stderr, flush=True)
        self.visible = False

    def through(self, name, items):
        """Each of the items, in turn, of a program of one part."""
        self.plan(name)
        self.begin(name)
        for k, item in enumerate(items):
            yield item
            self.share(k + 1, len(items))

    def share(self, step, steps):
        """Tell which share of the steps of the part is done."""
        if step < steps:
            self.tell(f", {step / steps:.0%}")
        elif len(self.names) > 1:
            self.tell()
        else:
            self.wipe()


work = Work()


def progress(what, steps):
    """tick(step) of a run of so many steps.

    If no work is planned, the run is the work, and `what` names it. If the run is a part by itself,
    its share is shown; if it is one of many in a part, only that the part goes on.
    """
    if not work.names:
        work.plan(what)
        work.begin(what, runs=True)
    if work.runs:
        return lambda step: work.share(step, steps)
    several = len(work.names) > 1
    return lambda step: work.tell() if several else None


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
    check_writable(LEDGER)
    seconds = timeit.repeat(lambda: subprocess.check_output(command), number=1, repeat=5)
    row = chapter, f"{sorted(seconds)[2]:.2f}", datetime.date.today(), processor().replace(",", "")
    rows = LEDGER.read_text(encoding="utf-8").splitlines()[1:] if LEDGER.exists() else []
    others = [line for line in rows if not line.startswith(f"{chapter},")]
    lines = ["chapter,seconds,date,machine", *others, ",".join(map(str, row))]
    write_whole(LEDGER, "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
