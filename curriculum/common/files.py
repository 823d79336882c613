"""Files that appear whole or not at all."""

import errno
import json
import os
import tempfile
from pathlib import Path


def write_whole(path, write):
    """Let `write(temporary)` fill a file beside `path`, then rename it into place.

    If `write` fails or is interrupted, `path` is as it was and nothing is left beside it. Raises what `write` raises.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path, content):
    """`content` as JSON, strict (no NaN), whole or not at all."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def check_writable(path):
    """Raise OSError now if `write_whole(path, ...)` could not work later; leaves nothing behind."""
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{path.name} is a folder there", str(path))
    with tempfile.TemporaryFile(dir=path.parent):
        pass


def make_ready(folder, names):
    """Make `folder`; raise OSError, with a sentence for the user, unless files `names` can be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in names:
            check_writable(folder / name)
    except OSError as error:
        raise OSError(f"cannot write into '{folder}': {error.strerror}; name a folder for the results") from None
