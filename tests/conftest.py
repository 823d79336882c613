"""What several test files need: mistakes, processes of their own, and a run that is made once."""

import os
import re
import subprocess
import sys
import tomllib
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import constraints
from curriculum.ch3_4_constraints import publish
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common.compiled import Compiled
from curriculum.common.ruler import nudged

import pytest

MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))
MANY = 50  # tests: fewer are all done here, for a debugger
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


# --- what another process does meanwhile, on the other core ---
WORK, BEGUN = {}, {}  # {name: function without arguments}, {name: Future}; of a test its id


def do(name):
    """In the other process, which was forked off with its WORK; of a test, why it is skipped."""
    try:
        return WORK[name]()
    except pytest.skip.Exception as why:
        return str(why)


def shared(find):
    """Makes a fixture of what find(folder) finds, once, which is begun before the first test."""

    @pytest.fixture(scope="session", name=find.__name__)
    def found(at_work):
        future = BEGUN.get(find.__name__)
        return future.result() if future else WORK[find.__name__]()

    WORK[find.__name__] = find
    return found


def pytest_collection_modifyitems(items):
    """Tests that need nothing but their numbers, and what `shared` finds, come last."""

    def late(item):
        given = getattr(item, "callspec", None)
        numbers = given.params if given else {}
        asked = set(item.fixturenames) - set(numbers) - {"at_work", "request", "tmp_path_factory"}
        if not asked:
            WORK[item.nodeid] = partial(item.function, **numbers)
        return not asked or not asked.isdisjoint(WORK)

    items.sort(key=late)


@pytest.fixture(scope="session", autouse=True)
def at_work(request, tmp_path_factory):
    """Begins what `shared` finds, if tests ask for it, and then such tests, if there are many."""
    items = request.session.items
    asked = {name for item in items for name in item.fixturenames}
    for name in asked & WORK.keys():
        WORK[name] = partial(WORK[name], tmp_path_factory.mktemp(name))
    alone = "PYTEST_XDIST_WORKER" not in os.environ  # or there are such processes already
    if len(items) < MANY or not (alone and hasattr(os, "fork")):
        yield
        return
    names = [name for name in WORK if name in asked] + [x.nodeid for x in items if x.nodeid in WORK]
    with ProcessPoolExecutor(1, get_context("fork")) as pool:
        BEGUN.update((name, pool.submit(do, name)) for name in names)
        yield
        pool.shutdown(cancel_futures=True)


def pytest_pyfunc_call(pyfuncitem):
    """True for a test that has been done meanwhile; what it raised there is raised here."""
    future = BEGUN.get(pyfuncitem.nodeid)
    if future is None or future.cancel():  # it has not been begun yet: it is done here
        return None
    why = future.result()
    if why is not None:
        pytest.skip(why)
    return True


@shared
def smoke(folder):
    """Two folders with all that --smoke writes; how Rerun compares the two recordings, and the
    lines in which it tells of the layout of one."""
    folders = folder / "one", folder / "and two"
    for place in folders:
        done = python(constraints.__file__, "--smoke", "--out", place)
        assert (done.returncode, done.stderr) == (0, "") and "\r" not in done.stdout
    one, two = (place / publish.RECORDING for place in folders)
    asked = ("verify", one), ("print", one), ("compare", one, two)
    verified, printed, compared = (python("-m", "rerun", "rrd", *words) for words in asked)
    assert verified.returncode == printed.returncode == 0
    layout = [line for line in printed.stdout.splitlines() if "BlueprintActivation" in line]
    return SimpleNamespace(folders=folders, compared=compared, layout=layout)
