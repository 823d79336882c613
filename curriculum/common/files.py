"""Files that appear whole or not at all, alone or several at once."""

import contextlib
import json
import os
import signal
from pathlib import Path

UNFINISHED = ".unfinished-"  # and a process: files that are being written


def write_together(folder, contents):
    """Write files {name: text or bytes} aside, then rename them into `folder`.

    A name whose content is None is not there afterwards. If one cannot be written, or all is
    interrupted, all is as it was, and an OSError names the file. Processes wait for each other.
    """
    made = {name: x.encode() if isinstance(x, str) else x for name, x in contents.items()}
    (folder := Path(folder)).mkdir(parents=True, exist_ok=True)
    aside = folder / f"{UNFINISHED}{os.getpid()}"
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):  # of a system that cannot lock folders
            import fcntl

            stack.callback(os.close, handle := os.open(folder, os.O_RDONLY))
            fcntl.flock(handle, fcntl.LOCK_EX)  # until it is closed, be it by a kill
            for left in folder.glob(f"{UNFINISHED}*"):
                remove(left)
        aside.mkdir(exist_ok=True)
        stack.callback(remove, aside)
        for name in (name for name, x in made.items() if x is not None):
            try:
                (aside / name).write_bytes(made[name])
            except OSError as why:
                raise OSError(why.errno, why.strerror or str(why), str(folder / name)) from None

        with undisturbed():
            for name, x in made.items():
                if x is None:
                    (folder / name).unlink(missing_ok=True)
                else:
                    (aside / name).replace(folder / name)


def remove(folder):
    """Remove a folder of files."""
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()


@contextlib.contextmanager
def undisturbed():
    """A moment in which no signal ends the program; one that comes then is heard afterwards."""
    names = {"SIGINT", "SIGTERM", "SIGHUP"} & set(dir(signal))
    before, heard = {}, []
    with contextlib.suppress(ValueError):  # only the main thread hears signals
        for name in names:
            number = getattr(signal, name)
            before[number] = signal.signal(number, lambda number, _: heard.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in heard:
            signal.raise_signal(number)


def write_whole(path, content):
    """Write a file of text or bytes, as write_together does."""
    write_together(Path(path).parent, {Path(path).name: content})


def as_json(content):
    """`content` as JSON: strict (no NaN), keys in order."""
    return json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"


def check_writable(path):
    """Raise OSError now if `path`, whose folder is made if need be, could not be written later."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        path.lstat()  # of a name that may be too long
    above = next(folder for folder in path.absolute().parents if os.path.lexists(folder))
    if not above.is_dir():
        raise OSError(f"{above.name} is {'no folder' if above.exists() else 'a link to nothing'}")
    if path.exists() and not path.is_file():  # a device, a pipe: a file would take its place
        raise OSError(f"{path.name} is {'a folder' if path.is_dir() else 'no plain file'} there")
    (probe := above / f"{UNFINISHED}{os.getpid()}").touch()
    probe.unlink()
