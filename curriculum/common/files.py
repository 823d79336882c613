"""Files that appear whole or not at all, alone or several at once."""

import contextlib
import errno
import json
import os
import shutil
import signal
import stat
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

ENDING = [getattr(signal, x) for x in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, x)]
UNFINISHED = ".unfinished-"  # begins the names of folders of files that are being written


def write_together(folder, contents):
    """Write files {name: text or bytes} aside, then rename them into `folder`.

    A name whose content is None is not there afterwards. If one cannot be written or replaced, or
    all is interrupted, all is as it was, and an OSError names the file. Other processes wait.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):  # of a system that cannot lock folders
            import fcntl

            handle = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, handle)
            fcntl.flock(handle, fcntl.LOCK_EX)  # until it is closed, be it by a kill
            for left in folder.glob(f"{UNFINISHED}*"):  # by processes that were killed
                with contextlib.suppress(OSError):  # somebody else's: it is in nobody's way
                    if left.is_dir():
                        shutil.rmtree(left)
                    else:
                        left.unlink()
        aside = [TemporaryDirectory(end, UNFINISHED, folder) for end in ("-new", "-old")]
        for place in aside:
            stack.callback(undisturbed()(place.cleanup))  # a second Ctrl-C waits for it, too
        new, old = (Path(place.name) for place in aside)
        for name, content in contents.items():
            with naming(folder / name):
                if content is not None:
                    made = content.encode() if isinstance(content, str) else content
                    (new / name).write_bytes(made)
                if os.path.lexists(folder / name):
                    keep(folder / name, old / name)
        replaced = []
        with undisturbed():
            try:
                for name in contents:
                    with naming(folder / name):
                        move(new / name, folder / name)
                    replaced.append(name)
            except OSError:
                for name in replaced:
                    move(old / name, folder / name)
                raise


def keep(path, second):
    """Have a file under a second name, too; on a disk that knows no links, a copy of it."""
    try:
        os.link(path, second)
    except OSError:
        shutil.copy2(path, second)


def move(source, target):
    """Have the file `target` be what `source` is, or not be there if that is not."""
    if source.exists():
        source.replace(target)
    else:
        target.unlink(missing_ok=True)


@contextlib.contextmanager
def naming(path):
    """An OSError that is raised meanwhile names this file, and not the one it is written to."""
    try:
        yield
    except OSError as why:
        raise OSError(why.errno, why.strerror or str(why), str(path)) from None


@contextlib.contextmanager
def undisturbed():
    """A moment in which no signal ends the program; one that comes then is heard afterwards."""
    before, heard = {}, []
    with contextlib.suppress(ValueError):  # only the main thread hears signals
        for number in ENDING:
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
        path.lstat()  # its name may be too long
    try:
        whole = path.absolute()
    except FileNotFoundError:
        raise OSError("the folder you are in is gone; cd to one that is there") from None
    above = next(folder for folder in whole.parents if os.path.lexists(folder))
    if not above.is_dir():
        raise OSError(f"{above.name} is {'no folder' if above.exists() else 'a link to nothing'}")
    if path.exists() and not path.is_file():  # a device, a pipe: a file would take its place
        raise OSError(f"{path.name} is {'a folder' if path.is_dir() else 'no plain file'} there")
    with naming(path), TemporaryFile(dir=above):
        pass
    if not path.exists():
        return
    fixed = False
    try:
        os.close(os.open(path, os.O_WRONLY | getattr(os, "O_NOFOLLOW", 0)))
    except OSError as why:  # EACCES of one that is just read-only, EPERM of one that is immutable
        fixed = why.errno == errno.EPERM or os.name == "nt"
    folder = path.parent.stat()  # whose sticky bit may be set, as that of /tmp
    owners = {0, folder.st_uid, path.lstat().st_uid}
    if fixed or (folder.st_mode & stat.S_ISVTX and os.geteuid() not in owners):
        raise OSError(f"{path.name} is there and must not be replaced; remove it, or name another")
