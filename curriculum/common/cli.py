"""Command lines that answer a mistake with one line: the flag, the value, and what is allowed."""

import argparse
import ctypes
import gc
import math
import os
import re
import signal
import sys
import textwrap
import warnings
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from curriculum import leave, program
from curriculum.common.files import ENDING, check_writable
from curriculum.common.origin import foreign
from curriculum.common.progress import work

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of mallopt, in malloc.h
EXTRAS = {"rerun": "", "llvmlite": "[fast]", "mpmath": "[reference]"}  # what brings a package
EXTRAS |= {"mujoco": "[compare]", "heyoka": "[peers]"}
FORMS = {int: r"[-+]?\d{1,99}", float: r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"}


def shorten(text):
    """The text in a line, or its beginning."""
    text = " ".join(text.split())
    return text if len(text) < 60 else text[:57] + "..."


def in_a_line(error):
    """What an exception says, without its line breaks."""
    return " ".join(str(error).split()) or type(error).__name__


def nearest(name, known):
    """The one of the `known` names that was meant by a wrong one, in a list; or an empty list."""
    from difflib import get_close_matches  # here: few runs end so

    return get_close_matches(name.lower(), known, 1, cutoff=0.65)


def meant(name, known, otherwise=""):
    """The end of a sentence about a wrong name: the nearest of the `known`, or `otherwise`."""
    near = nearest(name, known)
    return f"; did you mean {near[0]!r}?" if near else otherwise


def installed(package):
    """Raise ArgumentTypeError unless a package is installed."""
    if find_spec(package) is None:
        raise argparse.ArgumentTypeError(missing(package))


def missing(package):
    """A sentence about one of EXTRAS that is not installed, and how it is."""
    return f"{package} is not installed: pip install -e '.{EXTRAS[package]}'"


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is a single line and no flag may be abbreviated. `names`:
    {flag: words that it takes}, for those who forget the flag; a flag's choices are known."""

    def __init__(self, formatter_class=argparse.RawDescriptionHelpFormatter, **settings):
        super().__init__(formatter_class=formatter_class, allow_abbrev=False, **settings)
        self.names = {}

    def parse_known_args(self, args=None, namespace=None):
        """As argparse does, but without its reading of --flag=-- as a flag with no value at all."""
        if isinstance(args, str):
            self.error(f"arguments: {args!r} is a string; must be a list, as {args.split()}")
        args = sys.argv[1:] if args is None else list(args)
        for word in args:
            if re.fullmatch("--.+=--", word):
                self.error(f"argument {word[:-3]}: '--' is no value")
        return super().parse_known_args(args, namespace)

    def error(self, message):
        """Print the line to stderr and exit with status 2."""
        message = r"\n".join(message.splitlines())  # a value may hold a line break
        message = re.sub(r"arguments:\s*$", "arguments: ''", message)  # words that are empty
        message = message.replace("ignored explicit argument", "takes no value, not")
        wrong = re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message)
        stray = re.search(r"unrecognized arguments:\s+(\S+)", message)
        if wrong:
            message += meant(wrong[1], re.findall(r"[\w-]+", wrong[2]))
        elif stray:
            likely = [f"did you mean {found!r}?" for found in self.likely(stray[1])]
            message += f"; {[*likely, '--help lists what is known'][0]}"
        message = re.sub(r"\S{200,}", lambda long: long[0][:197] + "...", message)
        name = self.prog.split()[-1]  # of a study, without what runs it
        self.exit(2, f"{name}: error: {message}\n")

    def likely(self, word):
        """What a wrong word stands for, in a list: a flag, or a flag and the word that it takes."""
        if os.path.exists(word):  # a file of the reader's
            return [f"{flag} {word}" for flag in self.names]
        known = {flag.strip("-"): flag for a in self._actions for flag in a.option_strings}
        if word[0] != "-":
            taken = {a.option_strings[-1]: a.choices for a in self._actions if a.choices}
            pairs = [(flag, x) for flag, words in (taken | self.names).items() for x in words]
            known = {str(x): f"{flag} {x}" for flag, x in pairs}
        word = word.partition("=")[0].strip("-")
        begun = [name for name in known if name.startswith(word.lower())]
        return [known[name] for name in (begun if len(begun) == 1 else nearest(word, known))]

    def attempt(self, flag, function, *args):
        """function(*args), whose ArgumentTypeError becomes the error of the argument `flag`."""
        try:
            return function(*args)
        except argparse.ArgumentTypeError as error:
            self.error(f"argument {flag}: {error}")


def number(kind=float, low=1e-12, high=1e12):
    """An argparse type: a `kind` (int or float) >= `low` and < `high`: no square overflows."""
    allowed = f"a {'whole' if kind is int else 'finite'} number >= {low:g} and < {high:g}"

    def parse(text):
        value = kind(text) if re.fullmatch(FORMS[kind], text, re.ASCII) else math.nan
        lost = value == 0 and re.match(r"[-+.0]*[1-9]", text)  # 1e-400 is not meant as zero
        if lost or not low <= value < high:
            raise argparse.ArgumentTypeError(f"must be {allowed}, not {shorten(text)!r}")
        return value

    return parse


def one_of(known):
    """An argparse type: one of the `known` names. Unlike choices, it allows a list to be empty."""

    def parse(name):
        if name not in known:
            end = meant(name, known, f"; there are {', '.join(known)}")
            raise argparse.ArgumentTypeError(f"none is called {name!r}{end}")
        return name

    return parse


def writable(text, names=("",)):
    """An argparse type: the path of a file that can be written, or of a folder for such `names`."""
    try:
        if not text:
            raise ValueError("the name is empty")
        for name in names:
            check_writable(Path(text, name))
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise argparse.ArgumentTypeError(f"cannot write to {text!r}: {why}") from None
    return Path(text)


def add_flag(group, flag, **settings):
    """Add a flag, "--flag METAVAR" or "--flag", to a group; the help ends with the default."""
    names = flag.split()
    if names[-1].isupper():
        settings["metavar"] = names.pop()
        settings["help"] += " (%(default)s)" if settings.get("default") is not None else ""
    group.add_argument(*names, **settings)


def chapter_parser(prog, folder, out, examples):
    """(parser, system, method): with every chapter's flags; and add_flag, for two of its groups."""
    names = ", ".join(sorted(path.stem for path in folder.glob("studies/[!_]*.py")))
    studies = f"studies, python -m {'.'.join(folder.parts[-2:])}.studies NAME: {names}"
    # by its entry point a chapter is a command of its own
    command = f"python {prog}" if sys.argv[0].endswith(".py") else Path(sys.argv[0]).stem
    lines = ["examples:", *(f"  {command} {example}" for example in examples)]
    lines += textwrap.wrap(studies, 80, subsequent_indent="  ")
    use = f"{command} [flags]: each is a question, turn it and look"
    form = partial(argparse.RawDescriptionHelpFormatter, max_help_position=27, width=80)
    settings = {"epilog": "\n".join(lines), "add_help": False, "formatter_class": form}
    parser = Parser(prog=prog, usage=use, **settings)
    groups = map(parser.add_argument_group, ("which system", "which method", "results", "for CI"))
    system, method, results, ci = (partial(add_flag, group) for group in groups)
    start = "draws the start: a hair becomes metres"
    system("--seed K", type=number(int, 0), default=0, help=start)
    plain = "run the lines as they stand, in numpy: slow; print, breakpoint, traceback"
    method("--plain", action="store_true", help=plain)
    results("-h --help", action="help", help="these lines")
    results("--out DIR", default=out, help="a folder")
    switch = argparse.BooleanOptionalAction
    results("--picture", action=switch, default=True, help="one that moves, for any browser")
    results("--page", action=switch, default=True, help="one to touch, for any browser")
    viewer = find_spec("rerun") is not None  # without it nothing can make the recording
    results("--rerun", action=switch, default=viewer, help="the recording, for Rerun's viewer")
    results("--show-step", action="store_true", help="print the code that a step becomes, no more")
    ci("--smoke", action="store_true", help="few steps whatever --steps says: for a byte-diff")
    ci("--device", choices=["cpu"], default="cpu", help="here nothing needs another")
    return parser, system, method


def mistake(error):
    """The traceback of an exception, without frames of this package, of libraries, of made code."""
    import traceback  # here: few runs end so

    shown = traceback.TracebackException.from_exception(error)
    own = [frame for frame in shown.stack if not foreign(frame.filename)]
    shown.stack[:] = own or shown.stack
    return "".join(shown.format(chain=False)).rstrip()


def give_up(number, frame):
    """Exit as a signal asks for: so no temporary file is left."""
    # what is torn down half made, or in a __del__ by a second signal, has nothing to tell
    sys.unraisablehook = lambda unraisable: None
    sys.exit(128 + number)


def keep_memory():
    """Have glibc keep the memory of large arrays for the next ones: what it returns it gets back
    page by page, and cleared, which takes a third of a plain step of a long chain."""
    with suppress(AttributeError, OSError, TypeError):  # another C library
        libc = ctypes.CDLL(None)
        libc.mallopt(M_TRIM_THRESHOLD, 1 << 30)
        libc.mallopt(M_MMAP_THRESHOLD, 1 << 25)  # bytes, both; more it does not take


def run_script(main):
    """Exit with main's status; what stops it from outside is one line, a mistake a traceback."""
    if signal.getsignal(signal.SIGINT) is leave:  # all modules are loaded
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in {*ENDING} - {signal.SIGINT}:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            signal.signal(number, give_up)
    warnings.simplefilter("ignore", RuntimeWarning)  # numpy's: what blows up is told of in words
    prog, streams = program(), list(filter(None, (sys.stdout, sys.stderr)))
    for stream in streams:  # those that are open; what a terminal cannot show is an escape
        stream.reconfigure(errors="backslashreplace")
    keep_memory()
    gc.set_threshold(1_000_000)  # what is traced is many small things that all last
    try:
        try:
            status = main()
        except SystemExit as end:  # after --help, or a mistake
            status = end.code
        finally:
            work.wipe()
        for stream in streams:
            stream.flush()
    except KeyboardInterrupt:
        with suppress(OSError):
            print(end="", flush=True)
        leave(signal.SIGINT, None)  # dies of the signal: so a loop of the shell ends, too
    except MemoryError:
        status = f"{prog}: error: not enough memory; ask for fewer rods, members or steps"
    except OSError as error:
        if sys.stdout:  # or the exit would fail to flush, too
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        where = f": {error.filename}" if error.filename else ""
        line = f"{prog}: error: {error.strerror or error}{where}"
        status = 1 if isinstance(error, BrokenPipeError) else line
    except ModuleNotFoundError as error:
        known = error.name in EXTRAS
        status = f"{prog}: error: {missing(error.name)}" if known else mistake(error)
    except Exception as error:
        status = mistake(error)
    gc.freeze()  # an exit need not look for what is not used: all goes with the process
    for number in ENDING:
        if signal.getsignal(number) in (signal.default_int_handler, give_up):
            signal.signal(number, signal.SIG_DFL)  # all is done: nothing is left to be told
    sys.exit(status)
