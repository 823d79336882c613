"""Command lines that answer a mistake with one line: the flag, the value, and what is allowed."""

import argparse
import math
import os
import sys
from pathlib import Path

from curriculum.common.files import check_writable


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is a single line and no flag may be abbreviated."""

    def __init__(self, **settings):
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message):
        """Print the line to stderr and exit with status 2."""
        message = r"\n".join(message.splitlines())  # a value may hold a line break
        self.exit(2, f"{self.prog}: error: {message}\n")

    def attempt(self, flag, failure, function, *args):
        """function(*args), whose exception `failure` becomes the error of the argument `flag`."""
        try:
            return function(*args)
        except failure as error:
            self.error(f"argument {flag}: {error}")


def number(kind, low, include_low=True, high=1e12):
    """An argparse type: a `kind` (int or float) >= `low` and < `high`; unless `include_low`, >= `low` + 1e-9.

    Nobody means the numbers beyond, and they overflow once squared or divided by.
    """
    low = low if include_low else low + 1e-9
    allowed = f"a {'whole' if kind is int else 'finite'} number >= {low:g} and < {high:g}"

    def parse(text):
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value < high:
            raise argparse.ArgumentTypeError(f"must be {allowed}, not {text!r}")
        return value

    return parse


def writable(text):
    """An argparse type: the path of a file that can be written."""
    try:
        check_writable(text)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"cannot write {text!r}: {error.strerror}") from None
    return Path(text)


def chapter_parser(prog, folder, out, smoke_steps):
    """A Parser with the flags of every chapter: seed, smoke, device, out, rerun; its help ends with the studies."""
    studies = ", ".join(sorted(path.stem for path in folder.glob("studies/[!_]*.py")))
    module = ".".join(folder.parts[-2:])
    about = "Every figure is a question: turn a flag, guess what it does, and look."
    epilog = f"Studies, a question each: python -m {module}.studies.NAME, where NAME is one of: {studies}."
    parser = Parser(prog=prog, description=about, epilog=epilog)
    add = parser.add_argument
    add("--seed", type=number(int, 0), default=0, help="draws the start: seeds a hair apart may end metres apart (0)")
    add("--smoke", action="store_true", help=f"{smoke_steps} steps whatever --steps says: quick, for a byte-diff in CI")
    add("--device", choices=["cpu"], default="cpu", help="the same in every chapter; this one is too small for another")
    add("--out", type=Path, default=Path(out), metavar="FOLDER", help="one folder a run, to compare runs later")
    add("--rerun", action=argparse.BooleanOptionalAction, default=True, help="off when only the numbers count (on)")
    return parser


def run_script(main):
    """Exit with main's status; Ctrl-C ends in one line, and a reader that has seen enough (`| head`) in none."""
    try:
        status = main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(f"\n{Path(sys.argv[0]).name}: interrupted; files are as they were, or whole")
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the exit would fail to flush, too
        status = 1
    sys.exit(status)
