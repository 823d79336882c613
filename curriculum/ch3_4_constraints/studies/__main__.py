"""Runs a study by its name: python -m curriculum.ch3_4_constraints.studies NAME [its flags]."""

import sys
from importlib import import_module
from importlib.util import find_spec

from curriculum.common.cli import Parser, run_script

STUDIES = {  # and what each needs beside numpy
    "hard_cases": [],
    "race": ["llvmlite", "heyoka"],
    "real_thing": ["mujoco"],
    "speed_vs_error": ["llvmlite", "mujoco"],
}


def main(argv=None):
    """Hand what follows the name to the study that has it."""
    words = sys.argv[1:] if argv is None else argv
    parser = Parser(__doc__)
    parser.add_argument("name", choices=STUDIES, help="a question each; its own flags follow")
    name = parser.parse_args(words[:1]).name
    asks_for_help = not {"-h", "--help"}.isdisjoint(words)
    for peer in STUDIES[name]:
        if not find_spec(peer) and not asks_for_help:
            parser.error(f"{peer} is not installed: pip install -e '.[fast,peers]'")
    sys.argv[0] = f"studies {name}"  # as its help and its errors name it
    return import_module(f"{__package__}.{name}").main(words[1:])


if __name__ == "__main__":
    run_script(main)
