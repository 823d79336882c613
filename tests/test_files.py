"""Files appear whole or not at all, alone or as one set, whatever happens meanwhile."""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from unittest import mock

import constraints as c
from curriculum.ch3_4_constraints import publish, recording
from curriculum.common import banner, files

import pytest
from conftest import complaint, python, script

NAMES = publish.METRICS, publish.PICTURE, publish.PAGE, publish.RECORDING
FULL = OSError(28, "No space left on device", "a temporary name")
FAILS = [("write_bytes", error) for error in (KeyboardInterrupt(), FULL, ZeroDivisionError())]
FAILS.append(("replace", FULL))
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


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize(("call", "error"), FAILS)
def test_a_set_left_unfinished_leaves_all_as_it_was(call, error, links, tmp_path, monkeypatch):
    """Whatever was written, replaced, made or removed before it; also on a disk without links."""
    usual = getattr(files.Path, call)
    if not links:
        monkeypatch.setattr(os, "link", mock.Mock(side_effect=PermissionError))

    def failing(path, x):
        if path.name == "d" and path.parent.name.endswith("-new"):
            raise error
        return usual(path, x)

    files.write_together(tmp_path, dict.fromkeys("abd", "old"))
    monkeypatch.setattr(files.Path, call, failing)
    with pytest.raises(type(error)) as raised:
        files.write_together(tmp_path, {"a": "new", "b": None, "c": "new", "d": "new"})
    assert contents(tmp_path) == dict.fromkeys("abd", "old")
    assert error is not FULL or raised.value.filename == str(tmp_path / "d")


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_between_two_files_of_a_set_waits_for_the_second(name, tmp_path, monkeypatch):
    number, replace = getattr(signal, name), files.Path.replace

    def interrupted(*paths):
        signal.raise_signal(number)
        replace(*paths)

    before = signal.signal(number, signal.default_int_handler)  # it raises KeyboardInterrupt
    monkeypatch.setattr(files.Path, "replace", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt):
            files.write_together(tmp_path, dict.fromkeys("ab", "new"))
    finally:
        signal.signal(number, before)
    assert contents(tmp_path) == {"a": "new", "b": "new"}


def test_a_second_signal_waits_until_nothing_is_left_half_written(tmp_path, monkeypatch):
    """As it comes where Ctrl-C is pressed twice, or a shell and its job are both told to end."""
    remove = os.rmdir

    def interrupted(*place, **more):
        signal.raise_signal(signal.SIGINT)
        remove(*place, **more)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(files.Path, "write_bytes", mock.Mock(side_effect=KeyboardInterrupt))
    monkeypatch.setattr(os, "rmdir", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt):
            files.write_together(tmp_path, dict.fromkeys("ab", "new"))
    finally:
        signal.signal(signal.SIGINT, before)
    assert not any(tmp_path.iterdir())


def test_two_processes_at_once_leave_one_whole_set(tmp_path):
    with ThreadPoolExecutor(2) as pool:
        ended = pool.map(lambda name: script(FORTY, tmp_path, name), ("one", "two"))
        assert [process.returncode for process in ended] == [0, 0]
    found = contents(tmp_path)
    assert sorted(found) == ["a", "b", "c"] and len(set(found.values())) == 1


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGHUP"])
def test_what_a_signal_leaves_half_done_is_gone_after_the_next_write(name, tmp_path):
    """And so is what another program left under our name."""
    number = int(getattr(signal, name))
    heed = partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
    done = script(HALF, tmp_path / "a", number, preexec_fn=heed)
    assert done.returncode == (-number if name == "SIGKILL" else 128 + number)
    assert any(tmp_path.iterdir()) == (name == "SIGKILL")
    (tmp_path / f"{files.UNFINISHED}77").touch()
    (tmp_path / f"{files.UNFINISHED}78/folder").mkdir(parents=True)
    files.write_whole(tmp_path / "a", "whole")
    assert contents(tmp_path) == {"a": "whole"}


def test_a_file_that_must_not_be_replaced_is_found_out_before_a_run(tmp_path, monkeypatch, capsys):
    old, why = tmp_path / publish.PICTURE, "is there and must not be replaced"
    old.write_text("old")
    old.chmod(0o444)
    c.main(["--steps", "1", "--no-rerun", "--out", str(tmp_path)])
    assert old.read_text() != "old"  # read-only is no more than a wish
    capsys.readouterr()
    tmp_path.chmod(0o1777)
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: old.stat().st_uid + 1)  # as somebody else sees it
        assert why in complaint(capsys, "--out", tmp_path)
    tmp_path.chmod(0o777)
    if not subprocess.run(["chattr", "+i", old], capture_output=True).returncode:
        try:  # only root may, and not on every disk
            assert why in complaint(capsys, "--out", tmp_path)
        finally:
            subprocess.run(["chattr", "-i", old], check=True)


def test_what_could_not_be_written_later_is_found_out_before_a_run(tmp_path, monkeypatch, capsys):
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
    for name in NAMES:
        (tmp_path / name / name).mkdir(parents=True)
        assert f"{name} is a folder there" in complaint(capsys, "--out", tmp_path / name)
    monkeypatch.setattr(banner, "LEDGER", tmp_path / "file" / "ledger")  # for a default run's time
    monkeypatch.setattr(sys, "argv", ["banner", "ch3.4", "a command that there is not"])
    with pytest.raises(OSError, match="file is no folder"):
        banner.main()


def test_the_time_of_a_chapter_replaces_its_own_and_no_other(tmp_path, monkeypatch):
    ledger = tmp_path / "wallclock.csv"
    ledger.write_text("chapter,seconds,date,machine\nch3.3,0.10,2026-01-01,a\nch3.4,9.99,b,c\n")
    monkeypatch.setattr(banner, "LEDGER", ledger)
    monkeypatch.setattr(sys, "argv", ["banner", "ch3.4", sys.executable, "-S", "-c", "pass"])
    banner.main()
    head, other, mine = ledger.read_text().splitlines()
    assert (head, other) == ("chapter,seconds,date,machine", "ch3.3,0.10,2026-01-01,a")
    assert mine.startswith("ch3.4,") and "9.99" not in mine


def test_a_working_folder_that_is_gone_is_told_of(tmp_path, monkeypatch, capsys):
    gone, out = tmp_path / "gone", tmp_path / "out"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    there = {"PYTHONPATH": str(c.HERE)}
    done = python("-m", "curriculum.ch3_4_constraints.studies", cwd=None, variables=there)
    assert done.stderr.count("\n") == 1 and " a NAME is missing, " in done.stderr
    line = complaint(capsys, "--out", "outputs")
    assert line.endswith("the folder you are in is gone; cd to one that is there\n")
    c.main(["--steps", "1", "--rerun", "--out", str(out)])
    assert {path.name for path in out.iterdir()} == {*NAMES}


def test_a_run_leaves_its_own_files_only_and_none_tells_where_it_was(tmp_path, monkeypatch):
    scene, out = tmp_path / "mine.json", tmp_path / "out"
    scene.write_bytes((c.HERE / c.CHAPTER / "scenes/spin.json").read_bytes())
    files.write_together(out, dict.fromkeys(NAMES, "old"))
    monkeypatch.setattr(recording, "record", mock.Mock(return_value=b"new"))
    flags = ["--system", str(scene), "--steps", "2", "--out", str(out)]
    c.main([*flags, "--rerun"])
    written = contents(out)
    assert written.keys() == {*NAMES} and "old" not in written.values()
    assert f'"{scene.name}"' in written[publish.METRICS]
    assert not any(str(tmp_path) in text for text in written.values())
    c.main([*flags, "--no-rerun", "--no-picture", "--no-page"])
    assert contents(out).keys() == {publish.METRICS}
