"""The command line: a mistake is one line; whatever ends a run, nothing is lost."""

import signal
import subprocess
import sys
import tomllib
from functools import partial

import pytest
from conftest import BARE, ROOT, python

import constraints as c
from curriculum.ch3_4_constraints import scene_files
from curriculum.common import progress

WRONG = {  # flags: what the line names
    "--dt nan": "--dt: 'nan' must be a finite number",
    "--steps 2.5": "--steps: '2.5' must be a whole number",
    "--links 301": "--links: '301' must be a whole number from 1 to 300",
    "--baumgarte -1": "--baumgarte: '-1'",
    "--sys double": "--sys",
    "--system doubel": "did you mean 'double'?",
    "--integrator rk4 --stabilization impulse": "impulse is not for rk4",
}


@pytest.mark.parametrize(("flags", "words"), WRONG.items())
def test_a_wrong_flag_is_one_line_that_names_flag_and_value(flags, words, refused):
    assert words in refused(*flags.split())


def test_help_names_defaults_integrators_methods_and_studies(capsys):
    with pytest.raises(SystemExit, match="0"):
        c.main(["--help"])
    text = " ".join(capsys.readouterr().out.split())
    methods = ",".join(["all", *c.stabilizations(1.0)])
    integrators = ",".join(c.INTEGRATORS)
    for words in ("(double)", "(0)", "(0.005)", integrators, methods, "constraints.studies --help"):
        assert words in text


def test_scenes_lists_all_systems_that_have_a_name(capsys):
    with pytest.raises(SystemExit, match="0"):
        c.main(["--scenes"])
    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines()}
    assert listed == {*c.CHAINS, "chain", *scene_files.SHIPPED}


def test_the_entry_point_is_the_package_and_its_function_is_there():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    ((name, place),) = project["scripts"].items()
    module, function = place.split(":")
    assert name == project["name"]  # or uvx and pipx run do not find it
    assert callable(getattr(sys.modules[module], function))


def test_importing_and_calling_main_leave_python_as_it_was(tmp_path):
    code = """import gc, os, signal, sys, warnings
import numpy as np
def state():
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    hooks = sys.excepthook, sys.unraisablehook, sys.gettrace(), sys.getrecursionlimit()
    collector = gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()
    return handlers, hooks, collector, np.geterr(), os.getcwd(), warnings.filters[:]
before = state()
import constraints
assert state() == before, "the import"
constraints.main(["--dt", "0.1", "--steps", "300", "--out", sys.argv[1]])
assert state() == before, "main"
"""
    done = python("-c", code, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_runs_leave_no_memory_behind(tmp_path):
    code = """import resource, sys, constraints
def peak(runs):
    for _ in range(runs):
        constraints.main(sys.argv[1:])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # kB
print(-peak(10) + peak(50))
"""
    done = python("-c", code, "--steps", "8", *BARE, "--out", tmp_path)
    assert int(done.stdout.split()[-1]) < 5000 * 50 / 90  # 5 MB in 90 runs


@pytest.mark.parametrize("flags", ["--dt 1e-12 --steps 10", "--steps 1", "--dt 1e9 --steps 9"])
def test_the_shortest_runs_and_the_longest_steps_are_runs(flags, tmp_path):
    folder = tmp_path / "below" / "another"
    assert c.main([*flags.split(), "--out", str(folder)]) == 0
    assert len([*folder.iterdir()]) == 3


@pytest.mark.parametrize(
    ("mistake", "error"),
    {
        "return system['mass'] * GRAVITY": "KeyError: 'mass'",
        "return system['m'] * GRAVITY + np.linalg.inv(np.zeros((3, 3)))": "numpy.linalg.",
    }.items(),
)
def test_a_readers_mistake_is_a_traceback_that_ends_in_their_line(mistake, error, tmp_path):
    text = (ROOT / "constraints.py").read_text()
    mine = tmp_path / "constraints.py"
    mine.write_text(text.replace('return system["m"] * GRAVITY', mistake))
    done = python(mine, "--steps", "20", "--out", tmp_path, variables={"PYTHONPATH": str(ROOT)})
    *_, shown, _, last = [x for x in done.stderr.splitlines() if set(x) - {" ", "^", "~"}]
    assert done.returncode == 1 and last.startswith(error)
    assert f'File "{mine}"' in shown and "external_force" in shown


def test_ctrl_c_from_mains_first_line_on_ends_it_in_one_line(tmp_path):
    command = [sys.executable, "-u", "constraints.py", "--steps", "9999", "--out", str(tmp_path)]
    heed = partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    with subprocess.Popen([*command, "--plain"], preexec_fn=heed, **pipes) as process:
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT  # so that a loop of the shell ends, too
    assert said == "\ninterrupted: no file is half written\n" and not [*tmp_path.iterdir()]


def test_a_reader_who_wants_no_more_lines_ends_a_run_in_silence(tmp_path):
    command = f"{sys.executable} constraints.py --steps 9 {' '.join(BARE)} --out {tmp_path}"
    done = subprocess.run(f"{command} | head -0", shell=True, cwd=ROOT, capture_output=True)
    assert done.stderr == b""


def test_progress_is_a_line_on_a_terminal_that_is_gone_in_the_end(monkeypatch, capsys):
    monkeypatch.setattr(progress, "SOON", 0.0)
    for terminal, told in ((True, "a\x1b[K\rb\x1b[K\r\x1b[K\r"), (False, "")):
        monkeypatch.setattr(sys.stderr, "isatty", lambda shown=terminal: shown)
        assert [*progress.each("ab")] == ["a", "b"]
        assert capsys.readouterr() == ("", told)
