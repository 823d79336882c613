"""Do the texts still say what the programs print, and show the code that runs?  Runs every command
named in them, looks up every function listed in them, and rewrites the block below it.

A block is one of these lines and a fenced block below it, which may begin with `$ COMMAND`:

    <!-- printed by: COMMAND -->
    <!-- listing of: FILE FUNCTION -->
    <!-- listing of: FILE FUNCTION, from START, to START -->

A listing is a function without its docstring; or, of its body, the statement whose line begins
with the first START, up to and with the one, if any, that begins with the second. A text is written
after each of its blocks; a block that cannot be made stays as it was, and makes the exit status 1.
Studies of speed want a machine that does nothing else.
"""

import ast
import re
import shlex
import subprocess
import sys
import textwrap
import time

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import study_parser
from curriculum.common.files import write_whole

ROOT = c.HERE
PAGES = "README.md", "studies/README.md", "exercises/README.md", "exercises/solutions/README.md"
TEXTS = [ROOT / "README.md", *(ROOT / c.CHAPTER / page for page in PAGES)]
KIND = r"(?P<kind>printed by|listing of)"
HEAD = rf"<!-- {KIND}: (?P<command>[^\n]*?) -->\n```\w+\n(?P<prompt>\$ [^\n]*\n)?"
BLOCK = re.compile(rf"(?P<head>{HEAD})(?P<body>.*?)(?P<end>```\n)", re.S)
PART = re.compile(r"(\S+) (\w+)(?:, from (.+?))?(?:, to (.+))?")
AS_INSTALLED = """import runpy, sys
sys.modules["llvmlite"] = None
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
TIME = "us"  # the header of a column that belongs to the machine


def printed(command):
    """What `command`, a line that starts with `python`, prints. Raises ValueError if it fails.

    A file is run as by a reader without llvmlite, which studies and exercises may use.
    """
    words, clock = shlex.split(command)[1:], time.perf_counter()
    words = [sys.executable, *(words if words[0].startswith("-") else ["-c", AS_INSTALLED, *words])]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    print(f"{time.perf_counter() - clock:6.1f} s  {command}", flush=True)
    if done.returncode:
        raise ValueError(done.stderr.strip() or "failed")
    return done.stdout.strip("\n") + "\n"


def listed(what):
    """The code that `what`, "FILE FUNCTION, from START, to START", names. Raises ValueError."""
    part = PART.fullmatch(what)
    if part is None:
        raise ValueError("a listing is of FILE FUNCTION, from START, to START")
    file, name, start, last = part.groups()
    text = (ROOT / file).read_text(encoding="utf-8")
    lines = text.splitlines()
    statements = [x for x in ast.walk(ast.parse(text)) if isinstance(x, ast.stmt)]
    statements.sort(key=lambda x: x.lineno)

    def starting(words, after=0):
        for statement in statements:
            if statement.lineno > after and lines[statement.lineno - 1].lstrip().startswith(words):
                return statement
        raise ValueError(f"no statement there begins with {words!r}")

    first = end = function = starting(f"def {name}(")
    if start:
        first = end = starting(start, function.lineno)
    if last:
        end = starting(last, first.lineno)
    shown = lines[first.lineno - 1 : end.end_lineno]
    docstring = ast.get_docstring(first, clean=False) if first is function else None
    if docstring is not None:
        del shown[1 : 1 + len(docstring.splitlines())]
    return textwrap.dedent("\n".join(shown)) + "\n"


def machine_free(text):
    """Its lines, a list of cells each, without what belongs to the machine: the banner, times,
    where files went."""
    lines, header = [], []
    text = re.sub("^wrote .*", "", text, flags=re.M | re.S)
    text = re.sub(r",\s+compiled to .*?(?=\n\n|\Z)", "", text, flags=re.S)  # on a line or two
    for line in text.splitlines():
        cells = re.split(r" {2,}", line.strip())
        header = cells if TIME in cells else header
        if len(cells) == len(header):
            cells = [cell for cell, title in zip(cells, header, strict=True) if title != TIME]
        if not line.startswith("ch3.4 "):
            lines.append(cells)
    return lines


def main(argv=None):
    """Rewrite the blocks."""
    parser = study_parser("figures", __doc__.partition("\n\n")[0])
    parser.add_argument("--only", default="", metavar="WORD", help="blocks whose command has it")
    args, failed = parser.parse_args(argv), False
    texts = {path: path.read_text(encoding="utf-8") for path in TEXTS}
    blocks = [(path, match) for path, text in texts.items() for match in BLOCK.finditer(text)]
    blocks = [block for block in blocks if args.only in block[1]["command"]]
    if not blocks:
        parser.error(f"argument --only: no block of a text contains {args.only!r}")
    for path, match in blocks:
        command, body = match["command"], match["body"]
        try:
            output = printed(command) if match["kind"] == "printed by" else listed(command)
        except (OSError, SyntaxError, ValueError) as why:
            print(f"figures: {command}: {why}", file=sys.stderr)
            failed = True
            continue
        if machine_free(output) != machine_free(body):
            print(f"{path.relative_to(ROOT)}: {command}: changed", flush=True)
        texts[path] = texts[path].replace(match[0], match["head"] + output + match["end"])
        write_whole(path, texts[path])
    return int(failed)
