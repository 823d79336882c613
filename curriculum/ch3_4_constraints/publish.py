"""What a run hands over: numbers, a picture, a page and a recording, all in one folder."""

import contextlib
import os
import shlex
import shutil
import sys
import textwrap
from functools import partial
from pathlib import Path

from curriculum.ch3_4_constraints.picture import motion
from curriculum.ch3_4_constraints.scene_files import about
from curriculum.ch3_4_constraints.tables import WIDTH
from curriculum.common.cli import in_a_line, writable
from curriculum.common.files import as_json, write_together
from curriculum.common.progress import work
from curriculum.common.tape import Untraceable

METRICS, PICTURE, PAGE = "metrics.json", "motion.svg", "play.html"
RECORDING = "constraints.rrd"
DECIDE = "seed", "baumgarte", "time_constant", "impedance", "tol"  # the results
results_folder = partial(writable, names=(METRICS, PICTURE, PAGE, RECORDING))  # an argparse type


def scene_list(counts, folder):
    """The systems, a line each: {name: how many rods} of those without a file, and a chapter's."""
    width = max(20, shutil.get_terminal_size().columns - 17)
    short = partial(textwrap.shorten, width=width, placeholder=" ...")
    return "\n".join(f"{name:<16} {short(text)}" for name, text in about(counts, folder).items())


def parts(args):
    """What a run still has to do once its steps are done, in words, as the flags ask."""
    asked = {"the picture": args.picture, "the page": args.page, "the recording": args.rerun}
    return [name for name, wanted in asked.items() if wanted]


def publish(comparison, chapter, step_fn):
    """Write metrics.json and, if asked for, picture, page and recording; say so in words.

    The metrics are the rows of a Comparison, what was used, and those flags that decide them.
    `chapter`: the module whose lines the page is made of; `step_fn`: the integrator.
    Nothing of an earlier run stays beside them; if a file cannot be written, all stays as it was.
    """
    args, truth = comparison.args, comparison.truth
    knobs = args.baumgarte, args.time_constant, args.impedance
    used = {name: getattr(args, name) for name in DECIDE} | {"system": Path(args.system).name}
    used |= {"integrator": comparison.rule, "dt": comparison.dt, "steps": comparison.steps}
    used["rods"] = len(comparison.system["pairs"])
    used["error_at"] = truth.step * comparison.dt
    used["known"] = None if truth.q is None else float(f"{truth.uncertainty:.2g}")  # m
    files = {METRICS: as_json(used | {"results": comparison.rows})}
    files |= {PICTURE: None, PAGE: None, RECORDING: None}
    more = ""
    if args.picture:
        work.begin("the picture")
        files[PICTURE] = motion(comparison)
    if args.page:
        work.begin("the page")
        from curriculum.ch3_4_constraints.play import page  # here: a run without one is quicker

        scene = comparison.scene, comparison.system, comparison.rule
        refusals = [run.stepper.lies for run in comparison.runs.values() if run.stepper.lies]
        refusals += ["--plain compiles nothing"] if args.plain else []
        try:
            if refusals:
                raise Untraceable(refusals[0])
            files[PAGE] = page(chapter, *scene, step_fn, comparison.dt, knobs)
        except Untraceable as why:
            more = f"\n{PAGE} left out: {why}"
    if args.rerun:
        work.begin("the recording")
        try:
            from curriculum.ch3_4_constraints import recording  # here: it loads the viewer
        except Exception as why:  # which is there, and does not load
            more += f"\n{RECORDING} left out: {in_a_line(why)}"
        else:
            files[RECORDING] = recording.record(comparison)
            more += f"\nlook: {look(args.out / RECORDING)}"
    write_together(args.out, files)
    work.wipe()
    names = ", ".join(name for name in files if files[name])
    line = f"wrote {args.out}: {names}"
    if len(line) > WIDTH:
        line = f"wrote {args.out}:\n  {names}"
    return line + more


def look(recording):
    """The command that shows a recording, in a browser where there is no display; a shell takes it
    as it is pasted, though it may be two lines."""
    window = {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ} or sys.platform in ("win32", "darwin")
    script = Path(sys.executable).with_name("rerun")
    program, *words = [script] if script.exists() else [sys.executable, "-m", "rerun"]
    with contextlib.suppress(OSError, ValueError):  # in a folder that is gone; on another drive
        nearby = os.path.relpath(program)
        if os.sep in nearby and len(nearby) < len(str(program)):
            program = nearby
    words += ["--bind", "127.0.0.1"]  # no other machine is to see it
    if not window:
        words += ["--web-viewer", "--new", "--web-viewer-port", "0"]  # another may be open
    command, file = shlex.join([str(program), *words]), shlex.quote(str(recording))
    fits = len(f"look: {command} {file}") <= WIDTH
    return f"{command} {file}" if fits else f"{command} \\\n  {file}"
