"""Make again what is made: blocks in the texts, the pictures, and the chapter as a page.

    python -m curriculum.ch3_4_constraints.make

What is as it should be, or differs in times only, is left alone. Blocks of the studies that take
minutes are made if they are named. Otherwise what the study prints with --quick is looked for in
its block.
"""

import re
from functools import cache, partial

from curriculum.ch3_4_constraints.pages import texts
from curriculum.ch3_4_constraints.pages.page import NoPage
from curriculum.ch3_4_constraints.pictures import make_pictures
from curriculum.common import cli
from curriculum.common.files import write_together

STUDIES = texts.HERE / "studies" / "README.md"
PAGE = texts.HERE / "chapter.html"
STYLE = re.compile("<style>.*?</style>", re.S)


def content(path):
    """The text of a file; None if it is not there."""
    return path.read_text(encoding="utf-8") if path.exists() else None


@cache  # it takes seconds
def drawn():
    """{path: text} of the pictures that make_pictures draws."""
    return {make_pictures.FOLDER / f"{name}.svg": svg for name, svg in make_pictures.drawn()}


def pictures():
    """{path: text} of all pictures; those drawn by hand, or by a study, get the style of today."""
    made = drawn()
    for path in make_pictures.FOLDER.glob("*.svg"):
        if path not in made:
            made = made | {path: STYLE.sub(lambda _: make_pictures.STYLE, content(path), count=1)}
    return made


def text(path, *again):
    """{path: text} of a text; the blocks of slow studies only if they are named in `again`."""
    try:
        return {path: texts.filled(path.read_text(encoding="utf-8"), again)}
    except OSError as why:
        raise OSError(f"{short(path)}: {why}") from why


def study(name):
    """{path: text} of the studies' text, with the block of a slow one."""
    for command in texts.commands(STUDIES.read_text(encoding="utf-8"), name):
        texts.printed_by_study(command, name)  # in the minutes it takes the text may be edited
    return text(STUDIES, name)


def page():
    """{path: text} of the chapter as a page."""
    from curriculum.ch3_4_constraints.pages import chapter  # it needs the extra `site`

    try:
        return {PAGE: chapter.page()}
    except NoPage as why:
        raise OSError(f"{short(PAGE)}: {why}") from why


def short(path):
    """A path as one types it in the main folder."""
    return path.relative_to(texts.ROOT).as_posix()


# In this order: the page shows the pictures and the chapter's text.
MADE = {"pictures": pictures}
MADE |= {short(path): partial(text, path) for path in texts.TEXTS}
MADE |= {short(PAGE): page}
SLOW = {name: partial(study, name) for name in texts.SLOW}


def fresh(name):
    """{path: text} of the files of a name that are not what they should be."""
    made = (MADE | SLOW)[name]()
    return {path: new for path, new in made.items() if new != content(path)}


def stale(name):
    """What belongs to a name and is not what it should be, in words."""
    if name not in SLOW:
        return [short(path) for path in fresh(name)]
    if texts.is_outdated(STUDIES.read_text(encoding="utf-8"), name):
        return [f"{name} in {short(STUDIES)}, which takes minutes to make"]
    return []


def main(argv=None):
    """Make what is stale, or say what is."""
    parser = cli.Parser(__doc__, f"names: {', '.join(MADE)}; and, slowly, {', '.join(SLOW)}")
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="what to make; by default all that is quick")
    add("--check", action="store_true", help="make nothing, name what is stale, and exit with 1")
    parser.usage = "%(prog)s [flags] [NAME ...]"
    args = parser.parse_args(argv)
    for name in args.names:
        if name not in MADE | SLOW:
            parser.error(f"there is no {name!r}: choose from {', '.join(MADE | SLOW)}")
    left = []  # what is stale in the end
    try:
        for name in cli.progress(args.names or [*MADE, *SLOW]):
            if args.check or name not in [*MADE, *args.names]:
                left += stale(name)
                continue
            for path, made in fresh(name).items():
                write_together(path.parent, {path.name: made})
                print(f"made: {short(path)}", flush=True)
    except ModuleNotFoundError as why:
        parser.error(f"{name} needs {why.name}: pip install -e '.[fast,peers,site]'")
    for what in left:
        print(f"stale: {what}")
    return 1 if left else 0


if __name__ == "__main__":
    cli.run_script(main)
