"""Five scripts with blanks. A blank says what belongs there, its check in test_answers.py whether
it does."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.common.cli import run_script


class Blank(Exception):
    """Something is left to do; the message says where, and what."""


class Wrong(Exception):
    """An answer that is not so; the message says why."""


def blank(what):
    """Stands where an answer belongs: replace it, the call and all."""
    place = sys._getframe(1)
    raise Blank(f"{Path(place.f_code.co_filename).name}, line {place.f_lineno}: {what}")


def write_down(note, guess, allowed):
    """The guess as it was before the first run: written to the file `note` once, and then read.

    `allowed`: for each question the answers to choose from, or None if a number is wanted.
    """
    for key, choices in allowed.items():
        if choices is None and not isinstance(guess[key], (int, float)):
            raise Wrong(f"{key!r} is {guess[key]!r}; a number is wanted")
        if choices and guess[key] not in choices:
            raise Wrong(f"{key!r} is {guess[key]!r}; choose one of {', '.join(map(repr, choices))}")
    try:
        return json.loads(note.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):  # none so far, or one that a full disk cut short
        note.parent.mkdir(parents=True, exist_ok=True)
        part = note.with_suffix(".part")
        part.write_text(json.dumps(guess) + "\n", encoding="utf-8")
        part.replace(note)
        return guess


def run(main):
    """As a script: main(), then the check, up to the first blank or mistake, and a line about it.

    The exit status is 0 where something is left to do, and 1 after a mistake.
    """

    def script():
        from curriculum.ch3_4_constraints.exercises.test_answers import CHECKS

        name = Path(main.__code__.co_filename).stem
        try:
            main()
            CHECKS[name](SimpleNamespace(**main.__globals__))
        except (Blank, Wrong, SceneError) as message:
            print(message)
            return int(not isinstance(message, Blank))
        print(f"{name}.py: solved. Compare your sentence with the one in solutions/README.md.")
        return 0

    run_script(script)
