"""The chapter's README as one page whose pictures live: chapter.html, beside this file.

    python -m curriculum.ch3_4_constraints.chapter

A picture whose name has a figure in page/figures.js becomes that figure; without JavaScript it
stays the picture. What moves the figures is the chapter's own code (see page.traced).
"""

import re
from functools import partial
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
from markdown_it import MarkdownIt
from pygments import lex
from pygments.lexers import get_lexer_by_name
from pygments.token import Comment, Keyword, Name, Number, String

import constraints
from curriculum.ch3_4_constraints.page import (
    as_script,
    page_file,
    palette_css,
    scene_script,
    written,
)

HERE = Path(__file__).parent
SOURCE, PAGE = HERE / "README.md", HERE / "chapter.html"
MEASURES = {  # what figures ask of a state, by system, besides what every page has
    "pendulum": {
        "g": lambda *state: constraints.constraint_terms(*state)[1],
        "gdot": lambda *state: constraints.constraint_terms(*state)[2],
        "tensions": constraints.tensions,
        "weight": constraints.external_force,
    },
    "double": {"jacobian": lambda *state: constraints.constraint_terms(*state)[0]},
    "peaucellier": {},
}
KNOBS = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02, "impedance": 0.95}
CODE = {Comment: "comment", String: "string", Keyword: "keyword", Name.Function: "name"}
CODE |= {Name.Class: "name", Number: "number"}
# Inline code is a formula if it is made of these words alone, and an indented block always is.
SPELLED = {"lambda": "λ", "sqrt": "√", "gdot": "ġ", "gddot": "g̈", "Jdot": "J̇"}
UPRIGHT = "diag", "next", "trace", "determinant", "damping", "stiffness"
LETTER = rf"(?<![a-zA-Z])(?:{'|'.join(SPELLED)}|dt|rt|v?[a-zA-Z]\d?)(?![a-zA-Z])"
IN_WORDS = r"\b(?:g|gdot|d|dt|v|w|J)\b"  # what a caption has as plain text
FORMULA = re.compile(rf"(?!--)(?:{'|'.join(UPRIGHT)}|{LETTER}|[\d\s.,:+*/^=()_-])+")


def variable(found):
    """A letter of a formula, of the class that gives it a figure's colour; x0 and vx0, too."""
    name, below = found[0], ""
    if name[-1].isdigit():
        name, below = name[0], f"<sub>{name[1:]}</sub>"
    return f'<var class="{name}">{SPELLED.get(name, name)}</var>{below}'


def formula(text):
    """A formula as the chapter types it, such as d_(n-1) . v_n = 0, as HTML."""
    text = re.sub(LETTER, variable, escape(text)).replace("√</var> ", "√</var>")
    for mark, tag in (r"\^", "sup"), ("(?<=</var>)_", "sub"):
        what = r"(?:\((.*?)\)|(-?(?:<var.*?</var>|\w+)))"
        text = re.sub(mark + what, rf"<{tag}>\1\2</{tag}>", text)
    return re.sub(r" [.*] ", " · ", text).replace("-", "\N{MINUS SIGN}")


def code_inline(tokens, k, *_):
    text = tokens[k].content
    if FORMULA.fullmatch(text) and re.search("[a-zA-Z^]", text):
        return f'<span class="formula">{formula(text)}</span>'
    return f"<code>{escape(text)}</code>"


def code_block(tokens, k, *_):
    """Lines of formulas; a table, where they are typed in columns; or a matrix, as it is typed."""
    lines = tokens[k].content.rstrip().split("\n")
    rows = [re.split(" {2,}", line.strip()) for line in lines]
    if len(rows[-1]) == 1:
        return '<pre class="formula">' + "\n".join(map(formula, lines)) + "</pre>"
    if any(cell.count("(") != cell.count(")") for row in rows for cell in row):
        return f'<pre class="code"><code>{escape(tokens[k].content)}</code></pre>'
    cells = [[""] * (len(rows[-1]) - len(row)) + list(map(formula, row)) for row in rows]
    body = "".join(f"<tr><td>{'<td>'.join(row)}" for row in cells)
    return f'<table class="formula">{body}</table>'


def fence(tokens, k, *_):
    """A listing, coloured."""
    parts = []
    for kind, text in lex(tokens[k].content, get_lexer_by_name(tokens[k].info or "text")):
        name = next((name for of, name in CODE.items() if kind in of), None)
        parts.append(f'<span class="{name}">{escape(text)}</span>' if name else escape(text))
    return f'<pre class="code {tokens[k].info}" tabindex="0"><code>{"".join(parts)}</code></pre>'


def image(known, tokens, k, *_):
    """A picture within the page; for one whose name is `known` that of a figure is left free."""
    path = SOURCE.parent / tokens[k].attrs["src"]
    words = escape(" ".join(tokens[k].content.split()))
    data = quote(path.read_text().replace('"', "'"), safe=" '<>=:/;,()!*@$?+")
    picture = f'<img alt="{words}" src="data:image/svg+xml,{data}">'
    caption = f"<figcaption>{re.sub(IN_WORDS, variable, words)}</figcaption>"
    if path.stem not in known:
        return f"<figure>{picture}{caption}</figure>"
    return f'<figure data-figure="{path.stem}"><noscript>{picture}</noscript>{caption}</figure>'


def heading_open(tokens, k, *_):
    """A heading that links can lead to, by the name that GitHub gives it."""
    name = re.sub(r"[^\w\- ]", "", tokens[k + 1].content.lower()).replace(" ", "-")
    return f'<{tokens[k].tag} id="{name}">'


def page():
    """The page, as text."""
    figures = page_file("figures.js")
    known = re.findall(r"^figures\.(\w+) =", figures, re.M)
    markdown = MarkdownIt("commonmark").enable("table")
    rules = code_inline, code_block, fence, heading_open
    markdown.renderer.rules |= {rule.__name__: rule for rule in rules}
    markdown.renderer.rules |= {"image": partial(image, known), "html_block": lambda *_: ""}
    text = markdown.render(SOURCE.read_text())
    text = re.sub(r"<p>(<figure.*?</figure>)</p>", r"\1", text, flags=re.S)  # alone in a paragraph
    blanks = {
        "title": re.search("<h1.*?>(.*?)</h1>", text)[1],
        "style": palette_css() + page_file("style.css") + page_file("chapter.css"),
        "text": text,
        "script": f"const traced = {scenes()};\n" + page_file("parts.js") + figures,
    }
    return re.sub("{{(.*?)}}", lambda blank: blanks[blank[1]], page_file("chapter.html"))


def scenes():
    """The systems of the figures, as an object of JavaScript; seed1 is where that one starts."""
    systems = {name: constraints.build_system(name) for name in MEASURES}
    other = constraints.build_system("double", 1)
    made = {
        name: scene_script(constraints, system, "semi_implicit", KNOBS, MEASURES[name])
        for name, system in systems.items()
    }
    start = np.ravel([other["q0"], other["v0"]]).tolist()
    return written(made | {"seed1": as_script(start), "impedance": as_script(KNOBS["impedance"])})


if __name__ == "__main__":
    PAGE.write_text(page())
    print(f"wrote {PAGE.name}: {PAGE.stat().st_size / 1000:.0f} kB")
