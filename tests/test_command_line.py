"""The command line: a mistake is one line; whatever ends a run, nothing is lost."""

import json
import re
import signal
import subprocess
import sys
import tomllib
from functools import partial

import pytest
from conftest import ROOT, UNIX, python

import constraints as c
from curriculum.ch3_4_constraints.report.files import METRICS
from curriculum.ch3_4_constraints.rods import scenes
from curriculum.common import cli
from curriculum.common.errors import Refused

WRONG = {  # flags: what the line names
    "--dt nan": ("--dt", "'nan'"),
    "--dt 5km": ("--dt", "'5km'"),
    "--steps 2.5": ("--steps", "'2.5'", "whole"),
    "--steps 0": ("--steps", "'0'"),
    "--baumgarte -1": ("--baumgarte", "'-1'"),
    "--time-constant 0": ("--time-constant", "'0'"),
    "--links 301": ("--links", "'301'", "300"),
    "--out=": ("--out", "''"),
    "--out=a\udcff": ("--out", r"'a\udcff'"),
    f"--out={1990 * 'a/'}": ("--out", "100"),
    "--system=\x1b[31m": ("--system", r"'\x1b[31m'"),
    "--sys double": ("--sys",),
    "--system doubel": ("--system", "'doubel'", "'double'"),
    "--integrator rk4 --stabilization impulse": ("impulse", "semi_implicit", "rk4"),
    "--stabilization nothing": ("--stabilization", "'nothing'", "'project'"),
}


for text in ["1foot", "mm", "", "0", "-1mm", "nan", "1e9", "0.1pm", "1mmm"]:
    WRONG[f"--within={text}"] = "--within", repr(text)


@pytest.mark.parametrize("flags", WRONG, ids=lambda flags: flags[:30].encode("unicode_escape"))
def test_a_wrong_flag_is_one_line_that_names_flag_value_and_what_is_allowed(flags, refused):
    said = refused(*flags.split())
    assert all(word in said for word in WRONG[flags])


SIZES = {  # what is typed for metres or for seconds, and how many they are
    cli.length: {"0.5mm": 5e-4, "1um": 1e-6, "1µm": 1e-6, "1\N{GREEK SMALL LETTER MU}m": 1e-6},
    cli.seconds: {"5ms": 0.005, "200us": 2e-4, "0.01 s": 0.01, "1e-3": 1e-3},
}
SIZES[cli.length] |= {"2cm": 0.02, "2 cm": 0.02, "3nm": 3e-9, "1m": 1.0, "0.001": 1e-3}


@pytest.mark.parametrize("parse", SIZES)
def test_a_size_has_a_unit_or_is_a_number_of_metres_or_seconds(parse, tmp_path):
    for text, size in SIZES[parse].items():
        assert parse(text) == size
    asked = c.parse_args(["--within=0.5mm", "--dt=200us", f"--out={tmp_path}"])
    assert (asked.within, asked.dt) == (5e-4, 2e-4)


CHANGED = [  # a command line, its flags that are changed, and the new one
    ("--seed 3 --out a --within 1mm", {"--dt": "0.01"}, "--seed 3 --dt 0.01"),
    ("--dt=1 --smoke --plain", {"--steps": "9", "--dt": "2"}, "--plain --steps 9 --dt 2"),
    ("--stabilization none --no-page", {}, "--no-page"),
    (
        "--system=a --stabilization none",
        {"--stabilization": "soft"},
        "--system=a --stabilization soft",
    ),
]


@pytest.mark.parametrize(("flags", "changes", "expected"), CHANGED)
def test_a_command_that_is_to_be_pasted_has_the_flags_that_are_not_changed(
    flags, changes, expected, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").write_text(scenes.SHIPPED["spin"].read_text())
    flags = flags.replace("--out a", "--out=out")
    command = c.parse_args(flags.split()).command(changes)
    assert command.partition(" --")[2] == expected[2:]


def test_as_many_steps_as_are_said_to_fit_do_and_one_more_does_not(refused, tmp_path):
    said = refused("--steps", 10**9)
    fit = int(re.search(r"1000000000 steps take more than 4 GB; (\d+) fit", said)[1])
    c.parse_args(["--steps", str(fit), "--out", str(tmp_path)])
    assert f"{fit + 1} steps take more than 4 GB; {fit} fit" in refused("--steps", fit + 1)
    state = 2 * 3 * 8 * 2  # bytes: q and v of a particle
    assert fit == 4e9 // (state * 2 * len(c.make_methods()))  # of the double


def test_help_and_the_error_of_a_wrong_name_list_all_systems_that_have_one(capsys, refused):
    with pytest.raises(SystemExit, match="0"):
        c.main(["--help"])
    helped = re.split(r"[\s,]+", capsys.readouterr().out)
    said = re.split(r"[\s,]+", refused("--system", "nosuch"))
    names = {*c.CHAINS, "chain", *scenes.SHIPPED}
    assert names <= {*helped} and names <= {*said}


def test_a_wrong_name_from_python_blames_no_flag():
    with pytest.raises(Refused, match="^'doubel': .*'double'"):
        c.build_system("doubel")


def test_the_entry_point_is_the_package_and_its_function_is_there():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    name = project["name"]  # by which uvx and pipx run find it
    assert project["scripts"] == {name: "constraints:command"} and callable(c.command)


@UNIX
def test_runs_leave_no_memory_behind(tmp_path):
    code = """import resource, sys, constraints
def peak(runs):
    for _ in range(runs):
        constraints.main(["--steps=8", "--stabilization=project", "--no-rerun", *sys.argv[1:]])
    unit = 1024 if sys.platform == "darwin" else 1
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // unit  # kB
print(-peak(5) + peak(20))
"""
    done = python("-c", code, "--no-page", "--out", tmp_path)
    assert int(done.stdout.split()[-1]) < 5000 * 20 / 90  # 5 MB in 90 runs


WAYS = "PYTHONIOENCODING=cp1252 {} {}", "{} -OO {}", "{} {} 2>&-", "{} {} >&-"


@UNIX
@pytest.mark.parametrize("way", WAYS)
def test_no_run_is_lost_to_a_letter_that_a_console_lacks_or_to_how_python_is_started(way, tmp_path):
    scene = tmp_path / "Д.json"
    scene.write_bytes(scenes.SHIPPED["spin"].read_bytes())
    command = f"constraints.py --steps 9 --no-rerun --system {scene} --out {tmp_path / 'out'}"
    command = way.format(sys.executable, command)
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    assert len([*(tmp_path / "out").iterdir()]) == 2
    metrics = json.loads((tmp_path / "out" / METRICS).read_bytes())
    assert metrics["system"] == scene.name  # and no folder of this machine


ENDS = [
    "OSError(28, 'no space left')",
    "StepChanged('step 7')",
    "NotAState('(3,)')",
    "Refused('a wish')",
]


@pytest.mark.parametrize("error", ENDS)
def test_what_ends_a_run_is_one_line_and_no_success(error):
    code = f"from curriculum.common.cli import *; run_script(lambda: exec('raise ' + {error!r}))"
    done = python("-c", code)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("error: ")


@pytest.mark.parametrize("flags", ["--dt 1e-12 --steps 10", "--steps 1", "--dt 1e9 --steps 9"])
def test_the_shortest_runs_and_the_longest_steps_are_runs(flags, tmp_path):
    folder = tmp_path / "below" / "another"
    assert c.main([*flags.split(), "--out", str(folder)]) == 0
    assert len([*folder.iterdir()]) == 3


def test_a_readers_mistake_is_a_traceback_that_ends_in_their_line(tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text(
        """import constraints
import numpy as np
def external_force(system, q, v):
    return np.linalg.inv(np.zeros((3, 3)))
constraints.external_force = external_force
constraints.command()
"""
    )
    done = python(mine, "--steps", "20", "--out", tmp_path, variables={"PYTHONPATH": str(ROOT)})
    *_, shown, _, last = [x for x in done.stderr.splitlines() if set(x) - {" ", "^", "~"}]
    assert done.returncode == 1 and last.startswith("numpy.linalg.LinAlgError")
    assert f'File "{mine}"' in shown and "external_force" in shown


@UNIX
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
