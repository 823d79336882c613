"""What a run with --within says: which method to take, at which step."""

import textwrap
from decimal import Decimal

from curriculum.ch3_4_constraints.mechanics import choice as choosing
from curriculum.ch3_4_constraints.mechanics.choice import ENERGY
from curriculum.ch3_4_constraints.mechanics.outcome import moves
from curriculum.ch3_4_constraints.mechanics.reference import MAX_RODS, why_unknown
from curriculum.ch3_4_constraints.results.table import in_digits, length, per_cent, say
from curriculum.common import cli
from curriculum.common.tracing import Untraceable

SHOWN = {"m": 0, "cm": -2, "mm": -3, "µm": -6, "nm": -9}  # to say a tolerance
LINES = 10  # at most
ROWS = (3, 2), (2, 2), (2, 1), (1, 1)  # settings for places and for rods: the first that fit
WIDTH = 80  # columns


def spoken(x):
    """A tolerance of x m as one would say it: 0.001 is "1 mm"."""
    for unit, power in SHOWN.items():
        size = in_digits(Decimal(x).scaleb(-power), 6)
        if size >= 1.0:
            return f"{size:g} {unit}"
    return f"{1e12 * x:.6g} pm"


def milliseconds(dt):
    return f"{in_digits(1e3 * dt, 3):g} ms"


def name_of(x):
    return f"{x.integrator} with {x.method} at {milliseconds(x.dt)}"


def thousands(x):
    """A number of operations, three digits of it: 149,000."""
    return f"{in_digits(x, 3):,.0f}"


def microseconds(x):
    """A time of x s in µs, three digits of it: 31.6 or 1,390."""
    x = in_digits(1e6 * x, 3)
    return f"{x:,.0f}" if x >= 1000.0 else f"{x:g}"


def place_row(x):
    """What is said of a setting that puts every place right."""
    return f"{name_of(x)}, {length(x.error)} off"


def rods_row(x):
    energy = "" if x.energy is None else f", energy {per_cent(x.energy)}"
    return f"{name_of(x)}, {length(x.rods)}{energy}"


def spread(settings, many):
    """As many of the settings, in their order: the first of each integrator, then the others."""
    first = {}
    for x in settings:
        first.setdefault(x.integrator, x)
    wanted = list(first.values())
    wanted += [x for x in settings if x not in wanted]
    return [x for x in settings if x in wanted[:many]]


def rungs(choice):
    """The longest and the shortest step, in words."""
    steps = [x.dt for x in choice.settings]
    return f"from {milliseconds(max(steps))} down to {milliseconds(min(steps))}"


def places_head(choice):
    right = f"right to {spoken(choice.within)} at {choice.error_at:.3g} s"
    if choice.reference.q is None:
        return f"Nobody knows which places are right: {choice.reference.why}"
    if choice.places:
        return f"Places {right}, rods for {choice.span:.3g} s, by operations a second of motion:"
    if choice.reference.uncertainty >= choice.within:
        return f"Places are known to {length(choice.reference.uncertainty)} only"
    known = [x for x in choice.settings if x.error is not None and not x.lost]
    if not known:
        return f"No step {rungs(choice)} is {right}: all are lost"
    best = min(known, key=lambda x: max(x.error, x.rods))
    nearest = f"nearest, {place_row(best)}{later(best, choice.within)}"
    return f"No step {rungs(choice)} has places {right} and holds its rods; {nearest}"


def later(x, within):
    """What becomes of rods that do not stay within it as long as they were followed."""
    return f"; rods, {length(x.rods)} later" if x.rods > within else ""


def rods_head(choice):
    span = f"for {choice.span:.3g} s"
    if choice.span < choice.whole:
        span = f"for the first {choice.span:.3g} s (all would take long)"
    if choice.rods_hold:
        keeps = choice.rods_hold[0].energy is not None and choice.rods_hold[0].energy <= ENERGY
        energy = f", energy to {per_cent(ENERGY)}" if keeps else ""
        return f"Rods right to {spoken(choice.within)} {span}{energy}:"
    return f"No step {rungs(choice)} holds the rods to {spoken(choice.within)} {span}"


def why_they_differ(choice):
    """Why right rods are not yet right places, with what was measured; None if they are."""
    if not choice.rods_hold:
        return None
    x = choice.rods_hold[0]
    if x.error is None or x.error <= choice.within:
        return None
    return (
        "Right rods are not yet right places: the first of these puts a particle "
        f"{length(x.error)} off. Rods keep it on its path; they do not say how far it has come."
    )


def lost_settings(choice):
    """What was lost at the shortest step, and why, and how many settings more; None if none."""
    lost = [x for x in choice.settings if x.lost]
    if not lost:
        return None
    x = min(lost, key=lambda x: x.dt)
    others = f"; and {len(lost) - 1} more" if len(lost) > 1 else ""
    return f"Lost: {name_of(x)}, {x.lost}{others}"


def left_out(choice):
    """What was left out, and why, in a sentence."""
    what = "; ".join(choice.left_out)
    return what[:1].upper() + what[1:]


def wrapped(lines):
    return sum(len(textwrap.wrap(x, WIDTH, subsequent_indent="  ")) for x in lines)


def sentences(choice):
    """[(setting or None, sentence)]: what is said of a Choice, in at most LINES lines."""
    lost = lost_settings(choice)
    tail = [why_they_differ(choice), lost, left_out(choice)]
    shorter = [x for x in tail if x and x != lost]  # metrics.json says of each what became of it
    tail = [x for x in tail if x]
    attempts = [(rows, tail) for rows in ROWS]
    attempts.append((ROWS[-1], shorter))
    for rows, end in attempts:
        found = said(choice, rows, end)
        if wrapped([line(x, text) for x, text in found]) <= LINES:
            break
    return found


def said(choice, rows, tail):
    """The sentences with so many rows for places and for rods, and with those of the tail."""
    found = [(None, places_head(choice))]
    found += [(x, place_row(x)) for x in spread(choice.places, rows[0])]
    found += [(None, rods_head(choice))]
    found += [(x, rods_row(x)) for x in spread(choice.rods_hold, rows[1])]
    return found + [(None, x) for x in tail]


def line(x, text, pace=" (0.000 µs)"):
    """A sentence, or of a setting x a row that begins with its operations and its pace."""
    return f"  {thousands(x.operations)}{pace}: {text}" if x else text


def give(chapter, args, system, runs, reference):
    """Print which settings are right to args.within, and return the Choice of them.

    None without the flag, or where there is no answer; then a line says why.
    """
    if args.within is None:
        return None
    why = why_unknown(runs.values())
    if not why and reference.q is not None and not moves(reference.q, system):
        why = "nothing moves"
    if not why and len(system["pairs"]) > MAX_RODS:
        why = f"it would take long for more than {MAX_RODS} rods"
    if not why:
        try:
            found = choosing.choose(chapter, system, args, reference, cli.progress)
        except Untraceable as cause:
            why = f"steps cannot be compiled: {cause}"
    if why:
        say(f"no answer to --within {spoken(args.within)}: {why}")
        return None
    for x, text in sentences(found):
        say(line(x, text, f" ({microseconds(x.seconds)} µs)" if x else ""))
    return found


def as_metrics(choice):
    """What metrics.json says of a Choice, if there is one."""
    if choice is None:
        return None
    said = [line(x, text, "").strip() for x, text in sentences(choice)]
    return choosing.as_metrics(choice, said)
