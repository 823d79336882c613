"""What every chapter shares: commands in consoles of all kinds, and files, whatever ends a run."""

import math
import signal
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT, UNIX, python

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


def test_a_folder_too_deep_to_be_made_is_refused_in_a_line(refused):
    assert "at most 100 folders deep" in refused("--out", "a/" * 1990)


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
def test_sigterm_while_files_are_written_leaves_nothing_behind(tmp_path):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command = [sys.executable, "-c", SLOW, str(tmp_path)]
    with subprocess.Popen(command, cwd=ROOT, **pipes) as process:
        process.stdout.readline()
        assert len([*tmp_path.iterdir()]) == 1  # where they are written aside
        process.send_signal(signal.SIGTERM)
        process.wait(60)
        assert process.stderr.read() == b""
    assert process.returncode == 128 + signal.SIGTERM and not [*tmp_path.iterdir()]


def test_cos_and_sin_are_right_to_the_last_digit():
    for angle in np.random.default_rng(0).uniform(-10.0, 10.0, 300):
        assert abs(cos(angle) - math.cos(angle)) <= math.ulp(math.cos(angle))
        assert abs(sin(angle) - math.sin(angle)) <= math.ulp(math.sin(angle))
    assert (cos(0.0), sin(0.0)) == (1.0, 0.0)
