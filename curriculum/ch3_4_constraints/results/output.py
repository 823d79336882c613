"""What a run leaves behind: metrics.json, a page and a recording, all or nothing."""

import json
import math
import os
import shlex
import sys
from argparse import ArgumentTypeError
from pathlib import Path
from types import SimpleNamespace

from curriculum.ch3_4_constraints.mechanics.choice import suits
from curriculum.ch3_4_constraints.results import advice
from curriculum.ch3_4_constraints.results.table import say
from curriculum.common.files import check_writable, write_together

# What page, recording and --within take of a chapter: main hands over all its names, as its reader
# has edited them. A knob is an argument of make_methods that args.knobs has.
CHAPTER = {
    "GRAVITY": "(3,) in m/s^2",
    "INTEGRATORS": "{name: step(q, v, m, force, dt) -> (q, v)}",
    "make_methods": "(dt, **knobs) -> {name: Method}: make_force, words, post_step, integrator",
    "external_force": "(system, q, v) -> (N, 3) in N: the page asks whether energy should stay",
    "energy": "(system, q, v) -> J",
    "rod_lengths": "(system, q) -> (..., C) in m, which the page compares with lengths",
    "tensions": "(system, q, v, force) -> (C,) in N, which the recording plots",
    "make_force": "(system) -> force(q, v), which --within takes for the true motion, and",
    "project": "(system, q_start, q, v, dt) -> (q, v), too",
    "stabilized": "(step, system, method) -> step: --within takes steps of all integrators",
    "constraint_violation": "(system, q) -> (...) in m, of many states at once",
}
DECIMALS = {"tip_final": 6}  # of a row's numbers: others have 12
METRICS = "metrics.json"
PAGE = "play.html"
RECORDING = "constraints.rrd"
ALWAYS = {"system", "integrator", "dt", "steps", "seed", "results"}  # keys of METRICS
MEMORY = 4e9  # bytes of states, at most
STATE = 96  # bytes of a particle: its q and v, and once more where they are computed
OFF = ("0", "off", "false")  # what the variable RERUN is where rerun is to do nothing


def methods_of(args, every):
    """The methods that args ask for, of those by name in `every`, and those that are left out.

    These are not made for the integrator. Raises an error, in a sentence, if one is asked for.
    """
    fits = [name for name, x in every.items() if suits(x, args.integrator)]
    left_out = [name for name in every if name not in fits]
    if args.stabilization == "all":
        return fits, left_out
    if args.stabilization in left_out:
        made_for = every[args.stabilization].integrator
        why = f"{args.stabilization} is made for {made_for}, not for {args.integrator}"
        raise ArgumentTypeError(f"argument --stabilization: {why}")
    return [args.stabilization], left_out


def check(args, system):
    """Raise an error in a sentence if a run has too many states, or if its files could not be
    written, or would overwrite files that no run has written."""
    fit = int(MEMORY / (STATE * len(system["m"]) * len(args.methods)))
    if args.steps > fit:
        why = f"{args.steps} steps take more than {MEMORY / 1e9:g} GB; {fit} fit"
        raise ArgumentTypeError(f"argument --steps: {why}")
    for name in (METRICS, PAGE, RECORDING):
        path = args.out / name
        check_writable(path)
        if path.exists() and not is_ours(args.out):
            raise ArgumentTypeError(f"argument --out: {path} is not of a run; name another folder")


def is_ours(folder):
    """Whether a run has written to this folder: its metrics.json is a run's."""
    try:
        return json.loads((folder / METRICS).read_bytes()).keys() >= ALWAYS
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def write(args, system, runs, results, reference):
    """Answer --within, write the files that are asked for, and remove those of an earlier run.

    Of args, this_file has the names of CHAPTER and others, as globals() of the script does.
    """
    chapter = SimpleNamespace(**args.this_file)
    choice = advice.give(chapter, args, system, runs, reference)
    text = metrics(args, system, results, reference, choice)
    files = {METRICS: text, PAGE: None, RECORDING: None}
    edited = any(run.step.edited for run in runs.values())
    left_out = {}
    if args.page and not all(run.step.is_compiled for run in runs.values()):
        left_out[PAGE] = "steps are not compiled"
    elif args.page:
        from curriculum.ch3_4_constraints.pages import page  # here: a run without one is quicker

        try:
            shown = page.play(chapter, args, system, results, reference, choice, edited)
            files[PAGE] = shown
        except page.NoPage as why:
            left_out[PAGE] = why
    if args.rerun:
        files[RECORDING], why = recorded(args, system, runs, results, text, chapter)
        if why:
            left_out[RECORDING] = why
    write_together(args.out, files)
    say(f"wrote {args.out}: {', '.join(name for name in files if files[name])}")
    if files[PAGE] and edited:
        say(f"{PAGE} shows the scene without what the loop edits")
    for name, why in left_out.items():
        say(f"{name} is left out: {why}")
    if files[RECORDING]:
        print(look(args.out / RECORDING))
    if args.within is None:
        print("which step is right to 1 mm? add --within 1mm")


def recorded(args, system, runs, results, text, chapter):
    """The bytes of a recording, or None; and why there is none, in words, or None.

    Whatever rerun does, a run is not lost with it.
    """
    if os.environ.get("RERUN", "").lower() in OFF:
        return None, f"RERUN={os.environ['RERUN']} switches rerun off"
    try:
        from curriculum.ch3_4_constraints.results import recording  # here: it loads for long

        return recording.record(args, system, runs, results, text, chapter), None
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as why:  # what panics in Rust is no Exception
        said = " ".join(str(why).split()) or type(why).__name__
        return None, f"{said}; pip install --upgrade rerun-sdk may help"


def metrics(args, system, results, reference, choice=None):
    """The text of metrics.json. It has no times, and nothing about the machine: equal arguments
    give equal bytes. So does the page; recordings are equal but for a header."""
    used = {name: getattr(args, name) for name in ("integrator", "dt", "steps", "seed")}
    used["system"] = Path(args.system).name
    used |= args.knobs
    used["rods"] = len(system["pairs"])
    used["error_at"] = reference.step * args.dt
    used["reference_uncertainty"] = reference.uncertainty if reference.q is not None else None
    used["results"] = {name: rounded_row(row) for name, row in results.items()}
    used["choice"] = advice.as_metrics(choice)
    return json.dumps(used, indent=2, sort_keys=True, allow_nan=False) + "\n"


def rounded_row(row):
    """A row of the results, whose numbers have as many decimals as DECIMALS says."""
    return {key: rounded(x, DECIMALS.get(key, 12)) for key, x in row.items()}


def rounded(x, digits):
    """A number, or each of a list, with so many decimals, None if it is not finite; else x."""
    if isinstance(x, list):
        return [rounded(y, digits) for y in x]
    if isinstance(x, float):
        return round(float(x), digits) if math.isfinite(x) else None
    return x


def look(recording):
    """A line with the command that shows a recording: in a browser where there is no display."""
    words = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1"]  # no other machine is to see it
    if sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & {*os.environ}:
        words += ["--web-viewer", "--new", "--web-viewer-port", "0"]  # another may be open
    return f"look: {shlex.join([*words, str(recording)])}"
