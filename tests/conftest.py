"""What several test files need: mistakes, processes of their own, runs for the ruler, forces."""

import gc
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import constraints
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common.compiled import Compiled
from curriculum.common.ruler import nudged, truly

import pytest

MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))
gc.set_threshold(1_000_000)  # a trace makes many objects, which stay: a tenth less to do
START = "import os, signal, sys, time\nfrom curriculum.common import cli, files\ndef main():\n    "


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """All tests go in two processes if pytest-xdist is installed, which may be told otherwise."""
    all_of_them = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    here = hasattr(config, "workerinput") or config.option.usepdb
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of those two: more would wait by turning
    if all_of_them and not here and getattr(config.option, "numprocesses", 0) is None:
        config.option.numprocesses = 2
        config.option.dist = "worksteal"


def complaint(capsys, *words, main=constraints.main):
    """The one line with which a main refuses `words`; no folder can be written: that comes last."""
    nowhere = ["--out", "/dev/null/below"] if main is constraints.main else []
    with pytest.raises(SystemExit, match="2"):
        main([*nowhere, *map(str, words)])
    printed, line = capsys.readouterr()
    assert printed == "" and re.fullmatch(r"[\w.]+: error: [^\n]{1,400}\n", line)
    return line


def python(*words, variables=None, shell="", **settings):
    """A Python, run from the project's folder, that has ended; its output is text, kept apart.

    `variables` are added to its environment; a line of a `shell` may start it, as "$@".
    """
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60}
    pipes |= {"cwd": constraints.HERE, "env": os.environ | (variables or {})}
    start = ["sh", "-c", shell, "sh"] if shell else []
    return subprocess.run([*start, sys.executable, *map(str, words)], **pipes | settings)


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


def true_run(system):
    """What finds the truth of a system or a scene."""
    return truly(held(system, "project"))


def feel(monkeypatch, force):
    """Have the rods feel gravity and force(q, v)."""

    def both(system, q, v=None):
        return system["m"] * constraints.GRAVITY + force(q, v)

    monkeypatch.setattr(constraints, "external_force", both)
