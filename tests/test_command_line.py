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
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import constraints as c
import curriculum
from curriculum.ch3_4_constraints import publish, svg
from curriculum.ch3_4_constraints.studies import __main__ as studies
from curriculum.common import banner, cli, pure

import numpy
import pytest
from conftest import MISTAKES, complaint, python, script

posix = pytest.mark.skipif(os.name == "nt", reason="no signals, limits or /dev/full there")
SHORT = "--no-rerun", "--steps", "20", "--stabilization", "none"
STUDIES = sorted(path.stem for path in (c.HERE / c.CHAPTER / "studies").glob("[!_]*.py"))
QUICK = {"benchmark", "chaos", "hard_cases", "map", "reference", "speed_vs_error"}
REFUSED = MISTAKES["command_line"]["words"]
for flag, _, value in (words.partition("=") for words in MISTAKES["command_line"]["values"]):
    REFUSED.append(([f"{flag}={value}"], (f"argument {flag}: ", repr(value))))
ENDS = MISTAKES["command_line"]["ends"]


@pytest.mark.parametrize(("words", "parts"), REFUSED)
def test_a_bad_flag_value_or_combination_is_one_line_that_repeats_it(words, parts, capsys):
    line = complaint(capsys, *words)
    assert all(part in line for part in parts)


def test_help_and_scenes_fit_a_screen_and_leave_nothing_out(capsys, monkeypatch):
    shown, folder = {}, c.HERE / c.CHAPTER
    for flag, wide in (("--scenes", 80), ("--help", 80), ("--scenes", 500)):
        monkeypatch.setenv("COLUMNS", str(wide))
        with pytest.raises(SystemExit, match="0"):
            c.main([flag])
        shown[flag, wide] = capsys.readouterr().out.splitlines()
        assert len(shown[flag, wide]) <= 40 and max(map(len, shown[flag, wide])) <= wide
    narrow, text, wide = shown.values()
    scenes = {path.stem for path in folder.glob("scenes/*.json")} | {*c.SYSTEMS, "chain"}
    assert {line.split()[0] for line in narrow if len(line.split()) > 3} == scenes
    assert "..." not in "".join(wide)
    assert {"which system:", "which method:", "results:", "for CI:"} <= set(text)
    assert {*STUDIES} <= set(re.findall(r"\w+", "".join(text[-4:])))
    c.main(["--show-step", "--system", "pendulum", "--out", "/dev/null/below"])  # it is not needed


def test_importing_does_nothing_and_a_run_needs_no_rerun_unless_a_recording_is_asked_for(
    tmp_path, monkeypatch, capsys
):
    code = f"import os, sys; sys.path.insert(0, {str(c.HERE)!r}); import constraints as c"
    code += "\nprint(os.listdir()); c.main(sys.argv[1:]); assert 'rerun' not in sys.modules"
    done = python("-c", code, *SHORT, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("[]\nch3.4 ")
    files = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert files == {publish.METRICS, publish.PICTURE, publish.PAGE}
    monkeypatch.setattr(cli, "find_spec", lambda name: None)  # as if it were not installed
    assert not c.parse(["--out", str(tmp_path)])[1].rerun
    line = complaint(capsys, "--rerun")  # told before the run, not after it
    assert line.endswith("argument --rerun: rerun is not installed: pip install -e '.'\n")


def test_a_run_prints_nothing_that_is_wider_than_a_narrow_terminal(tmp_path, monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv/bin/python"))
    (tmp_path / ".venv/bin").mkdir(parents=True)
    (tmp_path / ".venv/bin/rerun").touch()
    for flags in (["--rerun"], ["--plain", "--no-rerun"]):
        c.main(["--steps", "9", *flags])
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= 80, lines


def test_a_program_is_told_as_it_was_started(monkeypatch, capsys):
    """By python, or by the entry point that pipx and uvx look for."""
    settings = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
    (name, place), *_ = settings["scripts"].items()
    assert name == settings["name"] == curriculum.COMMAND  # pipx run wants them to be one
    module, _, function = place.partition(":")
    assert callable(getattr(sys.modules[module], function))
    for started, command in ((f"bin/{name}", name), ("constraints.py", "python constraints.py")):
        monkeypatch.setattr(sys, "argv", [started, "--help"])
        with pytest.raises(SystemExit, match="0"):
            c.main()
        assert capsys.readouterr().out.startswith(f"usage: {command} [flags]")


def test_a_study_is_run_by_its_name_and_its_help_fits(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "80")
    for name in STUDIES:
        with pytest.raises(SystemExit, match="0"):
            studies.main([name, "--help"])
        lines = capsys.readouterr().out.splitlines()
        assert ("--quick" in " ".join(lines)) == (name in QUICK)
        if name not in ("figures", "real_thing"):
            assert lines[0].startswith(f"usage: python -m {studies.__package__} {name}")
            assert max(map(len, lines)) <= 80, lines
    for words, said in (([], "a NAME is missing, one of benchmark"), (["caos"], "mean 'chaos'?")):
        with pytest.raises(SystemExit, match="2"):
            studies.main(words)
        assert said in capsys.readouterr().err
    studies.main(["map", "--quick", "--size", "16", "--out", str(tmp_path / "a.png")])
    assert "size 16, seconds 5.0" in capsys.readouterr().out  # what comes after --quick counts


# --- what could stop a run, and does not ---
def second_line(*flags, python_flags=(), **variables):
    """The second line that a run prints, which tells how its steps were done."""
    words = [*python_flags, c.__file__, "--no-rerun", "--no-picture", "--stabilization", "none"]
    done = python(*words, *flags, variables=variables, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    return " ".join(done.stdout.partition("\n\n")[0].split())


def test_where_llvmlite_fails_a_run_goes_on_in_python_and_says_so_once(tmp_path):
    pytest.importorskip("llvmlite", reason="the extra fast brings it")
    long, path = ("--steps", "100000", "--out"), f"{tmp_path}{os.pathsep}{c.HERE}"
    second_line(*long, tmp_path / "machine")
    (tmp_path / "llvmlite").mkdir()
    (tmp_path / "llvmlite/__init__.py").touch()
    fails = {"processor": "raise OSError('built for another\\nprocessor')", "attribute": "x = 1"}
    for why, line in fails.items():
        (tmp_path / "llvmlite/binding.py").write_text(line)
        told = second_line(*long, tmp_path / "out", PYTHONPATH=path)
        assert told.count("compiled to Python; llvmlite fails: ") == 1 and why in told
        metrics = [(tmp_path / x / publish.METRICS).read_bytes() for x in ("out", "machine")]
        assert metrics[0] == metrics[1]


def test_numpy_may_lie_anywhere_and_is_no_code_of_the_readers(tmp_path):
    """As pip install --target has it, or a folder of one's own."""
    place = Path(numpy.__file__).parents[1]
    for name in {"numpy", "numpy.libs"} & {path.name for path in place.iterdir()}:
        less = shutil.ignore_patterns("tests", "__pycache__")
        shutil.copytree(place / name, tmp_path / name, ignore=less)
    flags = "--steps", "9", "--out", tmp_path / "out"
    told = second_line(*flags, python_flags=["-S"], PYTHONPATH=f"{tmp_path}{os.pathsep}{c.HERE}")
    assert told.endswith("compiled to Python")


def test_only_what_pip_put_beside_it_is_installed(tmp_path, monkeypatch):
    """The reader's own module, in the very folder, is asked what it remembers."""
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("theirs", "mine"):
        (tmp_path / f"{name}.py").touch()
        importlib.import_module(name)
    (tmp_path / "theirs-1.0.dist-info").mkdir()
    assert [name for name in ("theirs", "mine", "json", "math") if pure.ours(name)] == ["mine"]


def test_a_row_of_the_readers_own_in_the_table_of_modes_is_run_printed_and_drawn(tmp_path):
    row, name = '"none": Hold(1.0, 0.0, 0.0, 0.0),', "my <own>/spring"
    text = Path(c.__file__).read_text()
    assert row in text
    mine, out = tmp_path / "constraints.py", tmp_path / "out"
    mine.write_text(text.replace(row, f"{row}\n        {name!r}: Hold(1.0, 9.0, 9.0, 0.0),"))
    done = python(mine, "--steps", "9", "--out", out, variables={"PYTHONPATH": str(c.HERE)})
    assert (done.returncode, done.stderr) == (0, "") and (out / publish.RECORDING).exists()
    table = done.stdout.split("\n\n")[1].splitlines()
    assert sum(line.startswith(f"{name} ") for line in table) == 1
    assert len({len(line) for line in table[1:7]}) == 1  # and its columns are in line
    picture = ElementTree.parse(out / publish.PICTURE)
    assert name in {words.text for words in picture.iter("{http://www.w3.org/2000/svg}text")}
    assert json.dumps(name).replace("<", "\\u003c") in (out / publish.PAGE).read_text()
    assert len({*svg.mode_colors([*c.hold_table(), name, "another"]).values()}) == 7


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks there")
def test_a_forked_child_goes_on_with_a_crowd_of_its_own():
    """Its parent's threads are not there, and it must not wait for them."""
    lines = f"""sys.path.insert(0, {str(c.HERE)!r})
from curriculum.ch3_4_constraints.studies import chaos
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


@pytest.mark.parametrize(("lines", "line"), ENDS.items())
def test_an_end_to_be_expected_is_one_line(lines, line):
    done = script(lines)
    assert (done.returncode, done.stderr.strip()) == (1, line)


def test_a_missing_package_is_named_beside_what_brings_it():
    project = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
    known = {"": project["dependencies"], **project["optional-dependencies"]}
    for package, extra in cli.EXTRAS.items():
        assert any(x.startswith(package) for x in known[extra.strip("[]")])
    said = script("sys.modules['mpmath'] = None\nimport mpmath").stderr
    assert said == "-c: error: mpmath is not installed: pip install -e '.[reference]'\n"


@posix
def test_a_run_that_is_interrupted_or_outgrows_memory_leaves_nothing(tmp_path):
    import resource

    # a job in the background is born ignoring the signal
    heed, pipe = partial(signal.signal, signal.SIGINT, signal.SIG_DFL), subprocess.PIPE
    command = ["-u", c.__file__, "--no-rerun", "--out", tmp_path / "x", "--steps"]
    words, pipes = [sys.executable, *command, "1000000000"], {"stdout": pipe, "stderr": pipe}
    with subprocess.Popen(words, preexec_fn=heed, text=True, **pipes) as process:
        process.stdout.readline()  # imports done, main at work
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGINT  # a loop of the shell ends, too
    assert re.fullmatch(r"\n?constraints\.py: interrupted[^\n]*\n", said)
    little = partial(resource.setrlimit, resource.RLIMIT_AS, (4 << 30, 4 << 30))
    done = python(*command, "100000000000", preexec_fn=little)
    assert "not enough memory" in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
    nohup = partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)
    assert not script("os.kill(os.getpid(), signal.SIGHUP)", preexec_fn=nohup).returncode


@posix
def test_ctrl_c_while_modules_are_loaded_is_one_line(tmp_path):
    """While numpy is loaded, say, which takes longest, and may make an ImportError of it."""
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a job may be born ignoring it
    paths, kill = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{c.HERE}"}, "os.kill(os.getpid(), 2)"
    for answer, *started in (
        ("raise ImportError", c.__file__),
        ("raise", "-m", studies.__package__, "chaos"),
    ):
        lines = "import os", "try:", f"    {kill}", "except KeyboardInterrupt:", f"    {answer}", ""
        (tmp_path / "numpy.py").write_text("\n".join(lines))
        done = python(*started, variables=paths, preexec_fn=heed)
        assert done.returncode and re.fullmatch(rf"\n\S+: {curriculum.INTERRUPTED}\n", done.stderr)
    mine = "signal.getsignal(signal.SIGINT) is not curriculum.leave"  # the reader's keeps its own
    done = python("-c", f"import signal, curriculum; assert {mine}")
    assert done.returncode == 0


@posix
def test_a_full_closed_or_narrow_terminal_and_a_reader_who_leaves(tmp_path):
    with open("/dev/full", "w") as full:
        done = script("print(1)", stdout=full)
    assert (done.returncode, done.stderr) == (1, "-c: error: No space left on device\n")
    for flush in (False, True):  # as `| head -0` does: closed before anything is printed
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "w") as unread:
            done = script(f"print(1, flush={flush})", stdout=unread)
        assert (done.returncode, done.stderr) == (1, "")
    closed, run = partial(os.closerange, 0, 3), partial(python, c.__file__, *SHORT, "--out")
    done = run(tmp_path, preexec_fn=closed)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    done = run(tmp_path / "\u00e4", variables={"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0 and "\\xe4:\n  metrics.json" in done.stdout
    done = script("raise OSError(28, 'Full', 'a.json')", preexec_fn=partial(os.close, 1))
    assert (done.returncode, done.stderr) == (1, "-c: error: Full: a.json\n")
    assert script("import numpy; numpy.ones(1) / 0.0").stderr == ""  # a warning for nobody
    done = python("-S", c.__file__, variables={"PYTHONPATH": ""})
    assert done.returncode == 1 and re.fullmatch("numpy is not installed: [^\n]+\n", done.stderr)


# --- the banner, and what takes long ---
def test_only_a_default_run_begins_with_how_long_one_took(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(publish, "publish", lambda *_: "")  # which comes after it
    for flags, told in (([], True), (["--seed=1"], False), (["--smoke"], False)):
        c.main([*flags, "--out", str(tmp_path)])
        line, *_ = capsys.readouterr().out.splitlines()
        assert bool(re.search(r"a default run took [\d.]+ s, \d{4}-", line)) == told
        assert line.startswith("ch3.4 constraints | device cpu") and len(line) <= 80


def test_progress_names_what_is_under_way_and_counts_what_follows_the_steps(monkeypatch, capsys):
    now, work = [0.0], banner.Work()
    monkeypatch.setattr(banner, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(banner, "on_terminal", lambda: True)
    monkeypatch.setattr(banner, "work", work)

    def told():
        return capsys.readouterr().err.replace("\x1b[K", "").strip("\r")

    work.plan("the truth", "none", "the recording")
    work.begin("the truth")
    assert told() == ""  # it may be short
    now[0] = 1.0
    banner.progress("simulating", 10)(5)  # one of several runs in this part
    assert told() == "1 of 3, the truth"
    for _ in work.each(["none"]):
        assert told() == "2 of 3, none"
        tick = banner.progress("simulating", 1000)
        for now[0], step in ((21, 0), (22, 210)):
            tick(step)
        assert told().split("\r") == ["2 of 3, none, 0%", "2 of 3, none, 21%"]
        tick(1000)
    work.begin("the recording")
    assert told().endswith("3 of 3, the recording")
    work.wipe()
    assert told() == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_is_for_a_terminal_alone_and_also_of_a_run_that_stands_alone(
    terminal, monkeypatch, capsys
):
    monkeypatch.setattr(banner, "time", SimpleNamespace(monotonic=count().__next__))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.setattr(banner, "work", banner.Work())
    tick = banner.progress("simulating", 1000)
    tick(500)
    assert ("simulating, 50%" in capsys.readouterr().err) == terminal
    tick(1000)
    assert capsys.readouterr().err == "\x1b[K\r" * terminal  # the line is gone


def test_the_command_that_shows_a_recording_works_as_pasted(smoke, tmp_path, monkeypatch):
    """With whichever python ran, and where there is no display, by opening a browser."""
    monkeypatch.chdir(Path(sys.executable).parents[2])
    monkeypatch.setenv("DISPLAY", ":0")
    window = publish.look(smoke.folders[1] / publish.RECORDING)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    browser = publish.look(smoke.folders[1] / publish.RECORDING)
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
