"""What Python found, in the words of the page: the run's figures, and the answer to --within."""

import math
from html import escape

from curriculum.ch3_4_constraints.rods.advice import advice, command, distance
from curriculum.ch3_4_constraints.rods.choice import TIMES
from curriculum.ch3_4_constraints.rods.truth import HORIZON
from curriculum.common import words

NOTHING = "-"
FINER = 16  # times shorter than the answer's longest steps are those of the true motion


def of_the_run(asked, results, truth, scene):
    """How the run went: {blank of play.html: its HTML}."""
    rows = []
    for name, row in results.items():
        energy = row["energy_rel_max"]
        operations = row["operations"]
        cells = [
            words.length(row["max_violation"]),
            words.length(row["final_violation"]),
            NOTHING if energy is None else words.per_cent(energy),
            distance(row["error"], truth),
            NOTHING if operations is None else words.amount(operations),
        ]
        wide = len(cells)
        if row["stopped"]:  # its figures are of a shorter time
            cells = [row["stopped"]]
        rows.append(html_row(name, name, scene, cells, wide))
    why = [f"The true motion is not known: {truth.why}."] if truth.q is None else []
    if not scene["conserves"]:
        why.append("external_force takes or gives energy, so a change of energy is no error.")
    return {
        "span": f"{asked.steps * asked.dt:.3g} s in steps of {words.milliseconds(asked.dt)}",
        "at": escape(truth.at),
        "why": escape(" ".join(why)),
        "energy": "energy off" if scene["conserves"] else "energy change",
        "rows": "\n".join(rows),
    }


def rungs(answer):
    """[(Rung, what it is beside its scheme)]: what the page can play, in the order of its table."""
    if answer is None:
        return []
    found = []
    for row in answer.rows:
        found += [(row.rung, ""), (row.twice, "twice as long")]
    if answer.rods:
        found.append((answer.rods.rung, "enough if only rods matter"))
    return found


def others(asked, answer):
    """The Schemes of an Answer whose integrator is not that of the run."""
    schemes = dict.fromkeys(rung.scheme for rung, _ in rungs(answer))
    return [scheme for scheme in schemes if scheme.integrator != asked.integrator]


def key(asked, scheme):
    """What a Scheme is called in the page's scene, where a method alone is of the integrator."""
    return scheme.method if scheme.integrator == asked.integrator else str(scheme)


def played(asked, answer):
    """What play.js knows of an Answer: a dict.

    `answer`: a dict for each row of the table; dt and for how long it was tried are in s. `truth`:
    what draws the true motion. `tick`: at which multiples of a time in s places are compared, as
    they were for the answer; it is a power of 2 times each step. `seconds`: up to when they were; 0
    if they are not known.
    """
    if not rungs(answer):
        return {"answer": [], "truth": None, "tick": None, "seconds": 0.0}
    rows = []
    for rung, what in rungs(answer):
        row = {"name": str(rung.scheme), "what": what, "scheme": key(asked, rung.scheme)}
        rows.append({**row, "dt": rung.dt, "span": rung.span})
    best = max((row.rung for row in answer.rows), key=lambda rung: rung.dt)
    seconds = answer.seconds or HORIZON
    return {
        "answer": rows,
        "truth": {"scheme": key(asked, best.scheme), "dt": best.dt / FINER},
        "tick": asked.dt * 2.0 ** math.ceil(math.log2(seconds / TIMES / asked.dt)),
        "seconds": answer.seconds,
    }


def of_the_answer(asked, answer, scene):
    """Which scheme and which step: {blank of play.html: its HTML}."""
    if answer is None:
        ask = asked.command({"--within": "1mm"})
        says = f"Which method, and which step? Ask <code>{escape(ask)}</code>"
        return {"says": says, "how": "", "notes": "", "answer": ""}
    said = advice(asked, answer)
    run = command(asked, answer) if answer.verdict else ""
    return {
        "says": escape(said.verdict),
        "how": f"To run it: <code>{escape(run)}</code>" if run else "",
        "notes": escape(" ".join([*(f"{x}." for x in said.missing), *said.notes])),
        "answer": table(said, scene) if said.lines else "",
    }


def table(said, scene):
    """The table of an answer, whose rows are played when they are touched."""
    heads = [*said.heads[:-1], ("work", "1000 op/s")]  # a time is of a machine
    heads = [f"{over}<span>{head}</span>" for over, head in heads]
    head = "".join(f'<th scope="col">{head}' for head in heads)
    wide = 1 + len(heads)
    rows = [answer_row(line, scene, wide - 1) for line in said.lines]
    if said.alone:
        rows.append(f'<tr><td colspan="{wide}">If only the rods must be right:')
        rows += [answer_row(line, scene, wide - 1) for line in said.alone]
    return f"""<table id="ladder">
      <thead><tr><th scope="col">scheme{head}
      <tbody>{"".join(rows)}
    </table>"""


def answer_row(line, scene, wide):
    """A row of the answer: its name and cells or, where it is lost, why, in one cell."""
    cells = line.cells
    if not line.rung.lost:
        cells = [*cells[:-1], words.amount(1e-3 * line.rung.operations, 2)]
    return html_row(line.name.strip(), line.rung.scheme.method, scene, cells, wide)


def html_row(name, method, scene, cells, wide):
    """A row of a table: a name in its method's colour, then cells; one alone is so many wide."""
    color = scene["colors"].get(method, 0)
    span = f' colspan="{wide}"' if len(cells) == 1 else ""
    row = f'<tr><th scope="row" class="m{color}">{escape(name)}'
    return row + "".join(f"<td{span}>{escape(cell)}" for cell in cells)
