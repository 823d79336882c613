"""Files that appear whole or not at all."""

import argparse
import contextlib
import errno
import json
import os
import stat
import sys
import tempfile
from pathlib import Path


def write_whole(path, write):
    """Let `write(temporary)` fill a file beside `path`, then rename it into place.

    If `write` fails or is interrupted, `path` is as it was and nothing is left beside it. Raises
    what `write` raises, an OSError in the name of `path`.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    remove_left(path)
    try:
        write(temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def remove_left(path):
    """Remove what a process that was killed in the middle of `write_whole(path, ...)` has left."""
    for left in path.parent.glob(f".{path.name}.*"):
        owner = left.name.rpartition(".")[2]
        if owner.isdecimal() and not alive(int(owner)):
            with contextlib.suppress(OSError):  # another user's
                left.unlink()


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
    if (
        path.exists() and not path.is_file()
    ):  # a device, a pipe: renaming would put a file in its place
        what = "a folder" if path.is_dir() else "no plain file"
        raise OSError(errno.EINVAL, f"{path.name} is {what} there", str(path))
    with tempfile.TemporaryFile(dir=path.parent):
        pass
    sticky = (
        os.name == "posix" and stands(path) and path.parent.stat().st_mode & stat.S_ISVTX
    )  # a folder like /tmp
    if sticky and os.geteuid() not in (0, path.parent.stat().st_uid, path.lstat().st_uid):
        raise PermissionError(errno.EPERM, f"{path.name} there is another user's", str(path))


def stands(path):
    """Whether there is something of that name, be it a link to nothing. Raises OSError where one
    cannot tell."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


METRICS, RECORDING = "metrics.json", "constraints.rrd"


def results_folder(text):
    """An argparse type: the path of a folder for results, which may have to be made, by
    `publish`."""
    folder = Path(text)
    try:
        if not text:
            raise ValueError("the name is empty")
        above = [folder, *folder.absolute().parents]
        there = next(path for path in above if stands(path))
        if not there.exists():
            raise FileNotFoundError(
                errno.ENOENT, f"{'it' if there == folder else there.name} is a link to nothing"
            )
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{there.name} is no folder")
        for name in (METRICS, RECORDING) if there == folder else ("results",):
            check_writable(there / name)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise argparse.ArgumentTypeError(
            f"cannot write into {text!r}: {why}; name a folder for the results"
        ) from None
    return folder


def publish(args, settings, results, record):
    """Write metrics.json, then the recording by record(path), if args.rerun, to args.out; in words,
    what was written.

    The metrics are `results`, `settings` and those flags that decide them: equal runs are equal
    bytes. The old recording goes first: it must never lie beside another run's numbers.
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
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        return f"wrote {metrics}, but no recording: {why[:60]}"
    display = (
        "DISPLAY" in os.environ
        or "WAYLAND_DISPLAY" in os.environ
        or sys.platform in ("win32", "darwin")
    )
    return f"wrote {metrics} and {recording}\nlook: python -m rerun {'' if display else '--serve-web '}{recording}"
