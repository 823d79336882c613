"""Whose code it is: the reader's; or Python's, an installed package's, the curriculum's."""

import os
import sys
import sysconfig
from functools import lru_cache
from pathlib import Path

import numpy as np

# of Python's own modules, of installed ones, and of numpy, which may be anywhere
PLACES = {sysconfig.get_path(key) for key in ("stdlib", "platstdlib", "purelib", "platlib")}
PLACES = {Path(place).resolve() for place in (*PLACES, os.path.dirname(np.__file__))}
CURRICULUM = Path(__file__).resolve().parents[1]  # of which exercises are the reader's
FILE = CURRICULUM.with_name("constraints.py")  # which leads to forces of theirs, installed or not


@lru_cache
def of_reader(module):
    """Whether the reader may have written the module of this name: it is no part of Python, of an
    installed package, or of the curriculum but its exercises."""
    if not isinstance(module, str):  # as of what Cython makes
        return False
    file, name = getattr(sys.modules.get(module), "__file__", None), module.partition(".")[0]
    if module == "__main__" or file is None:
        return name not in sys.stdlib_module_names
    if foreign(file):
        return False
    path = Path(file)  # beside a package lies a folder that tells of it, if pip put it there
    beside = path.parents[module.count(".") + (path.stem == "__init__")]
    return not any(beside.glob(f"{name}-*.dist-info"))


def foreign(file):
    """Whether a file of code is Python's, an installed package's, or the curriculum's without its
    exercises; or is none."""
    path = Path(file).resolve()
    if path == FILE:
        return False
    installed = {"site-packages", "dist-packages"} & {*path.parts}
    ours = CURRICULUM in path.parents and "exercises" not in path.relative_to(CURRICULUM).parts
    return bool(installed or PLACES & {*path.parents}) or ours or file.startswith("<")
