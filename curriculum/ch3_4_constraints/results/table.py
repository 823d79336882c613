"""The table that a run prints: numbers with units, and a sentence for each mark."""

import math
import textwrap

import numpy as np

from curriculum.ch3_4_constraints.mechanics.outcome import MOVES
from curriculum.ch3_4_constraints.mechanics.stability import grows, stability_limit

JUMP = 0.1  # of m g L: energy may change by so much in a step without a mark
LONG = 0.12  # of its time scale: 0.15 sqrt(L/g) makes the double's energy jump by 12 % in project
LEVERAGE = 10.0  # times all loads: such a force needs rods nearly in line, or is no load's
UNSURE = 0.1  # of such a force: so much of it may change as rods are put right, without a mark
THREE_DIGITS = 0.005  # of a force: if it may be larger by no more between steps, it has them
TWO_DIGITS = 0.05
SANE = 0.5  # of rods, and of m g L: a run that is off by more tells nothing of the motion
ROUNDING = 1e-9  # of the shortest rod: errors below are not of a method
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "nm": 1e-9, "pm": 1e-12}  # in m


def length(x):
    """Metres x in two digits and a unit, 0.384 as "38 cm"; below project's aim "< 1 pm"."""
    if x < 1e-12:
        return "< 1 pm"
    x = in_digits(x, 2)
    unit = next(unit for unit, size in UNITS.items() if x >= size)
    return f"{x / UNITS[unit]:g} {unit}"


def per_cent(share):
    """A share in per cent, two digits."""
    return f"{in_digits(100.0 * share, 2):g} %"


def in_digits(x, many):
    """The number x, rounded to so many digits."""
    return float(f"{x:.{many}g}")


def force(row):
    """The largest force of a row in N, with as many digits as it is sure to have between steps."""
    most = row["tension_max"]
    if most is None:
        return "-"
    if row["tension_between"] > TWO_DIGITS:
        return f"over {significant(most, 2, down=True)}"
    return significant(most, 3 if row["tension_between"] < THREE_DIGITS else 2)


def significant(x, digits, down=False):
    """x in so many digits, 1570 or 1.2e5, rounded or, if `down`, cut off."""
    if x <= 0.0:
        return "0"
    places = digits - 1 - math.floor(math.log10(x))  # after the point
    unit = 10.0**-places
    count = math.floor(x / unit * (1.0 + 1e-12)) if down else round(x / unit)
    if x >= 1e5:
        return f"{count * unit:.{digits}g}".replace("e+0", "e")
    return f"{count * unit:.{max(0, places)}f}"


def largest_force(pulls):
    """What metrics.json says of the forces of rods, pulls (steps + 1, C) in N; NaN is unknown.

    `tension_max`: the largest at the steps whose forces are known, None if there is none.
    `tension_between`: by about what share of it a force between the steps may be larger. There a
    peak is taken for a parabola, and what is unknown for a straight line from either side.
    """
    hardest = np.max(np.abs(pulls), axis=1)
    known = np.flatnonzero(np.isfinite(hardest))
    if not len(known):
        return {"tension_max": None, "tension_between": None}
    hardest = hardest[known]
    most = np.max(hardest)
    gaps = np.diff(known)  # 1 from step to step
    rises = np.diff(hardest)
    top = hardest.copy()
    top[1:-1] += np.maximum(0.0, rises[:-1] - rises[1:]) / 8.0  # over the mean of its neighbours
    for k in np.flatnonzero(gaps > 1):
        before = rises[k - 1] if k > 0 else 0.0
        after = -rises[k + 1] if k + 1 < len(rises) else 0.0
        slope = max(0.0, before, after)
        top[k] = max(top[k], max(hardest[k], hardest[k + 1]) + slope * gaps[k])
    between = np.max(top) / most - 1.0 if most > 0.0 else 0.0
    return {"tension_max": most, "tension_between": between}


def say(text):
    """Print a sentence, in lines of 80 columns; a path is one word."""
    whole = {"break_on_hyphens": False, "break_long_words": False}
    print("\n".join(textwrap.wrap(text, 80, subsequent_indent="  ", **whole)))


def title(args, runs):
    """Print what was run, and how."""
    seconds = args.steps * args.dt
    span = f"{seconds:.2f}" if seconds >= 1.0 else f"{seconds:.3g}"
    what = f"integrated {args.system} ({args.integrator}) for {args.steps} steps of {args.dt:g} s"
    print(f"{what} -> {span} s of sim time")
    how = "; ".join(dict.fromkeys(run.step.how for run in runs.values()))
    say(f"seed {args.seed}; {how}")


def error(x, reference):
    """A distance from the reference in words, no finer than the reference is known."""
    if x is None:
        return "-"
    known = max(reference.uncertainty, 1e-12)
    return f"< {length(known)}" if x < known else length(x)


def energy(row):
    """The largest change of energy, where it is an error."""
    return per_cent(row["energy_rel_max"]) if row["conserves"] else "-"


def notes(args, runs, results, reference, step_fn):
    """Print a sentence for each mark, for what is missing, and on baumgarte beside none.

    `step_fn` took the steps.
    """
    stiffness = args.dt * args.baumgarte
    is_past = "baumgarte" in results and grows(step_fn, stiffness)
    for name, row in results.items():
        if not runs[name].lost:
            say_of_row(name, row, runs[name])
        elif name != "baumgarte" or not is_past:
            say_gain(name, row, runs[name])
    shown = [force(row) for name, row in results.items() if not runs[name].lost]
    if any(x.startswith("over") for x in shown):
        say("over: the largest force at the steps; between them it may be larger")
    if not all(row["conserves"] for row in results.values()):
        say("- energy off: external_force does work that energy does not count")
    times = [run.time_scale for name, run in runs.items() if holds(results[name], run)]
    quickest = min(times, default=math.inf)
    if args.dt > LONG * quickest:
        when = f"in {quickest:.2g} s the motion changes by its own size"
        say(f"a step of {args.dt:g} s is long: {when}")
    if reference.q is None:
        say(f"- no reference: {reference.why}")
    if args.stabilization == "all":
        for name in args.left_out:
            say(f"{name} is left out: it is not made for {args.integrator}")
    if is_past:
        say_limit(stiffness, stability_limit(step_fn))
    verdict(results, runs)


def say_of_row(name, row, run):
    """Print a sentence for each mark of a row."""
    if row["stopped"]:
        say(f"{name}: {row['stopped']}")
    if row["tension_max"] is None:
        say(f"- {name}: its rods' forces hang on the last digits of places")
    for why in doubts(row, run):
        say(f"* {name}: {why}")


def say_limit(stiffness, limit):
    """Print by how much dt w is past its limit; at the limit itself an error stays as it is."""
    digits = 3 if stiffness > 1.01 * limit else 6
    if stiffness > limit * (1.0 + 1e-6):
        found = f"dt w = {stiffness:.{digits}g} is past its limit {limit:.{digits}g}"
        say(f"baumgarte: {found}")


def holds(row, run):
    """Whether a run is near enough to a motion of rods to tell how quick that is."""
    is_sane = row["energy_rel_max"] < SANE or not row["conserves"]
    return not run.lost and row["max_violation"] < SANE * run.shortest and is_sane


def change_of_energy(row, run):
    """How much energy a run has gained in each state, (steps + 1,) in parts of m g L."""
    change = run.energies - run.energies[0]
    most = np.max(np.abs(change))
    return change * (row["energy_rel_max"] / most) if most > 0.0 else change


def say_gain(name, row, run):
    """Print how a run that was lost had gained energy before, if it had."""
    gain = change_of_energy(row, run)
    if not row["conserves"] or np.max(gain) < JUMP:
        return
    k = int(np.argmax(gain > min(1.0, 0.999 * np.max(gain))))
    before = f"its energy had grown by {per_cent(gain[k])} of m g L at {k * run.dt:.3g} s"
    say(f"{name}: {before}")


def verdict(results, runs):
    """Print how much better baumgarte holds the rods than none, where a run has both."""
    if not {"none", "baumgarte"} <= results.keys():
        return
    none = results["none"]
    baumgarte = results["baumgarte"]
    if none["stopped"] or baumgarte["stopped"]:
        return
    run = runs["baumgarte"]
    worst = none["max_violation"]
    kept = baumgarte["max_violation"]
    if np.max(np.abs(run.q - run.q[0])) < MOVES * run.shortest:
        say("largest rod error: nothing moves, so none and baumgarte have nothing to hold")
    elif max(worst, kept) < ROUNDING * run.shortest:
        say("largest rod error: none and baumgarte differ by rounding only")
    elif worst > 3.0 * kept:
        times = f"{in_digits(worst / kept, 2):g} x" if kept > 0.0 else "which has none"
        say(f"largest rod error, none > 3 x baumgarte: as expected ({times})")
    else:
        ratio = f"largest rod error, none / baumgarte: {in_digits(worst / kept, 2):g}"
        say(f"{ratio}; {why_so_little(baumgarte, run)}")


def why_so_little(row, run):
    """Why baumgarte holds rods little better than none, or worse."""
    gain = np.max(change_of_energy(row, run))
    if row["conserves"] and gain > JUMP:
        return f"baumgarte has gained {per_cent(gain)} of m g L in energy"
    return "with this w, step and time baumgarte holds rods no better, or not by much"


def doubts(row, run):
    """What makes a row look better than it is, in sentences."""
    found = []
    most = row["tension_max"] or 0.0
    # a force of `leverage` loads comes from an angle of 1 / leverage, which rods that are off by a
    # share x of their length change by leverage x, or if they are in line by leverage^2 x of itself
    leverage = most / run.loads if run.loads > 0.0 else 0.0  # weightless and at rest
    off = row["max_violation"] / run.shortest
    if leverage > LEVERAGE and leverage * leverage * off > UNSURE:
        found.append(
            f"a rod's force reaches {significant(most, 2)} N, {leverage:.2g} times all weights, "
            f"loads and centripetal loads; rods are off by {length(row['max_violation'])}, and "
            "right ones might need far less"
        )
    jumps = np.abs(np.diff(change_of_energy(row, run)))
    highest = np.max(jumps, initial=0.0)
    if row["conserves"] and highest > JUMP:
        off = run.violations[np.argmax(jumps > JUMP)]  # before the first
        before = f"; rods had left the constraint by {length(off)}" if off > 1e-9 else ""
        found.append(f"energy jumps by {per_cent(highest)} of m g L in one step{before}")
    return found
