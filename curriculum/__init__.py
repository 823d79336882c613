"""Companion code of the course, one package a chapter."""

import os
import sys
from importlib.util import find_spec

INTERRUPTED = "interrupted; files are as they were, or whole"
COMMAND = "constraints-chapter"  # the entry point that pyproject.toml names


def is_a_program_of_ours():
    """Whether what was started is a script beside this package, a module of it, or a command."""
    started, here = os.path.abspath(sys.argv[0]), os.path.dirname(__file__)
    beside = os.path.dirname(started) == os.path.dirname(here) and os.path.isfile(started)
    return beside or sys.argv[0] == "-m" or os.path.basename(started).startswith(COMMAND)


def tell(kind, error, trace, otherwise=sys.excepthook):
    """A Ctrl-C while modules are loaded, before a program can answer it, is one line, too."""
    if issubclass(kind, KeyboardInterrupt):
        print(f"\n{os.path.basename(sys.argv[0])}: {INTERRUPTED}", file=sys.stderr)
    else:
        otherwise(kind, error, trace)


if is_a_program_of_ours():
    sys.excepthook = tell
if not find_spec("numpy"):  # the usual reason: another python than the one README installs into
    raise SystemExit("numpy is not installed: pip install -e '.', or run .venv/bin/python")
