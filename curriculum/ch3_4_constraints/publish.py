"""What a run hands over: numbers, a picture and a recording, all of one run, in one folder."""

import json
import os
import shlex
import sys
import textwrap
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints import play
from curriculum.ch3_4_constraints.picture import motion
from curriculum.ch3_4_constraints.recording import record, scene_name
from curriculum.common.cli import writable
from curriculum.common.files import as_json, write_together
from curriculum.common.trace import Untraceable

METRICS, PICTURE, RECORDING = "metrics.json", "motion.svg", "constraints.rrd"
PAGE = play.PAGE
DECIDE = "integrator", "seed", "baumgarte", "time_constant", "impedance", "tol"  # the results
results_folder = partial(writable, names=(METRICS, PICTURE, RECORDING, PAGE))  # an argparse type


def scene_list(counts, folder):
    """The systems, a line each: {name: how many rods} of those without a file, and a chapter's."""
    named = {name: f"let go level, rods: {n}" for name, n in counts.items()}
    named["chain"] = "let go level, rods: --links"
    for path in sorted(folder.glob("scenes/*.json")):
        about = json.loads(path.read_bytes())["about"]
        named[path.stem] = textwrap.shorten(about, 63, placeholder=" ...")
    return "\n".join(f"{name:<16} {text}" for name, text in named.items())


def publish(args, used, system, runs, rows, scale, pulls, shown, ghost, page):
    """Write metrics.json and, if asked for, the picture, the page and the recording; in words.

    `page`(name) is the page's text, or raises Untraceable. The metrics are `rows`, what was `used`,
    and those flags that decide them. Nothing of an earlier run stays beside them; if a file cannot
    be written, all stays as it was. The rest: as `record` takes it.
    """
    flags = {name: getattr(args, name) for name in DECIDE} | {"system": Path(args.system).name}
    files = {METRICS: as_json(flags | used | {"results": rows})}
    files |= dict.fromkeys((PICTURE, PAGE, RECORDING))
    scene, left_out = (args, used, system, runs), ""
    if args.picture:
        files[PICTURE] = motion(*scene, shown, ghost)
    if args.page:
        try:
            files[PAGE] = page(scene_name(args))
        except Untraceable as why:
            left_out = f"\n{PAGE} left out: {why}"
    if args.rerun:
        found = {mode: pulls[mode](run.q, run.v) for mode, run in runs.items()}
        files[RECORDING] = record(*scene, rows, scale, found, ghost)
    write_together(args.out, files)
    text = f"wrote {', '.join(str(args.out / name) for name in files if files[name])}"
    text += left_out
    return text + (f"\nlook: {look(args.out / RECORDING)}" if args.rerun else "")


def look(recording):
    """The command that shows a recording, in a browser where there is no display."""
    nearby = os.path.relpath(sys.executable)
    short = os.sep in nearby and len(nearby) < len(sys.executable)
    window = {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ} or sys.platform in ("win32", "darwin")
    viewer = ["rerun"] if window else ["rerun", "--web-viewer"]
    return shlex.join([nearby if short else sys.executable, "-m", *viewer, str(recording)])
