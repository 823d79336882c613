"""What stands in the texts and is not typed but made.

A block below one of these comments is made again by `python -m curriculum.make`:

    <!-- region: NAME -->              that region of the chapter's script
    <!-- printed by: COMMAND -->       a command that starts with "python", behind a "$", and what
                                       it prints
    <!-- printed by: lines above -->   what the last block of Python prints; those of one text run
                                       in order and share their names, as in a notebook
    <!-- passage: NAME -->             a passage of the chapter's, such as its gallery, up to
                                       <!-- end of passage -->

A passage is Markdown, the others are fenced. A file tests/said/NAME.txt has commands,
each behind a "$" and above what it prints, errors too. What differs in nothing but times is left as
it is.
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

ROOT = Path(__file__).parents[2]
COMMENT = r"<!-- (?P<kind>region|printed by): (?P<what>[^\n]+) -->\n"
FENCED = rf"^(?:{COMMENT})?```(?P<language>\w+)\n(?P<body>.*?)^```$"
END = "<!-- end of passage -->"
PASSAGE = rf"^<!-- passage: (?P<passage>\w+) -->\n.*?^{END}\n"
BLOCK = re.compile(f"{FENCED}|{PASSAGE}", re.S | re.M)
NUMBER = r"\d[\d,.e+-]*"
TIMES = re.compile(rf"{NUMBER}(?= [uµ]s\b)|(?<=ratio ){NUMBER}|{NUMBER}(?=/)")  # as in 13/2.5
HEAD = re.compile(r"\s[uµ]s(?:/s)?$")  # of a table whose last column is of times


def region(script, name):
    """The lines of a region of a script, without its marks."""
    source = script.read_text(encoding="utf-8")
    return re.search(rf"# --- region: {name} ---\n(.*?)# --- endregion ---\n", source, re.S)[1]


def ran(command, errors=None):
    """A command that was run in an empty folder: what it printed, and its status.

    `errors`: where its stderr goes.
    """
    words = [sys.executable, *shlex.split(command)[1:]]
    if (ROOT / words[1]).is_file():
        words[1] = str(ROOT / words[1])
    env = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"}
    with tempfile.TemporaryDirectory() as folder:
        streams = {"stdout": subprocess.PIPE, "stderr": errors, "encoding": "utf-8"}
        run = subprocess.run(words, cwd=folder, env=env, **streams)
    return run.stdout, run.returncode


@lru_cache
def printed(command):
    """What a command prints. Raises OSError if it fails."""
    found, status = ran(command)
    if status:
        raise OSError(f"`{command}` has failed: see above")
    return found


def study_of(command):
    """The name of the study that a command runs; None if it runs none."""
    found = re.search(r"\.studies (\w+)", command)
    return found and found[1]


def lines_without_times(text):
    """The lines of a block without what belongs to the machine, and without its columns' widths.

    That is what TIMES finds, and the last column of a table below a HEAD.
    """
    lines = []
    width = None  # of a table whose last column is of times
    for line in text.splitlines():
        if HEAD.search(line):
            width = len(line)
        elif len(line) == width:
            line = re.sub(f"{NUMBER}$", "", line)
        lines.append(" ".join(TIMES.sub("", line).split()))
    return lines


def differs(old, new):
    """Whether two bodies of a block differ in more than times."""
    return lines_without_times(old) != lines_without_times(new)


def filled(text, chapter, outputs=None):
    """The text with each of its blocks made anew; its Python is run.

    `chapter` is the Chapter whose script, passages and studies it has. Blocks of slow studies are
    left as they are, unless `outputs` {command: what it prints} has them. Raises OSError, which
    names the line, if a block cannot be made.
    """
    space = {}
    said = []
    outputs = outputs or {}

    def run(match):
        try:
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(match["body"], space)
        except Exception as why:
            line = text.count("\n", 0, match.start()) + 1
            raise OSError(f"the Python from line {line} on: {type(why).__name__}: {why}") from why
        said.append(output.getvalue())

    def new_body(kind, what, body):
        if kind == "region":
            return region(chapter.script, what)
        if what == "lines above":
            new = said[-1]
        elif study_of(what) in chapter.slow and what not in outputs:
            return body
        else:
            new = f"$ {what}\n{outputs.get(what) or printed(what)}"
        return new if differs(body, new.rstrip()) else body

    def fill(match):
        kind, what, language, body, passage = match.groups()
        if passage:
            return f"<!-- passage: {passage} -->\n\n{chapter.passages[passage]()}\n{END}\n"
        if kind is None and language == "python":
            run(match)
        if kind is None:
            return match[0]
        new = new_body(kind, what, body)
        return f"<!-- {kind}: {what} -->\n```{language}\n{new.rstrip()}\n```"

    return BLOCK.sub(fill, text)


def commands(text, study):
    """Those of a text that run a study."""
    found = [match["what"] or "" for match in BLOCK.finditer(text)]
    return [what for what in found if study_of(what) == study]


def is_outdated(text, study):
    """Whether a slow study's --quick prints, times aside, what begins no line of its block."""
    for match in BLOCK.finditer(text):
        if study_of(match["what"] or "") == study:
            lines = lines_without_times(match["body"])
            quick = lines_without_times(printed(f"{match['what']} --quick"))
            return not all(any(x.startswith(part) for x in lines) for part in quick)
    return False


def said_again(text):
    """A file of tests/said with what its commands print now; the same, but for times, if it can.

    There may be several, each behind a "$" and above what it prints, errors too.
    """
    parts = []
    for command, body in re.findall(r"^\$ (.+)\n((?:(?!\$ ).*\n)*)", text, re.M):
        new, _ = ran(command, subprocess.STDOUT)
        body = body.rstrip()
        new = new.rstrip() if differs(body, new.rstrip()) else body
        parts.append(f"$ {command}\n{new}\n")
    return "\n".join(parts)
