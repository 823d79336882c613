"""Files appear whole or not at all, alone or as one set, whatever happens meanwhile."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from unittest import mock

import constraints as c
from curriculum.ch3_4_constraints import publish
from curriculum.common import banner, files

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


def refused(capsys, flags, why):
    """A run with these flags, before it begins."""
    with pytest.raises(SystemExit, match="2"):
        c.main(flags)
    assert why in capsys.readouterr().err


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


def test_a_file_that_cannot_be_replaced_leaves_all_as_it_was(tmp_path, monkeypatch):
    """Whatever was replaced, made or removed before it."""

    def refused(path, target, replace=Path.replace):
        if target.name == "d" and path.parent.name.endswith("-new"):
            raise PermissionError(1, "Operation not permitted", "a temporary name")
        replace(path, target)

    files.write_together(tmp_path, dict.fromkeys("abd", "old"))
    monkeypatch.setattr(files.Path, "replace", refused)
    with pytest.raises(PermissionError) as raised:
        files.write_together(tmp_path, {"a": "new", "b": None, "c": "new", "d": "new"})
    assert contents(tmp_path) == dict.fromkeys("abd", "old")
    assert raised.value.filename == str(tmp_path / "d")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_between_two_files_of_a_set_waits_for_the_second(name, tmp_path, monkeypatch):
    number = getattr(signal, name)

    def interrupted(*paths, replace=Path.replace):
        signal.raise_signal(number)
        replace(*paths)

    before = signal.signal(number, signal.default_int_handler)  # it raises KeyboardInterrupt
    try:
        monkeypatch.setattr(files.Path, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            files.write_together(tmp_path, dict.fromkeys("ab", "new"))
    finally:
        signal.signal(number, before)
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
    assert any(tmp_path.iterdir()) == (name == "SIGKILL")
    files.write_whole(tmp_path / "a", "whole")
    assert contents(tmp_path) == {"a": "whole"}


def test_what_another_program_left_under_our_name_stops_no_tidying(tmp_path):
    (tmp_path / f"{files.UNFINISHED}77").touch()
    (tmp_path / f"{files.UNFINISHED}78/folder").mkdir(parents=True)
    files.write_whole(tmp_path / "a", "whole")
    assert contents(tmp_path) == {"a": "whole"}


def test_a_file_that_must_not_be_replaced_is_found_out_before_a_run(tmp_path, monkeypatch, capsys):
    old, flags = tmp_path / publish.PICTURE, ["--steps", "1", "--out", str(tmp_path)]
    old.write_text("old")
    old.chmod(0o444)
    c.main([*flags, "--no-rerun"])  # read-only is no more than a wish
    assert old.read_text() != "old"
    tmp_path.chmod(0o1777)
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: old.stat().st_uid + 1)  # as somebody else sees it
        refused(capsys, flags, "is there and must not be replaced")
    tmp_path.chmod(0o777)
    if not subprocess.run(["chattr", "+i", old], capture_output=True).returncode:
        try:  # only root may, and not on every disk
            refused(capsys, flags, "is there and must not be replaced")
        finally:
            subprocess.run(["chattr", "-i", old], check=True)


def test_each_file_of_a_run_is_looked_for_and_none_of_them_tells_where_it_was(tmp_path, capsys):
    scene, out = tmp_path / "mine.json", tmp_path / "out"
    scene.write_bytes((c.HERE / c.CHAPTER / "scenes/spin.json").read_bytes())
    c.main(["--system", str(scene), "--steps", "1", "--no-rerun", "--out", str(out)])
    written = contents(out)
    assert f'"{scene.name}"' in written[publish.METRICS]
    assert not any(str(tmp_path) in text for text in written.values())
    for name in (publish.METRICS, publish.PICTURE, publish.PAGE, publish.RECORDING):
        (tmp_path / name / name).mkdir(parents=True)
        refused(capsys, ["--out", str(tmp_path / name)], f"{name} is a folder there")


def test_what_measures_a_default_run_does_not_begin_where_it_cannot_write(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(banner, "LEDGER", tmp_path / "file" / "ledger")
    monkeypatch.setattr(sys, "argv", ["banner", "ch3.4", "a command that there is not"])
    with pytest.raises(OSError, match="file is no folder"):
        banner.main()


def test_a_working_folder_that_is_gone_is_told_of(tmp_path):
    gone = f"os.mkdir({str(tmp_path / 'x')!r}); os.chdir(sys.argv[1]); os.rmdir(sys.argv[1])\n"
    start = f"sys.path.insert(0, {str(c.HERE)!r}); import constraints as c\n{gone}"
    done = script(f"{start}c.main(['--steps', '1'])", tmp_path / "x")
    assert done.stderr.rstrip().endswith("the folder you are in is gone; cd to one that is there")
    done = script(f"{start}c.main(['--steps', '1', '--out', {str(tmp_path)!r}])", tmp_path / "x")
    assert (done.returncode, done.stderr) == (0, "")


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
