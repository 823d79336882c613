"""Companion code of the course, one package a chapter."""

import os
import signal
import sys
from importlib.util import find_spec

INTERRUPTED = "interrupted; files are as they were, or whole"
COMMAND = "constraints-chapter"  # the entry point that pyproject.toml names


def is_a_program_of_ours():
    """Whether what was started is a script beside this package, a module of it, or a command."""
    started, here = os.path.abspath(sys.argv[0]), os.path.dirname(__file__)
    beside = os.path.dirname(started) == os.path.dirname(here) and os.path.isfile(started)
    return beside or sys.argv[0] == "-m" or os.path.basename(started).startswith(COMMAND)


def leave(number, frame):
    """End as Ctrl-C ends a program, after one line."""
    print(f"\n{os.path.basename(sys.argv[0])}: {INTERRUPTED}", file=sys.stderr, flush=True)
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


# while modules are loaded, of which some swallow a KeyboardInterrupt; run_script has its own answer
if is_a_program_of_ours() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, leave)
if not find_spec("numpy"):  # the usual reason: another python than the one README installs into
    raise SystemExit("numpy is not installed: pip install -e '.', or run .venv/bin/python")
