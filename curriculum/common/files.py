"""Files that appear whole or not at all, alone or several at once."""

import contextlib
import errno
import json
import os
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

with contextlib.suppress(ImportError):
    import fcntl  # not on Windows, where a folder cannot be opened either: see `held`

ASIDE = ".unfinished-"  # how the folders begin in which files are written, beside where they belong


@contextlib.contextmanager
def held(folder, wait=True):
    """Lock a folder for the block, and say whether that worked. A killed process locks nothing."""
    with contextlib.ExitStack() as stack:
        try:
            handle = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            mine = True
        except OSError:  # another process has it, or this file system cannot lock
            mine = False
        yield mine


def write_together(folder, writers):
    """Let each write(path) of `writers` {name: write} fill a file aside, then rename all of them.

    What no writer has made, or has None for one, is not there afterwards. If a writer fails or is
    interrupted, `folder` is as it was; of two processes, one has the last word on all files.
    Raises what a writer raises, an OSError in the name of the file that it was to fill.
    """

    def rename():
        for name in writers:
            if (aside / name).exists():
                os.replace(aside / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)

    folder = Path(folder)
    with contextlib.ExitStack() as stack:
        with held(folder):
            for left in folder.glob(f"{ASIDE}*"):  # by a process that was killed
                with held(left, wait=False) as dead:
                    shutil.rmtree(left, ignore_errors=True) if dead else None
            aside = Path(stack.enter_context(tempfile.TemporaryDirectory("", ASIDE, folder)))
            stack.enter_context(held(aside))
        for name, write in writers.items():
            try:
                write(aside / name) if write else None
            except OSError as error:
                why = error.strerror or str(error)
                raise OSError(error.errno, why, str(folder / name)) from None
        with held(folder), ThreadPoolExecutor(1) as thread:  # which Ctrl-C does not interrupt
            thread.submit(rename).result()


def write_whole(path, write):
    """Let write(temporary) fill a file, then rename it to `path`; see write_together."""
    path = Path(path)
    write_together(path.parent, {path.name: write})


def as_json(content):
    """write(path) of `content` as JSON: strict (no NaN), keys in order."""
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"
    return lambda path: path.write_text(text, encoding="utf-8")


def write_json(path, content):
    """`content` as JSON, whole or not at all."""
    write_whole(path, as_json(content))


def check_writable(path):
    """Raise OSError now if `path` could not be written later; leaves nothing behind."""
    path = Path(path)
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        path.lstat()  # whose name may be too long
    if path.exists() and not path.is_file():  # a device, a pipe: a file would take its place
        what = "a folder" if path.is_dir() else "no plain file"
        raise OSError(errno.EINVAL, f"{path.name} is {what} there", str(path))
    tempfile.TemporaryFile(dir=path.parent).close()


def check_folder(folder, names):
    """Raise OSError now if files of these names could not be written into `folder` later.

    `folder` may have to be made.
    """
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        folder.lstat()
    there = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not there.is_dir():
        what = "no folder" if there.exists() else "a link to nothing"
        raise NotADirectoryError(errno.ENOTDIR, f"{there.name} is {what}", str(there))
    for name in names if there == folder else ["results"]:
        check_writable(there / name)
