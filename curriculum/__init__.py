"""Companion code of the course, one package a chapter."""

import sys


def quiet(kind, value, trace):
    """As Python reports an exception, but in one line: Ctrl-C, say while numpy is loading, and a package too few."""
    if kind is KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    elif kind is ModuleNotFoundError and value.name in ("numpy", "rerun"):
        print(f"{value.name} is not installed: pip install -e .", file=sys.stderr)
    else:
        sys.__excepthook__(kind, value, trace)


sys.excepthook = quiet
