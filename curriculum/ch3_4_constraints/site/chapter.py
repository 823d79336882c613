"""The chapter's README as one page whose pictures live: chapter.html, in the folder above.

A picture whose name has a figure in figures/ becomes that figure; printed, or without JavaScript,
it stays the picture. What moves the figures is the chapter's own code (see page.scene_of).
"""

import re
from functools import partial
from html import escape
from itertools import groupby
from pathlib import Path
from urllib.parse import quote

from latex2mathml.converter import convert
from markdown_it import MarkdownIt
from mdit_py_plugins.anchors import anchors_plugin
from mdit_py_plugins.dollarmath import dollarmath_plugin
from pygments import lex
from pygments.lexers import get_lexer_by_name
from pygments.token import Comment, Keyword, Name, Number, String

from curriculum.ch3_4_constraints.page.scene import as_script, page_file, palette_css
from curriculum.ch3_4_constraints.site.drawing import still
from curriculum.ch3_4_constraints.site.scenes import scenes

HERE = Path(__file__).parents[1]
SOURCE = HERE / "README.md"
KEYS = {  # functions that are folded, and the lines of each that stay in sight, by their beginning
    "constraint_terms": ("jac.append", "g.append", "gdot.append", "jdotv.append"),
    "tensions": ("lam = ",),
    "euler_step": ("return ",),
    "rk4_step": ("q_next = ",),
    "energy": ("return ",),
    "constraint_violation": ("return ",),
    "Method": (),
    "project": ("dmu = ", "v = ", "nu = "),
    "stabilized": ("q_end, v_end = method.post_step",),
}
CODE = {Comment: "comment", String: "string", Keyword: "keyword", Name.Function: "name"}
CODE |= {Name.Class: "name", Number: "number"}


def mathml(latex, settings):
    """A formula as MathML; a letter's class is its name, for the colour it has in figures.

    In a line it may end before each = sign, since browsers break lines only between formulas.
    """
    latex = latex.replace(r"\mathrm{dt} ", r"\text{dt}\,").replace(r"\mathrm", r"\text")
    kind = "block" if settings["display_mode"] else "inline"
    parts = [latex] if kind == "block" else re.split(r" (?==)", latex)
    math = "<wbr>".join(convert(part, display=kind) for part in parts)
    math = re.sub("(?<=</mo>)(?<!&#x00029;</mo>)<mo>(?=&#x02212;)", '<mo form="prefix">', math)
    return re.sub("<mi>([^<]+)</mi>", r'<mi class="\1">\1</mi>', math)


def colored(code, language):
    """The lines of a listing."""

    def name_of(token):
        return next((name for kind, name in CODE.items() if token[0] in kind), None)

    parts = []
    for name, tokens in groupby(lex(code, get_lexer_by_name(language, stripnl=False)), name_of):
        text = escape("".join(text for _, text in tokens), quote=False)
        parts.append(f'<span class="{name}">{text}</span>' if name else text)
    return f"<pre><code>{''.join(parts)}</code></pre>"


def fence(tokens, k, *_):
    """A listing; of a region of constraints.py each function that is in KEYS is folded."""
    language = tokens[k].info or "text"
    code = tokens[k].content
    is_region = k > 0 and tokens[k - 1].content.startswith("<!-- region")
    pieces = re.split(r"(?<=\n\n\n)", code) if is_region else [code]
    text = "".join(folded(piece, language) for piece in pieces)
    return f'<div class="code {language}" tabindex="0">{text}</div>'


def folded(code, language):
    """A piece of a region, behind its key lines if it is a function of KEYS.

    Three dots stand where lines are left out.
    """
    found = re.search(r"^(?:def|class) (\w+)", code, re.M)
    whole = colored(code, language)
    if not found or found[1] not in KEYS:
        return whole
    lines = code[found.start() :].rstrip().splitlines()
    seen = lines[:2]  # its head, and what it says of itself first
    if seen[1].count('"""') == 1:
        seen[1] += '"""'
    kept = len(seen)
    skipped = ""  # what stands for the lines left out since the last one in sight
    for line in lines[2:]:
        if not line.lstrip().startswith(KEYS[found[1]]):
            skipped = skipped or "    ..."
            continue
        seen += [skipped, line] if skipped else [line]
        skipped = ""
        kept += 1
    seen += [skipped] if skipped else []
    hidden = len(code.strip().splitlines()) - kept
    if hidden == 0:
        return whole
    more = f'<span class="more">{hidden} more lines</span>'
    head = colored("\n".join(seen), language)
    return f'<details class="fold"><summary>{head}{more}</summary>{whole}</details>'


def image(live, tokens, k, *_):
    """A picture within the page; one whose name is `live` makes place for a figure.

    Here pictures stand still: what moves is a figure.
    """
    path = SOURCE.parent / tokens[k].attrs["src"]
    words = escape(" ".join(tokens[k].content.split()))
    drawn = needed(still(path.read_text(encoding="utf-8")))
    shorter = drawn.replace('"', "'").replace("\n", " ")  # where it is quoted
    data = quote(shorter, safe=" '<>=:/;,()!*@$?+")
    picture = f'<img alt="{words}" src="data:image/svg+xml,{data}">'
    kind = f' data-figure="{path.stem}"' if path.stem in live else ""
    return f"<figure{kind}>{picture}<figcaption>{words}</figcaption></figure>"


def needed(picture):
    """A picture, as text, without the colours that it has no use for."""
    picture = re.sub(r"^\.m\d \{.*?\}\n", "", picture, flags=re.M)

    def kept(found):
        return found[0] if f"var(--{found[1]})" in picture else ""

    return re.sub(r"--(\w+): #\w+; ", kept, picture)


def html_block(tokens, k, *_):
    """Comments say how blocks are made; what else is HTML stays."""
    return "" if tokens[k].content.startswith("<!--") else tokens[k].content


def link_open(tokens, k, *_):
    """A link that works from anywhere; others lead beside the page, which travels alone."""
    href = escape(tokens[k].attrs["href"])
    if href.startswith(("https:", "#")):
        return f'<a href="{href}">'
    return f'<a class="inside" title="{href}">'


def site_file(name):
    """The text of a file in this folder."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def figure_files():
    """The texts of the figures: first of what they share."""
    folder = Path(__file__).parent / "figures"
    paths = sorted(folder.glob("*.js"), key=lambda path: (path.stem != "common", path.stem))
    return [path.read_text(encoding="utf-8") for path in paths]


def page():
    """The page, as text."""
    figures = "\n".join([*figure_files(), "begin();\n"])
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
    text = text.replace("<h2", contents + "<h2", 1)
    blanks = {
        "style": palette_css() + page_file("style.css") + site_file("chapter.css"),
        "text": text,
        "script": f"const traced = {as_script(scenes())};\n" + page_file("parts.js") + figures,
    }
    return re.sub("{{(.*?)}}", lambda blank: blanks[blank[1]], site_file("frame.html"))
