"""The first line that a chapter prints, and how long a default run took.

python -m curriculum.common.banner CHAPTER COMMAND ...   measures a default run, and notes it
"""

import platform
import re
import sys
from pathlib import Path

from curriculum.common.files import check_writable, write_whole

LEDGER = Path(__file__).with_name("wallclock.csv")


def banner(chapter, title, device, default):
    """At most 80 columns; for a default run, how long one took where it was measured."""
    line = f"{chapter} {title} | device {device}"
    measured = re.search(f"^{chapter},(.*),(.*),(.*)", LEDGER.read_text(encoding="utf-8"), re.M)
    if default and measured:
        line += " | a default run took {} s, {}, {}".format(*measured.groups())
    return line[:80]


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
