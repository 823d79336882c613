"""Five scripts with blanks. A blank says what belongs there; checks.py says whether it does."""

import json
import sys
from importlib import import_module, reload
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.common.cli import run_script
from curriculum.common.files import write_json


class Blank(Exception):
    """Something is left to do; the message says where, and what."""


class Wrong(Exception):
    """An answer that is not so; the message says why."""


def blank(what):
    """Stands where an answer belongs: replace it, the call and all."""
    place = sys._getframe(1)
    raise Blank(f"{Path(place.f_code.co_filename).name}, line {place.f_lineno}: {what}")


def noted(note, guess):
    """What was guessed before the first run: the file `note` keeps it, whatever follows."""
    if not note.exists():
        write_json(note, guess)
    return json.loads(note.read_text(encoding="utf-8"))


def solved(name, answers):
    """The exercise `name`, anew, with what stands in the module `answers` for its blanks."""
    exercise = reload(import_module(f"{__name__}.{name}"))
    vars(exercise).update({key: x for key, x in vars(answers).items() if key[0] != "_"})
    return exercise


def run(main):
    """As a script: the guess is noted, main(), then the check, up to the first blank or mistake.

    With --solved it is done with the answers, and nothing is noted. The exit status is 1 after a
    mistake, or else 0.
    """

    def script():
        from curriculum.ch3_4_constraints.exercises.checks import judge

        name, exercise = Path(main.__code__.co_filename).stem, sys.modules[main.__module__]
        note, told = c.HERE / f"outputs/guess_{name}.json", "--solved" in sys.argv
        if told:
            exercise = solved(name, import_module(f"{__name__}.solutions.{name}"))
        try:
            if hasattr(exercise, "answer"):
                guess = exercise.answer() if told else noted(note, exercise.answer())
                print(f"you wrote down {guess}\n")
            exercise.main()
            judge(name, exercise)
        except (Blank, Wrong, SceneError) as message:
            print(message)
            return int(not isinstance(message, Blank))
        print(f"{name}.py: solved. Compare your sentence with the one in solutions/{name}.py.")
        return 0

    run_script(script)
