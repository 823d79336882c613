"""The command line: a mistake is answered by one line, a run by sentences that fit a terminal."""

import os
import re
import signal
import subprocess
import sys
import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints import publish
from curriculum.common import banner, cli

import pytest
from conftest import MISTAKES, complaint, python, script

posix = pytest.mark.skipif(os.name == "nt", reason="no signals, limits or /dev/full there")
SHORT = "--no-rerun", "--steps", "20", "--stabilization", "none"
REFUSED = MISTAKES["command_line"]["words"]
for flag, _, value in (words.partition("=") for words in MISTAKES["command_line"]["values"]):
    REFUSED.append(([f"{flag}={value}"], (f"argument {flag}: ", repr(value))))
ENDS = dict(MISTAKES["command_line"]["ends"])
for package, extra in cli.EXTRAS.items():
    line = f"-c: error: {package} is not installed: pip install -e '.{extra}'"
    ENDS[f"sys.modules[{package!r}] = None\nimport {package}"] = line


@pytest.mark.parametrize(("words", "parts"), REFUSED)
def test_a_bad_flag_value_or_combination_is_one_line_that_repeats_it(words, parts, capsys):
    line = complaint(capsys, *words)
    assert all(part in line for part in parts)


def test_help_and_scenes_fit_a_screen_and_leave_nothing_out(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown, folder = {}, c.HERE / c.CHAPTER
    for flag in ("--scenes", "--help"):
        with pytest.raises(SystemExit, match="0"):
            c.main([flag])
        shown[flag] = capsys.readouterr().out.splitlines()
        assert len(shown[flag]) <= 40 and max(map(len, shown[flag])) <= 80
    scenes = {path.stem for path in folder.glob("scenes/*.json")} | {*c.SYSTEMS, "chain"}
    assert {line.split()[0] for line in shown["--scenes"] if len(line.split()) > 3} == scenes
    assert {"which system:", "which method:", "results:", "for CI:"} <= set(shown["--help"])
    studies = {path.stem for path in folder.glob("studies/[!_]*.py")}
    assert studies <= set(re.findall(r"\w+", "".join(shown["--help"][-4:])))
    c.main(["--show-step", "--system", "pendulum", "--out", "/dev/null/below"])  # it is not needed


def test_importing_does_nothing_and_a_run_needs_no_rerun_unless_a_recording_is_asked_for(
    tmp_path, monkeypatch
):
    code = f"import os, sys; sys.path.insert(0, {str(c.HERE)!r}); import constraints as c"
    code += "\nprint(os.listdir()); c.main(sys.argv[1:]); assert 'rerun' not in sys.modules"
    done = python("-c", code, *SHORT, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("[]\nch3.4 ")
    files = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert files == {publish.METRICS, publish.PICTURE}
    monkeypatch.setattr(cli, "find_spec", lambda name: None)  # as if it were not installed
    flags = ["--out", str(tmp_path)]
    assert [c.parse([*flags, *more])[0].rerun for more in ([], ["--rerun"])] == [False, True]


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
def test_an_end_to_be_expected_is_one_line_that_names_what_brings_a_missing_package(lines, line):
    done = script(lines)
    assert (done.returncode, done.stderr.strip()) == (1, line)
    project = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
    known = {"": project["dependencies"], **project["optional-dependencies"]}
    if "import" in lines:
        package, extra = re.fullmatch(r"-c: error: (\w+) .*-e '.\[?(\w*)]?'", line).groups()
        assert any(x.startswith(package) for x in known[extra])


@posix
def test_a_run_that_is_interrupted_or_outgrows_memory_leaves_nothing(tmp_path):
    import resource

    # a job in the background is born ignoring the signal
    heed, pipe = partial(signal.signal, signal.SIGINT, signal.SIG_DFL), subprocess.PIPE
    command = [sys.executable, "-u", c.__file__, "--steps", "1000000000", "--out", tmp_path / "x"]
    with subprocess.Popen(command, preexec_fn=heed, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.readline()  # imports done, main at work
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode and re.fullmatch(r"\n?constraints\.py: interrupted[^\n]*\n", said)
    little = partial(resource.setrlimit, resource.RLIMIT_AS, (4 << 30, 4 << 30))
    done = python(*command[1:], "--no-rerun", preexec_fn=little)
    assert "not enough memory" in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
    nohup = partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)
    assert not script("os.kill(os.getpid(), signal.SIGHUP)", preexec_fn=nohup).returncode


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
    assert done.returncode == 0 and done.stdout.rstrip().endswith("\\xe4/motion.svg")
    assert script("import numpy; numpy.ones(1) / 0.0").stderr == ""  # a warning for nobody
    done = python("-S", c.__file__, variables={"PYTHONPATH": ""})
    assert done.returncode == 1 and re.fullmatch("numpy is not installed: [^\n]+\n", done.stderr)


# --- the banner, and what takes long ---
@pytest.mark.parametrize(("flags", "told"), [("", True), ("--seed=1", False), ("--smoke", False)])
def test_only_a_default_run_begins_with_how_long_one_took(flags, told, tmp_path):
    _, _, usual, _ = c.parse([*flags.split(), "--out", str(tmp_path)])
    line = banner.banner("ch3.4", "constraints", "cpu", usual)
    assert bool(re.search(r"a default run took [\d.]+ s, \d{4}-", line)) == told
    assert line.startswith("ch3.4 constraints | device cpu") and len(line) <= 80


def test_progress_of_all_parts_is_told_to_a_terminal(monkeypatch, capsys):
    """Unless it is short, or has hardly begun."""
    long = 0.0, 0.1, 5.0, 10.0, 10.1, 20.0, 30.0
    short = 0.0, 0.1, 0.2, 0.4, 0.5, 1.0, 1.5
    told = ["", "soft: 25% of all, about 15 s left", "", "none: 50% of all, about 10 s left"]
    told += ["none: 75% of all, about 7 s left", ""]
    for terminal, times in ((True, long), (True, short), (False, long)):
        clock, shown = iter(times), []
        monkeypatch.setattr(banner, "time", SimpleNamespace(monotonic=clock.__next__))
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal, raising=False)
        for _ in banner.in_parts(["soft", "none"]):
            tick = banner.progress("swinging", 1000)
            for step in (1, 500, 1000):
                tick(step)
                shown.append(capsys.readouterr().err.replace("\x1b[K", "").strip()[9:])
        assert shown == (told if terminal and times == long else [""] * 6)
    words = {0.2: "1 s", 45: "45 s", 170: "3 min", 8000: "2 h", 1e6: "278 h"}
    assert all(banner.about(seconds) == f"about {text}" for seconds, text in words.items())


def test_the_command_that_shows_a_recording_works_as_pasted(smoke, tmp_path, monkeypatch):
    """With whichever python ran, and where there is no display, by opening a browser."""
    monkeypatch.chdir(Path(sys.executable).parents[2])
    monkeypatch.setenv("DISPLAY", ":0")
    window = publish.look(smoke[1] / publish.RECORDING)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    browser = publish.look(smoke[1] / publish.RECORDING)
    assert window == browser.replace(" --web-viewer", "") != browser and window[0] != "/"
    assert "--bind 127.0.0.1" in browser  # or it listens to the network
    opened, opener = tmp_path / "opened", tmp_path / "browser"
    opener.write_text(f"#!/bin/sh\necho $1 > {opened}\nkill 0")  # it ends the viewer, too
    opener.chmod(0o700)
    monkeypatch.setenv("BROWSER", str(opener))
    command = f"exec {browser} --port 0 --web-viewer-port 0"  # the usual ones may be taken
    own = {"start_new_session": True, "stderr": subprocess.DEVNULL, "timeout": 30}
    subprocess.run(command, shell=True, **own)
    assert opened.read_text().startswith("http://")
