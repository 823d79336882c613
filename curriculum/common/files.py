"""Files that appear whole or not at all, alone or several at once."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile


def write_together(folder, contents):
    """Write files {name: text or bytes} aside, then rename them into `folder`.

    A name whose content is None is not there afterwards. If one cannot be written, or Ctrl-C comes
    before they are renamed, all is as it was. Raises OSError, also where a name cannot be taken.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".unfinished-", dir=folder) as aside:
        for name, content in contents.items():
            if content is not None:
                content = content.encode() if isinstance(content, str) else content
                Path(aside, name).write_bytes(content)

        for name in contents:
            check_writable(folder / name)

        def rename_all():
            for name, content in contents.items():
                if content is None:
                    (folder / name).unlink(missing_ok=True)
                else:
                    Path(aside, name).replace(folder / name)

        # Ctrl-C interrupts the main thread only, and leaving this block waits for the other one.
        with ThreadPoolExecutor(1) as pool:
            pool.submit(int).result()  # a pool that is interrupted as it starts a thread forgets it
            pool.submit(rename_all).result()


def check_writable(path):
    """Raise an OSError now if write_together could not write a file at `path` later."""
    if path.exists() and not path.is_file():  # a device, say: a file would take its place
        raise FileExistsError(f"{path} is not a plain file")
    above = next(folder for folder in path.absolute().parents if os.path.lexists(folder))
    try:
        TemporaryFile(dir=above).close()
    except OSError as why:
        raise OSError(f"{path} cannot be written: {why.strerror}") from None
