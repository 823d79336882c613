"""Command lines whose mistakes are one line: the flag, the value, and what is allowed."""

import argparse
import contextlib
import signal
import sys
import time
import traceback
import warnings
from functools import partial
from pathlib import Path

from curriculum.common.errors import Refused
from curriculum.common.tracing.tape import NotAState, StepChanged, current
from curriculum.common.words import LENGTHS, TIMES, parsed

Switch = argparse.BooleanOptionalAction  # an action: --page or --no-page
ERRORS = OSError, Refused, NotAState, StepChanged  # such as a full disk
SOON = 0.5  # s: what is done sooner needs no word
DEEP = 100  # folders: Python makes a thousand at once, and no more
COMMON = Path(__file__).parent
LEAST = 1e-12  # of a length in m, or a time in s
LARGEST = 1e12  # a number is below it
MOST = 1e6  # m: a length is below it


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is one line. Its help begins with `text`'s first paragraph."""

    def __init__(self, text, epilog=None):
        self.words = []  # of the command line
        started = Path(sys.argv[0])
        package = started.name == "__main__.py"
        super().__init__(
            prog=started.parent.name if package else started.name,
            description=(text or "").partition("\n\n")[0],  # python -OO keeps no docstrings
            usage="%(prog)s [flags]",
            epilog=epilog,
            allow_abbrev=False,
        )

    def add_argument(self, *names, **words):
        """A flag, whose help ends with its default."""
        action = super().add_argument(*names, **words)
        if action.nargs != 0 and action.default is not None:
            action.help += " (%(default)s)"
        return action

    def parse_args(self, words=None, namespace=None):
        """The flags; and, as `command`, how the program was called."""
        self.words = sys.argv[1:] if words is None else list(words)
        args = super().parse_args(words, namespace)
        started = ["python", self.prog] if self.prog.endswith(".py") else [self.prog]
        args.command = started + self.words
        return args

    def error(self, message):
        """End the program, with status 2, in a line that has the message."""
        flag = message.removeprefix("argument ").removesuffix(": expected one argument")
        k = self.words.index(flag) + 1 if flag in self.words else 0
        if 0 < k < len(self.words):  # argparse takes what begins with - for a flag
            message = f"argument {flag}: expected a value, and not {self.words[k]!r}"
        self.exit(2, f"{self.prog}: error: {' '.join(message.split())}\n")

    @contextlib.contextmanager
    def errors(self, what=""):
        """A block whose errors end the program in a line, which begins with `what`."""
        try:
            yield
        except (OSError, Refused) as why:
            self.error(f"{what}{why}")


def checked(read, low, high, allowed):
    """An argparse type: what read(text) makes of a text, from low up to, not including, high.

    `allowed` says so in words. A text of which it can make nothing raises ValueError.
    """

    def parse(text):
        with contextlib.suppress(ValueError):
            value = read(text)
            if low <= value < high:
                return value
        raise argparse.ArgumentTypeError(f"{text!r} must be {allowed}")

    return parse


def number(low):
    """An argparse type: a finite number, at least `low`."""
    return checked(float, low, LARGEST, f"a finite number >= {low:g} and < {LARGEST:g}")


def whole(low, high=10**12):
    """An argparse type: a whole number from low to high."""
    return checked(int, low, high + 1, f"a whole number from {low} to {high:g}")


length = checked(  # metres, from a length such as 0.5mm or 2 cm, or from a number
    partial(parsed, units=LENGTHS),
    LEAST,
    MOST,
    "a length such as 1mm, 0.5mm, 1um or 2cm, or a number of metres, from 1pm on",
)
seconds = checked(  # from a time such as 5ms or 200us, or from a number
    partial(parsed, units=TIMES),
    LEAST,
    LARGEST,
    f"a finite number >= {LEAST:g} and < {LARGEST:g}, or a time such as 5ms",
)


def folder(text):
    """An argparse type: a Path that a folder may have."""
    path = Path(text)
    if not text or not text.isprintable() or len(path.parts) > DEEP:
        allowed = f"a name in characters that can be printed, at most {DEEP} folders deep"
        raise argparse.ArgumentTypeError(f"{text[:80]!r} must be {allowed}")
    return path


def progress(names):
    """Each of the names; on a terminal in a line that the next replaces.

    Where nothing is compiled, each stands in a line of its own: what is printed there follows it.
    """
    begun = time.monotonic()
    terminal = sys.__stderr__  # None, where 2>&- has closed it; not what an editor shows
    seen = terminal and terminal is sys.stderr and terminal.isatty() and not current.plain
    for name in names:
        if current.plain:
            print(name, flush=True)
        elif seen and time.monotonic() > begun + SOON:
            print(f"{name}\033[K", end="\r", file=sys.stderr, flush=True)
        yield name
    if seen:
        print("\033[K", end="\r", file=sys.stderr, flush=True)


def run_script(main):
    """Exit with main's status. Ctrl-C is one line; a traceback ends in a line of the reader's."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError):  # there may be none, or one of an editor's
            stream.reconfigure(errors="backslashreplace")  # a console may lack a letter of a name
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = show
    try:
        with signals(), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # the table says what diverged
            status = main()
    except ERRORS as why:
        print(f"error: {why}", file=sys.stderr)
        status = 2
    if status:  # else an editor goes on, and so may whoever calls
        sys.exit(status)


@contextlib.contextmanager
def signals():
    """A block that `| head` ends in silence; SIGTERM and SIGHUP end it with what `with` tidies."""
    own = {}
    for name in "SIGTERM", "SIGHUP":  # Windows has no SIGHUP, and no SIGPIPE
        if hasattr(signal, name):
            own[getattr(signal, name)] = lambda number, _: sys.exit(128 + number)
    if hasattr(signal, "SIGPIPE"):
        own[signal.SIGPIPE] = signal.SIG_DFL
    before = {}
    with contextlib.suppress(ValueError):  # an editor's thread may not set any
        for signum, handler in own.items():
            before[signum] = signal.signal(signum, handler)
    try:
        yield
    finally:
        if sys.stdout is sys.__stdout__:
            print(end="", flush=True)
        for signum, handler in before.items():
            signal.signal(signum, handler)


def show(kind, error, trace):
    """Print an error, as sys.excepthook does; of its lines the reader's own, if there are any."""
    if kind is KeyboardInterrupt:
        print("\ninterrupted: no file is half written", file=sys.stderr)
        return
    shown = traceback.TracebackException(kind, error, trace)
    own = list(filter(is_readers, shown.stack))
    shown.stack[:] = own or shown.stack
    print("".join(shown.format()), end="", file=sys.stderr)


def is_readers(frame):
    """Whether a line is not a library's, nor of what Python makes, as <frozen runpy> is."""
    path = Path(frame.filename)
    is_library = "site-packages" in path.parts or COMMON in path.parents
    return not is_library and not frame.filename.startswith("<")
