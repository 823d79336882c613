"""The command line: mistakes answered by one line, results whole or not at all, and no work that was not asked for."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial

import pytest

import constraints
from curriculum.common.files import write_whole

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
FLAGS = ["--nosuch 1", "--no\nsuch 1", "--integ rk4", "--stabilization impulse --integrator rk4"]


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


@pytest.mark.parametrize(("flag", "value"), [(flag, x) for flag, values in VALUES.items() for x in values.split(" ")])
def test_a_bad_value_is_one_line_with_flag_and_value(flag, value, out, capsys):
    line = refusal(capsys, "--out", out, flag, value)
    assert f"argument {flag}: " in line
    assert repr(value) in line


@pytest.mark.parametrize("flags", FLAGS)
def test_a_bad_flag_or_combination_is_one_line_that_repeats_it(flags, out, capsys):
    line = refusal(capsys, "--out", out, *flags.split(" "))
    assert all(word.replace("\n", r"\n") in line for word in flags.split(" "))


def test_an_out_that_cannot_be_a_folder(out, capsys):
    for path in (out / "metrics.json", out / "metrics.json" / "below"):
        assert f"--out: cannot write into '{path}'" in refusal(capsys, "--out", path)


@pytest.mark.parametrize("name", ["metrics.json", "constraints.rrd"])
def test_a_folder_where_a_result_should_go(name, tmp_path, capsys):
    (tmp_path / name).mkdir()
    assert f"--out: cannot write into '{tmp_path}': {name} is a folder" in refusal(capsys, "--out", tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == [name]


def results(capsys, folder, *flags):
    """The lines that main prints and the results that it writes, which must be JSON without NaN and Infinity."""
    assert constraints.main(["--no-rerun", "--out", str(folder), *flags]) == 0
    content = json.loads((folder / "metrics.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    return capsys.readouterr().out.splitlines(), content["results"]


def test_a_run_that_diverges_says_where_and_why(tmp_path, capsys):
    lines, content = results(capsys, tmp_path, "--dt", "0.05", "--baumgarte", "40")
    (line,) = (line for line in lines if line.startswith("baumgarte diverged"))
    assert re.match(r"baumgarte diverged at step [1-9]\d{,2}: dt\*omega = 2 .* limit of 0\.83 ", line)
    assert line.startswith(f"baumgarte {content['baumgarte']['stopped']}: ")


@pytest.mark.parametrize("integrator", constraints.INTEGRATORS)
def test_a_hopeless_step_still_gives_results(integrator, tmp_path, capsys):
    lines, content = results(capsys, tmp_path, "--dt", "10", "--integrator", integrator)
    assert any(line.startswith(f"none {content['none']['stopped']}") for line in lines)


@pytest.mark.skipif(os.name == "nt", reason="an interrupt is no signal there")
def test_an_interrupted_run_leaves_nothing(out):
    command = [sys.executable, "-u", constraints.__file__, "--steps", "1000000000", "--out", str(out)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a job in the background is born ignoring it
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


def test_help_ends_by_naming_the_studies(capsys):
    with pytest.raises(SystemExit, match="0"):
        constraints.main(["--help"])
    ending = capsys.readouterr().out.split("\n\n")[-1]
    studies = {path.stem for path in (constraints.HERE / constraints.CHAPTER / "studies").glob("[!_]*.py")}
    assert {"benchmark"} < studies <= set(re.findall(r"\w+", ending))


def test_importing_does_nothing(tmp_path):
    code = "import constraints, sys; assert not {'rerun', 'pyarrow'} & set(sys.modules)"
    environment = os.environ | {"PYTHONPATH": str(constraints.HERE)}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert not list(tmp_path.iterdir())


def test_without_a_recording_rerun_is_never_imported(tmp_path):
    code = "import constraints, sys; constraints.main(sys.argv[1:]); assert not {'rerun', 'pyarrow'} & set(sys.modules)"
    command = [sys.executable, "-c", code, "--smoke", "--no-rerun", "--out", str(tmp_path)]
    subprocess.run(command, cwd=constraints.HERE, check=True)
    assert [path.name for path in tmp_path.iterdir()] == ["metrics.json"]


def test_the_table_has_a_row_a_mode_and_a_verdict(tmp_path, capsys):
    lines, content = results(capsys, tmp_path)
    first, modes = [line.partition(" ")[0] for line in lines], list(constraints.hold_table())
    assert first[first.index("mode") + 1 :][: len(modes) + 1] == [*modes, ""]
    assert list(content) == sorted(modes)
    assert "as expected" in lines[first.index("verdict:")]
