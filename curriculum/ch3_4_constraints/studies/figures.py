"""Do the texts still say what the programs print?  Runs every command named in them and rewrites
the block below it.

A block is a line `<!-- printed by: COMMAND -->` and a fenced block below it, which may begin with
`$ COMMAND`, for the reader. A text is written after each of its blocks; a command that fails leaves
its block as it was, is told of, and makes the exit status 1. Studies of speed want a machine that
does nothing else. What is quick and the same everywhere is run by tests/test_texts.py, too.
"""

import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

from curriculum.common.cli import Parser, run_script
from curriculum.common.files import write_whole

ROOT = Path(__file__).resolve().parents[3]
CHAPTER = ROOT / "curriculum/ch3_4_constraints"
PAGES = "README.md", "studies/README.md", "exercises/README.md", "exercises/solutions/README.md"
TEXTS = [ROOT / "README.md", *(CHAPTER / page for page in PAGES)]
HEAD = r"(<!-- printed by: (?P<command>.*?) -->\n```\w+\n)(\$ .*?\n)?"
BLOCK = re.compile(HEAD + r"(?P<body>.*?)(```\n)", re.S)
TIMES = ("us",)  # headers of columns that belong to the machine


def printed(command):
    """What `command`, a line that starts with `python`, prints; None if it fails."""
    words, clock = [sys.executable, *shlex.split(command)[1:]], time.perf_counter()
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    print(f"{time.perf_counter() - clock:6.1f} s  {command}", flush=True)
    if done.returncode:
        print(f"figures: {command}: {done.stderr.strip() or 'failed'}", file=sys.stderr)
        return None
    return done.stdout.strip("\n") + "\n"


def machine_free(text):
    """Its lines, a list of cells each, without what belongs to the machine: the banner, times,
    where files went."""
    lines, header = [], []
    text = re.sub("^wrote .*", "", text, flags=re.M | re.S)
    for line in re.sub(", compiled to .*", "", text).splitlines():
        cells = re.split(r" {2,}", line.strip())
        header = cells if any(cell in TIMES for cell in cells) else header
        if len(cells) == len(header):
            cells = [cell for cell, title in zip(cells, header, strict=True) if title not in TIMES]
        if not line.startswith("ch3.4 "):
            lines.append(cells)
    return lines


def main(argv=None):
    """Rewrite the blocks."""
    parser = Parser(prog="figures", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--only", default="", metavar="WORD", help="commands that contain this")
    args, failed = parser.parse_args(argv), False
    texts = {path: path.read_text(encoding="utf-8") for path in TEXTS}
    blocks = [(path, match) for path, text in texts.items() for match in BLOCK.finditer(text)]
    blocks = [block for block in blocks if args.only in block[1]["command"]]
    if not blocks:
        parser.error(f"argument --only: no command in a text contains {args.only!r}")
    for path, match in blocks:
        command, body = match["command"], match["body"]
        output = printed(command)
        failed |= output is None
        if output in (None, body):
            continue
        if machine_free(output) != machine_free(body):
            print(f"{path.relative_to(ROOT)}: {command}: changed", flush=True)
        new = match[1] + (match[3] or "") + output + match[5]
        texts[path] = text = texts[path].replace(match[0], new)
        write_whole(path, text)
    return int(failed)


if __name__ == "__main__":
    run_script(main)
