"""The command line: a mistake is answered by one line, a run by sentences that fit a terminal."""

import contextlib
import importlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest import mock
from xml.etree import ElementTree

import constraints as c
import curriculum
from curriculum.ch3_4_constraints import publish, svg
from curriculum.ch3_4_constraints.studies import __main__ as studies
from curriculum.common import cli, llvm, origin, progress

import numpy
import pytest
from conftest import MISTAKES, complaint, python, script

posix = pytest.mark.skipif(os.name == "nt", reason="no signals, limits or /dev/full there")
SHORT = "--no-rerun", "--steps", "20", "--stabilization", "none"
NUMBERS = *SHORT, "--no-picture", "--no-page"
# a job in the background is born ignoring Ctrl-C
HEED = {"preexec_fn": partial(signal.signal, signal.SIGINT, signal.SIG_DFL), "text": True}
PROJECT = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
STUDIES = sorted(path.stem for path in (c.HERE / c.CHAPTER / "studies").glob("[!_]*.py"))
REFUSED = MISTAKES["command_line"]["words"]
for flag, _, value in (words.partition("=") for words in MISTAKES["command_line"]["values"]):
    REFUSED.append(([f"{flag}={value}"], (f"argument {flag}: ", repr(value))))
ENDS = MISTAKES["command_line"]["ends"]


def library(_):
    raise OSError("not found")


@pytest.mark.parametrize("found", [library, lambda _: object(), lambda _: len(None)])
def test_where_there_is_another_c_library_memory_is_kept_as_that_likes(found, monkeypatch):
    monkeypatch.setattr(cli.ctypes, "CDLL", found)
    cli.keep_memory()


def test_a_command_line_in_one_string_is_told_to_be_a_list(capsys):
    with pytest.raises(SystemExit):
        c.main("--seed 7")
    said = "error: arguments: '--seed 7' is a string; must be a list, as ['--seed', '7']\n"
    assert capsys.readouterr().err.endswith(said)


@pytest.mark.parametrize(("words", "parts"), REFUSED)
def test_a_bad_flag_value_or_combination_is_one_line_that_repeats_it(words, parts, capsys):
    line = complaint(capsys, *words)
    assert all(part in line for part in parts)


def test_help_fits_a_screen_and_leaves_nothing_out(monkeypatch, capsys):
    def shown(program, *words, wide=80):
        monkeypatch.setenv("COLUMNS", str(wide))
        with pytest.raises(SystemExit, match="0"):
            program([*words])
        return capsys.readouterr().out.splitlines()

    listed, text = shown(c.main, "--scenes"), shown(c.main, "--help")
    assert max(len(listed), len(text)) <= 40 and max(map(len, listed + text)) <= 80
    names = {line.split()[0] for line in listed if len(line.split()) > 3}
    scenes = {path.stem for path in (c.HERE / c.CHAPTER).glob("scenes/*.json")}
    assert names == {*scenes, *c.SYSTEMS, "chain"}
    assert "..." not in "".join(shown(c.main, "--scenes", wide=500))
    assert {"which system:", "which method:", "results:", "for CI:"} <= set(text)
    assert {*STUDIES} <= set(re.findall(r"\w+", "".join(text[-4:])))
    for name in STUDIES:
        lines = shown(studies.main, name, "--help")
        usage = f"usage: python -m {studies.__package__} {name}"
        own = name in ("figures", "real_thing")
        assert own or lines[0].startswith(usage) and max(map(len, lines)) <= 80
    # as it was started: by python, or by the entry point that pipx and uvx look for
    (name, place), *_ = PROJECT["scripts"].items()
    assert name == PROJECT["name"] == curriculum.COMMAND  # pipx run wants them to be one
    module, _, function = place.partition(":")
    assert callable(getattr(sys.modules[module], function))
    for started, command in ((f"bin/{name}", name), ("constraints.py", "python constraints.py")):
        monkeypatch.setattr(sys, "argv", [started])
        assert shown(c.main, "--help")[0].startswith(f"usage: {command} [flags]")
    c.main(["--show-step", "--system", "pendulum", "--out", "/dev/null/below"])  # it is not needed


def test_importing_does_nothing_and_only_a_recording_needs_rerun(tmp_path, monkeypatch, capsys):
    code = f"import os, sys; sys.path.insert(0, {str(c.HERE)!r}); import constraints as c"
    code += "\nprint(os.listdir()); c.main(sys.argv[1:]); assert 'rerun' not in sys.modules"
    done = python("-c", code, *SHORT, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("[]\nch3.4 ")
    assert not any(tmp_path.rglob(publish.RECORDING))
    broken = {r"raise OSError('no\ndriver')": "no driver", "raise MemoryError": "MemoryError"}
    old = "import sys; blueprint = sys.modules['rerun.blueprint'] = sys; __version__ = '0.22.1'"
    broken[old] = "rerun 0.22.1 is too old: pip install -e '.'"
    for lines, why in broken.items():  # it does not load, or is another
        (tmp_path / "rerun.py").write_text(lines)
        words = c.__file__, *NUMBERS, "--rerun", "--out", tmp_path
        done = python(*words, variables={"PYTHONPATH": str(tmp_path)})
        assert f"\n{publish.RECORDING} left out: {why}\n" in done.stdout and done.returncode == 0
        (tmp_path / publish.METRICS).unlink()
    monkeypatch.setattr(cli, "find_spec", lambda name: None)  # as if it were not installed
    assert not c.parse(["--out", str(tmp_path)])[1].rerun
    line = complaint(capsys, "--rerun")  # told before the run, not after it
    assert line.endswith("argument --rerun: rerun is not installed: pip install -e '.'\n")
    known = {"": PROJECT["dependencies"], **PROJECT["optional-dependencies"]}
    for package, extra in cli.EXTRAS.items():
        assert any(x.startswith(package) for x in known[extra.strip("[]")])


def test_a_study_is_run_by_its_name_with_its_flags(tmp_path, capsys):
    assert "a NAME is missing, one of benchmark" in complaint(capsys, main=studies.main)
    assert "mean 'chaos'?" in complaint(capsys, "caos", main=studies.main)
    studies.main(["map", "--quick", "--size", "16", "--out", str(tmp_path / "a.png")])
    said = " ".join(capsys.readouterr().out.split())  # lines break where the processor's name ends
    assert "size 16, seconds 5.0" in said  # what comes after --quick counts


# --- what could stop a run, and does not ---
def test_where_llvmlite_fails_python_goes_on_and_it_is_said_once(tmp_path, monkeypatch, capsys):
    llvmlite = pytest.importorskip("llvmlite", reason="the extra fast brings it")

    def metrics():
        c.main([*NUMBERS, "--steps", "100000", "--out", str(tmp_path)])
        return (tmp_path / publish.METRICS).read_bytes()

    machine = metrics()
    assert "compiled to machine code" in capsys.readouterr().out.replace("\n", " ")
    another = mock.Mock(side_effect=OSError("built for another\nprocessor"))
    begins = SimpleNamespace(initialize_native_target=another)
    for binding, why in ((begins, "another processor"), (SimpleNamespace(), "attribute")):
        monkeypatch.setattr(llvm, "FAILED", [])
        monkeypatch.setattr(llvmlite, "binding", binding)
        assert metrics() == machine
        told = " ".join(capsys.readouterr().out.partition("\n\n")[0].split())
        assert told.count("compiled to Python; llvmlite fails: ") == 1 and why in told


def test_numpy_may_lie_anywhere_and_is_no_code_of_the_readers(tmp_path):
    """As pip install --target has it, or a folder of one's own."""
    place = Path(numpy.__file__).parents[1]
    for name in {"numpy", "numpy.libs"} & {path.name for path in place.iterdir()}:
        less = shutil.ignore_patterns("tests", "__pycache__")
        shutil.copytree(place / name, tmp_path / name, ignore=less)
    paths = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{c.HERE}"}
    done = python("-S", c.__file__, *NUMBERS, "--out", tmp_path / "out", variables=paths)
    assert (done.returncode, done.stderr) == (0, "") and "compiled to Python\n\n" in done.stdout


def test_where_the_project_is_installed_a_force_is_still_the_readers(tmp_path):
    place = tmp_path / "site-packages"
    shutil.copytree(c.HERE / "curriculum", place / "curriculum")
    shutil.copy(c.__file__, place)
    code = "import constraints as c\nfrom curriculum.ch3_4_constraints.studies._runs import run"
    code += "\nT = 0\ndef force(system, q):\n    global T\n    T += 1\n    return T + 0.0 * q"
    code += "\nc.external_force = force\nprint(run(c.build_system('double'), steps=20).how)"
    done = python("-c", code, cwd=tmp_path, variables={"PYTHONPATH": str(place)})
    assert (done.returncode, done.stderr) == (0, "") and "it changes the global T" in done.stdout


def test_only_what_pip_put_beside_it_is_installed(tmp_path, monkeypatch):
    """The reader's own module, in the very folder, is asked what it remembers."""
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("theirs", "mine"):
        (tmp_path / f"{name}.py").touch()
        importlib.import_module(name)
    (tmp_path / "theirs-1.0.dist-info").mkdir()
    names = "theirs", "mine", "json", "math"
    assert [name for name in names if origin.of_reader(name)] == ["mine"]


def test_a_mode_of_the_readers_own_is_run_printed_and_drawn(tmp_path, monkeypatch, capsys):
    """And nothing that is printed is wider than a narrow terminal."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv/bin/python"))
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/rerun").touch()
    name, rows = "my <own>/spring", c.hold_table
    own = {name: c.Hold(1.0, 9.0, 9.0, 0.0)}
    monkeypatch.setattr(c, "hold_table", lambda *given, **named: rows(*given, **named) | own)
    for flags in (["--plain", "--no-rerun"], ["--rerun"]):
        c.main(["--steps", "9", *flags])
        printed = capsys.readouterr().out
        assert max(map(len, printed.splitlines())) <= 80
        table = printed.split("\n\n")[1].splitlines()
        assert sum(line.startswith(f"{name} ") for line in table) == 1
        assert len({len(line) for line in table[1:7]}) == 1  # and its columns are in line
    assert Path(c.OUT, publish.RECORDING).exists()
    picture = ElementTree.parse(Path(c.OUT, publish.PICTURE))
    assert name in {words.text for words in picture.iter("{http://www.w3.org/2000/svg}text")}
    assert json.dumps(name).replace("<", "\\u003c") in Path(c.OUT, publish.PAGE).read_text()
    assert len({*svg.mode_colors([*c.hold_table(), "another"]).values()}) == 7


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks there")
def test_a_forked_child_goes_on_with_a_crowd_of_its_own():
    """Its parent's threads are not there, and it must not wait for them."""
    lines = """from curriculum.ch3_4_constraints.studies import chaos
seeds = chaos.ensemble("double", range(99))
before = chaos.follow(seeds, "rk4", "none", 9)
child = os.fork()
signal.alarm(20)
assert (before.rods == chaos.follow(seeds, "rk4", "none", 9).rods).all()
if child:
    sys.exit(os.waitpid(child, 0)[1])"""
    assert script(lines).returncode == 0


# --- what ends a program ---
def test_a_mistake_is_a_traceback_that_ends_in_the_readers_line(tmp_path):
    """Though it was traced on the way there, and numpy raised the error."""
    right, mine = 'return system["m"] * GRAVITY', tmp_path / "constraints.py"
    mine.write_text(Path(c.__file__).read_text().replace(right, f"{right} + np.ones((5, 3))"))
    done = python(mine, *SHORT, cwd=tmp_path, variables={"PYTHONPATH": str(c.HERE)})
    files = re.findall(r'File "(.+?)"', done.stderr)
    assert done.returncode == 1 and files == [str(mine)] * len(files)
    assert "np.ones((5, 3))\n" in done.stderr.partition("external_force\n")[2]
    assert done.stderr.splitlines()[-1].startswith("ValueError: ")
    assert not any(tmp_path.rglob("*.json"))
    assert "Traceback" in script("raise ImportError").stderr  # of no package that is missing


@posix
@pytest.mark.parametrize(("lines", "shell", "status", "printed", "said"), ENDS)
def test_an_end_to_be_expected_is_one_line(lines, shell, status, printed, said):
    """Though the terminal is full, closed or narrow."""
    done = script(lines, shell=shell)
    assert (done.returncode, done.stdout.strip(), done.stderr.strip()) == (status, printed, said)


@posix
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_that_comes_when_all_is_done_has_nothing_to_tell(name):
    """As the second of two, or while Python shuts down."""
    heed = partial(signal.signal, getattr(signal, name), signal.SIG_DFL)
    late = f"import atexit; atexit.register(os.kill, os.getpid(), signal.{name})"
    done = script(late, preexec_fn=heed)
    assert (done.returncode, done.stdout, done.stderr) == (-getattr(signal, name), "", "")
    lines = f"""class Held:
    def __del__(self):
        os.kill(os.getpid(), signal.{name})
held = Held()
held.__del__()"""  # and once more as it is let go
    done = script(lines, preexec_fn=heed)
    said = f"\n-c: {curriculum.INTERRUPTED}\n" if name == "SIGINT" else ""
    assert done.returncode != 0 and (done.stdout, done.stderr) == ("", said)


@posix
def test_a_run_that_is_interrupted_or_outgrows_memory_leaves_nothing(tmp_path):
    pipes = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
    command = ["-u", c.__file__, "--no-rerun", "--out", tmp_path / "x", "--steps"]
    with subprocess.Popen([sys.executable, *command, "1000000000"], **pipes, **HEED) as process:
        process.stdout.readline()  # imports done, main at work
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT  # a loop of the shell ends, too
    assert re.fullmatch(r"\n?constraints\.py: interrupted[^\n]*\n", said)
    done = script("sys.argv[0] = 'a/studies/__main__.py'\nraise KeyboardInterrupt")
    assert done.stderr.startswith("\nstudies: interrupted")  # all packages have such a file
    done = python(*command, "100000000000", shell='ulimit -v 4000000; "$@"')
    assert "not enough memory" in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@posix
def test_ctrl_c_while_modules_are_loaded_is_one_line(tmp_path):
    """While numpy is loaded, say, which takes longest, and may make an ImportError of it."""
    paths = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{c.HERE}"}
    lines = "import os\ntry:\n    os.kill(os.getpid(), 2)\nexcept KeyboardInterrupt:\n    "
    started = {"raise ImportError": [c.__file__], "raise": ["-m", studies.__package__, "chaos"]}
    for answer, words in started.items():
        (tmp_path / "numpy.py").write_text(lines + answer)
        done = python(*words, variables=paths, **HEED)
        assert done.returncode and re.fullmatch(rf"\n\S+: {curriculum.INTERRUPTED}\n", done.stderr)
    mine = "signal.getsignal(signal.SIGINT) is not curriculum.leave"  # the reader's keeps its own
    assert python("-c", f"import signal, curriculum; assert {mine}").returncode == 0


@posix
def test_a_reader_who_leaves_no_streams_at_all_and_a_python_without_numpy(tmp_path):
    for flush in (False, True):  # as `| head -0` does: closed before anything is printed
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "w") as unread:
            done = script(f"print(1, flush={flush})", stdout=unread)
        assert (done.returncode, done.stderr) == (1, "")
    done = python(c.__file__, *NUMBERS, "--out", tmp_path, shell='"$@" <&- >&- 2>&-')
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    done = python("-S", c.__file__, variables={"PYTHONPATH": ""})
    assert done.returncode == 1 and re.fullmatch("numpy is not installed: [^\n]+\n", done.stderr)


def test_a_python_or_a_numpy_that_is_too_old_or_broken_is_one_line(tmp_path):
    code = "import sys; sys.version_info = (3, 10, 13); import constraints"
    done = python("-c", code)
    assert done.stderr == "Python 3.10 is too old: take 3.11 or later\n"
    told = {
        '__version__ = "1.26.4"': "numpy 1.26.4 is too old: pip install -e '.', or run .venv",
        r"raise ImportError('Read\n\nError: x\n')": "numpy does not load: Error: x; try pip ",
        "raise MemoryError": "numpy does not load: MemoryError; try pip ",
    }
    for lines, words in told.items():
        (tmp_path / "numpy.py").write_text(lines)
        done = python(c.__file__, variables={"PYTHONPATH": str(tmp_path)})
        assert done.returncode == 1 and done.stderr.startswith(words)
        assert done.stderr.count("\n") == 1
    assert "numpy>=2.0" in PROJECT["dependencies"]


# --- the banner, and what takes long ---
def test_only_a_default_run_begins_with_how_long_one_took(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(c.run_checks, "fitting", mock.Mock(side_effect=InterruptedError))
    for flags, told in (([], True), (["--seed=1"], False), (["--smoke"], False)):
        with pytest.raises(InterruptedError):  # soon after it
            c.main([*flags, "--out", str(tmp_path)])
        (line,) = capsys.readouterr().out.splitlines()
        assert bool(re.search(r"a default run took [\d.]+ s, \d{4}-", line)) == told
        assert line.startswith("ch3.4 constraints | device cpu") and len(line) <= 80


def test_progress_names_what_is_under_way_and_counts_what_follows_the_steps(monkeypatch, capsys):
    now, work = [0.0], progress.Work()
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    def told():
        return capsys.readouterr().err.replace("\x1b[K", "").strip("\r")

    work.plan("the truth", "none", "the recording")
    work.begin("the truth")
    assert told() == ""  # it may be short
    now[0] = 1.0
    work.ticks(10)(5)  # one of several runs in this part
    assert told() == "1 of 3, the truth"
    for _ in work.each(["none"]):
        assert told() == "2 of 3, none"
        tick = work.ticks(1000)
        for now[0], step in ((21, 0), (22, 210)):
            tick(step)
        assert told().split("\r") == ["2 of 3, none, 0%", "2 of 3, none, 21%"]
        tick(1000)
    work.begin("the recording")
    assert told().endswith("3 of 3, the recording")
    work.wipe()
    assert told() == ""
    for terminal in (True, False):  # of a run that stands alone
        work.plan()
        monkeypatch.setattr(sys.stderr, "isatty", lambda shown=terminal: shown)
        tick = work.ticks(1000)
        now[0] += 1.0
        tick(500)
        assert ("simulating, 50%" in told()) == terminal
        tick(1000)
        assert capsys.readouterr().err == "\x1b[K\r" * terminal  # the line is gone


def test_the_command_that_shows_a_recording_works_as_pasted(tmp_path, monkeypatch):
    """With whichever python ran, and where there is no display, by opening a browser."""
    c.main(["--steps", "2", "--rerun", "--out", str(tmp_path / "and two")])
    monkeypatch.chdir(Path(sys.executable).parents[2])
    monkeypatch.setenv("DISPLAY", ":0")
    window = publish.look(tmp_path / "and two" / publish.RECORDING)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    browser = publish.look(tmp_path / "and two" / publish.RECORDING)
    assert window == browser.replace(" --web-viewer --new --web-viewer-port 0", "") != browser
    assert window[0] != "/"  # the way from here is shorter
    opened, opener = tmp_path / "opened", tmp_path / "browser"
    opener.write_text(f"#!/bin/sh\necho $1 > {opened}\nkill 0")  # it ends the viewer, too
    opener.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(opener))
    own = {"start_new_session": True, "stderr": subprocess.DEVNULL, "timeout": 30}
    with contextlib.ExitStack() as stack:
        for port in (9876, 9090):  # as another viewer has them, or whatever has them here
            with contextlib.suppress(OSError):
                stack.enter_context(socket.create_server(("127.0.0.1", port)))
        subprocess.run(f"exec {browser}", shell=True, **own)
    assert opened.read_text().startswith("http://")
