"""What every chapter shares: commands in consoles of all kinds, and files, whatever ends a run."""

import io
import math
import signal
import subprocess
import sys
import tempfile

import numpy as np
import pytest
from conftest import ROOT, UNIX, contents, python

from curriculum.common import cli, files, words
from curriculum.common.exact import cos, sin

CONSOLE = """
import runpy, signal, sys, threading, warnings, numpy

class Lines:  # as editors and notebooks have: it can be written to, and no more
    def __init__(self):
        self.text = ""
    def write(self, text):
        self.text += text

def state():
    return len(warnings.filters), *map(signal.getsignal, (signal.SIGTERM, signal.SIGPIPE))

before, usual, lines = state(), (sys.stdout, sys.stderr), Lines()
_, name, *sys.argv[1:] = sys.argv
sys.stdout, sys.stderr = lines, lines
thread = threading.Thread(target=runpy.run_path, args=[name], kwargs={"run_name": "__main__"})
thread.run() if THREAD == "main" else (thread.start(), thread.join())
sys.stdout, sys.stderr = usual
print(before == state(), lines.text)
"""


@UNIX
@pytest.mark.parametrize("thread", ["main", "another"])
def test_a_script_runs_in_a_console_whose_streams_only_write_and_goes_on(thread, tmp_path):
    code = CONSOLE.replace("THREAD", repr(thread))
    flags = "--smoke", "--no-rerun", "--no-page", f"--out={tmp_path}"
    done = python("-c", code, "constraints.py", *flags)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("True ch3.4") and "metrics.json\n" in done.stdout


SLOW = """
from curriculum.common import cli, files
from pathlib import Path
import sys
class Slow(str):
    def encode(self):
        print(flush=True)
        sys.stdin.read()
cli.run_script(lambda: files.write_together(Path(sys.argv[1]), {"first": b"1", "second": Slow()}))
"""


@UNIX
@pytest.mark.parametrize("ends", ["SIGTERM", "SIGHUP"])
def test_a_signal_while_files_are_written_leaves_nothing_behind(ends, tmp_path):
    ends = getattr(signal, ends)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command = [sys.executable, "-c", SLOW, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, **pipes) as process:
        process.stdout.readline()
        assert len([*tmp_path.iterdir()]) == 1  # where they are written aside
        process.send_signal(ends)
        process.wait(60)
        assert process.stderr.read() == b""
    assert process.returncode == 128 + ends and not [*tmp_path.iterdir()]


def test_ctrl_c_while_files_are_renamed_waits_for_the_last(tmp_path, monkeypatch):
    heed = signal.signal(signal.SIGINT, signal.default_int_handler)  # it may be ignored
    monkeypatch.setattr(tempfile, "tempdir", "/nowhere")  # which may be another file system
    files.write_together(tmp_path, {"a": "old", "c": "old"})

    def interrupted(*paths):
        monkeypatch.undo()  # once is enough
        signal.raise_signal(signal.SIGINT)
        files.Path.replace(*paths)

    monkeypatch.setattr(files.Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.write_together(tmp_path, {"a": "new", "b": "new", "c": None})
    signal.signal(signal.SIGINT, heed)
    assert contents(tmp_path) == {"a": b"new", "b": b"new"}


@pytest.mark.parametrize("is_terminal", [True, False])
def test_progress_is_shown_on_a_terminal_only_and_is_gone_afterwards(is_terminal, monkeypatch):
    screen = io.StringIO()
    screen.isatty = lambda: is_terminal
    for name in ("stderr", "__stderr__"):
        monkeypatch.setattr(sys, name, screen)
    monkeypatch.setattr(cli, "SOON", -1.0)
    assert [*cli.progress(["a", "b"])] == ["a", "b"]
    clear = "\033[K\r"
    assert screen.getvalue() == (f"a{clear}b{clear}{clear}" if is_terminal else "")


SAID = [  # what says a number, the number, and what it says
    (words.length, 9.9e-13, "< 1 pm"),
    (words.length, 4.56e-10, "460 pm"),
    (words.length, 2.34e-8, "23 nm"),
    (words.length, 9.94e-4, "990 µm"),
    (words.length, 9.96e-4, "1 mm"),
    (words.length, 0.384, "38 cm"),
    (words.length, 123.4, "120 m"),
    (words.tolerance, 0.00125, "1.25 mm"),
    (words.milliseconds, 0.0003125, "0.312 ms"),
    (words.milliseconds, 0.04, "40 ms"),
    (words.per_cent, 0.384, "38 %"),
    (words.per_cent, 2.44e-5, "0.0024 %"),
    (words.amount, 149_321.0, "149,000"),
    (words.amount, 0.33123, "0.331"),
    (words.amount, 99.96, "100"),
    (words.sentence, "why not", "Why not."),
]


@pytest.mark.parametrize(("say", "x", "said"), SAID)
def test_numbers_have_their_digits_and_the_unit_in_which_they_are_short(say, x, said):
    assert say(x) == said


def test_cos_and_sin_are_right_to_the_last_digit():
    for angle in np.random.default_rng(0).uniform(-10.0, 10.0, 300):
        assert abs(cos(angle) - math.cos(angle)) <= math.ulp(math.cos(angle))
        assert abs(sin(angle) - math.sin(angle)) <= math.ulp(math.sin(angle))
    assert (cos(0.0), sin(0.0)) == (1.0, 0.0)
