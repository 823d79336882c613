"""Command lines that answer a mistake with one line: the flag, the value, and what is allowed."""

import argparse
import json
import math
import os
import re
import signal
import sys
import textwrap
import traceback
import warnings
from difflib import get_close_matches
from pathlib import Path

from curriculum.common.files import check_writable

EXTRAS = {  # which extra of pyproject.toml brings a package that some runs need
    "rerun": "", "llvmlite": "[fast]", "scipy": "[large]", "mujoco": "[compare]",
    "exudyn": "[peers]", "pymunk": "[peers]", "heyoka": "[peers]", "mpmath": "[reference]",
}  # fmt: skip
NOT_OWN = (
    f"^<|^{re.escape(os.path.dirname(__file__))}|(site|dist)-packages"  # frames not to be shown
)


def shorten(text):
    """The text, or its beginning."""
    return text if len(text) < 60 else text[:57] + "..."


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is a single line and no flag may be abbreviated."""

    def __init__(self, **settings):
        super().__init__(allow_abbrev=False, **settings)

    def parse_known_args(self, args=None, namespace=None):
        """As argparse does, but without its reading of --flag=-- as a flag with no value at all."""
        args = sys.argv[1:] if args is None else list(args)
        for word in args[: args.index("--") if "--" in args else None]:
            if re.fullmatch(r"--[\w-]+=--", word):
                self.error(f"argument {word[:-3]}: '--' is no value")
        return super().parse_known_args(args, namespace)

    def error(self, message):
        """Print the line to stderr and exit with status 2."""
        message = r"\n".join(message.splitlines())  # a value may hold a line break
        choice = r"invalid choice: '(.*)' \(choose from (.*)\)|unrecognized arguments: (--[\w-]+)"
        if wrong := re.search(choice, message):
            flags = re.findall(r"--[\w-]+", self.format_help())
            known = re.findall(r"[\w-]+", wrong[2]) if wrong[2] else flags
            near = get_close_matches((wrong[1] or wrong[3] or "").lower(), known, 1)
            message += f"; did you mean {near[0]}?" if near else ""
        message = re.sub(r"\S{200,}", lambda long: long[0][:197] + "...", message)
        self.exit(2, f"{self.prog}: error: {message}\n")

    def attempt(self, flag, function, *args):
        """function(*args), whose ValueError becomes the error of the argument `flag`."""
        try:
            return function(*args)
        except (ValueError, argparse.ArgumentTypeError) as error:
            self.error(f"argument {flag}: {error}")


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
        lost = value == 0 and re.match(r"[-+.0]*[1-9]", text)  # 1e-400 is not meant as zero
        if lost or not low <= value < high:
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
        why = getattr(error, "strerror", None) or error
        raise argparse.ArgumentTypeError(f"cannot write {text!r}: {why}") from None
    return Path(text)


class SceneList(argparse.Action):
    """A flag that prints systems and what they show, a line each, and ends the program.

    `const`: {name: about} of the chapter's own, and the folder of its scene files.
    """

    def __call__(self, parser, *_):
        named, folder = self.const
        for path in sorted(folder.glob("*.json")):
            named = named | {path.stem: json.loads(path.read_bytes()).get("about", "")}
        for name, text in named.items():
            print(f"{name:<16} {textwrap.shorten(text, 63, placeholder=' ...')}")
        parser.exit()


def chapter_parser(prog, folder, out, examples, named):
    """A Parser with the flags of every chapter: (parser, system, method, results).

    The last three add flags to their groups. `named`: {name: about} of systems without a file.
    """
    studies = ", ".join(sorted(path.stem for path in folder.glob("studies/[!_]*.py")))
    parser = Parser(
        prog=prog,
        usage=f"python {prog} [flags]",
        description="Every flag is a question: turn it, guess what it does, and look.",
        formatter_class=lambda prog: argparse.RawDescriptionHelpFormatter(prog, 2, 27, 80),
        epilog="\n".join(
            ["examples:", *(f"  python {prog} {example}" for example in examples)]
            + textwrap.wrap(f"studies, a question each: {studies}", 80, subsequent_indent="  ")
            + [f"  python -m {'.'.join(folder.parts[-2:])}.studies.NAME"]
        ),
        add_help=False,
    )

    def flags(title):
        group = parser.add_argument_group(title)

        def add(flag, **settings):
            name, _, metavar = flag.partition(" ")
            if metavar:
                shown = "" if settings.get("default") is None else " (%(default)s)"
                settings |= {"metavar": metavar, "help": settings["help"] + shown}
            group.add_argument(name, **settings)

        return add

    system, method, results, ci = map(flags, ("which system", "which method", "results", "for CI"))
    system(
        "--scenes", action=SceneList, nargs=0, const=(named, folder / "scenes"), help="list them"
    )
    system("--seed K", type=number(int, 0), default=0, help="a hair apart may end metres apart")
    results("--help", action="help", help="these lines")
    results("--out DIR", default=out, help="one a run, to compare them")
    switch = argparse.BooleanOptionalAction
    results("--rerun", action=switch, default=True, help="the recording; or only numbers")
    ci("--smoke", action="store_true", help="few steps whatever --steps says: for a byte-diff")
    ci("--device", choices=["cpu"], default="cpu", help="here nothing needs another")
    return parser, system, method, results


def mistake(error):
    """The traceback of an exception, without frames of this package, libraries and made code."""
    shown = whole = traceback.TracebackException.from_exception(error)
    while shown:
        own = [frame for frame in shown.stack if not re.search(NOT_OWN, frame.filename)]
        shown.stack[:] = own or shown.stack
        shown.__context__, shown = None, shown.__cause__
    return "".join(whole.format())


def run_script(main):
    """Exit with main's status; what stops it from outside is one line, a mistake is shown."""
    # a standard stream that is closed is opened again, lest a file take its place
    while (spare := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(spare)
    for name in {"SIGTERM", "SIGHUP"} & set(dir(signal)):
        number = getattr(signal, name)
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup wants it
            # leave no temporary file
            signal.signal(number, lambda number, _: sys.exit(128 + number))
    warnings.simplefilter("ignore", RuntimeWarning)  # numpy's: what blows up is told of in words
    streams = [stream for stream in (sys.stdout, sys.stderr) if stream]
    for stream in streams:
        stream.reconfigure(errors="backslashreplace")
    prog = Path(sys.argv[0]).name
    try:
        try:
            status = main()
        except SystemExit as end:  # after --help, or a mistake
            status = end.code
        for stream in streams:
            stream.flush()
    except KeyboardInterrupt:
        status = f"\n{prog}: interrupted; files are as they were, or whole"
    except MemoryError:
        status = f"{prog}: error: not enough memory; ask for fewer rods, members or steps"
    except OSError as error:
        if sys.stdout:  # or the exit would fail to flush, too
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        where = f": {error.filename}" if error.filename else ""
        broken = isinstance(error, BrokenPipeError)
        status = 1 if broken else f"{prog}: error: {error.strerror or error}{where}"
    except Exception as error:
        package = error.name if isinstance(error, ModuleNotFoundError) else None
        missing = f"{prog}: error: {package} is not installed: pip install -e "
        status = f"{missing}'.{EXTRAS[package]}'" if package in EXTRAS else mistake(error)
    sys.exit(status)
