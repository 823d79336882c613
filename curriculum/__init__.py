"""Companion code of the course, one package a chapter."""

import os
import signal
import sys
from contextlib import suppress
from importlib.util import find_spec

INTERRUPTED = "interrupted; files are as they were, or whole"
COMMAND = "constraints-chapter"  # the entry point that pyproject.toml names


def program():
    """The name of what was started: a script, or a package by its __main__.py."""
    folder, name = os.path.split(sys.argv[0])
    return os.path.basename(folder) if name == "__main__.py" else name


def leave(number, frame):
    """End as Ctrl-C ends a program, after one line."""
    print(f"\n{program()}: {INTERRUPTED}", file=sys.stderr, flush=True)
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def unfit():
    """Why the chapters cannot run here, in words, or None."""
    if sys.version_info < (3, 11):  # noqa: UP036 - an older one reads this, too
        return f"Python {'.'.join(map(str, sys.version_info[:2]))} is too old: take 3.11 or later"
    if not find_spec("numpy"):  # the usual reason: another python than the one README installs into
        return "numpy is not installed: pip install -e '.', or run .venv/bin/python"
    try:
        from numpy import __version__ as version
    except Exception as why:  # numpy's own advice is a page, and the reason its last line
        lines = [type(why).__name__, *filter(str.strip, str(why).splitlines())]
        return f"numpy does not load: {lines[-1]}; try pip install --force-reinstall numpy"
    if int(version.partition(".")[0]) < 2:
        return f"numpy {version} is too old: pip install -e '.', or run .venv/bin/python"
    return None


# While modules are loaded: some swallow a KeyboardInterrupt. Later run_script has its own answer.
# A program of chapters is a script beside this package, a module of it (-m), or the entry point.
here, started = os.path.dirname(__file__), ""
with suppress(FileNotFoundError):  # of the folder that it is started in, which may be gone
    started = os.path.abspath(sys.argv[0])
beside = os.path.dirname(started) == os.path.dirname(here) and os.path.isfile(started)
of_chapters = beside or sys.argv[0] == "-m" or os.path.basename(sys.argv[0]).startswith(COMMAND)
if of_chapters and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave)
reason = unfit()
if reason is not None:
    raise SystemExit(reason)
