"""What Python found, in the words of the page: the run's figures, and which setting is enough."""

import shlex
from html import escape

from curriculum.ch3_4_constraints.results import table

TOLERANCES = {"1 cm": 1e-2, "1 mm": 1e-3, "0.1 mm": 1e-4, "1 µm": 1e-6}  # m
NOTHING = "\N{EN DASH}"
TIE = 1.05  # times the work, for
BETTER = 0.1  # of the error: that comes first


def of_the_run(args, results, reference, scene):
    """How the run went: {blank of play.html: its HTML}."""
    rows = []
    for name, row in results.items():
        operations = row.get("operations", scene["operations"][name] / args.dt)
        cells = [
            table.length(row["max_violation"]),
            table.length(row["final_violation"]),
            table.per_cent(row["energy_rel_max"]) if scene["conserves"] else NOTHING,
            table.error(row["error"], reference),
            count(operations),
        ]
        if row["stopped"]:  # its figures are of a shorter time
            rows.append(html_row(name, scene, [row["stopped"]], len(cells)))
        else:
            rows.append(html_row(name, scene, cells))
    why = f"No true motion to compare with: {reference.why}." if reference.q is None else ""
    return {
        "span": f"{args.steps * args.dt:.3g} s in steps of {ms(args.dt)}",
        "at": escape(reference.at),
        "why": escape(why),
        "rows": "\n".join(rows),
    }


def at_first(args, choice, answers):
    """Which method and which step, as the page opens: {blank of play.html: its HTML}."""
    if choice is None:
        says = f"Which method, and which step? Ask <code>{escape(command(args))}</code>"
        return {"says": says, "holds": "", "ladder": ""}
    first = answers[name_of(choice["within"])]
    table = ladder(choice, first["rows"])
    return {"says": escape(first["says"]), "holds": escape(first["holds"]), "ladder": table}


def ladder(choice, rows):
    """The table of steps, with the rows that it has at first."""
    tolerance = name_of(choice["within"])
    shortened = as_sentence(choice["shortened"])
    heads = "".join(f'<th scope="col">{escape(x)}' for x in integrators(choice["settings"]))
    return f"""<table id="ladder">
      <caption>The longest step that is enough for <span id="within">{escape(tolerance)}</span>,
        and the operations that a second of motion then takes. {escape(shortened)}</caption>
      <thead><tr><th scope="col">method{heads}
      <tbody>{rows}
    </table>"""


def answers(choice, scene):
    """{tolerance: sentences, and the rows of the table of steps}, of which the page shows one.

    The tolerances are that of the run, and those of TOLERANCES that any setting meets.
    """
    if choice is None:
        return {}
    tolerances = TOLERANCES | {name_of(choice["within"]): choice["within"]}
    found = {}
    for name in sorted(tolerances, key=tolerances.get, reverse=True):
        within = tolerances[name]
        enough = cheapest_first(choice["settings"], measure(choice), within)
        if enough or within == choice["within"]:
            rods = cheapest_first(choice["settings"], "rods", within)
            found[name] = {
                "says": cheapest(choice, name, enough),
                "holds": "" if choice["why"] else rods_hold(choice, name, rods),
                "rows": ladder_rows(choice, enough, scene),
            }
    return found


def measure(choice):
    """What a tolerance is of: places or, where nobody knows the true motion, rods."""
    return "rods" if choice["why"] else "error"


def cheapest_first(settings, key, within):
    """The settings that are right to `within` m, and so is the next shorter step, cheapest first.

    Of two that cost about the same, one with a tenth of the error comes first.
    """
    enough = []
    for setting in settings:
        shorter = [x for x in of(settings, setting) if x["dt"] < setting["dt"]]
        next_shorter = max(shorter, key=lambda x: x["dt"], default=setting)
        if is_right(setting, key, within) and is_right(next_shorter, key, within):
            enough.append(setting)
    enough.sort(key=lambda x: x["operations"])
    found = []
    while enough:
        first = enough[0]
        for other in enough[1:]:
            about_the_same = other["operations"] < TIE * first["operations"]
            if about_the_same and other[key] <= BETTER * first[key]:
                first = other
        enough.remove(first)
        found.append(first)
    return found


def is_right(setting, key, within):
    return setting["lost"] is None and setting[key] is not None and setting[key] <= within


def of(settings, setting):
    """Those of the same integrator and method."""
    same = setting["integrator"], setting["method"]
    return [x for x in settings if (x["integrator"], x["method"]) == same]


def integrators(settings):
    return list(dict.fromkeys(x["integrator"] for x in settings))


def cheapest(choice, tolerance, enough):
    """The cheapest setting that is enough and, beside it, that of each other integrator."""
    what = f"Right to {tolerance} after {choice['error_at']:.3g} s"
    if choice["why"]:
        what = f"{as_sentence(choice['why'])} Rods within {tolerance} for {choice['span']:.3g} s"
    if not enough:
        shortest = min(x["dt"] for x in choice["settings"])
        return f"{what}: nothing is, down to steps of {ms(shortest)}."
    best = enough[0]
    parts = [f"{what}: {best['integrator']} with {best['method']} at {ms(best['dt'])}"]
    for integrator in integrators(choice["settings"]):
        mine = [x for x in enough if x["integrator"] == integrator]
        if not mine:
            parts.append(f"with {integrator}, nothing that was tried")
        elif integrator != best["integrator"]:
            cost = times(mine[0]["operations"] / best["operations"])
            parts.append(f"with {integrator}, {mine[0]['method']} at {ms(mine[0]['dt'])}, {cost}")
    return "; ".join(parts) + "."


def rods_hold(choice, tolerance, enough):
    """The cheapest setting that holds the rods."""
    if not enough:
        return ""
    best = enough[0]
    setting = f"{best['integrator']} with {best['method']} at {ms(best['dt'])}"
    return f"Rods alone stay within {tolerance} for {choice['span']:.3g} s: {setting}."


def ladder_rows(choice, enough, scene):
    """A row a method: under each integrator the longest step that is enough, and what it costs."""
    settings = choice["settings"]
    rows = []
    for method in dict.fromkeys(x["method"] for x in settings):
        cells = []
        for integrator in integrators(settings):
            tried = of(settings, {"integrator": integrator, "method": method})
            cells.append(longest(tried, enough, measure(choice)))
        rows.append(html_row(method, scene, cells))
    return "\n".join(rows)


def longest(tried, enough, key):
    """The longest step of those that is enough, in words; or how far off the shortest still is."""
    if not tried:
        return NOTHING
    good = [x for x in tried if x in enough]
    if good:
        best = max(good, key=lambda x: x["dt"])
        return f"{ms(best['dt'])}: {count(best['operations'])}"
    last = min(tried, key=lambda x: x["dt"])
    off = "lost" if last["lost"] else f"{table.length(last[key])} off"
    return f"{off} at {ms(last['dt'])}"


def html_row(method, scene, cells, wide=1):
    """A row of a table, that begins with a method in its colour; each cell is so many wide."""
    color = scene["colors"].get(method, 0)
    wide = f' colspan="{wide}"' if wide > 1 else ""
    cells = "".join(f"<td{wide}>{escape(cell)}" for cell in cells)
    return f'<tr><th scope="row" class="m{color}">{escape(method)}{cells}'


def command(args):
    """The command of this run, with --within; it writes where a run writes if nothing is said."""
    words = list(args.words)
    while "--out" in words:
        k = words.index("--out")
        del words[k : k + 2]
    words = [x for x in words if not x.startswith("--out=")]
    return shlex.join([*words, "--within", "1mm"])


def as_sentence(text):
    """A clause as a sentence; "" of None."""
    return f"{text[0].upper()}{text[1:]}." if text else ""


def name_of(within):
    """A tolerance in m in words."""
    for name, tolerance in TOLERANCES.items():
        if tolerance == within:
            return name
    return table.length(within)


def ms(dt):
    """A step in s in words."""
    return f"{1000.0 * dt:.3g} ms"


def count(operations):
    """So many in three digits: 27,200."""
    return f"{float(f'{operations:.3g}'):,.0f}"


def times(ratio):
    """So much work, of another's."""
    return f"for {float(f'{ratio:.2g}'):g} times the work"
