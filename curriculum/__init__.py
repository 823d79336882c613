"""Companion code of the course, one package a chapter."""

import sys


def quiet(kind, value, trace):
    """As Python reports an exception, but Ctrl-C, say while numpy is loading, in one line."""
    if kind is KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    else:
        sys.__excepthook__(kind, value, trace)


sys.excepthook = quiet
