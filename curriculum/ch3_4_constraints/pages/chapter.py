"""The chapter's README as one page whose pictures live: chapter.html, in the folder above.

    python -m curriculum.ch3_4_constraints.pages.chapter

A picture whose name has a figure in figures.js becomes that figure; printed, or without JavaScript,
it stays the picture. What moves the figures is the chapter's own code (see page.scene_of).
"""

import re
from functools import partial
from html import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
from latex2mathml.converter import convert
from markdown_it import MarkdownIt
from mdit_py_plugins.anchors import anchors_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from pygments import lex
from pygments.lexers import get_lexer_by_name
from pygments.token import Comment, Keyword, Name, Number, String

import constraints
from curriculum.ch3_4_constraints.pages.page import as_script, page_file, palette_css, scene_of

HERE = Path(__file__).parents[1]
SOURCE, PAGE = HERE / "README.md", HERE / "chapter.html"


def equation(system, q, v):
    """J, and A, b and lambda of A lambda = b, without a spring: what constraint_force goes through.

    They are its lines once more, since it returns none of them; a test compares the two.
    """
    m = np.repeat(system["m"], 3)
    f = constraints.external_force(system, q, v).ravel()
    jac, _, _, jdotv = constraints.constraint_terms(system, q, v)
    A = (jac / m) @ jac.T
    b = -(jac @ (f / m) + jdotv)
    return {"J": jac, "A": A, "b": b, "lambda": constraints.solve(system, A, b, v)}


def of_equation(name):
    """A measure: one of what equation has."""
    return lambda *state: equation(*state)[name]


def pull(system, q, v):
    """How hard each rod pulls in N, without a spring."""
    return constraints.tensions(system, q, v, constraints.make_force(system))


MEASURES = {  # what figures ask of a state, by system, besides what every page has
    "pendulum": {
        "g": lambda *state: constraints.constraint_terms(*state)[1],
        "gdot": lambda *state: constraints.constraint_terms(*state)[2],
        "tensions": pull,
        "weight": constraints.external_force,
    },
    "double": {name: of_equation(name) for name in ("J", "A", "b", "lambda")},
    "peaucellier": {},
}
KNOBS = {"dt": 0.005, "baumgarte": 20.0, "time_constant": 0.02, "impedance": 0.95}
FOLDED = "setup|the-systems"  # sections that wait behind a button
CODE = {Comment: "comment", String: "string", Keyword: "keyword", Name.Function: "name"}
CODE |= {Name.Class: "name", Number: "number"}


def mathml(latex, settings):
    """A formula as MathML; a letter's class is its name, for the colour it has in figures."""
    latex = latex.replace(r"\mathrm{dt} ", r"\text{dt}\,").replace(r"\mathrm", r"\text")
    math = convert(latex, display="block" if settings["display_mode"] else "inline")
    math = re.sub("(?<=</mo>)(?<!&#x00029;</mo>)<mo>(?=&#x02212;)", '<mo form="prefix">', math)
    return re.sub("<mi>([^<]+)</mi>", r'<mi class="\1">\1</mi>', math)


def fence(tokens, k, *_):
    """A listing, coloured."""
    parts = []
    for kind, text in lex(tokens[k].content, get_lexer_by_name(tokens[k].info or "text")):
        name = next((name for of, name in CODE.items() if kind in of), None)
        parts.append(f'<span class="{name}">{escape(text)}</span>' if name else escape(text))
    return f'<pre class="code {tokens[k].info}" tabindex="0"><code>{"".join(parts)}</code></pre>'


def image(live, tokens, k, *_):
    """A picture within the page; one whose name is `live` makes place for a figure."""
    path = SOURCE.parent / tokens[k].attrs["src"]
    words = escape(" ".join(tokens[k].content.split()))
    data = quote(path.read_text().replace('"', "'"), safe=" '<>=:/;,()!*@$?+")
    picture = f'<img alt="{words}" src="data:image/svg+xml,{data}">'
    kind = f' data-figure="{path.stem}"' if path.stem in live else ""
    return f"<figure{kind}>{picture}<figcaption>{words}</figcaption></figure>"


def html_block(tokens, k, *_):
    """Comments say how blocks are made; what else is HTML stays."""
    return "" if tokens[k].content.startswith("<!--") else tokens[k].content


def link_open(tokens, k, *_):
    """A link that works from anywhere; others lead beside the page, which travels alone."""
    href = escape(tokens[k].attrs["href"])
    if href.startswith(("https:", "#")):
        return f'<a href="{href}">'
    return f'<a class="inside" title="{href}">'


def page():
    """The page, as text."""
    figures = page_file("figures.js")
    live = re.findall(r"^figures\.(\w+) =", figures, re.M)
    markdown = MarkdownIt("commonmark").enable("table")
    markdown.use(dollarmath_plugin, renderer=mathml, double_inline=True)
    markdown.use(anchors_plugin, min_level=2, max_level=3, permalink=True, permalinkSymbol="#")
    rules = fence, html_block, link_open
    markdown.renderer.rules |= {rule.__name__: rule for rule in rules}
    markdown.renderer.rules |= {"image": partial(image, live)}
    text = markdown.render(SOURCE.read_text(encoding="utf-8"))
    text = re.sub(r"<p>(<figure.*?</figure>)</p>", r"\1", text, flags=re.S)  # alone in a paragraph
    heads = re.findall('<h2 id="(.*?)">(.*?) <a', text)
    links = " ".join(f'<a href="#{name}">{title}</a>' for name, title in heads)
    contents = f'<nav aria-label="Contents">{links}</nav>\n'
    section = f'(<h2 id="(?:{FOLDED})">.*?</h2>)(.*?)(?=<h2)'
    folded = r"<details><summary>\1</summary>\2</details>\n"
    text = re.sub(section, folded, text.replace("<h2", contents + "<h2", 1), flags=re.S)
    blanks = {
        "style": palette_css() + page_file("style.css") + page_file("chapter.css"),
        "text": text,
        "script": f"const traced = {as_script(scenes())};\n" + page_file("parts.js") + figures,
    }
    return re.sub("{{(.*?)}}", lambda blank: blanks[blank[1]], page_file("chapter.html"))


def scenes():
    """The systems of the figures, for parts.js; seed1 is where that one starts."""
    found = {}
    for name, measures in MEASURES.items():
        system = constraints.build_system(name)
        found[name] = scene_of(constraints, system, "semi_implicit", KNOBS, measures)
    other = constraints.build_system("double", 1)
    found["seed1"] = np.ravel([other["q0"], other["v0"]]).tolist()
    return found


if __name__ == "__main__":
    PAGE.write_text(page())
    print(f"wrote {PAGE.name}: {PAGE.stat().st_size / 1000:.0f} kB")
