"""Files that appear whole or not at all, alone or several at once."""

import contextlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from threading import Thread


def write_together(folder, writers):
    """Let write(path) of `writers` {name: write} fill files aside, then rename them into `folder`.

    A name whose writer made no file, or is None, is not there afterwards. If a writer fails or is
    interrupted, all is as it was, and an OSError names the file. Processes wait for each other.
    """
    (folder := Path(folder)).mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):  # of a system that cannot lock folders
            import fcntl

            stack.callback(os.close, handle := os.open(folder, os.O_RDONLY))
            fcntl.flock(handle, fcntl.LOCK_EX)  # until it is closed, be it by a kill
            for left in folder.glob(".unfinished-*"):
                shutil.rmtree(left, ignore_errors=True)
        aside = Path(stack.enter_context(tempfile.TemporaryDirectory("", ".unfinished-", folder)))
        for name in filter(writers.get, writers):
            try:
                writers[name](aside / name)
            except OSError as why:
                raise OSError(why.errno, why.strerror or str(why), str(folder / name)) from None

        failed = []

        def rename():
            try:
                for name in writers:
                    made = (aside / name).exists()
                    os.replace(aside / name, folder / name) if made else (folder / name).unlink(
                        True
                    )
            except OSError as why:
                failed.append(why)

        worker = Thread(target=rename)  # as Ctrl-C interrupts the main thread only
        stack.callback(worker.join)
        worker.start()
        worker.join()
        if failed:
            raise failed[0]


def write_whole(path, write):
    """Let write(temporary) fill the file `path`, as write_together does."""
    write_together(Path(path).parent, {Path(path).name: write})


def write_json(path, content):
    """`content` as JSON, strict (no NaN), keys in order, whole or not at all."""
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def check_writable(path):
    """Raise OSError now if `path`, whose folder is made if need be, could not be written later."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        path.lstat()  # of a name that may be too long
    above = next(folder for folder in path.absolute().parents if os.path.lexists(folder))
    if not above.is_dir():
        raise OSError(f"{above.name} is {'no folder' if above.exists() else 'a link to nothing'}")
    if path.exists() and not path.is_file():  # a device, a pipe: a file would take its place
        raise OSError(f"{path.name} is {'a folder' if path.is_dir() else 'no plain file'} there")
    tempfile.TemporaryFile(dir=above).close()
