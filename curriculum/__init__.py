"""Companion code of the course, one package a chapter."""

import sys

PACKAGES = {
    "numpy": "",
    "rerun": "",
    "scipy": "[large]",
    "mujoco": "[compare]",
    "exudyn": "[peers]",
}
PACKAGES["mpmath"] = "[reference]"  # what installs each, see pyproject.toml


def quiet(kind, value, trace):
    """As Python reports an exception, but in one line: Ctrl-C, say while numpy is loading, and a
    package too few."""
    if kind is KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    elif kind is ModuleNotFoundError and value.name in PACKAGES:
        print(
            f"{value.name} is not installed: pip install -e '.{PACKAGES[value.name]}'",
            file=sys.stderr,
        )
    else:
        sys.__excepthook__(kind, value, trace)


sys.excepthook = quiet
