"""What several test files need: mistakes, processes of their own, and a run that is made once."""

import os
import re
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import constraints
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common.compiled import Compiled
from curriculum.common.ruler import nudged

import pytest

MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))
START = "import os, signal, sys, time\nfrom curriculum.common import cli, files\ndef main():\n    "


def complaint(capsys, *words):
    """The one line with which main refuses `words`; no folder can be written: that comes last."""
    with pytest.raises(SystemExit, match="2"):
        constraints.main(["--out", "/dev/null/below", *map(str, words)])
    printed, line = capsys.readouterr()
    assert printed == "" and re.fullmatch(r"constraints\.py: error: [^\n]{1,400}\n", line)
    return line


def python(*words, variables=None, **settings):
    """A Python, run from the project's folder, that has ended; its output is text, kept apart;
    `variables` are added to its environment."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60}
    pipes |= {"cwd": constraints.HERE, "env": os.environ | (variables or {})}
    return subprocess.run([sys.executable, *map(str, words)], **pipes | settings)


def script(lines, *words, **settings):
    """Such a process whose main, as run_script runs it, is these lines."""
    body = lines.replace("\n", "\n    ")
    return python("-c", f"{START}{body}\ncli.run_script(main)", *words, **settings)


def held(system, mode):
    """The run of a system or a scene, held by a mode, that the ruler asks for."""
    system = constraints.build_system(system) if isinstance(system, str) else system

    def asked(rule, dt, steps, keep=(), way=Compiled, nudge=False):
        return run(nudged(system) if nudge else system, rule, mode, dt, steps, keep, way)

    return asked


def feel(monkeypatch, force):
    """Have the rods feel gravity and force(q, v)."""

    def both(system, q, v=None):
        return system["m"] * constraints.GRAVITY + force(q, v)

    monkeypatch.setattr(constraints, "external_force", both)


AHEAD = {}  # {name: work(folder)}, in the order in which it is begun


def ahead(work):
    """Makes a session's fixture of what work(folder) finds out by processes of its own.

    It begins before the first test, if any test asks for it, and goes on beside them.
    """
    AHEAD[work.__name__] = work

    @pytest.fixture(scope="session", name=work.__name__)
    def found(at_work):
        return at_work[work.__name__].result()

    return found


@pytest.fixture(scope="session", autouse=True)
def at_work(request, tmp_path_factory):
    """{name: Future} of such work."""
    asked = {name for item in request.session.items for name in item.fixturenames}
    names = [name for name in AHEAD if name in asked]
    with ThreadPoolExecutor(1) as pool:
        yield {name: pool.submit(AHEAD[name], tmp_path_factory.mktemp(name)) for name in names}


@ahead
def smoke(folder):
    """Two folders, one whose name has a space, each with all that --smoke writes."""
    folders = folder / "one", folder / "and two"
    for place in folders:
        done = python(constraints.__file__, "--smoke", "--out", place)
        assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    return folders
