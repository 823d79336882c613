"""Do the texts still say what the programs print?  Runs every command named in them and rewrites
the block below it.

A block is a line `<!-- printed by: COMMAND -->` and a fenced block below it, which may begin with
`$ COMMAND`, for the reader. `--only WORD` takes the commands that contain WORD: the studies of
speed take minutes, and want a machine that does nothing else. The quick commands, whose digits are
the same everywhere, are run by tests/test_texts.py, too.
"""

import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

from curriculum.common.cli import Parser, run_script
from curriculum.common.files import write_whole

ROOT = Path(__file__).resolve().parents[3]
CHAPTER = ROOT / "curriculum/ch3_4_constraints"
PAGES = ("README.md", "studies/README.md", "exercises/README.md", "exercises/solutions/README.md")
TEXTS = [ROOT / "README.md", *(CHAPTER / page for page in PAGES)]
BLOCK = re.compile(
    r"(<!-- printed by: (?P<command>.*?) -->\n```\w+\n)(\$ .*?\n)?(?P<body>.*?)(```\n)", re.S
)
TIMES = ("us",)  # headers of columns that belong to the machine


@cache
def printed(command):
    """What `command`, a line that starts with `python`, prints."""
    words = [sys.executable, *shlex.split(command)[1:]]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"figures: {command}: {done.stderr.strip() or 'failed'}")
    return done.stdout.strip("\n") + "\n"


def machine_free(text):
    """Its lines, a list of cells each, without what belongs to the machine: the banner, times,
    where files went."""
    lines, header = [], []
    for line in text.splitlines():
        cells = re.split(r" {2,}", line.strip())
        header = cells if any(cell in TIMES for cell in cells) else header
        if len(cells) == len(header):
            cells = [cell for cell, title in zip(cells, header, strict=True) if title not in TIMES]
        if not line.startswith(("ch3.4 ", "wrote ", "look: ")):
            lines.append(cells)
    return lines


def main(argv=None):
    """Rewrite the blocks."""
    parser = Parser(
        prog="figures", description="Make the figures in the texts what their commands print."
    )
    parser.add_argument(
        "--only", default="", metavar="WORD", help="only the commands that contain this"
    )
    args = parser.parse_args(argv)
    for path in TEXTS:

        def renewed(match, path=path):
            if args.only not in match["command"]:
                return match[0]
            output = printed(match["command"])
            changed = machine_free(output) != machine_free(match["body"])
            print(
                f"{path.relative_to(ROOT)}: {match['command']}{': changed' if changed else ''}",
                flush=True,
            )
            asked = f"$ {match['command']}\n" if match[3] else ""
            return match[1] + asked + output + match[5]

        before = path.read_text(encoding="utf-8")
        text = BLOCK.sub(renewed, before)
        if text != before:
            write_whole(
                path, lambda temporary, text=text: temporary.write_text(text, encoding="utf-8")
            )
    return 0


if __name__ == "__main__":
    run_script(main)
