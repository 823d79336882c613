"""What a run hands over: numbers, a picture and a recording, all of one run, in one folder."""

import json
import os
import shlex
import sys
import textwrap
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints.picture import write_motion
from curriculum.ch3_4_constraints.recording import record
from curriculum.common.cli import shorten, writable
from curriculum.common.files import dump_json, write_together

METRICS, PICTURE, RECORDING = "metrics.json", "motion.svg", "constraints.rrd"
DECIDE = "integrator", "seed", "baumgarte", "time_constant", "impedance", "tol"  # the results
results_folder = partial(writable, names=(METRICS, PICTURE, RECORDING))  # an argparse type


def scene_list(counts, folder):
    """The systems, a line each: {name: how many rods} of those without a file, and a chapter's."""
    named = {name: f"let go level, rods: {n}" for name, n in counts.items()}
    named["chain"] = "let go level, rods: --links"
    for path in sorted(folder.glob("scenes/*.json")):
        about = json.loads(path.read_bytes())["about"]
        named[path.stem] = textwrap.shorten(about, 63, placeholder=" ...")
    return "\n".join(f"{name:<16} {text}" for name, text in named.items())


def publish(args, used, system, runs, rows, fall, pulls, shown, ghost):
    """Write metrics.json and, if they are asked for, the picture and the recording; in words.

    The metrics are `rows`, what was `used`, and those flags that decide them. Nothing of an earlier
    run stays beside them. A file that cannot be written is left out; but where an earlier run has
    left it, all stays as it was, and the error is raised. The rest: as `record` takes it.
    """
    flags = {name: getattr(args, name) for name in DECIDE} | {"system": Path(args.system).name}
    scene, lost = (args, used, system, runs), []

    def attempt(write, path, *more):
        try:
            write(path, *scene, *more)
        except (OSError, ImportError, MemoryError) as error:
            if (args.out / path.name).exists():
                raise
            path.unlink(missing_ok=True)
            why = getattr(error, "strerror", None) or str(error) or type(error).__name__
            lost.append(f", but no {path.name}: {shorten(why)}")

    metrics = partial(dump_json, content=flags | used | {"results": rows})
    files = {METRICS: metrics, PICTURE: None, RECORDING: None}
    if args.picture:
        files[PICTURE] = lambda path: attempt(write_motion, path, shown, ghost)
    if args.rerun:
        newtons = {mode: pulls[mode](run.q, run.v) for mode, run in runs.items()}
        files[RECORDING] = lambda path: attempt(record, path, rows, fall, newtons, ghost)
    write_together(args.out, files)
    written = [args.out / name for name in files if (args.out / name).exists()]
    text = f"wrote {', '.join(map(str, written))}{''.join(lost)}"
    return text + (f"\nlook: {look(written[-1])}" if written[-1].name == RECORDING else "")


def look(recording):
    """The command that shows a recording, in a browser where there is no display."""
    nearby = os.path.relpath(sys.executable)
    short = os.sep in nearby and len(nearby) < len(sys.executable)
    window = {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ} or sys.platform in ("win32", "darwin")
    viewer = ["rerun"] if window else ["rerun", "--web-viewer"]
    return shlex.join([nearby if short else sys.executable, "-m", *viewer, str(recording)])
