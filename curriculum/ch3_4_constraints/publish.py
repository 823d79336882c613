"""What a run hands over: numbers, a picture and a recording, all of one run, in one folder."""

import json
import os
import shlex
import sys
import textwrap
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints.picture import motion
from curriculum.ch3_4_constraints.recording import record
from curriculum.common.cli import writable
from curriculum.common.files import as_json, write_together

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


def publish(found):
    """Write metrics.json, and the picture and the recording if they are asked for; say so in words.

    The metrics are the rows of a Comparison, what was used, and those flags that decide them.
    Nothing of an earlier run stays beside them; if a file cannot be written, all stays as it was.
    """
    args = found.args
    flags = {name: getattr(args, name) for name in DECIDE} | {"system": Path(args.system).name}
    used = {"dt": found.dt, "steps": found.steps, "rods": len(found.system["pairs"])}
    used["error_at"] = found.truth.step * found.dt
    used["known"] = None if found.truth.q is None else float(f"{found.truth.known:.2g}")  # m
    files = {METRICS: as_json(flags | used | {"results": found.rows})}
    files[PICTURE] = motion(found) if args.picture else None
    files[RECORDING] = record(found) if args.rerun else None
    write_together(args.out, files)
    text = f"wrote {', '.join(str(args.out / name) for name in files if files[name])}"
    return text + (f"\nlook: {look(args.out / RECORDING)}" if args.rerun else "")


def look(recording):
    """The command that shows a recording, in a browser where there is no display."""
    nearby = os.path.relpath(sys.executable)
    short = os.sep in nearby and len(nearby) < len(sys.executable)
    window = {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ} or sys.platform in ("win32", "darwin")
    viewer = ["rerun"] if window else ["rerun", "--web-viewer"]
    alone = ["--bind", "127.0.0.1"]  # else its ports are open to the network
    return shlex.join([nearby if short else sys.executable, "-m", *viewer, *alone, str(recording)])
