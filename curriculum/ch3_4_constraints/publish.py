"""What a run hands over: numbers, a picture and a recording, all of the same run, in one folder."""

import argparse
import os
import shlex
import sys
from functools import partial
from pathlib import Path

from curriculum.common.cli import shorten
from curriculum.common.files import as_json, check_folder, write_together

METRICS, PICTURE, RECORDING = "metrics.json", "motion.svg", "constraints.rrd"
DECIDE = "integrator", "seed", "baumgarte", "time_constant", "impedance", "tol"  # flags: the result


def results_folder(text):
    """An argparse type: the path of a folder for results, which `publish` makes if need be."""
    try:
        if not text:
            raise ValueError("the name is empty")
        check_folder(Path(text), (METRICS, PICTURE, RECORDING))
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        what = f"cannot write into {text!r}: {why}; name a folder for the results"
        raise argparse.ArgumentTypeError(what) from None
    return Path(text)


def publish(args, used, rows, writers):
    """Write metrics.json and what `writers` {file name: write(path)} make into args.out; in words.

    The metrics are `rows`, what was `used`, and those flags that decide them: equal runs are equal
    bytes. Files of an earlier run never stay beside them. What cannot be written is left out, and
    said; but if an earlier run has left it there, all stays as it was, and OSError is raised.
    """
    flags = {name: getattr(args, name) for name in DECIDE} | {"system": Path(args.system).name}
    lost = []

    def attempt(name, write, path):
        try:
            write(path)
        except (OSError, ImportError, MemoryError) as error:
            if (args.out / name).exists():
                raise
            path.unlink(missing_ok=True)
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            lost.append(f", but no {name}: {shorten(why)}")

    files = {METRICS: as_json(flags | used | {"results": rows}), PICTURE: None, RECORDING: None}
    files |= {name: partial(attempt, name, write) for name, write in writers.items()}
    args.out.mkdir(parents=True, exist_ok=True)
    write_together(args.out, files)
    written = [str(args.out / name) for name in files if (args.out / name).exists()]
    text = f"wrote {' and '.join(filter(None, (', '.join(written[:-1]), written[-1])))}"
    text += "".join(lost)
    return (
        f"{text}\nlook: {look(args.out / RECORDING)}"
        if str(args.out / RECORDING) in written
        else text
    )


def look(recording):
    """The command that shows a recording, in the browser where there is no display."""
    here = os.path.relpath(sys.executable)
    python = here if os.sep in here and len(here) < len(sys.executable) else sys.executable
    display = {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ) or sys.platform in (
        "win32",
        "darwin",
    )
    browser = [] if display else ["--web-viewer"]
    return shlex.join([python, "-m", "rerun", *browser, str(recording)])
