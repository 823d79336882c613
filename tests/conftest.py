"""What several test files look at: made once a session."""

import os
import subprocess
import sys

import constraints

import pytest


@pytest.fixture(scope="session")
def python():
    """python(*words, **settings): a process of its own, run from the project's folder, completed.

    `variables` are added to its environment; its output is text, kept apart.
    """

    def of(*words, variables=None, **settings):
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60}
        pipes |= {"cwd": constraints.HERE, "env": os.environ | (variables or {})}
        return subprocess.run([sys.executable, *map(str, words)], **pipes | settings)

    return of


@pytest.fixture(scope="session")
def smoke(python, tmp_path_factory):
    """Two folders, the second of whose name has a space, with all that --smoke writes."""
    pytest.importorskip("rerun", reason="the viewer and its recordings: pip install -e .")
    folders = [tmp_path_factory.mktemp(name) for name in ("one", "and two")]
    for folder in folders:
        done = python(constraints.__file__, "--smoke", "--out", folder)
        assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    return folders
