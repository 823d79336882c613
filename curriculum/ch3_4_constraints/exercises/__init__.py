"""Five scripts with blanks. A blank says what belongs there; checks.py says whether it does."""

import sys
from importlib import import_module, reload
from pathlib import Path

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


def solved(name, answers):
    """The exercise `name`, anew, with what stands in the module `answers` for its blanks."""
    exercise = reload(import_module(f"{__name__}.{name}"))
    vars(exercise).update({key: x for key, x in vars(answers).items() if key[0] != "_"})
    return exercise


def run(main):
    """As a script: the guess is shown, main(), then the check, up to the first blank or mistake.

    With --solved it is done with the answers. The exit status is 1 after a mistake, or else 0.
    """

    def script():
        from curriculum.ch3_4_constraints.exercises.checks import CHECKS

        name, exercise = Path(main.__code__.co_filename).stem, sys.modules[main.__module__]
        if "--solved" in sys.argv:
            exercise = solved(name, import_module(f"{__name__}.solutions.{name}"))
        try:
            if hasattr(exercise, "predict"):
                print(f"you wrote down {exercise.predict()}\n")
            exercise.main()
            CHECKS[name](exercise)
        except (Blank, Wrong, SceneError) as message:
            print(message)
            return int(not isinstance(message, Blank))
        print(f"{name}.py: solved. Compare your sentence with the one in solutions/{name}.py.")
        return 0

    run_script(script)
