"""Files appear whole or not at all, alone or as one set, whatever happens meanwhile."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from unittest import mock

import constraints as c
from curriculum.ch3_4_constraints import publish
from curriculum.common import files

import pytest
from conftest import script

FULL = OSError(28, "No space left on device", "a temporary name")
HALF = """def half(path, content):
    path.write_text("half")
    os.kill(os.getpid(), int(sys.argv[2]))
    while True: pass
files.Path.write_bytes = half
files.write_whole(sys.argv[1], "new")"""
FORTY = """for k in range(40):
    files.write_together(sys.argv[1], dict.fromkeys("abc", f"{sys.argv[2]} {k}"))
    time.sleep(0.001)"""
pytestmark = pytest.mark.skipif(os.name == "nt", reason="no signals, locks or pipes there")


def contents(folder):
    """{name: text} of all that is in a folder."""
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), FULL, ZeroDivisionError()])
def test_a_set_that_cannot_be_finished_leaves_all_as_it_was(error, tmp_path, monkeypatch):
    def half(path, content):
        path.write_text("half")
        if path.name == "b":
            raise error

    (tmp_path / "b").write_text("old")
    monkeypatch.setattr(files.Path, "write_bytes", half)
    with pytest.raises(type(error)) as raised:
        files.write_together(tmp_path, {"a": "new", "b": "new"})
    assert contents(tmp_path) == {"b": "old"}
    assert error is not FULL or raised.value.filename == str(tmp_path / "b")


def test_ctrl_c_between_two_files_of_a_set_waits_for_the_second(tmp_path, monkeypatch):
    def interrupted(*paths, replace=Path.replace):
        signal.raise_signal(signal.SIGINT)
        replace(*paths)

    signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored
    monkeypatch.setattr(files.Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        files.write_together(tmp_path, dict.fromkeys("ab", "new"))
    assert contents(tmp_path) == {"a": "new", "b": "new"}


def test_two_processes_at_once_leave_one_whole_set(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        ended = pool.map(lambda name: script(FORTY, tmp_path, name), ("one", "two"))
        assert [process.returncode for process in ended] == [0, 0]
    found = contents(tmp_path)
    assert sorted(found) == ["a", "b", "c"] and len(set(found.values())) == 1


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGHUP"])
def test_what_a_signal_leaves_half_done_is_gone_after_the_next_write(name, tmp_path):
    number = int(getattr(signal, name))
    heed = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    done = script(HALF, tmp_path / "a", number, preexec_fn=heed)
    assert done.returncode == (-number if name == "SIGKILL" else 128 + number)
    assert len(list(tmp_path.iterdir())) == (name == "SIGKILL")
    files.write_whole(tmp_path / "a", "whole")
    assert contents(tmp_path) == {"a": "whole"}


def test_what_could_not_be_written_later_is_found_out_before_a_run(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nothing")
    told = {"pipe": "pipe is no plain file", "folder": "folder is a folder", "x" * 5000: "too long"}
    told |= {"file/x": "file is no folder", "link/below/x": "link is a link to nothing"}
    for path, why in told.items():
        with pytest.raises(OSError, match=why):
            files.check_writable(tmp_path / path)
    for path in ("file", "not/yet/there"):
        files.check_writable(tmp_path / path)
    with pytest.raises(ValueError, match="not JSON compliant"):
        files.as_json({"error": float("nan")})
    assert {path.name for path in tmp_path.iterdir()} == {"pipe", "folder", "file", "link"}


def test_a_run_leaves_all_its_files_and_none_older(tmp_path, monkeypatch):
    names = publish.METRICS, publish.PICTURE, publish.PAGE, publish.RECORDING
    old = dict.fromkeys(names, "old")
    files.write_together(tmp_path, old)
    monkeypatch.setattr(publish, "record", mock.Mock(return_value=b"new"))
    c.main(["--steps", "2", "--rerun", "--out", str(tmp_path)])
    new, less = contents(tmp_path), ["--no-rerun", "--no-picture", "--no-page"]
    assert new.keys() == old.keys() and "old" not in new.values()
    c.main(["--steps", "2", *less, "--out", str(tmp_path)])
    assert contents(tmp_path).keys() == {publish.METRICS}
