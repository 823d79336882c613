"""The command line: mistakes answered by one line, results whole or not at all, and no work that
was not asked for."""

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import constraints
from curriculum.common import banner as device
from curriculum.common.files import write_json, write_whole

import pytest

VALUES = {  # a space between two of them
    "--dt": "0 -1 nan inf abc 1e-320 1e308",
    "--steps": "0 -5 1.5 999999999999999999999999",
    "--seed": "-1 x",
    "--baumgarte": "-1 nan 1e300",
    "--time-constant": "0 1e-320 1e308",
    "--impedance": "0 1 2 1e-320",
    "--links": "0 99999999999",
    "--system": "nosuch two\nlines",
    "--integrator": "nosuch",
    "--stabilization": "nosuch",
    "--device": "gpu",
}
FLAGS = {  # and what the line must repeat
    "--nosuch 1": "--nosuch 1",
    "--no\nsuch 1": r"--no\nsuch 1",
    "--integ rk4": "--integ rk4",
    "--stabilization impulse --integrator rk4": "--stabilization impulse rk4",
    "--stabilization impulse --integrator euler": "--stabilization impulse euler",
    "--tol 0.001": "--tol 0.001 --integrator gauss",
    "--tol 0.001 --integrator rk4": "--tol 0.001 --integrator gauss",
}
TOO_FINE = [
    "--links 40 --system chain",
    "--system heavy_tip",
]  # where the ruler ends: too many rods, too hard


@pytest.fixture
def out(tmp_path):
    """A folder that holds the results of an earlier run, and nothing else before and after."""
    results = tmp_path / "out" / "metrics.json"
    results.parent.mkdir()
    results.write_text("as it was")
    yield results.parent
    assert set(tmp_path.rglob("*")) == {results.parent, results}
    assert results.read_text() == "as it was"


def refusal(capsys, *flags):
    """The one line with which main refuses `flags`."""
    with pytest.raises(SystemExit) as stop:
        constraints.main([str(flag) for flag in flags])
    printed, line = capsys.readouterr()
    assert (stop.value.code, printed) == (2, "")
    assert re.fullmatch(r"constraints\.py: error: [^\n]+\n", line)
    return line


@pytest.mark.parametrize(
    ("flag", "value"), [(flag, x) for flag, values in VALUES.items() for x in values.split(" ")]
)
def test_a_bad_value_is_one_line_with_flag_and_value(flag, value, out, capsys):
    line = refusal(capsys, "--out", out, flag, value)
    assert f"argument {flag}: " in line
    assert repr(value) in line


@pytest.mark.parametrize(("flags", "repeated"), FLAGS.items())
def test_a_bad_flag_or_combination_is_one_line_that_repeats_it(flags, repeated, out, capsys):
    line = refusal(capsys, "--out", out, *flags.split(" "))
    assert all(word in line for word in repeated.split(" "))


def test_an_out_that_cannot_be_a_folder(out, capsys):
    for path in (out / "metrics.json", out / "metrics.json" / "below"):
        assert f"--out: cannot write into '{path}'" in refusal(capsys, "--out", path)


@pytest.mark.parametrize("name", ["metrics.json", "constraints.rrd"])
def test_a_folder_where_a_result_should_go(name, tmp_path, capsys):
    (tmp_path / name).mkdir()
    assert f"--out: cannot write into '{tmp_path}': {name} is a folder" in refusal(
        capsys, "--out", tmp_path
    )
    assert [path.name for path in tmp_path.rglob("*")] == [name]


@pytest.mark.parametrize("flags", TOO_FINE)
def test_a_tolerance_that_nobody_could_judge_is_refused(flags, out):
    command = [
        sys.executable,
        constraints.__file__,
        "--integrator",
        "gauss",
        "--tol",
        "0.001",
        "--steps",
        "400",
    ]
    command += [*flags.split(), "--out", str(out)]
    done = subprocess.run(command, cwd=constraints.HERE, capture_output=True, text=True)
    assert re.fullmatch(r"[^\n]*error: argument --tol: [^\n]* 0\.001 m[^\n]*\n", done.stderr)
    assert done.returncode == 2


def results(capsys, folder, *flags):
    """The lines that main prints and the results that it writes, which must be JSON without NaN and
    Infinity."""
    assert constraints.main(["--no-rerun", "--out", str(folder), *flags]) == 0
    content = json.loads(
        (folder / "metrics.json").read_text(), parse_constant=lambda name: pytest.fail(name)
    )
    return capsys.readouterr().out.splitlines(), content["results"]


def test_a_run_that_diverges_says_where_and_why(tmp_path, capsys):
    lines, content = results(capsys, tmp_path, "--dt", "0.05", "--baumgarte", "40")
    assert any(line.startswith("baumgarte* ") for line in lines)
    (line,) = (line for line in lines if line.startswith("* baumgarte "))
    assert re.fullmatch(r"diverged at step [1-9]\d?", content["baumgarte"]["stopped"])
    assert content["baumgarte"]["stopped"] in line
    assert any("dt*omega 2 is past the limit 0.828" in line for line in lines)


@pytest.mark.parametrize("integrator", constraints.INTEGRATORS)
def test_a_hopeless_step_still_gives_results(integrator, tmp_path, capsys):
    lines, content = results(
        capsys, tmp_path, "--dt", "100", "--steps", "10", "--integrator", integrator
    )
    for mode, row in content.items():
        told = [
            line
            for line in lines
            if line.startswith(f"* {mode} ") and line.endswith(str(row["stopped"]))
        ]
        assert len(told) == (row["stopped"] is not None)
    assert content["none"]["stopped"] and content["baumgarte"]["stopped"]


@pytest.mark.skipif(os.name == "nt", reason="an interrupt is no signal there")
def test_an_interrupted_run_leaves_nothing(out):
    command = [
        sys.executable,
        "-u",
        constraints.__file__,
        "--steps",
        "1000000000",
        "--out",
        str(out),
    ]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    heed = partial(
        signal.signal, signal.SIGINT, signal.SIG_DFL
    )  # a job in the background is born ignoring it
    with subprocess.Popen(command, cwd=constraints.HERE, preexec_fn=heed, **pipes) as process:
        process.stdout.readline()  # imports done, main at work
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert process.returncode
    assert re.fullmatch(r"\n?constraints\.py: interrupted[^\n]*\n", err)


def test_an_interrupted_write_leaves_the_file_as_it_was(out):
    def half(temporary):
        temporary.write_text("half of the resu")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_whole(out / "metrics.json", half)


@pytest.mark.skipif(os.name == "nt", reason="an open file cannot be replaced there")
def test_who_reads_the_metrics_sees_the_old_or_the_new_ones(tmp_path, capsys):
    constraints.main(["--no-rerun", "--steps", "1", "--out", str(tmp_path)])
    with open(tmp_path / "metrics.json") as reader:
        old = (tmp_path / "metrics.json").read_text()
        constraints.main(["--no-rerun", "--steps", "2", "--out", str(tmp_path)])
        assert reader.read() == old != (tmp_path / "metrics.json").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


@pytest.mark.skipif(os.name == "nt", reason="a closed pipe is another error there")
@pytest.mark.parametrize("python", [["python"], ["python", "-u"]], ids=["buffered", "unbuffered"])
def test_a_reader_that_has_seen_enough_is_no_error(python, tmp_path):
    """As `| head -0` does: the other end of standard output is closed before anything is
    printed."""
    read, write = os.pipe()
    os.close(read)
    command = [
        sys.executable,
        *python[1:],
        constraints.__file__,
        "--smoke",
        "--no-rerun",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, cwd=constraints.HERE, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert done.stderr == b"" and done.returncode == 1


def test_nothing_that_is_no_json_is_written(out):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(out / "metrics.json", {"error": float("nan")})


def test_help_ends_by_naming_the_studies(capsys):
    with pytest.raises(SystemExit, match="0"):
        constraints.main(["--help"])
    ending = capsys.readouterr().out.split("\n\n")[-1]
    studies = {
        path.stem for path in (constraints.HERE / constraints.CHAPTER / "studies").glob("[!_]*.py")
    }
    assert {"benchmark"} < studies <= set(re.findall(r"\w+", ending))


def test_importing_does_nothing(tmp_path):
    code = "import constraints, sys; assert not {'rerun', 'pyarrow'} & set(sys.modules)"
    environment = os.environ | {"PYTHONPATH": str(constraints.HERE)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert not list(tmp_path.iterdir())


def test_without_a_recording_rerun_is_never_imported(tmp_path):
    code = "import constraints, sys; constraints.main(sys.argv[1:]); assert not {'rerun', 'pyarrow'} & set(sys.modules)"
    command = [sys.executable, "-c", code, "--smoke", "--no-rerun", "--out", str(tmp_path)]
    subprocess.run(command, cwd=constraints.HERE, check=True)
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


def test_a_run_begins_with_the_banner(tmp_path, capsys):
    lines, _ = results(capsys, tmp_path, "--smoke")
    assert lines[0] == device.banner("ch3.4", "constraints", "cpu")


@pytest.mark.parametrize("terminal", [False, True])
def test_only_a_terminal_sees_progress(terminal, tmp_path, monkeypatch, capsys):
    ticks = itertools.count(
        step=10.0
    )  # a clock on which every block takes long enough to be told of
    monkeypatch.setattr(device, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    constraints.main(
        ["--steps", "40000", "--stabilization", "none", "--no-rerun", "--out", str(tmp_path)]
    )
    out, err = capsys.readouterr()
    assert "\r" not in out
    assert ("\r" in err) == terminal
    assert bool(err) == terminal
