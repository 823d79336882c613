"""Runs a study by its name: python -m curriculum.ch3_4_constraints.studies NAME [its flags]."""

import sys
from importlib import import_module
from pathlib import Path

from curriculum.common.cli import Parser, run_script

NAMES = sorted(path.stem for path in Path(__file__).parent.glob("[!_]*.py"))


def main(argv=None):
    """Hand what follows the name to the study that has it."""
    words = sys.argv[1:] if argv is None else argv
    parser = Parser(prog="studies", description="One question each. NAME --help tells its flags.")
    parser.add_argument("name", metavar="NAME", choices=NAMES, help=", ".join(NAMES))
    name = parser.parse_args(words[:1]).name
    return import_module(f"{__package__}.{name}").main(words[1:])


if __name__ == "__main__":
    run_script(main)
