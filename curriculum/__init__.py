"""Companion code of the course, one package a chapter."""

from importlib.util import find_spec

if not find_spec("numpy"):  # the usual reason: another python than the one README installs into
    raise SystemExit("numpy is not installed: pip install -e '.', or run .venv/bin/python")
