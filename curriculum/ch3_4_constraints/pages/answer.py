"""What Python found, in the words of the page: the run's figures, and which setting is enough."""

import shlex
from html import escape

from curriculum.ch3_4_constraints.mechanics.choice import chosen, shortened
from curriculum.ch3_4_constraints.results import table
from curriculum.ch3_4_constraints.results.advice import (
    later,
    milliseconds,
    name_of,
    spoken,
    thousands,
)

TOLERANCES = 1e-2, 1e-3, 1e-4, 1e-6  # m: those that are offered, if any setting meets them
NOTHING = "\N{EN DASH}"


def of_the_run(args, results, reference, scene):
    """How the run went: {blank of play.html: its HTML}."""
    rows = []
    for name, row in results.items():
        cells = [
            table.length(row["max_violation"]),
            table.length(row["final_violation"]),
            table.energy(row),
            table.error(row["error"], reference),
            NOTHING if row["operations"] is None else thousands(row["operations"]),
        ]
        if row["stopped"]:  # its figures are of a shorter time
            rows.append(html_row(name, scene, [escape(row["stopped"])], len(cells)))
        else:
            rows.append(html_row(name, scene, map(escape, cells)))
    why = f"No true motion to compare with: {reference.why}." if reference.q is None else ""
    return {
        "span": f"{args.steps * args.dt:.3g} s in steps of {milliseconds(args.dt)}",
        "at": escape(reference.at),
        "why": escape(why),
        "rows": "\n".join(rows),
    }


def at_first(args, choice, answers):
    """Which method and which step, as the page opens: {blank of play.html: its HTML}."""
    if choice is None:
        ask = command(args, {"--within": "1mm"})
        says = f"Which method, and which step? Ask <code>{escape(ask)}</code>"
        if args.within is not None:
            says = "Which method, and which step? The run found no answer, and said why."
        return {"says": says, "how": "", "holds": "", "ladder": ""}
    first = answers[spoken(choice.within)]
    return {
        **{key: first[key] for key in ("says", "how", "holds")},
        "ladder": ladder(choice, first["rows"]),
    }


def ladder(choice, rows):
    """The table of steps, with the rows that it has at first."""
    heads = [f'<th scope="col">{escape(x)}' for x in integrators(choice.settings)]
    return f"""<table id="ladder">
      <caption>The cheapest step that is enough for
        <span id="within">{escape(spoken(choice.within))}</span>, and the operations that a
        second of motion then takes. {escape(as_sentence(shortened(choice)))}</caption>
      <thead><tr><th scope="col">method{"".join(heads)}
      <tbody>{rows}
    </table>"""


def answers(args, choice, scene):
    """{tolerance: sentences and the rows of the table of steps, as HTML}: the page shows one.

    The tolerances are that of the run, and those of TOLERANCES that any setting meets. `steps`: of
    the run's integrator, those that are advised, in s.
    """
    if choice is None:
        return {}
    found = {}
    for within in sorted({*TOLERANCES, choice.within}, reverse=True):
        sure = choice.reference.uncertainty if is_known(choice) else 0.0  # m
        enough = chosen(choice.settings, compared(choice), within, sure)
        if enough or within == choice.within:
            rods = chosen(choice.settings, "rods", within)
            advised = [x for x in enough[:1] + rods[:1] if x.integrator == args.integrator]
            found[spoken(within)] = {
                "says": escape(cheapest(choice, within, enough)),
                "how": how(args, choice, within, enough),
                "holds": escape(rods_hold(choice, within, enough, rods)),
                "rows": "\n".join(ladder_rows(choice, within, enough, scene)),
                "steps": [table.in_digits(x.dt, 9) for x in advised],
            }
    return found


def compared(choice):
    """What a tolerance is of: places or, where nobody knows the true motion, rods."""
    return "error" if is_known(choice) else "rods"


def is_known(choice):
    return choice.reference.q is not None


def integrators(settings):
    return list(dict.fromkeys(x.integrator for x in settings))


def not_tried(choice):
    """Without which integrators settings were measured, in words; "" if with all."""
    return ", ".join(f"without {x}" for x in choice.untried)


def cheapest(choice, within, enough):
    """The cheapest setting that is enough and, beside it, that of each other integrator."""
    rods = f"rods for {choice.span:.3g} s"
    what = f"right to {spoken(within)} after {choice.error_at:.3g} s, {rods}"
    without = not_tried(choice)
    if without and within < choice.within:  # where they might be better
        what = f"{without}, {what}"
    what = what[0].upper() + what[1:]
    if not is_known(choice):
        what = f"{as_sentence(choice.reference.why)} Rods {within_for(choice, within)}"
    if not enough:
        shortest = min(x.dt for x in choice.settings)
        return f"{what}: nothing is, down to steps of {milliseconds(shortest)}."
    best = enough[0]
    parts = [f"{what}: {name_of(best)}"]
    for integrator in integrators(choice.settings):
        mine = [x for x in enough if x.integrator == integrator]
        if not mine:
            parts.append(f"with {integrator}, nothing that was tried")
        elif integrator != best.integrator:
            times = table.in_digits(mine[0].operations / best.operations, 2)
            step = f"{mine[0].method} at {milliseconds(mine[0].dt)}"
            parts.append(f"with {integrator}, {step}, for {times:g} times the operations")
    return "; ".join(parts) + "."


def how(args, choice, within, enough):
    """The command that runs the answer; and where more would be tried, the flag: HTML."""
    parts = []
    if enough:
        best = enough[0]
        changed = {
            "--integrator": best.integrator,
            "--dt": f"{best.dt:.9g}",
            "--steps": str(max(1, round(choice.whole / best.dt))),
        }
        parts.append(f"To run it: <code>{escape(command(args, changed))}</code>")
    if within != choice.within:
        tried = f"Of the steps tried for {spoken(choice.within)}"
        without = not_tried(choice)
        tried += f", {without}" if without else ""
        typed = spoken(within).replace(" ", "").replace("µ", "u")
        parts.append(f"{tried}: <code>--within {typed}</code> tries more.")
    return "<br>".join(parts)


def rods_hold(choice, within, enough, rods):
    """The cheapest setting that holds the rods, where that is not the answer already."""
    if not is_known(choice) or not rods or rods[0] in enough[:1]:
        return ""
    x = rods[0]
    parts = [f"If rods alone matter, {within_for(choice, within)}: {name_of(x)}"]
    if x.error is not None and x.error > within:
        parts.append(f"but places are {table.length(x.error)} off after {choice.error_at:.3g} s")
    if x.energy is not None:
        parts.append(f"its energy is off by {table.per_cent(x.energy)}")
    return "; ".join(parts) + "."


def within_for(choice, within):
    return f"within {spoken(within)} for {choice.span:.3g} s"


def ladder_rows(choice, within, enough, scene):
    """A row a method: under each integrator the cheapest step that is enough, and what it costs."""
    for method in dict.fromkeys(x.method for x in choice.settings):
        cells = []
        for integrator in integrators(choice.settings):
            tried = [x for x in choice.settings if (x.integrator, x.method) == (integrator, method)]
            cell = escape(in_words(tried, within, enough, compared(choice)))
            is_best = enough and enough[0] in tried
            cells.append(f"<b>{cell}</b>" if is_best else cell)
        yield html_row(method, scene, cells)


def in_words(tried, within, enough, key):
    """The one that is enough, of those tried; or how far off the shortest step still is."""
    if not tried:
        return NOTHING
    for setting in enough:
        if setting in tried:
            return f"{milliseconds(setting.dt)}: {thousands(setting.operations)}"
    last = min(tried, key=lambda x: x.dt)
    if last.lost:
        when, _, why = last.lost.partition(": ")
        return f"lost {when} in steps of {milliseconds(last.dt)}: {why}"
    if getattr(last, key) <= within and last.rods <= within:
        return f"perhaps {milliseconds(last.dt)}: no shorter step was tried"
    off = f"{table.length(getattr(last, key))} off at {milliseconds(last.dt)}"
    return off + later(last, within) if key == "error" and last.error <= within else off


def html_row(method, scene, cells, wide=1):
    """A row of a table: a method in its colour, then cells of HTML, each so many columns wide."""
    color = scene["colors"].get(method, 0)
    wide = f' colspan="{wide}"' if wide > 1 else ""
    cells = "".join(f"<td{wide}>{cell}" for cell in cells)
    return f'<tr><th scope="row" class="m{color}">{escape(method)}{cells}'


def as_sentence(text):
    """A clause as a sentence; "" of ""."""
    return f"{text[0].upper()}{text[1:]}." if text else ""


def command(args, changed):
    """The command of this run with some flags changed, {flag: value}.

    It is for all methods, and writes where a run writes if nothing is said.
    """
    new = {"--out", "--within", "--stabilization", *changed}
    if "--steps" in new:
        new.add("--smoke")
    kept = []
    words = iter(args.command)
    for word in words:
        flag, has_value, _ = word.partition("=")
        if flag not in new:
            kept.append(word)
        elif not has_value and flag != "--smoke":
            next(words, None)
    for flag, value in changed.items():
        kept += [flag, value]
    return shlex.join(kept)
