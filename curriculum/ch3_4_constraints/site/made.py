"""What is made of this chapter, by python -m curriculum.make."""

import re
from functools import cache
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.page.scene import NoPage
from curriculum.ch3_4_constraints.site import gallery
from curriculum.ch3_4_constraints.site import pictures as drawings
from curriculum.ch3_4_constraints.site.drawing import STYLE, still
from curriculum.make import texts

FOLDER = Path(__file__).parents[1]
PAGE = FOLDER / "chapter.html"
NOTEBOOK = FOLDER / "chapter.ipynb"
SCRIPT = "constraints.py"
STYLES = re.compile("<style>.*?</style>", re.S)


def methods():
    """A row for each method: its name, and its own words."""
    lines = ["| method | what it does |", "|---|---|"]
    lines += [f"| `{name}` | {method.words} |" for name, method in c.make_methods().items()]
    return "\n".join(lines) + "\n"


@cache  # it takes seconds
def drawn():
    """{path: text} of the pictures that are drawn quickly."""
    return {drawings.FOLDER / f"{name}.svg": svg for name, svg in drawings.drawn()}


def pictures():
    """{path: text} of all pictures; those drawn by hand, or by a study, get the style of today."""
    made = drawn()
    for path in drawings.FOLDER.glob("*.svg"):
        if path not in made:
            old = path.read_text(encoding="utf-8")
            made = made | {path: STYLES.sub(lambda _: STYLE, old, count=1)}
    return made


def page():
    """{path: text} of the chapter as a page."""
    from curriculum.ch3_4_constraints.site import chapter  # it needs the extra `site`

    try:
        return {PAGE: chapter.page()}
    except NoPage as why:
        raise OSError(f"{PAGE.name}: {why}") from why


ABOUT = """*This is [the chapter](README.md) as a notebook, and its cells are
[`constraints.py`](../../constraints.py). Change a line in one, run it and the cells below, and
table, answer and page follow. The file stays as it is; `import constraints` gives you the cells.
Figures that you can drag are in [`chapter.html`](chapter.html).*

*Run the next cell first. It runs all regions once, since the text uses the last of them before it
shows them.*
"""
END = """## Your turn

Which method and which step, for what stands in the cells now? With `"--system", "jansen_leg"` it is
another machine, and with the name of a file it is yours.

<!-- notebook: python constraints.py --no-rerun --within 1mm -->
"""


def notebook():
    """{path: text} of the chapter as a notebook."""
    from curriculum.make.notebook import notebook as made_of  # it needs the extra `site`

    shown = "outputs/ch3.4-constraints/play.html"
    return {NOTEBOOK: made_of(FOLDER / "README.md", texts.ROOT / SCRIPT, shown, ABOUT, END, still)}


def speed_vs_error(commands):
    """What the study prints, and its diagrams."""
    from curriculum.ch3_4_constraints.site.work_precision import diagram
    from curriculum.ch3_4_constraints.studies import speed_vs_error as study

    lines = []
    made = {}
    for scene in study.SCENES:
        measured = study.measure(scene, study.GOALS)
        lines += ["", *study.lines_of(measured)]
        made[drawings.FOLDER / f"work_precision_{scene}.svg"] = diagram(measured)
    return dict.fromkeys(commands, "\n".join(lines) + "\n"), made


def hard_cases(commands):
    """What the study prints."""
    return {command: texts.printed(command) for command in commands}, {}


PASSAGES = {"gallery": gallery.text, "methods": methods}
MADE = {"pictures": pictures, "page": page, "notebook": notebook}
SLOW = {"speed_vs_error": speed_vs_error, "hard_cases": hard_cases}
