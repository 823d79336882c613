"""What Python found, in the words of the page: the run's figures, and which setting is enough."""

import shlex
from html import escape

from curriculum.ch3_4_constraints.mechanics.choice import chosen, shortened
from curriculum.ch3_4_constraints.results import table
from curriculum.ch3_4_constraints.results.advice import milliseconds, name_of, spoken, thousands

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
        says = f"Which method, and which step? Ask <code>{escape(command(args))}</code>"
        if args.within is not None:
            says = "Which method, and which step? The run found no answer, and said why."
        return {"says": says, "holds": "", "ladder": ""}
    first = answers[spoken(choice.within)]
    return {
        "says": escape(first["says"]),
        "holds": escape(first["holds"]),
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


def answers(choice, scene):
    """{tolerance: sentences, and the rows of the table of steps}, of which the page shows one.

    The tolerances are that of the run, and those of TOLERANCES that any setting meets.
    """
    if choice is None:
        return {}
    found = {}
    for within in sorted({*TOLERANCES, choice.within}, reverse=True):
        unsure = choice.reference.uncertainty if is_known(choice) else 0.0  # m
        enough = chosen(choice.settings, compared(choice), within - unsure)
        if enough or within == choice.within:
            rods = chosen(choice.settings, "rods", within)
            found[spoken(within)] = {
                "says": cheapest(choice, within, enough),
                "holds": rods_hold(choice, within, rods, scene),
                "rows": "\n".join(ladder_rows(choice, enough, scene)),
            }
    return found


def compared(choice):
    """What a tolerance is of: places or, where nobody knows the true motion, rods."""
    return "error" if is_known(choice) else "rods"


def is_known(choice):
    return choice.reference.q is not None


def integrators(settings):
    return list(dict.fromkeys(x.integrator for x in settings))


def cheapest(choice, within, enough):
    """The cheapest setting that is enough and, beside it, that of each other integrator."""
    what = f"Right to {spoken(within)} after {choice.error_at:.3g} s"
    if not is_known(choice):
        what = f"{as_sentence(choice.reference.why)} Rods {within_for(choice, within)}"
    if not enough:
        shortest = min(x.dt for x in choice.settings)
        return f"{what}: nothing is, down to steps of {milliseconds(shortest)}."
    best = enough[0]
    parts = [f"{what}: {name_of(best)}{later(best, within)}"]
    for integrator in integrators(choice.settings):
        mine = [x for x in enough if x.integrator == integrator]
        if not mine:
            parts.append(f"with {integrator}, nothing that was tried")
        elif integrator != best.integrator:
            times = float(f"{mine[0].operations / best.operations:.2g}")
            step = f"{mine[0].method} at {milliseconds(mine[0].dt)}{later(mine[0], within)}"
            parts.append(f"with {integrator}, {step}, for {times:g} times the work")
    return "; ".join(parts) + "."


def later(setting, within):
    """What becomes of rods that do not stay within it as long as they were followed."""
    return f" (its rods, {table.length(setting.rods)} off later)" if setting.rods > within else ""


def rods_hold(choice, within, enough, scene):
    """The cheapest setting that holds the rods, where that is not the answer already."""
    if not is_known(choice) or not enough:
        return ""
    says = f"If rods alone matter, {within_for(choice, within)}: {name_of(enough[0])}"
    off = f"; its energy is off by {table.per_cent(enough[0].energy)}" if scene["conserves"] else ""
    return f"{says}{off}."


def within_for(choice, within):
    return f"within {spoken(within)} for {choice.span:.3g} s"


def ladder_rows(choice, enough, scene):
    """A row a method: under each integrator the cheapest step that is enough, and what it costs."""
    for method in dict.fromkeys(x.method for x in choice.settings):
        cells = []
        for integrator in integrators(choice.settings):
            tried = [x for x in choice.settings if (x.integrator, x.method) == (integrator, method)]
            cell = escape(in_words(tried, enough, compared(choice)))
            is_best = enough and enough[0] in tried
            cells.append(f"<b>{cell}</b>" if is_best else cell)
        yield html_row(method, scene, cells)


def in_words(tried, enough, key):
    """The one that is enough, of those tried; or how far off the shortest step still is."""
    if not tried:
        return NOTHING
    for setting in enough:
        if setting in tried:
            return f"{milliseconds(setting.dt)}: {thousands(setting.operations)}"
    last = min(tried, key=lambda x: x.dt)
    if last.lost:
        return f"lost in steps of {milliseconds(last.dt)}"
    return f"{table.length(getattr(last, key))} off at {milliseconds(last.dt)}"


def html_row(method, scene, cells, wide=1):
    """A row of a table: a method in its colour, then cells of HTML, each so many columns wide."""
    color = scene["colors"].get(method, 0)
    wide = f' colspan="{wide}"' if wide > 1 else ""
    cells = "".join(f"<td{wide}>{cell}" for cell in cells)
    return f'<tr><th scope="row" class="m{color}">{escape(method)}{cells}'


def as_sentence(text):
    """A clause as a sentence; "" of ""."""
    return f"{text[0].upper()}{text[1:]}." if text else ""


def command(args):
    """The command of this run, with --within; it writes where a run writes if nothing is said."""
    typed = list(args.command)
    while "--out" in typed:
        k = typed.index("--out")
        del typed[k : k + 2]
    typed = [x for x in typed if not x.startswith("--out=")]
    return shlex.join([*typed, "--within", "1mm"])
