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
VALUES = {  # a space between two of them
    "--dt": "0 -1 nan inf abc 1e-320 1e308",
    "--steps": "0 -5 1.5 1e3 \u0663 1_000 0x10 999999999999999999999999",
    "--seed": "-1 x --",
    "--baumgarte": "-1 nan 1e300 1e-400",
    "--time-constant": "0 1e-320 1e308",
    "--impedance": "0 1 2 1e-320",
    "--links": "0 99999999999 --",
    "--system": "nosuch two\nlines --",
    "--integrator": "nosuch --",
    "--stabilization": "nosuch",
    "--device": "gpu",
}
FLAGS = {  # and what the line must repeat
    "--nosuch 1": "--nosuch 1",
    "--no\nsuch 1": r"--no\nsuch 1",
    "--integ rk4": "--integ rk4",
    "--stabilization impulse --integrator rk4": "impulse rk4 q + dt (v + dt a) semi_implicit",
    "--stabilization impulse --integrator euler": "impulse euler",
    "--tol 0.001": "--tol 0.001 --integrator gauss",
    "--tol 0.001 --integrator rk4": "--tol 0.001 --integrator gauss",
    "--integrator RK4": "mean rk4?",
    "--SYSTEM double": "mean --system?",
    "--system Triple": "mean 'triple'?",
}


def program(*words, before=None, **settings):
    """A process of its own that runs constraints.py, or python with `words` that begin with -c."""
    command = [sys.executable, *([] if words[0] == "-c" else [c.__file__]), *map(str, words)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 60}
    return subprocess.run(command, preexec_fn=before, **{"cwd": c.HERE} | pipes | settings)


def script(lines, before=None):
    """What a process of its own says whose main is `lines`."""
    body = "".join(f"    {line}\n" for line in lines.splitlines())
    start = "import os, signal, sys, numpy\nfrom curriculum.common.cli import run_script\n"
    return program("-c", f"{start}def main():\n{body}run_script(main)", before=before)


def refusal(capsys, *words):
    """The one line with which main refuses `words`; no folder can be written: that comes last."""
    with pytest.raises(SystemExit) as end:
        c.main(["--out", "/dev/null/below", *map(str, words)])
    printed, line = capsys.readouterr()
    assert (end.value.code, printed) == (2, "")
    assert re.fullmatch(r"constraints\.py: error: [^\n]{1,400}\n", line)
    return line


@pytest.mark.parametrize(
    ("flag", "value"), [(flag, x) for flag, values in VALUES.items() for x in values.split(" ")]
)
def test_a_bad_value_is_one_line_with_flag_and_value(flag, value, capsys):
    line = refusal(capsys, f"{flag}={value}")
    assert f"argument {flag}: " in line and repr(value) in line


@pytest.mark.parametrize(("flags", "repeated"), FLAGS.items())
def test_a_bad_flag_or_combination_is_one_line_that_repeats_it(flags, repeated, capsys):
    line = refusal(capsys, *flags.split(" "))
    assert all(word in line for word in repeated.split(" "))


def test_where_results_cannot_go_is_said_before_the_run(tmp_path, capsys):
    (tmp_path / "constraints.rrd").mkdir()
    for out in (tmp_path, tmp_path / "constraints.rrd" / ("x" * 5000), "/dev/null", ""):
        line = refusal(capsys, *SHORT, "--out", out)
        assert f"argument --out: cannot write to {str(out)[:60]!r}"[:-1] in line
    assert c.main(["--show-step", "--system", "pendulum", "--out", "/dev/null/below"]) == 0


def test_scenes_are_listed_a_line_each(capsys):
    with pytest.raises(SystemExit, match="0"):
        c.main(["--scenes"])
    lines = capsys.readouterr().out.splitlines()
    files = {path.stem for path in (c.HERE / c.CHAPTER / "scenes").glob("*.json")}
    assert {line.split()[0] for line in lines} == files | {*c.SYSTEMS, "chain"}
    assert all(len(line.split()) > 3 and len(line) <= 80 for line in lines)


def test_help_is_a_screenful_in_groups_and_ends_by_naming_the_studies(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit, match="0"):
        c.main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40 and max(map(len, lines)) <= 80
    assert {"which system:", "which method:", "results:", "for CI:"} <= set(lines)
    studies = {path.stem for path in (c.HERE / c.CHAPTER / "studies").glob("[!_]*.py")}
    assert {"benchmark"} < studies <= set(re.findall(r"\w+", "".join(lines[-4:])))


def test_importing_does_nothing_and_a_run_without_a_recording_never_imports_rerun(tmp_path):
    code = f"import sys; sys.path.insert(0, {str(c.HERE)!r}); import constraints as c"
    for work in ("", "; c.main(sys.argv[1:])"):
        done = program(
            "-c", f"{code}{work}; assert 'rerun' not in sys.modules", *SHORT, cwd=tmp_path
        )
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


@pytest.mark.parametrize(
    ("error", "line"),
    [
        ("MemoryError", "-c: error: not enough memory; ask for fewer rods, members or steps"),
        ("OSError(28, 'Full', 'a.json')", "-c: error: Full: a.json"),
        ("BrokenPipeError", ""),
        ("SystemExit('so be it')", "so be it"),
        ("ImportError", None),
    ],
)
def test_an_end_to_be_expected_is_one_line(error, line):
    done = script(f"raise {error}")
    assert (done.stderr.strip() == line) if line is not None else "Traceback" in done.stderr
    assert done.returncode == 1


def test_a_missing_package_is_one_line_that_names_what_brings_it():
    extras = tomllib.loads((c.HERE / "pyproject.toml").read_text())["project"]
    known = {"": extras["dependencies"], **extras["optional-dependencies"]}
    for package, extra in cli.EXTRAS.items():
        assert any(x.startswith(package) for x in known.get(extra.strip("[]"), [package]))
        done = script(f"sys.modules[{package!r}] = None\nimport {package}")
        assert done.stderr == f"-c: error: {package} is not installed: pip install -e '.{extra}'\n"
    bare = {"env": os.environ | {"PYTHONPATH": ""}, "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "-S", c.__file__], **bare)
    assert done.returncode == 1 and re.fullmatch("numpy is not installed: [^\n]+\n", done.stderr)


@posix
def test_a_run_that_is_interrupted_or_outgrows_memory_leaves_nothing(tmp_path):
    import resource

    command = [sys.executable, "-u", c.__file__, "--steps", "1000000000", "--out", tmp_path / "x"]
    # a job in the background is born ignoring the signal
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipe = subprocess.PIPE
    with subprocess.Popen(command, preexec_fn=heed, stdout=pipe, stderr=pipe, text=True) as process:
        process.stdout.readline()  # imports done, main at work
        process.send_signal(signal.SIGINT)
        _, said = process.communicate()
    assert process.returncode and re.fullmatch(r"\n?constraints\.py: interrupted[^\n]*\n", said)
    little = partial(resource.setrlimit, resource.RLIMIT_AS, (4 << 30, 4 << 30))
    done = program("--steps", 10**9, "--no-rerun", "--out", tmp_path / "x", before=little)
    assert "not enough memory" in done.stderr and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@posix
def test_a_hangup_ends_a_program_but_not_under_nohup():
    for how, status in ((signal.SIG_DFL, 128 + signal.SIGHUP), (signal.SIG_IGN, 0)):
        heed = partial(signal.signal, signal.SIGHUP, how)
        assert script("os.kill(os.getpid(), signal.SIGHUP)", heed).returncode == status


@posix
@pytest.mark.parametrize("python", [[], ["-u"]], ids=["buffered", "unbuffered"])
def test_a_reader_that_has_seen_enough_is_no_error(python, tmp_path):
    """As `| head -0` does: standard output is closed before anything is printed."""
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, *python, c.__file__, *SHORT, "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=c.HERE, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert done.stderr == b"" and done.returncode == 1


@posix
def test_a_full_or_closed_or_narrow_terminal(tmp_path):
    with open("/dev/full", "w") as full:
        done = program(*SHORT, "--out", tmp_path, stdout=full)
    assert (done.returncode, done.stderr) == (1, "constraints.py: error: No space left on device\n")
    for closed in ((1,), (0, 1, 2)):
        shut = partial(lambda closed: [os.close(k) for k in closed], closed)
        done = program(*SHORT, "--out", tmp_path, before=shut)
        assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    narrow = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = program(*SHORT, "--out", tmp_path / "\u00e4", env=narrow)
    assert done.returncode == 0 and done.stdout.rstrip().endswith("\\xe4/metrics.json")
    # or what a library writes to a closed stream would be in a file that took its number
    assert script("numpy.ones(1) / 0.0").stderr == ""  # a warning of numpy's is for nobody
    done = script("return os.open(os.devnull, 0)", lambda: [os.close(k) for k in range(3)])
    assert done.returncode > 2


# --- the banner, and what takes long ---
def test_only_a_default_run_begins_with_how_long_one_took(tmp_path, capsys):
    for flags, told in (([], True), (["--seed", "1"], False), (["--smoke"], False)):
        _, _, usual = c.parse([*flags, "--out", str(tmp_path)])
        line = banner.banner("ch3.4", "constraints", "cpu", usual)
        assert bool(re.search(r"a default run took [\d.]+ s, \d{4}-", line)) == told
        assert line.startswith("ch3.4 constraints | device cpu") and len(line) <= 80
    c.main([*SHORT, "--out", str(tmp_path)])
    assert capsys.readouterr().out.splitlines()[0] == "ch3.4 constraints | device cpu"


@pytest.fixture
def shown(monkeypatch, capsys):
    """shown(names, times): what a terminal shows, part by part, after half of it and after it."""

    def of(names, *times):
        clock = iter(times)
        monkeypatch.setattr(banner, "time", SimpleNamespace(monotonic=clock.__next__))
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        for _ in banner.in_parts(names):
            tick = banner.progress("swinging", 1000)
            for step in (500, 1000):
                tick(step)
                yield capsys.readouterr().err.replace("\x1b[K", "").strip()

    return of


def test_progress_is_told_of_all_parts_by_name(shown):
    told = [
        "swinging soft: 25% of all, about 15 s left",
        "",
        "swinging none: 75% of all, about 7 s left",
        "",
    ]
    assert list(shown(["soft", "none"], 0.0, 5.0, 10.0, 20.0, 30.0)) == told


def test_what_is_short_or_has_hardly_begun_or_is_no_terminal_shows_no_progress(
    shown, capsys, monkeypatch
):
    assert list(shown(["soft", "none"], 0.0, 0.1, 0.4, 1.0, 1.5)) == [""] * 4
    monkeypatch.setattr(sys.stderr, "isatty", lambda: False, raising=False)
    banner.progress("swinging", 1000)(500)
    assert capsys.readouterr().err == ""


def test_an_estimate_has_no_false_digits():
    words = {0.2: "1 s", 45: "45 s", 170: "3 min", 8000: "2 h", 1e6: "278 h"}
    assert all(banner.about(seconds) == f"about {text}" for seconds, text in words.items())


@posix
def test_the_command_that_shows_a_recording_works_as_pasted(tmp_path, monkeypatch):
    """With whichever python ran, and where there is no display, by opening a browser."""
    pytest.importorskip("rerun", reason="the viewer: pip install -e .")
    c.main(["--smoke", "--out", str(tmp_path / "a b")])
    monkeypatch.chdir(Path(sys.executable).parents[2])
    monkeypatch.setenv("DISPLAY", ":0")
    window = publish.look(tmp_path / "a b" / publish.RECORDING)
    assert not window.startswith("/") and "--web-viewer" not in window
    assert subprocess.run(f"{window} --version", shell=True, capture_output=True).returncode == 0
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    opened = tmp_path / "opened"
    (tmp_path / "browser").write_text(f"#!/bin/sh\necho $1 > {opened}\n")
    (tmp_path / "browser").chmod(0o700)
    monkeypatch.setenv("BROWSER", str(tmp_path / "browser"))
    ports = "exec {} --port 0 --web-viewer-port 0"  # the usual ones may be taken
    command = ports.format(publish.look(tmp_path / "a b" / publish.RECORDING))
    with subprocess.Popen(command, shell=True, stderr=subprocess.DEVNULL) as viewer:
        end = time.monotonic() + 30.0
        while time.monotonic() < end and viewer.poll() is None and not opened.exists():
            time.sleep(0.1)
        viewer.terminate()
    assert opened.read_text().startswith("http://")
