"""What a run leaves behind: metrics.json, a page and a recording, written all at once."""

import json
import math
import os
import shlex
import sys
from pathlib import Path

from curriculum.ch3_4_constraints.page import play
from curriculum.ch3_4_constraints.page.scene import NoPage
from curriculum.ch3_4_constraints.report import answer as answers
from curriculum.ch3_4_constraints.report.table import say
from curriculum.common.errors import Refused
from curriculum.common.files import check_writable, write_together

METRICS = "metrics.json"
PAGE = "play.html"
RECORDING = "constraints.rrd"
MARK = "written_by"  # a key of METRICS
EARLIER = {"baumgarte", "error_at", "reference_uncertainty", "rods", "time_constant"}  # keys
HEAD = 4096  # bytes of a file, in which its mark is looked for
MARKS = {  # what is in the head of a file that a run has written, or an earlier version has
    PAGE: [(play.MARK.encode(),), (b"<!doctype html>", b"which method holds its rods?</title>")],
    RECORDING: [(b"RRF", b"constraints*")],
}
OFF = ("0", "off", "false")  # what the variable RERUN is where rerun is to do nothing


def check(folder):
    """Raise Refused where a file of a run's would take the place of one that no run has written."""
    for name in (METRICS, PAGE, RECORDING):
        path = folder / name
        check_writable(path)
        if path.exists() and not is_ours(path):
            raise Refused(f"argument --out: {path} is not of a run; name another folder")


def is_ours(path):
    """Whether a run has written this file: it has a run's mark, or is like an earlier version's."""
    if path.name == METRICS:
        try:
            keys = json.loads(path.read_bytes()).keys()
        except (ValueError, AttributeError, RecursionError):
            return False
        return MARK in keys or keys >= EARLIER
    with path.open("rb") as file:
        head = file.read(HEAD)
    return any(all(part in head for part in mark) for mark in MARKS[path.name])


def write_files(asked, runs, results, truth, answer):
    """Write the files that are asked for, and remove those of an earlier run."""
    text = metrics(asked, results, truth, answer)
    files = {METRICS: text, PAGE: None, RECORDING: None}
    left_out = {}
    if asked.page and not all(run.report.is_compiled for run in runs.values()):
        left_out[PAGE] = "steps are not compiled"
    elif asked.page:
        try:
            files[PAGE] = play.page(asked, results, truth, answer)
        except NoPage as why:
            left_out[PAGE] = why
    if asked.rerun:
        files[RECORDING], why = recorded(asked, runs, results, text)
        if why:
            left_out[RECORDING] = why
    check(asked.out)  # once more: the run may have taken long
    write_together(asked.out, files)
    say(f"wrote {asked.out}: {', '.join(name for name in files if files[name])}")
    for name, why in left_out.items():
        say(f"{name} is left out: {why}")
    if files[PAGE]:
        print(f"look: open {shlex.quote(str(asked.out / PAGE))} in a browser")
    if files[RECORDING]:
        print(look(asked.out / RECORDING))
    if asked.within is None:
        print("which step is right to 1 mm? add --within 1mm")


def recorded(asked, runs, results, text):
    """The bytes of a recording, or None; and why there is none, in words, or None.

    Whatever rerun does, a run is not lost with it.
    """
    if os.environ.get("RERUN", "").lower() in OFF:
        return None, f"RERUN={os.environ['RERUN']} switches rerun off"
    try:
        from curriculum.ch3_4_constraints.report import recording  # here: it loads for long

        return recording.record(asked, runs, results, text), None
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as why:  # what panics in Rust is no Exception
        said = " ".join(str(why).split()) or type(why).__name__
        return None, f"{said}; pip install --upgrade rerun-sdk may help"


def metrics(asked, results, truth, answer):
    """The text of metrics.json. It has no times, and nothing about the machine: equal arguments
    give equal bytes. So does the page; recordings are equal but for a header."""
    found = {
        MARK: "constraints.py",
        "system": Path(asked.scene).name,
        "integrator": asked.integrator,
        "dt": asked.dt,
        "steps": asked.steps,
        "seed": asked.seed,
        **asked.knobs,
        "rods": len(asked.system["pairs"]),
        "error_at": truth.step * asked.dt,
        "reference_uncertainty": truth.uncertainty if truth.q is not None else None,
        "results": {
            name: {key: rounded(x) for key, x in row.items()} for name, row in results.items()
        },
        "choice": answers.as_metrics(answer) if answer else None,
    }
    return json.dumps(finite(found), indent=2, sort_keys=True, allow_nan=False) + "\n"


def rounded(x):
    """A figure with 12 decimals, or a list of places in m with 6; else x."""
    if isinstance(x, list):
        return [round(place, 6) for place in x]
    return round(float(x), 12) if isinstance(x, float) else x


def finite(x):
    """The same dicts, lists and numbers, with None for what is not finite."""
    if isinstance(x, dict):
        return {key: finite(y) for key, y in x.items()}
    if isinstance(x, list):
        return list(map(finite, x))
    return None if isinstance(x, float) and not math.isfinite(x) else x


def look(recording):
    """A line with the command that shows a recording: in a browser where there is no display."""
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1"]  # no other machine is to see it
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}:
        words += ["--web-viewer", "--new", "--web-viewer-port", "0"]  # another may be open
    return f"or the recording: {shlex.join([*words, str(recording)])}"
