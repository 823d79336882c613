"""A chapter's text and its script as a notebook.

    in the text                                 in the notebook
    prose, formulas, tables, pictures           the same; a picture is part of its cell
    <!-- region: NAME -->, and its lines        a cell: it takes the place of the script's lines
    lines of Python                             a cell
    what a command of the script prints         a cell that calls its main, and shows the page
    what lines of Python print                  nothing: the cell prints it
    <!-- notebook: COMMAND -->                  a cell like that, which no other reader sees

Cells have no outputs. Equal texts give equal bytes.
"""

import ast
import json
import re
import shlex
from base64 import b64encode
from html import escape

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from curriculum.make import texts

ASIDE = r"^<!-- notebook: (?P<command>[^\n]+) -->\n"
PIECE = re.compile(f"{texts.FENCED}|{ASIDE}", re.S | re.M)
FOLDED = re.compile("^<details><summary>(.*?)</summary>\n(.*?)^</details>\n", re.S | re.M)
PICTURE = re.compile(r"!\[([^]]*)\]\(([^)]+\.svg)\)")
COMMENT = re.compile("^<!--.*?-->\n", re.S | re.M)
SECTION = re.compile("^(?=##)", re.M)
LOADS = """\
import os

if not os.path.exists("{script}"):
    os.chdir("{up}")  # from the notebook's folder to the project's

from curriculum.common.notebook import load, show

load("{script}")"""
SHOWS = """\
main({words})
show("{page}")"""


class Maker:
    """Makes the cells of a notebook, from a text in a `folder` and a script in texts.ROOT."""

    def __init__(self, folder, script, shown, picture):
        self.folder = folder
        self.script = script.name
        self.shown = shown  # the page that a command writes
        self.picture = picture  # function(the text of a picture) -> that as the notebook has it
        self.own = names(script.read_text(encoding="utf-8"))
        self.cells = []

    def text(self, text):
        """The cells of a text."""
        text = FOLDED.sub(unfolded, text)
        end = 0
        for match in PIECE.finditer(text):
            self.prose(text[end : match.start()])
            self.piece(match)
            end = match.end()
        self.prose(text[end:])

    def prose(self, text):
        """A cell for each section, if there is something in it."""
        text = COMMENT.sub("", text)
        for section in SECTION.split(PICTURE.sub(self.image, text)):
            if section.strip():
                self.cells.append(new_markdown_cell(section.strip(), id=self.next_id()))

    def code(self, source):
        self.cells.append(new_code_cell(source.strip(), id=self.next_id()))

    def next_id(self):
        return f"cell-{len(self.cells)}"

    def image(self, match):
        """A picture within the cell, with what it shows below it."""
        words, path = match.groups()
        words = " ".join(words.split())
        drawn = self.picture((self.folder / path).read_text(encoding="utf-8"))
        data = b64encode(drawn.encode()).decode()
        return f'<img alt="{escape(words)}" src="data:image/svg+xml;base64,{data}">\n\n*{words}*'

    def piece(self, match):
        """The cell of a fenced block, or of a command."""
        if match["command"]:
            self.command(match["command"])
        elif match["kind"] == "region":
            self.code(without_start(match["body"]))
        elif match["kind"] == "printed by":
            self.printed(match)
        elif match["language"] == "python":
            self.python(match["body"])
        else:
            self.prose(match[0])

    def python(self, body):
        """Lines of Python of the text. Raises OSError where they take a name of the script's."""
        if taken := sorted(names(body) & self.own):
            raise OSError(f"lines of Python bind {', '.join(taken)}, as {self.script} does")
        self.code(body)

    def printed(self, match):
        """A command of the script is called; what other commands print, stays."""
        what = match["what"]
        if what.startswith(f"python {self.script}"):
            self.command(what)
        elif what != "lines above":
            self.prose(match[0])

    def command(self, command):
        """A command of the script, as a call of its main."""
        words = json.dumps(shlex.split(command)[2:])
        self.code(SHOWS.format(words=words, page=self.shown))


def names(source):
    """What a script binds, but for imports."""
    kinds = ast.FunctionDef, ast.ClassDef
    bound = set()
    for line in ast.parse(source).body:
        if isinstance(line, kinds):
            bound.add(line.name)
            continue
        inside = [x for x in ast.walk(line) if isinstance(x, ast.Name)]
        bound |= {x.id for x in inside if isinstance(x.ctx, ast.Store)}
    return bound


def without_start(body):
    """The lines of a region but for those that start the script as a program."""
    return re.sub('^if __name__ == "__main__":\n(    .*\n)+', "", body, flags=re.M)


def unfolded(match):
    """What is folded in the text, unfolded where a cell is made of it."""
    title, body = match.groups()
    return f"**{title}**\n{body}" if PIECE.search(body) else match[0]


def notebook(path, script, shown, about, end, picture):
    """A text at `path` as a notebook, in the format that Jupyter keeps: a text.

    `about` and `end` are Markdown: what stands under the title, and what follows the text.
    `shown`: where commands write their page, from the project's folder. picture(text) makes a
    picture smaller.
    """
    maker = Maker(path.parent, script, shown, picture)
    folders = path.parent.relative_to(texts.ROOT).parts
    up = "/".join([".."] * len(folders))
    title, text = path.read_text(encoding="utf-8").split("\n", 1)
    maker.text(f"{title}\n\n{about}")
    maker.code(LOADS.format(script=script.name, up=up))
    maker.text(text)
    maker.text(end)
    made = new_notebook(cells=maker.cells)
    made.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    nbformat.validate(made)
    return nbformat.writes(made) + "\n"
