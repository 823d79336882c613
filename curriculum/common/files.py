"""Files that appear whole or not at all."""

import argparse
import errno
import json
import os
import sys
import tempfile
from pathlib import Path

from curriculum.common.scenes import shorten


def write_whole(path, write):
    """Let `write(temporary)` fill a file beside `path`, then rename it into place.

    If `write` fails or is interrupted, `path` is as it was and nothing is left beside it. Raises what `write` raises.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    remove_left(path)
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def remove_left(path):
    """Remove what a process that was killed in the middle of `write_whole(path, ...)` has left."""
    for left in path.parent.glob(f".{path.name}.*"):
        owner = left.name.rpartition(".")[2]
        if owner.isdecimal() and not alive(int(owner)):
            left.unlink(missing_ok=True)


def alive(process):
    """Whether a process of that number runs, as far as the system tells."""
    try:
        os.kill(process, 0) if os.name == "posix" else None
    except ProcessLookupError:
        return False
    except OSError:
        pass  # another user's
    return True


def write_json(path, content):
    """`content` as JSON, strict (no NaN), keys in order, whole or not at all."""
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def check_writable(path):
    """Raise OSError now if `write_whole(path, ...)` could not work later; leaves nothing behind."""
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{path.name} is a folder there", str(path))
    with tempfile.TemporaryFile(dir=path.parent):
        pass


METRICS, RECORDING = "metrics.json", "constraints.rrd"


def results_folder(text):
    """An argparse type: the path of a folder for results, which may have to be made, by `publish`."""
    folder = Path(text)
    try:
        if not text:
            raise ValueError("the name is empty")
        if folder.is_symlink() and not folder.exists():
            raise FileNotFoundError(errno.ENOENT, "it is a link to nothing")
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{there.name} is no folder")
        for name in (METRICS, RECORDING) if there == folder else ("results",):
            check_writable(there / name)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise argparse.ArgumentTypeError(f"cannot write into {text!r}: {why}; name a folder for the results") from None
    return folder


def publish(args, settings, results, record):
    """Write metrics.json, then the recording by record(path), if args.rerun, to args.out; in words, what was written.

    The metrics are `results`, `settings` and those flags that decide them: equal runs are equal bytes. The old
    recording goes first: it must never lie beside another run's numbers.
    """
    names = ("integrator", "seed", "baumgarte", "time_constant", "impedance", "tol")
    flags = {name: getattr(args, name) for name in names} | {"system": Path(args.system).name}
    metrics, recording = args.out / METRICS, args.out / RECORDING
    args.out.mkdir(parents=True, exist_ok=True)
    recording.unlink(missing_ok=True)
    remove_left(recording)
    write_json(metrics, flags | settings | {"results": results})
    if not args.rerun:
        return f"wrote {metrics}"
    try:
        write_whole(recording, record)
    except Exception as error:  # of a library; the numbers are safe
        return f"wrote {metrics}, but no recording: {shorten(str(error))}"
    display = "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ or sys.platform in ("win32", "darwin")
    return f"wrote {metrics} and {recording}\nlook: python -m rerun {'' if display else '--serve-web '}{recording}"
