"""Do the texts still say what the programs print?  Runs every command named in them and rewrites the block below it.

A block is a line `<!-- printed by: COMMAND -->` and a fenced block below it, in README.md, the chapter text and the
exercises. `--check` changes nothing and compares instead, leaving out what belongs to the machine: numbers that carry
a unit of time or a ratio of times (us, ms, x), and what follows the word wall-clock. `--only WORD` takes the commands
that contain WORD: some studies take minutes.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

from curriculum.common.cli import Parser, run_script
from curriculum.common.files import write_whole

ROOT = Path(__file__).resolve().parents[3]
CHAPTER = ROOT / "curriculum/ch3_4_constraints"
TEXTS = [ROOT / "README.md", CHAPTER / "README.md", CHAPTER / "exercises/README.md"]
BLOCK = re.compile(r"(<!-- printed by: (?P<command>.*?) -->\n```text\n)(?P<body>.*?)(```\n)", re.S)


def printed(command, cwd=ROOT):
    """What `command`, a line that starts with `python`, prints."""
    words = shlex.split(command)
    return subprocess.run([sys.executable, *words[1:]], cwd=cwd, check=True, capture_output=True, text=True).stdout


def machine_free(text):
    """`text` without the figures that only the machine decides, and without the white space that aligned them."""
    text = re.sub(r"wall-clock .*", "wall-clock", text)
    text = re.sub(r"\d[\d.e+-]* (us|ms|x)\b", r"# \1", text)
    return [" ".join(line.split()) for line in text.splitlines()]


def main(argv=None):
    """Rewrite or check the blocks; returns 1 if a check found a difference."""
    parser = Parser(prog="figures", description="Keep the figures in the texts equal to what their commands print.")
    parser.add_argument("--check", action="store_true", help="compare only, exit 1 on a difference")
    parser.add_argument("--only", default="", metavar="WORD", help="only the commands that contain this")
    args = parser.parse_args(argv)
    different = 0
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")

        def replace(match, path=path):
            nonlocal different
            if args.only not in match["command"]:
                return match[0]
            output = printed(match["command"])
            if machine_free(output) != machine_free(match["body"]):
                different += 1
                print(f"{path.relative_to(ROOT)}: {match['command']}: {'differs' if args.check else 'rewritten'}")
            return match[1] + output + match[4]

        renewed = BLOCK.sub(replace, text)
        if not args.check:
            write_whole(path, lambda temporary, renewed=renewed: temporary.write_text(renewed, encoding="utf-8"))
    return 1 if args.check and different else 0


if __name__ == "__main__":
    run_script(main)
