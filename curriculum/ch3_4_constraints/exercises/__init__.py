"""Five scripts with blanks. A blank says what belongs there, its check in test_answers.py whether
it does."""

import sys
from pathlib import Path

from curriculum.ch3_4_constraints.scene_files import SceneError


class Blank(Exception):
    """Something is left to do; the message says where, and what."""


class Wrong(Exception):
    """An answer that is not so; the message says why."""


def blank(what):
    """Stands where an answer belongs: replace it, the call and all."""
    place = sys._getframe(1)
    raise Blank(f"{Path(place.f_code.co_filename).name}, line {place.f_lineno}: {what}")


def run(main):
    """main(), which ends at the first blank, or mistake, with a line about it."""
    try:
        main()
    except (Blank, Wrong, SceneError) as message:
        print(message)
