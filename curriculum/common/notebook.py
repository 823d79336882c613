"""What a chapter's notebook begins with, and how it shows a page."""

import sys
from html import escape
from pathlib import Path

HEIGHT = 760  # pixels, of the frame of a page


def load(path):
    """Run the lines of a script in the notebook, all but those that start it as a program.

    From then on `import constraints` means the notebook, for a script constraints.py. So whoever
    imports it gets the functions of the cells, as they have been edited.
    """
    path = Path(path)
    notebook = sys.modules["__main__"]
    space = vars(notebook)
    sys.argv = [path.name]  # commands are named as in a terminal
    sys.modules[path.stem] = notebook
    name = space["__name__"]
    space["__name__"] = path.stem  # the script is imported, so to speak
    try:
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), space)
    finally:
        space["__name__"] = name


class Page:
    """A page of one file, which a notebook shows below the cell."""

    def __init__(self, path):
        self.path = Path(path)
        # A page is read at once: the next run may write another in its place.
        self.text = self.path.read_text(encoding="utf-8") if self.path.exists() else None

    def __repr__(self):
        if self.text is None:
            return f"there is no {self.path}: what the run has printed says why"
        return f"open {self.path} in a browser"

    def _repr_html_(self):
        if self.text is None:
            return f"<p>{escape(repr(self))}</p>"
        style = f"width: 100%; height: {HEIGHT}px; border: 0"
        return f'<iframe style="{style}" srcdoc="{escape(self.text)}"></iframe>'


def show(path):
    """The page in the file at `path`, in a frame below the cell: a Page."""
    return Page(path)
