"""Command lines whose mistakes are one line: the flag, the value, and what is allowed."""

import argparse
import contextlib
import math
import signal
import sys
import traceback
import warnings
from pathlib import Path

from curriculum.common.tracing.tape import StepChanged

LIBRARY = "curriculum/common/", "site-packages", "<"  # whose lines are not the reader's


class WithDefaults(argparse.HelpFormatter):
    def _get_help_string(self, action):
        if action.nargs == 0 or action.default is None:
            return action.help
        return f"{action.help} (%(default)s)"


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is one line; its help begins with that of `text`."""

    def __init__(self, text, epilog=None):
        started = Path(sys.argv[0])
        package = started.name == "__main__.py"
        super().__init__(
            prog=started.parent.name if package else started.name,
            description=(text or "").partition("\n\n")[0],  # python -OO keeps no docstrings
            usage="%(prog)s [flags]",
            epilog=epilog,
            formatter_class=WithDefaults,
            allow_abbrev=False,
        )

    def parse_args(self, words=None, namespace=None):
        """The flags; and, as `words`, how the program was called."""
        args = super().parse_args(words, namespace)
        started = ["python", self.prog] if self.prog.endswith(".py") else [self.prog]
        args.words = started + list(sys.argv[1:] if words is None else words)
        return args

    def error(self, message):
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())}\n")

    @contextlib.contextmanager
    def errors(self, what=""):
        """A block whose errors end the program in a line, which begins with `what`."""
        try:
            yield
        except (OSError, argparse.ArgumentTypeError) as why:
            self.error(f"{what}{why}")


def number(low, high=1e12, kind=float):
    """An argparse type: a finite number, at least `low` and below `high`."""
    allowed = f"a finite number >= {low:g} and < {high:g}"
    if kind is int:
        allowed = f"a whole number from {low} to {high - 1:g}"

    def parse(text):
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not low <= value < high:
            raise argparse.ArgumentTypeError(f"{text!r} must be {allowed}")
        return value

    return parse


positive = number(1e-12)


def whole(low, high=10**12):
    return number(low, high + 1, int)


def folder(text):
    if not text or not text.isprintable():
        allowed = "a name in characters that can be printed"
        raise argparse.ArgumentTypeError(f"{text!r} must be {allowed}")
    return Path(text)


def run_script(main):
    """Exit with main's status. Ctrl-C is one line; a traceback ends in a line of the reader's."""
    for stream in filter(None, (sys.stdout, sys.stderr)):
        stream.reconfigure(errors="backslashreplace")  # a console may lack a letter of a name
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `| head` ends it in silence
    sys.excepthook = show
    warnings.simplefilter("ignore", RuntimeWarning)  # numpy's: the table says what diverged
    try:
        sys.exit(main())
    except (OSError, StepChanged, argparse.ArgumentTypeError) as why:  # such as a full disk
        print(f"error: {why}", file=sys.stderr)
        sys.exit(2)


def show(kind, error, trace):
    if kind is KeyboardInterrupt:
        print("\ninterrupted: no file is half written", file=sys.stderr)
        return
    shown = traceback.TracebackException(kind, error, trace)
    own = [x for x in shown.stack if not any(part in x.filename for part in LIBRARY)]
    shown.stack[:] = own or shown.stack
    print("".join(shown.format()), end="", file=sys.stderr)
