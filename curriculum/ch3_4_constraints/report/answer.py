"""The answer to --within: which integrator, which method, which step."""

from curriculum.ch3_4_constraints.report.table import aligned, say
from curriculum.ch3_4_constraints.rods.advice import advice, command
from curriculum.ch3_4_constraints.rods.choice import Answer, choose
from curriculum.ch3_4_constraints.rods.run import moves
from curriculum.ch3_4_constraints.rods.truth import why_unknown
from curriculum.common import cli
from curriculum.common.tracing import Untraceable


def find_answer(asked, runs, truth):
    """The Answer to a Request whose runs are {method: Run}; it may say why there is none."""
    why = why_unknown(runs.values())
    if not why and truth.q is not None and not moves(truth.q, asked.system):
        why = "nothing moves"
    if why:
        return Answer(asked.within, why)
    settings = asked.within, asked.dt, asked.steps, asked.knobs, truth, cli.progress
    try:
        return choose(asked.chapter, asked.system, *settings)
    except Untraceable as cause:
        return Answer(asked.within, f"steps cannot be compiled: {cause}")


def print_answer(asked, answer):
    """Print the verdict, a row for each integrator, and the command that runs it."""
    said = advice(asked, answer)
    print()
    say(said.verdict)
    lines = said.lines + said.alone
    if lines:
        heads = [("", ""), *said.heads]
        shown = aligned(heads, [[x.name, *x.cells] for x in lines])
        many = 2 + len(said.lines)
        print("\n".join(shown[:many]))
    for text in said.missing:
        say(text)
    if said.alone:
        print("If only the rods must be right:")
        print("\n".join(shown[many:]))
    for text in said.notes:
        say(text)
    if answer.verdict:
        say(f"Run it: {command(asked, answer)}", " \\")


def as_metrics(answer):
    """What metrics.json says of an Answer. It has no times of this machine."""
    return {
        "within": answer.within,
        "whole": answer.whole,
        "places_to": answer.seconds,
        "uncertainty": answer.uncertainty,
        "why": answer.why or None,
        "rows": [as_row(row) for row in answer.rows],
        "missing": [
            {"integrator": x.integrator, "shortest": x.shortest, "best": as_rung(x.best)}
            for x in answer.missing
        ],
        "rods": as_row(answer.rods) if answer.rods else None,
    }


def as_row(row):
    """A Row of an Answer, as metrics.json has it: the first is the verdict."""
    return {**as_rung(row.rung), "ends": row.ends, "twice": as_rung(row.twice)}


def as_rung(rung):
    """A Rung, as metrics.json has it."""
    found = rung._asdict()
    scheme = found.pop("scheme")
    return {"integrator": scheme.integrator, "method": scheme.method, **found}
