"""A little SVG (lines, arrows, words, charts), and the one palette of pictures and recordings."""

import math
from itertools import pairwise
from xml.sax.saxutils import escape, quoteattr

# Told apart by everybody, in each kind of colour blindness, and readable on white and on black.
MODES = {"none": "#458fac", "baumgarte": "#4149da", "impulse": "#947c00", "soft": "#b70034"}
MODES["project"] = "#ff008d"
PULL, PUSH, EXCESS = "#cd8166", "#bb72ff", "#ff1f1f"  # of a rod; and what it has too much
INK, GREY, PALE, PAPER = "currentColor", "#7d8590", "#7d859055", "var(--paper)"
STYLE = """<style>svg{color:#1f2328;--paper:#fff}
@media(prefers-color-scheme:dark){svg{color:#e6edf3;--paper:#0d1117}}</style>"""
FONT, LINE = "Helvetica, Arial, sans-serif", 18  # pixels from a line of words to the next


def element(name, *inside, **attributes):
    """An SVG element; `_` in the name of an attribute stands for `-`."""
    words = "".join(f" {k.replace('_', '-')}={quoteattr(str(x))}" for k, x in attributes.items())
    return f"<{name}{words}>{''.join(inside)}</{name}>" if inside else f"<{name}{words}/>"


def path(points):
    """Points (x, y) in the form that polylines want."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


class Drawing:
    """A sheet of `width` times `height` pixels, y down; points are pairs of pixels.

    Its paper is white where the reader's screen is light, and dark where that is dark.
    """

    def __init__(self, width, height, title):
        self.size, self.title, self.parts = (width, height), title, []
        sides = {"width": width - 1, "height": height - 1}
        self.add("rect", x=0.5, y=0.5, **sides, rx=6, fill=PAPER, stroke=PALE)

    def add(self, name, *inside, **attributes):
        """An element more."""
        self.parts.append(element(name, *inside, **attributes))

    def line(self, points, color=INK, width=1.5, dash="none"):
        """A line through points."""
        style = {"stroke": color, "stroke-width": width, "stroke-dasharray": dash}
        self.add("polyline", points=path(points), fill="none", **style)

    def dot(self, at, radius, color=INK):
        """A filled circle."""
        self.add("circle", cx=f"{at[0]:.1f}", cy=f"{at[1]:.1f}", r=radius, fill=color)

    def words(self, x, y, text, color=INK, anchor="start", size=15, weight="normal"):
        """A line of words that starts, has its middle or ends at x, on the base line y."""
        style = {"fill": color, "text-anchor": anchor, "font-size": size, "font-weight": weight}
        self.add("text", escape(text), x=f"{x:.1f}", y=f"{y:.1f}", **style)

    def arrow(self, start, end, color=INK, width=3.0, head=11.0):
        """An arrow, if it is long enough to have a head."""
        length = math.dist(start, end)
        if length < head:
            return
        (dx, dy), (x, y) = ((end[k] - start[k]) * head / length for k in (0, 1)), end
        neck = x - dx, y - dy
        self.line([start, neck], color, width)
        corners = end, (neck[0] + 0.45 * dy, neck[1] - 0.45 * dx)
        last = neck[0] - 0.45 * dy, neck[1] + 0.45 * dx
        self.add("polygon", points=path([*corners, last]), fill=color)

    def text(self):
        """The file."""
        (width, height), font = self.size, {"font-family": FONT, "font-size": 15}
        size = {"viewBox": f"0 0 {width} {height}", "width": width, "height": height}
        line = {"stroke-linecap": "round", "stroke-linejoin": "round", "role": "img"}
        inside = "\n".join(["", f"<title>{escape(self.title)}</title>", STYLE, *self.parts, ""])
        return element("svg", inside, xmlns="http://www.w3.org/2000/svg", **size, **font, **line)


def chart(title, x, y, curves, size=(480, 420)):
    """The text of a chart: an axis is (its name, its range, {value: words}, logarithmic?).

    `curves`: {name: (colour, [(x, y), ...], dots?)}; the names stand where their curves end.
    """
    sheet, room = Drawing(*size, title), ((64, size[0] - 96), (size[1] - 58, 48))

    def place(axis, pixels, value):
        low, high, value = (math.log10(a) if axis[3] else a for a in (*axis[1], value))
        return pixels[0] + (pixels[1] - pixels[0]) * (value - low) / (high - low)

    for value, words in x[2].items():
        at = place(x, room[0], value)
        sheet.line([(at, edge) for edge in room[1]], PALE, 1)
        sheet.words(at, room[1][0] + LINE + 2, words, GREY, "middle")
    for value, words in y[2].items():
        at = place(y, room[1], value)
        sheet.line([(edge, at) for edge in room[0]], PALE, 1)
        sheet.words(room[0][0] - 8, at + 5, words, GREY, "end")
    sheet.words(sum(room[0]) / 2, size[1] - 12, x[0], anchor="middle")
    sheet.words(16, 28, y[0])
    names = []
    for name, (color, values, dots) in curves.items():
        points = [(place(x, room[0], a), place(y, room[1], b)) for a, b in values]
        sheet.line(points, color, 2.5)
        for point in points if dots else ():
            sheet.dot(point, 3, color)
        names.append([*points[-1], name, color])
    names.sort(key=lambda name: name[1])
    for above, below in list(pairwise(names)) * 100:  # names that overlap are moved apart
        overlap = LINE - (below[1] - above[1])
        if overlap > 0.0 and abs(above[0] - below[0]) < 100.0:
            above[1], below[1] = above[1] - 0.5 * overlap, below[1] + 0.5 * overlap
    for x_end, y_end, name, color in names:
        sheet.words(x_end + 6, y_end + 5, name, color, weight="bold")
    return sheet.text()
