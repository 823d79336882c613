"""The banner every chapter prints first: what runs, on what, and how long that took where it was
measured.

The wall-clock comes from the ledger `wallclock.csv` beside this file, one row a chapter and
hardware tier. Only a measured row carries a number.

    python -m curriculum.common.banner                               prints the ledger as a table
    for a text python -m curriculum.common.banner CHAPTER TIER -- COMMAND ...   measures a default
    run here, and notes it
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
TIERS = {
    "cpu-laptop": "cpu",
    "mps": "mps",
    "t4": "cuda",
    "4090": "cuda",
}  # of the course, and the device of each
UNKNOWN = "not yet measured"
LONG, SURE = 2.0, 0.2  # s: what takes longer is shown, once so much of it is done that one can tell


def read_ledger(ledger=LEDGER):
    """The ledger's rows as dicts, in file order."""
    with open(ledger, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def took(row):
    """How long a default run took by a row of the ledger; None if nobody has measured it."""
    return f"{float(row['minutes']) * 60.0:.2g} s" if row and row["status"] == "measured" else None


def banner(chapter, title, device, tier=None, ledger=LEDGER):
    """One line: chapter, device, tier, and how long a default run took on a machine of that tier.

    `tier`: one of TIERS, by default the first of the device's.
    """
    tier = tier or next(name for name, its in TIERS.items() if its == device)
    row = next(
        (row for row in read_ledger(ledger) if (row["chapter"], row["tier"]) == (chapter, tier)),
        None,
    )
    clock = f"took {took(row)} on {row['machine']}, {row['date']}" if took(row) else f"is {UNKNOWN}"
    return f"{chapter} {title} | device {device} | tier {tier} | a default run {clock}"


def table(ledger=LEDGER):
    """The ledger in Markdown."""
    head = ("chapter", "tier", "a default run", "machine", "date"), ("---",) * 5
    rows = read_ledger(ledger)
    cells = (
        (row["chapter"], row["tier"], took(row) or UNKNOWN, row["machine"], row["date"])
        for row in rows
    )
    return "\n".join(f"| {' | '.join(line)} |" for line in (*head, *cells))


def progress(what, steps):
    """A callback for long runs, where stderr is a terminal: it shows the share that is done, and
    how long is left."""
    if not (sys.stderr and sys.stderr.isatty()):
        return lambda step: None
    begin, shown = time.monotonic(), -1.0  # when a line was last written, in s after the beginning

    def tick(step):
        nonlocal shown
        taken = time.monotonic() - begin
        if step >= steps and shown >= 0.0:
            line = ""
        elif 0 < step < steps and taken > max(SURE, shown + 0.1) and taken * steps > LONG * step:
            line = f"{what}: {step / steps:4.0%}, {about(taken * (steps / step - 1.0))} left"
        else:
            return
        # back to the line's start, so that whatever comes next, even if the run ends early, writes
        # over it
        print(f"{line}\033[K", end="\r", file=sys.stderr, flush=True)
        shown = taken

    return tick


def about(seconds):
    """A time in words, without more digits than an estimate has."""
    size, unit = next(
        (size, unit)
        for size, unit in ((3600.0, "h"), (60.0, "min"), (1.0, "s"))
        if seconds >= size - 1.0
    )
    return f"about {max(1, round(seconds / size))} {unit}"


def processor():
    """The processor's name, as the system gives it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(
            line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")
        )
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def measure(chapter, tier, command, ledger=LEDGER):
    """Run `command` five times, write the median wall-clock of the process to the ledger, return it
    in seconds.

    Raises OSError or subprocess.CalledProcessError, and the ledger is as it was.
    """
    seconds, tick = [], progress("measuring", 5)
    for _ in range(5):
        clock = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        seconds.append(time.perf_counter() - clock)
        tick(len(seconds))
    try:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True
        ).stdout.strip()
    except OSError:
        commit = ""  # no git here
    median = sorted(seconds)[2]
    values = [
        chapter,
        tier,
        f"{median / 60.0:.5f}",
        processor(),
        datetime.date.today().isoformat(),
        commit,
        "measured",
    ]
    rows = {(row["chapter"], row["tier"]): row for row in read_ledger(ledger)}
    for name in TIERS:  # a row for each
        rows.setdefault((chapter, name), {"chapter": chapter, "tier": name, "status": UNKNOWN})
    rows[chapter, tier] = dict(zip(COLUMNS, values, strict=True))

    def write(path):
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows.values())

    write_whole(ledger, write)
    return median


def main(argv=None):
    """Print the table, or measure."""
    from curriculum.common.cli import Parser

    parser = Parser(
        prog="device", usage="python -m curriculum.common.banner [CHAPTER TIER -- COMMAND ...]"
    )
    parser.add_argument("chapter", nargs="?", help="whose default run COMMAND is, say ch3.4")
    parser.add_argument("tier", nargs="?", choices=TIERS, help="what this machine is")
    parser.add_argument("command", nargs="*", help="what to measure, five times")
    args = parser.parse_args(argv)
    if args.chapter is None:
        print(table())
        return 0
    if not args.command:
        parser.error("argument COMMAND: what is to be measured? Give CHAPTER TIER -- COMMAND ...")
    try:
        median = measure(args.chapter, args.tier, args.command)
    except subprocess.CalledProcessError as failed:
        parser.error(f"argument COMMAND: {failed}")
    print(f"{median:.2f} s, median of 5, written to {LEDGER.name}")
    return 0


if __name__ == "__main__":
    from curriculum.common.cli import run_script

    run_script(main)
