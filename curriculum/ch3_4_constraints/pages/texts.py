"""Fill the blocks of the texts:  python -m curriculum.ch3_4_constraints.pages.texts [FILE ...]

A fenced block below one of these comments is not typed but made:

    <!-- region: NAME -->              that region of constraints.py
    <!-- printed by: COMMAND -->       what a command that starts with "python" prints
    <!-- printed by: lines above -->   what the last block of Python prints; those of one text run
                                       in order and share their names, as in a notebook
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[3]
HERE = Path(__file__).parents[1]
TEXTS = [ROOT / "README.md", HERE / "README.md", *sorted(HERE.glob("exercises/**/README.md"))]
COMMENT = r"<!-- (?P<kind>region|printed by): (?P<what>[^\n]+) -->\n"
BLOCK = re.compile(rf"^(?:{COMMENT})?```(?P<language>\w+)\n(?P<body>.*?)^```$", re.S | re.M)


def region(name):
    """The lines of a region of constraints.py, without its marks."""
    source = (ROOT / "constraints.py").read_text(encoding="utf-8")
    return re.search(rf"# --- region: {name} ---\n(.*?)# --- endregion ---\n", source, re.S)[1]


def printed(command):
    """What a command prints, run in an empty folder."""
    words = [sys.executable, *shlex.split(command)[1:]]
    if words[1] == "constraints.py":
        words[1] = str(ROOT / words[1])
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"PYTHONPATH": str(ROOT)}
        return subprocess.check_output(words, cwd=folder, env=env, text=True)


def filled(text):
    """The text with each of its blocks made anew; its Python is run."""
    space, outputs = {}, []

    def fill(match):
        kind, what, language, body = match.groups()
        if kind is None and language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(body, space)
            outputs.append(output.getvalue())
        if kind is None:
            return match[0]
        if kind == "region":
            body = region(what)
        elif what == "lines above":
            body = outputs[-1]
        else:
            body = printed(what)
        return f"<!-- {kind}: {what} -->\n```{language}\n{body.rstrip()}\n```"

    return BLOCK.sub(fill, text)


if __name__ == "__main__":
    for path in [Path(name) for name in sys.argv[1:]] or TEXTS:
        path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"filled {path}")
