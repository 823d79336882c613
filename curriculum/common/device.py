"""The banner every chapter prints first: what runs, on what, and how long that took where it was measured.

The wall-clock comes from the ledger `wallclock.csv` beside this file, one row a chapter and tier. Only a measured row
carries a number. To measure one on your machine, and write it:

    python -m curriculum.common.device CHAPTER TIER -- COMMAND ...
"""

import csv
import datetime
import platform
import subprocess
import sys
import time
from pathlib import Path

from curriculum.common.files import write_whole

LEDGER = Path(__file__).with_name("wallclock.csv")
COLUMNS = ["chapter", "tier", "minutes", "machine", "date", "commit", "status"]


def read_ledger(ledger=LEDGER):
    """The ledger's rows as dicts, in file order."""
    with open(ledger, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def banner(chapter, title, device, tier, ledger=LEDGER):
    """One line: chapter, device, tier and the wall-clock measured for that tier, or that nobody has measured it yet."""
    row = next((row for row in read_ledger(ledger) if (row["chapter"], row["tier"]) == (chapter, tier)), None)
    clock = "not yet measured"
    if row and row["status"] == "measured":
        clock = f"{float(row['minutes']) * 60.0:.2g} s on {row['machine']}, {row['date']}"
    return f"{chapter} {title} | device {device} | tier {tier} | wall-clock of the default run {clock}"


def progress(what, steps):
    """A callback for long runs that shows the share done, after two seconds and where stderr is a terminal."""
    if not sys.stderr.isatty():
        return lambda step: None
    begin = time.monotonic()

    def tick(step):
        if time.monotonic() - begin > 2.0:
            # back to the line's start, so that whatever comes next, even if the run ends early, writes over it
            line = f"{what}: {step / steps:4.0%}" if step < steps else ""
            print(f"{line}\033[K", end="\r", file=sys.stderr, flush=True)

    return tick


def processor():
    """The processor's name, as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def measure(chapter, tier, command, ledger=LEDGER):
    """Run `command` five times, write the median wall-clock of the process to the ledger, return it in seconds."""
    seconds = []
    for _ in range(5):
        clock = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds.append(time.perf_counter() - clock)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    median = sorted(seconds)[2]
    values = [chapter, tier, f"{median / 60.0:.5f}", processor(), datetime.date.today().isoformat(), commit, "measured"]
    rows = [row for row in read_ledger(ledger) if (row["chapter"], row["tier"]) != (chapter, tier)]
    rows.append(dict(zip(COLUMNS, values, strict=True)))

    def write(path):
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(sorted(rows, key=lambda row: (row["chapter"], row["tier"])))

    write_whole(ledger, write)
    return median


if __name__ == "__main__":
    if len(sys.argv) < 5 or sys.argv[3] != "--":
        sys.exit("usage: python -m curriculum.common.device CHAPTER TIER -- COMMAND ...")
    print(f"{measure(sys.argv[1], sys.argv[2], sys.argv[4:]):.2f} s, median of 5, written to {LEDGER.name}")
