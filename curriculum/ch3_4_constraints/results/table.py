"""The table that a run prints: numbers with units, and a sentence for each mark."""

import math
import textwrap

import numpy as np

from curriculum.ch3_4_constraints.mechanics.stability import grows, stability_limit

JUMP = 0.1  # of m g L: energy may change by so much in a step without a mark
LONG = 0.12  # of its time scale: 0.15 sqrt(L/g) makes the double's energy jump by 12 % in project
LEVERAGE = 10.0  # times all loads: such a force needs rods nearly in line, or is no load's
UNSURE = 0.1  # of such a force: so much of it may change as rods are put right, without a mark
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


def say(text):
    """Print a sentence, in lines of 80 columns; a path is one word."""
    whole = {"break_on_hyphens": False, "break_long_words": False}
    print("\n".join(textwrap.wrap(text, 80, subsequent_indent="  ", **whole)))


def title(args, runs):
    """Print what was run, and how."""
    what = f"integrated {args.system} ({args.integrator}) for {args.steps} steps of {args.dt:g} s"
    print(f"{what} -> {args.steps * args.dt:.2f} s of sim time")
    how = "; ".join(dict.fromkeys(run.step.how for run in runs.values()))
    say(f"seed {args.seed}; {how}")


def error(x, reference):
    """A distance from the reference in words, no finer than the reference is known."""
    if x is None:
        return "-"
    known = max(reference.uncertainty, 1e-12)
    return f"< {length(known)}" if x < known else length(x)


def notes(args, runs, results, reference, step_fn):
    """Print a sentence for each mark, and for what is missing; `step_fn` took the steps."""
    for name, row in results.items():
        if runs[name].lost:
            continue
        if row["stopped"]:
            say(f"{name}: {row['stopped']}")
        for why in doubts(row, runs[name]):
            say(f"* {name}: {why}")
    times = [run.time_scale for run in runs.values() if not run.lost]
    quickest = min(times, default=math.inf)
    if args.dt > LONG * quickest:
        when = f"in {quickest:.2g} s the motion changes by its own size"
        say(f"a step of {args.dt:g} s is long: {when}")
    if reference.q is None:
        say(f"- no reference: {reference.why}")
    if args.stabilization == "all" and args.integrator != "semi_implicit":
        say(f"impulse is left out: it is not made for {args.integrator}")
    if "baumgarte" in results and grows(step_fn, args.dt * args.baumgarte):
        limit = stability_limit(step_fn)
        say(f"baumgarte: dt w = {args.dt * args.baumgarte:.3g} is past its limit {limit:.3g}")


def verdict(results, runs):
    """Print how much better baumgarte holds the rods than none, where a run has both."""
    both = [results[name] for name in ("none", "baumgarte") if name in results]
    if len(both) < 2 or any(row["stopped"] for row in both):
        return
    none, baumgarte = (row["max_violation"] for row in both)
    ok = none > 3.0 * baumgarte
    print(f"largest rod error, none > 3 x baumgarte: {'as expected' if ok else 'UNEXPECTED'}")


def doubts(row, run):
    """What makes a row look better than it is, in sentences."""
    found = []
    force, load = row["tension_max"], run.load
    # a force of `leverage` loads comes from an angle of 1 / leverage, which rods that are off by a
    # share x of their length change by leverage x, or if they are in line by leverage^2 x of itself
    leverage, off = force / load, row["max_violation"] / run.shortest
    if leverage > LEVERAGE and leverage * leverage * off > UNSURE:
        found.append(
            f"a rod's force reaches {force:.2g} N, {leverage:.2g} times all weights and "
            f"centripetal loads: rods are off by {length(row['max_violation'])}, and those that "
            "all but repeat one another work against each other"
        )
    if row["energy_step_max"] > JUMP:
        share = per_cent(row["energy_step_max"])
        jumps = np.abs(np.diff(run.energies))
        first = np.argmax(jumps * row["energy_step_max"] > JUMP * np.max(jumps))
        off = run.violations[first]
        before = f"; rods had left the constraint by {length(off)}" if off > 1e-9 else ""
        found.append(f"energy jumps by {share} of m g L in one step{before}")
    return found
