"""Files that appear whole or not at all, alone or several at once."""

import contextlib
import json
import os
import signal
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

ENDING = [getattr(signal, x) for x in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, x)]


def write_together(folder, contents):
    """Write files {name: text or bytes} aside, then rename them into `folder`.

    A name whose content is None is not there afterwards. If one cannot be written, or all is
    interrupted, all is as it was. An OSError names the file.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".unfinished-", dir=folder) as aside:
        new = {name: Path(aside, name) for name, content in contents.items() if content is not None}
        for name, path in new.items():
            content = contents[name]
            with naming(folder / name):
                path.write_bytes(content.encode() if isinstance(content, str) else content)
        with undisturbed():
            for name in contents:
                with naming(folder / name):
                    if name in new:
                        new[name].replace(folder / name)
                    else:
                        (folder / name).unlink(missing_ok=True)


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
    try:
        whole = path.absolute()
    except FileNotFoundError:
        raise OSError("the folder you are in is gone; cd to one that is there") from None
    if path.exists() and not path.is_file():  # a device, a pipe: a file would take its place
        raise OSError(f"{path.name} is {'a folder' if path.is_dir() else 'no plain file'} there")
    above = next(folder for folder in whole.parents if os.path.lexists(folder))
    if not above.is_dir():
        raise OSError(f"{above.name} is {'no folder' if above.exists() else 'a link to nothing'}")
    with naming(path), TemporaryFile(dir=above):
        pass
