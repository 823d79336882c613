"""A little SVG (lines, arrows, words, charts), and the one palette of pictures and recordings."""

import math
from itertools import pairwise

ESCAPES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"})


class Colors(dict):
    """Colours by name; a mode that a reader adds to the chapter's has one, too."""

    spare = "#2e8b57", "#b8690f", "#7a5c99"

    def __missing__(self, name):
        return self.spare[sum(name.encode()) % len(self.spare)]


# Told apart by everybody, in each kind of colour blindness, and readable on any ground.
MODES = Colors(none="#458fac", baumgarte="#5a4cef", impulse="#947c00", soft="#bd144e")
MODES["project"] = "#ff008d"
PULL, PUSH, EXCESS = "#cd8166", "#bb72ff", "#ff1f1f"  # of a rod; and what it has too much
INK, GREY, PALE = "currentColor", "#7d8590", "#7d859055"
STYLE = """<style>svg{color:#1f2328;--paper:#fff}
@media(prefers-color-scheme:dark){svg{color:#e6edf3;--paper:#0d1117}}</style>"""
LINE = 18  # pixels from a line of words to the next


def element(name, *inside, **attributes):
    """An SVG element; `_` in the name of an attribute stands for `-`."""
    words = name
    for key, value in attributes.items():
        words += f' {key.replace("_", "-")}="{str(value).translate(ESCAPES)}"'
    return f"<{words}>{''.join(inside)}</{name}>" if inside else f"<{words}/>"


class Drawing:
    """A sheet of so many pixels, y down, light or dark as the reader's screen is."""

    def __init__(self, width, height, title):
        paper = element("rect", width=width, height=height, rx=6, fill="var(--paper)")
        self.parts = [element("title", title.translate(ESCAPES)), STYLE, paper]
        self.look = {"width": width, "height": height, "viewBox": f"0 0 {width} {height}"}

    def add(self, name, *inside, **attributes):
        """An element more."""
        self.parts.append(element(name, *inside, **attributes))

    def line(self, points, color, width, dash="none", fill="none"):
        """A line through points."""
        style = {"stroke": color, "stroke_width": width, "stroke_dasharray": dash, "fill": fill}
        self.add("polyline", points=" ".join(f"{x:.1f},{y:.1f}" for x, y in points), **style)

    def dot(self, at, radius, color):
        """A filled circle."""
        self.add("circle", cx=f"{at[0]:.1f}", cy=f"{at[1]:.1f}", r=radius, fill=color)

    def words(self, x, y, text, color=INK, anchor="start", size=15, weight="normal"):
        """A line of words that starts, has its middle or ends at x, on the base line y."""
        style = {"fill": color, "text_anchor": anchor, "font_size": size, "font_weight": weight}
        self.add("text", text.translate(ESCAPES), x=f"{x:.1f}", y=f"{y:.1f}", **style)

    def arrow(self, start, end, color, width, head):
        """An arrow, if it is long enough to have a head."""
        if (length := math.dist(start, end)) > head:
            dx, dy = ((end[k] - start[k]) * head / length for k in (0, 1))
            x, y = end[0] - dx, end[1] - dy
            sides = [(x + s * 0.45 * dy, y - s * 0.45 * dx) for s in (1, -1)]
            self.line([start, (x, y)], color, width)
            self.line([end, *sides, end], color, 0.5, fill=color)

    def text(self):
        """The file."""
        self.look |= {"stroke_linecap": "round", "stroke_linejoin": "round"}
        self.look |= {"xmlns": "http://www.w3.org/2000/svg", "font_family": "Arial, sans-serif"}
        return element("svg", "\n".join(["", *self.parts, ""]), role="img", **self.look) + "\n"


def position(value, limits, begin, end):
    """Where a value is between two pixels, logarithmic if the limits are above 0."""
    low, high, at = (math.log10(x) if limits[0] > 0 else x for x in (*limits, value))
    return begin + (end - begin) * (at - low) / (high - low)


def chart(title, x, y, curves, size=(480, 420), right=100):
    """The text of a chart of `curves` {name: (colour, [(x, y), ...])}, named where they end; x and
    y: (name, limits, {value: words}), logarithmic if the limits are above 0."""
    sheet, left, end, bottom, top = Drawing(*size, title), 64, size[0] - right, size[1] - 58, 48
    for value, words in x[2].items():
        at = position(value, x[1], left, end)
        sheet.line([(at, bottom), (at, top)], PALE, 1)
        sheet.words(at, bottom + LINE + 2, words, GREY, "middle")
    for value, words in y[2].items():
        at = position(value, y[1], bottom, top)
        sheet.line([(left, at), (end, at)], PALE, 1)
        sheet.words(left - 8, at + 5, words, GREY, "end")
    sheet.words(left, size[1] - 12, x[0])
    sheet.words(16, 28, y[0])
    names = []
    for name, (color, values) in curves.items():
        points = [(position(a, x[1], left, end), position(b, y[1], bottom, top)) for a, b in values]
        sheet.line(points, color, 2.5)
        names.append([*points[-1], name, color])
    names.sort(key=lambda name: name[1])
    for above, below in list(pairwise(names)) * 100:  # names that overlap are moved apart
        overlap = LINE - (below[1] - above[1])
        if overlap > 0.0 and abs(above[0] - below[0]) < 100.0:
            above[1], below[1] = above[1] - 0.5 * overlap, below[1] + 0.5 * overlap
    for at, height, name, color in names:
        sheet.words(at + 6, height + 5, name, color, weight="bold")
    return sheet.text()
