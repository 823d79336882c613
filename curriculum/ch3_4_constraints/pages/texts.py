"""What stands in the texts and is not typed but made.

A block below one of these comments is made again by make.py, in the folder above:

    <!-- region: NAME -->              that region of constraints.py
    <!-- printed by: COMMAND -->       what a command that starts with "python" prints
    <!-- printed by: lines above -->   what the last block of Python prints; those of one text run
                                       in order and share their names, as in a notebook
    <!-- table: methods -->            a row for each method: its name, and its own words

The last is a table of Markdown, the others are fenced. A block that differs in nothing but times is
left as it is, and so is that of a study in SLOW unless it is asked for by name: whether it is still
true is seen by its --quick, whose lines are some of its own.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import constraints as c

ROOT = Path(__file__).parents[3]
HERE = Path(__file__).parents[1]
TEXTS = [ROOT / "README.md", *sorted(HERE.glob("**/README.md"))]
SLOW = {  # studies that take minutes, and the flag by which they draw their pictures, too
    "hard_cases": "",
    "speed_vs_error": "--picture",
}
COMMENT = r"<!-- (?P<kind>region|printed by|table): (?P<what>[^\n]+) -->\n"
FENCED = rf"^(?:{COMMENT})?```(?P<language>\w+)\n(?P<body>.*?)^```$"
TABLE = r"^<!-- table: (?P<rows>\w+) -->\n(?:\|[^\n]*\n)*"
BLOCK = re.compile(f"{FENCED}|{TABLE}", re.S | re.M)
NUMBER = r"\d[\d,.e+-]*"
TIMES = re.compile(rf"{NUMBER}(?= [uµ]s\b)|(?<=ratio ){NUMBER}|(?<=took ){NUMBER}(?= s\b)")
CELL = re.compile(rf"(?<= )({NUMBER}/{NUMBER}|-)(?=,? |,?$)")  # of speed_vs_error: ms / ms


def region(name):
    """The lines of a region of constraints.py, without its marks."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    return re.search(rf"# --- region: {name} ---\n(.*?)# --- endregion ---\n", source, re.S)[1]


def table(name):
    """A table of Markdown; there is one: methods."""
    rows = {"methods": c.make_methods()}[name]
    lines = ["| method | what it does |", "|---|---|"]
    lines += [f"| `{method}` | {row.words} |" for method, row in rows.items()]
    return "\n".join(lines) + "\n"


@lru_cache
def printed(command):
    """What a command prints, run in an empty folder. Raises OSError if it fails."""
    words = [sys.executable, *shlex.split(command)[1:]]
    if words[1] == "constraints.py":
        words[1] = str(ROOT / words[1])
    env = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run(words, cwd=folder, env=env, stdout=subprocess.PIPE, encoding="utf-8")
    if run.returncode:
        raise OSError(f"`{command}` has failed: see above")
    return run.stdout


def printed_by_study(command, name):
    """What a slow study prints; it draws its pictures in the same run."""
    return printed(f"{command} {SLOW[name]}")


def study_of(command):
    """The name of the study that a command runs; None if it runs none."""
    found = re.search(r"\.studies (\w+)", command)
    return found and found[1]


def commands(text, study):
    """Those of a text that run a study."""
    found = [what for _, what, _, _, _ in BLOCK.findall(text)]
    return [what for what in found if study_of(what) == study]


def lines_without_times(text):
    """The lines of a block without what belongs to the machine, and without its columns' widths.

    That is what TIMES finds, the last column of a table whose head ends in "us", and, of a table
    of times to an error, its CELLs and the sentences on who was quickest.
    """
    lines = []
    width = None  # of a table whose last column is of times
    cells = False  # whether this is a table of times to an error
    for line in text.splitlines():
        if re.search(r"\s[uµ]s$", line):
            width = len(line)
        elif len(line) == width:
            line = re.sub(f"{NUMBER}$", "", line)
        cells = cells or "ms of computing" in line
        if cells and line.startswith("to "):
            continue
        if cells:
            line = CELL.sub("", line)
        lines.append(" ".join(TIMES.sub("", line).split()))
    return lines


def differs(old, new):
    """Whether two bodies of a block differ in more than times."""
    return lines_without_times(old) != lines_without_times(new)


def filled(text, again=()):
    """The text with each of its blocks made anew; its Python is run.

    Blocks of slow studies are left as they are, but for those in `again`. Raises OSError, which
    names the line, if a block cannot be made.
    """
    space = {}
    outputs = []

    def run(match):
        try:
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(match["body"], space)
        except Exception as why:
            line = text.count("\n", 0, match.start()) + 1
            raise OSError(f"the Python from line {line} on: {type(why).__name__}: {why}") from why
        outputs.append(output.getvalue())

    def fill(match):
        kind, what, language, body, rows = match.groups()
        if rows:
            return f"<!-- table: {rows} -->\n{table(rows)}"
        if kind is None and language == "python":
            run(match)
        if kind is None:
            return match[0]
        new = output_of(what, body, outputs, again) if kind == "printed by" else region(what)
        return f"<!-- {kind}: {what} -->\n```{language}\n{new.rstrip()}\n```"

    return BLOCK.sub(fill, text)


def output_of(what, body, outputs, again):
    """What a block says that it prints; its body, if that differs in nothing but times.

    `outputs` are those of the text's Python so far, and `again` the slow studies to be run.
    """
    study = study_of(what)
    if what == "lines above":
        new = outputs[-1]
    elif study in SLOW and study not in again:
        return body
    elif study in SLOW:
        new = printed_by_study(what, study)
    else:
        new = printed(what)
    return new if differs(body, new.rstrip()) else body


def is_outdated(text, study):
    """Whether a slow study's --quick prints a line, times aside, that its block has not."""
    for _, what, _, body, _ in BLOCK.findall(text):
        if study_of(what) == study:
            quick = printed(f"{what} --quick")
            lines = [x for x in lines_without_times(quick) if not x.startswith("coarse")]
            return not {*lines} <= {*lines_without_times(body)}
    return False
