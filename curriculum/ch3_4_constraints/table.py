"""The table that a run prints: numbers with units, and a sentence for each mark."""

import math
import textwrap

import numpy as np

WIDTH = 80  # columns
JUMP = 0.1  # of m g L: energy may change by so much in a step without a mark
LONG = 0.1  # of sqrt(L/g): a step of 0.15 makes the double's energy jump by 12 % under project
RESIDUAL = 1e-3  # m/s^2: so much of what is asked may be left without a mark
JUDGED, ENOUGH = ("pendulum", "double", "triple"), 800  # systems and steps that show the drift
UNITS = (1.0, 1.0, "m"), (1e-3, 1e-2, "cm"), (1e-6, 1e-6, "um"), (1e-9, 1e-9, "nm")


def length(x):
    """Metres x in two digits and a unit, 0.384 as "38 cm"; below project's aim "< 1 pm"."""
    if x < 1e-12:
        return "< 1 pm"
    x = float(f"{x:.2g}")
    size, unit = next(((size, unit) for least, size, unit in UNITS if x >= least), (1e-12, "pm"))
    return f"{x / size:g} {unit}"


def per_cent(share):
    """A share in per cent, two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def wrapped(text, width=WIDTH):
    """A sentence in lines that fit a terminal; a path is one word."""
    whole = {"break_on_hyphens": False, "break_long_words": False}
    return textwrap.wrap(text, width, subsequent_indent="  ", **whole)


def say(text):
    """Print a sentence, in lines that fit a terminal."""
    print("\n".join(wrapped(text)))


def show(args, runs, results, reference, limits):
    """Print what was run, a row for each method, a sentence for each mark, and the verdict.

    `limits`: by integrator, the dt w up to which baumgarte is stable.
    """
    seconds = args.steps * args.dt
    print(
        f"integrated {args.system} ({args.integrator}) for {args.steps} steps of {args.dt:g} s"
        f" -> {seconds:.2f} s of sim time"
    )
    how = "; ".join(dict.fromkeys(run.how for run in runs.values()))
    say(f"seed {args.seed}; {how}")
    wide = max(10, *(len(name) + 1 for name in results))
    at = f"at {reference.step * args.dt:.3g} s"
    print(f"\n{'':{wide}}     rods off by      energy off  from reference    a step")
    print(f"{'method':{wide}}    worst     at end    of m g L  {at:>14}        us")
    notes = []
    for name, row in results.items():
        if row["stopped"]:
            say(f"{name:<{wide}}  {row['stopped']}{before_a_jump(row, runs[name])}")
            continue
        marks = [f"* {name}: {why}" for why in doubts(row, runs[name])]
        notes += marks
        worst, end = length(row["max_violation"]), length(row["final_violation"])
        energy, pace = per_cent(row["energy_rel_max"]), runs[name].pace
        print(
            f"{name + '*' * bool(marks):<{wide}}{worst:>9}  {end:>9}  {energy:>10}"
            f"  {reference.shown(row['error'], length):>14}"
            f"  {'-' if math.isnan(pace) else f'{pace:.3g}':>8}"
        )
    for note in notes:
        say(note)
    if args.dt > LONG * reference.time_scale:
        share = args.dt / reference.time_scale
        say(f"a step of {args.dt:g} s is long: it is {share:.2g} sqrt(L/g) of the shortest rod")
    if reference.q is None:
        say(f"- no reference: {reference.why}")
    elif any(run.q is None for run in runs.values()):
        say("- not known: this simulate returns no states")
    for name in args.left_out:
        say(f"{name} is left out: it is not made for {args.integrator}")
    limit = limits.get(args.integrator, math.inf)
    if "baumgarte" in results and args.dt * args.baumgarte > limit:
        say(f"baumgarte: dt w = {args.dt * args.baumgarte:.3g} is past its limit {limit:.3g}")
    if args.system in JUDGED and args.steps >= ENOUGH and args.baumgarte > 0.0:
        verdict(results)


def doubts(row, run):
    """What makes a row look better than it is, in words."""
    if (row["constraint_residual"] or 0.0) > RESIDUAL:
        left = f"{row['constraint_residual']:.2g} m/s^2"
        yield f"no tensions make an acceleration of {left} that its rods ask for"
    if row["energy_step_max"] > JUMP:
        share = per_cent(row["energy_step_max"])
        yield f"energy jumps by {share} of m g L in one step{before_a_jump(row, run)}"


def before_a_jump(row, run):
    """Where the energy jumps in a step, in words: how far its rods had been off before."""
    if row["energy_step_max"] <= JUMP:
        return ""
    jumps = np.abs(np.diff(run.energies))
    first = np.argmax(jumps * row["energy_step_max"] > JUMP * np.max(jumps))
    off = run.violations[first]
    return f"; rods had left the constraint by {length(off)}" if off > 1e-9 else ""


def verdict(results):
    """Print how much further `none` drifts than `baumgarte`, if both got to the end."""
    drift = {name: row["max_violation"] for name, row in results.items() if not row["stopped"]}
    if "baumgarte" in drift and drift.get("none", 0.0) > 1e-9:
        ratio = drift["none"] / max(drift["baumgarte"], 1e-12)
        words = "as expected, over 3" if ratio > 3.0 else "UNEXPECTED, not over 3"
        print(f"verdict: worst rod error, none / baumgarte = {ratio:.1f}: {words}")
