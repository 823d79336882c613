"""Files appear whole or not at all, alone or as one set, whatever happens meanwhile."""

import os
import signal
import sys
from unittest import mock

import constraints as c
from curriculum.ch3_4_constraints import publish, recording
from curriculum.common import banner, files

import pytest
from conftest import complaint, python

NAMES = publish.METRICS, publish.PICTURE, publish.PAGE, publish.RECORDING
FULL = OSError(28, "No space left on device", "a temporary name")
pytestmark = pytest.mark.skipif(os.name == "nt", reason="no signals, locks or pipes there")


def contents(folder):
    """{name: text} of all that is in a folder."""
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), FULL, ZeroDivisionError()])
def test_a_set_left_unfinished_leaves_all_as_it_was(error, tmp_path, monkeypatch):
    """Whatever was written before it."""
    usual = files.Path.write_bytes

    def failing(path, x):
        if path.name == "d":
            raise error
        return usual(path, x)

    files.write_together(tmp_path, dict.fromkeys("abd", "old"))
    monkeypatch.setattr(files.Path, "write_bytes", failing)
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
