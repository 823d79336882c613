"""Runs a study by its name: python -m curriculum.ch3_4_constraints.studies NAME [its flags]."""

import sys
from importlib import import_module
from pathlib import Path

from curriculum.common.cli import Parser, run_script

NAMES = sorted(path.stem for path in Path(__file__).parent.glob("[!_]*.py"))


def main(argv=None):
    """Hand what follows the name to the study that has it."""
    words = sys.argv[1:] if argv is None else argv
    command, known = f"python -m {__package__}", f"one of {', '.join(NAMES)}"
    parser = Parser(prog=command, usage=f"{command} NAME [its flags, or --help]")
    parser.add_argument("name", metavar="NAME", choices=NAMES, help=f"a question each: {known}")
    if not words:
        parser.error(f"a NAME is missing, {known}")
    name = parser.parse_args(words[:1]).name
    return import_module(f"{__package__}.{name}").main(words[1:])


if __name__ == "__main__":
    run_script(main)
