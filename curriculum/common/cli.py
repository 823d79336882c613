"""Command lines that answer a mistake with one line: the flag, the value, and what is allowed."""

import argparse
import math
import os
import re
import signal
import sys
import textwrap
import warnings
from difflib import get_close_matches
from pathlib import Path

from curriculum.common.files import check_writable, results_folder


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is a single line and no flag may be abbreviated."""

    def __init__(self, **settings):
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message):
        """Print the line to stderr and exit with status 2."""
        message = r"\n".join(message.splitlines())  # a value may hold a line break
        if wrong := re.search(
            r"invalid choice: '(.*)' \(choose from (.*)\)|unrecognized arguments: (--[\w-]+)",
            message,
        ):
            known = (
                re.findall(r"[\w-]+", wrong[2])
                if wrong[2]
                else re.findall(r"--[\w-]+", self.format_help())
            )
            near = get_close_matches((wrong[1] or wrong[3] or "").lower(), known, 1)
            message += f"; did you mean {near[0]}?" if near else ""
        message = re.sub(r"\S{100,}", lambda long: long[0][:97] + "...", message)
        self.exit(2, f"{self.prog}: error: {message}\n")

    def attempt(self, flag, function, *args):
        """function(*args), whose ValueError becomes the error of the argument `flag`."""
        try:
            return function(*args)
        except ValueError as error:
            self.error(f"argument {flag}: {error}")


def shorten(text):
    """The text, or its beginning."""
    return text if len(text) < 60 else text[:57] + "..."


def number(kind=float, low=1e-12, high=1e12):
    """An argparse type: a `kind` (int or float) >= `low` and < `high`.

    Nobody means the numbers beyond, and they overflow once squared or divided by.
    """
    allowed = f"a {'whole' if kind is int else 'finite'} number >= {low:g} and < {high:g}"

    def parse(text):
        try:
            value = kind(text) if re.fullmatch(r"[-+.\deE]+", text, re.ASCII) else math.nan
        except ValueError:
            value = math.nan
        if not low <= value < high:
            raise argparse.ArgumentTypeError(f"must be {allowed}, not {shorten(text)!r}")
        return value

    return parse


def writable(text):
    """An argparse type: the path of a file that can be written."""
    try:
        if not text:
            raise ValueError("the name is empty")
        check_writable(text)
    except (OSError, ValueError) as error:
        raise argparse.ArgumentTypeError(
            f"cannot write {text!r}: {getattr(error, 'strerror', error)}"
        ) from None
    return Path(text)


def chapter_parser(prog, folder, out, examples):
    """A Parser with the flags of every chapter, and the groups for what is simulated and how:
    (parser, what, how)."""
    scenes, studies = (
        ", ".join(sorted(path.stem for path in folder.glob(pattern)))
        for pattern in ("scenes/*.json", "studies/[!_]*.py")
    )
    parser = Parser(
        prog=prog,
        usage=f"python {prog} [flags]",
        description="Every flag is a question: turn it, guess what it does, and look.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="\n".join(
            ["examples:", *(f"  python {prog} {example}" for example in examples)]
            + textwrap.wrap(f"scenes, each for --system: {scenes}", 80, subsequent_indent="  ")
            + textwrap.wrap(f"studies, a question each: {studies}", 80, subsequent_indent="  ")
            + [f"  python -m {'.'.join(folder.parts[-2:])}.studies.NAME"]
        ),
    )
    titles = "what is simulated", "how", "where results go"
    what, how, where = (parser.add_argument_group(title).add_argument for title in titles)
    what(
        "--seed",
        type=number(int, 0),
        default=0,
        help="draws the start: a hair apart may end metres apart (0)",
    )
    how(
        "--smoke",
        action="store_true",
        help="few steps whatever --steps says: quick, for a byte-diff in CI",
    )
    how(
        "--device",
        choices=["cpu"],
        default="cpu",
        help="the same in every chapter; here nothing needs another",
    )
    where(
        "--out",
        type=results_folder,
        default=out,
        metavar="FOLDER",
        help=f"one a run, to compare them ({out})",
    )
    where(
        "--rerun",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the recording; or only numbers (on)",
    )
    return parser, what, how


def run_script(main):
    """Exit with main's status; what stops it from outside is one line, and a reader that has seen
    enough is none."""
    # a standard stream that is closed is opened again, lest a file take its place
    while (spare := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(spare)
    for name in {"SIGTERM", "SIGHUP"} & set(dir(signal)):
        number = getattr(signal, name)
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(
                number, lambda number, _: sys.exit(128 + number)
            )  # leave no temporary file
    warnings.simplefilter("ignore", RuntimeWarning)  # numpy's: what blows up is told of in words
    streams = [stream for stream in (sys.stdout, sys.stderr) if stream]
    for stream in streams:
        stream.reconfigure(errors="backslashreplace")
    name = Path(sys.argv[0]).name
    try:
        try:
            status = main()
        except SystemExit as end:  # after --help, or a mistake
            status = end.code
        for stream in streams:
            stream.flush()
    except KeyboardInterrupt:
        status = f"\n{name}: interrupted; files are as they were, or whole"
    except MemoryError:
        status = f"{name}: error: not enough memory; ask for fewer rods, members or steps"
    except OSError as error:
        if sys.stdout:
            os.dup2(
                os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
            )  # or the exit would fail to flush, too
        status = 1
        if not isinstance(error, BrokenPipeError):
            status = f"{name}: error: {error.strerror or error}{f': {error.filename}' if error.filename else ''}"
    sys.exit(status)
