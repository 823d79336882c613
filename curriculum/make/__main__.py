"""Make again what is made: blocks in the texts, pictures, pages, notebooks, and what tests expect.

    python -m curriculum.make

What is as it should be, or differs in times only, is left alone. What studies print that take
minutes is made if they are named. Otherwise what such a study prints with --quick is looked for in
its block.
"""

from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from curriculum.common import cli
from curriculum.common.files import write_together
from curriculum.make import texts

FOLDER = Path(__file__).parents[1]
SAID = texts.ROOT / "tests" / "said"
README = texts.ROOT / "README.md"


class Chapter(NamedTuple):
    """What is made of a chapter: its site/made.py has these in capitals, but for the folder."""

    folder: Path
    script: Path
    passages: dict  # {name: function() -> Markdown}
    made: dict  # {name: function() -> {path: text}}
    slow: dict  # {study: function(its commands) -> ({command: what it prints}, {path: text})}


def chapters():
    """All Chapters of the curriculum."""
    found = []
    for path in sorted(FOLDER.glob("*/site/made.py")):
        folder = path.parents[1]
        made = import_module(f"curriculum.{folder.name}.site.made")
        script = texts.ROOT / made.SCRIPT
        parts = made.PASSAGES, made.MADE, made.SLOW
        found.append(Chapter(folder, script, *parts))
    return found


def text(path, chapter, outputs=None):
    """{path: text} of a text, with its blocks made anew."""
    try:
        return {path: texts.filled(path.read_text(encoding="utf-8"), chapter, outputs)}
    except OSError as why:
        raise OSError(f"{short(path)}: {why}") from why


def said():
    """{path: text} of what tests expect commands to print."""
    return {path: texts.said_again(content(path)) for path in sorted(SAID.glob("*.txt"))}


def study(chapter, name):
    """{path: text} of what a slow study makes, and of the text that shows what it prints."""
    path = chapter.folder / "studies" / "README.md"
    outputs, made = chapter.slow[name](texts.commands(content(path), name))
    return made | text(path, chapter, outputs)


def content(path):
    """The text of a file; None if it is not there."""
    return path.read_text(encoding="utf-8") if path.exists() else None


def short(path):
    """A path as one types it in the main folder."""
    return path.relative_to(texts.ROOT).as_posix()


def everything():
    """{name: function() -> {path: text}} of what is quick to make, and {name: (such a function,
    function() -> what is stale)} of what is slow.

    A name that an earlier chapter has, too, begins with the chapter's folder.
    """
    quick = {}
    slow = {}

    def named(name, chapter):
        return f"{chapter.folder.name}/{name}" if name in quick | slow else name

    for chapter in chapters():  # pages show pictures and texts: so first these
        quick[named("pictures", chapter)] = chapter.made["pictures"]
        for path in [README, *sorted(chapter.folder.glob("**/*.md"))]:
            quick.setdefault(short(path), partial(text, path, chapter))
        for name, made in chapter.made.items():
            if name != "pictures":
                quick[named(name, chapter)] = made
        for name in chapter.slow:
            both = partial(study, chapter, name), partial(stale_study, chapter, name)
            slow[named(name, chapter)] = both
    quick["said"] = said
    return quick, slow


def stale_study(chapter, name):
    """What belongs to a slow study and is not what it should be, in words."""
    path = chapter.folder / "studies" / "README.md"
    if texts.is_outdated(content(path), name):
        return [f"{name} in {short(path)}, which takes minutes to make"]
    return []


def fresh(make):
    """{path: text} of the files that are not what they should be."""
    return {path: new for path, new in make().items() if new != content(path)}


def main(argv=None):
    """Make what is stale, or say what is."""
    quick, slow = everything()
    parser = cli.Parser(__doc__, f"names: {', '.join(quick)}; and, slowly, {', '.join(slow)}")
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help="what to make; by default all that is quick")
    add("--check", action="store_true", help="make nothing, name what is stale, and exit with 1")
    parser.usage = "%(prog)s [flags] [NAME ...]"
    args = parser.parse_args(argv)
    for name in args.names:
        if name not in quick | slow:
            parser.error(f"there is no {name!r}: choose from {', '.join(quick | slow)}")
    left = []  # what is stale in the end
    try:
        for name in cli.progress(args.names or [*quick, *slow]):
            make, stale = slow.get(name) or (quick[name], None)
            if stale and (args.check or name not in args.names):
                left += stale()
                continue
            files = fresh(make)
            if args.check:
                left += map(short, files)
                continue
            for path, made in files.items():
                write_together(path.parent, {path.name: made})
                print(f"made: {short(path)}", flush=True)
    except ModuleNotFoundError as why:
        parser.error(f"{name} needs {why.name}: pip install -e '.[fast,peers,site]'")
    for what in left:
        print(f"stale: {what}")
    return 1 if left else 0


if __name__ == "__main__":
    cli.run_script(main)
