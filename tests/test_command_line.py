"""The command line: a mistake is answered by one line, a run by sentences that fit a terminal."""

import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints import publish
from curriculum.common import banner, cli

import pytest

posix = pytest.mark.skipif(os.name == "nt", reason="no signals, limits or /dev/full there")
SHORT = "--no-rerun", "--steps", "20", "--stabilization", "none"
REFUSED = {  # what the line must repeat, beside each flag with a value
    "--dt=0 --dt=-1 --dt=nan --dt=inf --dt=abc --dt=1e-320 --dt=1e308 --steps=0 --steps=1.5": "",
    f"--steps=1e3 --steps=\u0663 --steps=1_000 --steps={10**24} --seed=-1 --seed=x --seed=--": "",
    "--baumgarte=-1 --baumgarte=1e-400 --impedance=0 --impedance=1 --links=0 --device=gpu": "",
    "--system=nosuch --system=-- --stabilization=nosuch --links=99999999999": "",
    "--system=two\nlines": r"two\nlines",
    "--no\nsuch|1": r"--no\nsuch 1",
    "--integ|rk4": "--integ rk4",
    "--stabilization|impulse|--integrator|rk4": "impulse|rk4|q + dt (v + dt a)|semi_implicit",
    "--tol|0.001|--integrator|rk4": "--tol|0.001|--integrator gauss",
    "--integrator|RK4": "mean rk4?",
    "--SYSTEM|double": "mean --system?",
    "--system|Triple": "mean 'triple'?",
}


def program(*words, python=(c.__file__,), before=None, **settings):
    """A process of its own that runs constraints.py with these words, or what `python` is told."""
    command = [sys.executable, *python, *map(str, words)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60}
    return subprocess.run(command, preexec_fn=before, **{"cwd": c.HERE} | pipes | settings)


def script(lines, before=None):
    """What a process of its own says whose main is `lines`."""
    body = "".join(f"    {line}\n" for line in lines.splitlines())
    start = "import os, signal, sys, numpy\nfrom curriculum.common.cli import run_script\n"
    return program(python=["-c", f"{start}def main():\n{body}run_script(main)"], before=before)


def refusal(capsys, *words):
    """The one line with which main refuses `words`; no folder can be written: that comes last."""
    with pytest.raises(SystemExit) as end:
        c.main(["--out", "/dev/null/below", *map(str, words)])
    printed, line = capsys.readouterr()
    assert (end.value.code, printed) == (2, "")
    assert re.fullmatch(r"constraints\.py: error: [^\n]{1,400}\n", line)
    return line


@pytest.mark.parametrize(("flags", "repeated"), REFUSED.items())
def test_a_bad_flag_value_or_combination_is_one_line_that_repeats_it(flags, repeated, capsys):
    for words in flags.split(" ") if "=" in flags else [flags]:
        line, (flag, _, value) = refusal(capsys, *words.split("|")), words.partition("=")
        assert all(part in line for part in repeated.split("|"))
        assert not value or (f"argument {flag}: " in line and repr(value) in line), words


def test_where_results_cannot_go_is_said_before_the_run(tmp_path, capsys):
    (tmp_path / "constraints.rrd").mkdir()
    for out in (tmp_path, tmp_path / "constraints.rrd" / ("x" * 5000), "/dev/null", ""):
        line = refusal(capsys, *SHORT, "--out", out)
        assert f"argument --out: cannot write to {str(out)[:60]!r}"[:-1] in line
    assert c.main(["--show-step", "--system", "pendulum", "--out", "/dev/null/below"]) == 0


def test_help_and_scenes_fit_a_screen_and_leave_nothing_out(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    shown = {}
    for flag in ("--scenes", "--help"):
        with pytest.raises(SystemExit, match="0"):
            c.main([flag])
        shown[flag] = capsys.readouterr().out.splitlines()
        assert len(shown[flag]) <= 40 and max(map(len, shown[flag])) <= 80
    files = {path.stem for path in (c.HERE / c.CHAPTER / "scenes").glob("*.json")}
    assert {line.split()[0] for line in shown["--scenes"]} == files | {*c.SYSTEMS, "chain"}
    assert all(len(line.split()) > 3 for line in shown["--scenes"])
    assert {"which system:", "which method:", "results:", "for CI:"} <= set(shown["--help"])
    studies = {path.stem for path in (c.HERE / c.CHAPTER / "studies").glob("[!_]*.py")}
    assert studies <= set(re.findall(r"\w+", "".join(shown["--help"][-4:])))


def test_a_run_without_a_recording_never_imports_rerun_and_importing_writes_nothing(tmp_path):
    code = f"import sys; sys.path.insert(0, {str(c.HERE)!r}); import constraints as c"
    for work in ("", "; c.main(sys.argv[1:])"):
        quiet = f"{code}{work}; assert 'rerun' not in sys.modules"
        done = program(*SHORT, python=["-c", quiet], cwd=tmp_path)
        assert (done.returncode, done.stderr, bool(done.stdout)) == (0, "", bool(work))
        assert bool(list(tmp_path.iterdir())) == bool(work)


# --- what ends a program ---
def test_a_mistake_is_a_traceback_that_ends_in_the_readers_line(tmp_path):
    wrong = "import numpy\ndef wrong(path):\n    numpy.stack([numpy.ones(2), numpy.ones(3)])\n"
    (tmp_path / "mine.py").write_text(wrong)
    lines = f"sys.path.insert(0, {str(tmp_path)!r})\nfrom mine import wrong\nfrom curriculum.common"
    done = script(f"{lines}.files import write_whole\nwrite_whole({str(tmp_path / 'a')!r}, wrong)")
    files = re.findall(r'File "(.+?)", line (\d+)', done.stderr)
    assert files[-1] == (str(tmp_path / "mine.py"), "3") and len(files) <= 2
    assert done.stderr.splitlines()[-1].startswith("ValueError: ") and done.returncode == 1


def test_an_end_to_be_expected_is_one_line_and_a_missing_package_names_what_brings_it():
    ends = {
        "raise MemoryError": "-c: error: not enough memory; ask for fewer rods, members or steps",
        "raise OSError(28, 'Full', 'a.json')": "-c: error: Full: a.json",
        "raise BrokenPipeError": "",
        "raise SystemExit('so be it')": "so be it",
    }
    extras = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
    known = {"": extras["dependencies"], **extras["optional-dependencies"]}
    for package, extra in cli.EXTRAS.items():
        assert any(x.startswith(package) for x in known[extra.strip("[]")]), package
        line = f"-c: error: {package} is not installed: pip install -e '.{extra}'"
        ends[f"sys.modules[{package!r}] = None\nimport {package}"] = line
    for lines, line in ends.items():
        done = script(lines)
        assert (done.returncode, done.stderr.strip()) == (1, line), lines
    assert "Traceback" in script("raise ImportError").stderr
    hangup = "os.kill(os.getpid(), signal.SIGHUP)"  # under nohup
    assert not script(hangup, partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)).returncode
    done = program(python=["-S", c.__file__], env=os.environ | {"PYTHONPATH": ""})
    assert done.returncode == 1 and re.fullmatch("numpy is not installed: [^\n]+\n", done.stderr)


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
    done = program("--steps", 10**9, "--no-rerun", "--out", tmp_path / "x", before=little)
    assert "not enough memory" in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@posix
def test_a_full_closed_or_narrow_terminal_and_a_reader_that_has_seen_enough(tmp_path):
    with open("/dev/full", "w") as full:
        done = program(*SHORT, "--out", tmp_path, stdout=full)
    assert (done.returncode, done.stderr) == (1, "constraints.py: error: No space left on device\n")
    for python in (
        [c.__file__],
        ["-u", c.__file__],
    ):  # as `| head -0` does: closed before anything is printed
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write, "w") as closed:
            done = program(*SHORT, "--out", tmp_path, python=python, stdout=closed)
        assert (done.returncode, done.stderr) == (1, "")
    for closed in ((1,), (0, 1, 2)):
        shut = partial(lambda closed: [os.close(k) for k in closed], closed)
        done = program(*SHORT, "--out", tmp_path, before=shut)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    narrow = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = program(*SHORT, "--out", tmp_path / "\u00e4", env=narrow)
    assert done.returncode == 0 and done.stdout.rstrip().endswith("\\xe4/motion.svg")
    # or what a library writes to a closed stream would be in a file that took its number
    done = script("return os.open(os.devnull, 0)", lambda: [os.close(k) for k in range(3)])
    assert done.returncode > 2
    assert script("numpy.ones(1) / 0.0").stderr == ""  # a warning of numpy's is for nobody


# --- the banner, and what takes long ---
def test_only_a_default_run_begins_with_how_long_one_took(tmp_path):
    for flags, told in (([], True), (["--seed", "1"], False), (["--smoke"], False)):
        _, _, usual, _ = c.parse([*flags, "--out", str(tmp_path)])
        line = banner.banner("ch3.4", "constraints", "cpu", usual)
        assert bool(re.search(r"a default run took [\d.]+ s, \d{4}-", line)) == told
        assert line.startswith("ch3.4 constraints | device cpu") and len(line) <= 80


def test_progress_of_all_parts_is_told_to_a_terminal(monkeypatch, capsys):
    """Unless it is short, or has hardly begun."""
    long, short = (0.0, 5.0, 10.0, 20.0, 30.0), (0.0, 0.1, 0.4, 1.0, 1.5)
    told = ["soft: 25% of all, about 15 s left", "", "none: 75% of all, about 7 s left", ""]
    for terminal, times in ((True, long), (True, short), (False, long)):
        clock, shown = iter([*times, *times]), []
        monkeypatch.setattr(banner, "time", SimpleNamespace(monotonic=clock.__next__))
        monkeypatch.setattr(sys.stderr, "isatty", lambda terminal=terminal: terminal, raising=False)
        for _ in banner.in_parts(["soft", "none"]):
            tick = banner.progress("swinging", 1000)
            for step in (500, 1000):
                tick(step)
                shown.append(capsys.readouterr().err.replace("\x1b[K", "").strip()[9:])
        assert shown == (told if terminal and times == long else [""] * 4)
    words = {0.2: "1 s", 45: "45 s", 170: "3 min", 8000: "2 h", 1e6: "278 h"}
    assert all(banner.about(seconds) == f"about {text}" for seconds, text in words.items())


@posix
def test_the_command_that_shows_a_recording_works_as_pasted(tmp_path, monkeypatch):
    """With whichever python ran, and where there is no display, by opening a browser."""
    pytest.importorskip("rerun", reason="the viewer: pip install -e .")
    c.main(["--smoke", "--no-picture", "--stabilization", "none", "--out", str(tmp_path / "a b")])
    monkeypatch.chdir(Path(sys.executable).parents[2])
    monkeypatch.setenv("DISPLAY", ":0")
    window = publish.look(tmp_path / "a b" / publish.RECORDING)
    assert not window.startswith("/") and "--web-viewer" not in window
    assert subprocess.run(f"{window} --version", shell=True, capture_output=True).returncode == 0
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    opened = tmp_path / "opened"
    monkeypatch.setenv("BROWSER", str(browser := tmp_path / "browser"))
    browser.write_text(f"#!/bin/sh\necho $1 > {opened}\n")
    browser.chmod(0o700)
    # the usual ports may be taken; and rerun has a child, which outlives it: end the whole group
    command = f"{publish.look(tmp_path / 'a b' / publish.RECORDING)} --port 0 --web-viewer-port 0"
    viewer = subprocess.Popen(
        command, shell=True, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        end = time.monotonic() + 30.0
        while time.monotonic() < end and viewer.poll() is None and not opened.exists():
            time.sleep(0.1)
    finally:
        os.killpg(viewer.pid, signal.SIGKILL)
        viewer.wait()
    assert opened.read_text().startswith("http://")
