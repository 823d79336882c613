"""A little SVG (lines, arrows, words, charts), and the one palette of pictures and recordings."""

import math
from itertools import cycle, pairwise

HEAD = 12  # pixels, of an arrow
ESCAPES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"})

# Each colour on white paper, on dark paper and, of lines, in the plots of a recording, which are as
# light or dark as the reader's viewer. All have a contrast of at least 4.5 to their paper, as words
# need, or of 3 in plots, and are told apart in each kind of colour blindness: a test computes that.
COLORS = {
    "none": ("#005368", "#2ee5ff", "#126d78"),
    "baumgarte": ("#422bd1", "#8169f0", "#424aef"),
    "impulse": ("#534406", "#ffc900", "#6f6113"),
    "soft": ("#bb3f9d", "#fa84c4", "#da6dac"),
    "project": ("#0c864b", "#1eb765", "#03a252"),
    "spare": ("#092800", "#c6d5b8", "#a65ae9"),
    "pull": ("#be5700", "#ed7705"),
    "push": ("#850aa4", "#b35cb4"),
    "excess": ("#ca2837", "#e63e37"),
    "missing": ("#0072e5", "#88a8fe"),
    "grey": ("#727373", "#8b837a"),
    "ink": ("#1f2328", "#e6edf3"),
    "pale": ("#d8dbdf", "#30363d"),
    "paper": ("#ffffff", "#0d1117"),
}
LIGHT = {name: color[0] for name, color in COLORS.items()}
DARK = {color[0]: color[1] for color in COLORS.values()}  # what a light colour becomes
RECORDED = {color[0]: color[-1] for color in COLORS.values()}  # or, in a recording
MODES = {name: LIGHT[name] for name in ("none", "baumgarte", "impulse", "soft", "project")}
PULL, PUSH = LIGHT["pull"], LIGHT["push"]  # of a rod
EXCESS, MISSING = LIGHT["excess"], LIGHT["missing"]  # what a rod has too much, and what it lacks
INK, GREY, PALE, PAPER = (LIGHT[name] for name in ("ink", "grey", "pale", "paper"))
# Colours stand in the drawing as they are on white; only where a style sheet is read and the
# reader's screen is dark does another take their place.
RULES = (f'[fill="{a}"]{{fill:{b}}}[stroke="{a}"]{{stroke:{b}}}' for a, b in DARK.items())
STYLE = f"<style>@media(prefers-color-scheme:dark){{{''.join(RULES)}}}</style>"


def mode_colors(modes):
    """{mode: colour}, also of rows that a reader has added to the table."""
    spare = cycle([LIGHT["spare"], INK, GREY])
    return {mode: MODES.get(mode) or next(spare) for mode in modes}


def element(name, *inside, **attributes):
    """An SVG element; `_` in the name of an attribute stands for `-`."""
    words = name
    for key, value in attributes.items():
        words += f' {key.replace("_", "-")}="{str(value).translate(ESCAPES)}"'
    return f"<{words}>{''.join(inside)}</{name}>" if inside else f"<{words}/>"


class Drawing:
    """A sheet of so many pixels, y down, light or dark as the reader's screen is."""

    def __init__(self, width, height, title):
        paper = element("rect", width=width, height=height, rx=6, fill=PAPER)
        self.parts = [element("title", title.translate(ESCAPES)), STYLE, paper]
        self.look = {"width": width, "height": height, "viewBox": f"0 0 {width} {height}"}
        self.look |= {"stroke_linecap": "round", "stroke_linejoin": "round"}
        self.look |= {"xmlns": "http://www.w3.org/2000/svg", "font_family": "Arial, sans-serif"}

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

    def arrow(self, start, end, color):
        """An arrow, if it is long enough to have a HEAD."""
        length = math.dist(start, end)
        if length > HEAD:
            dx, dy = ((end[k] - start[k]) * HEAD / length for k in (0, 1))
            x, y = end[0] - dx, end[1] - dy
            sides = [(x + s * 0.45 * dy, y - s * 0.45 * dx) for s in (1, -1)]
            self.line([start, (x, y)], color, 4)
            self.line([end, *sides, end], color, 0.5, fill=color)

    def text(self):
        """The file."""
        return element("svg", "\n".join(["", *self.parts, ""]), role="img", **self.look) + "\n"


def position(value, limits, begin, end):
    """Where a value is between two pixels, logarithmic if the limits are above 0."""
    low, high, at = (math.log10(x) if limits[0] > 0 else x for x in (*limits, value))
    return begin + (end - begin) * (at - low) / (high - low)


def chart(title, x, y, curves, size=(480, 420), right=100):
    """The text of a chart of `curves`, as `plot` draws them; `right`: pixels for their names."""
    sheet = Drawing(*size, title)
    sheet.words(64, size[1] - 12, x[0])
    sheet.words(16, 28, y[0])
    plot(sheet, (64, 48, size[0] - right, size[1] - 58), x, y, curves)
    return sheet.text()


def plot(sheet, corners, x, y, curves, size=15):
    """Draw `curves` {name: (colour, [(x, y), ...])} between (left, top, right, bottom), in pixels.

    x and y: (name, limits, {value: words}), logarithmic if the limits are above 0. A curve has its
    name where it ends, in words of `size`; a third entry beside its points is a line's dashes.
    """
    left, top, end, bottom = corners
    line = 1.2 * size  # from a line of words to the next
    _, across, columns = x
    _, upward, rows = y
    for value, words in columns.items():
        if across[0] <= value <= across[1]:
            at = position(value, across, left, end)
            sheet.line([(at, bottom), (at, top)], PALE, 1)
            sheet.words(at, bottom + line + 2, words, GREY, "middle", size)
    for value, words in rows.items():
        if upward[0] <= value <= upward[1]:
            at = position(value, upward, bottom, top)
            sheet.line([(left, at), (end, at)], PALE, 1)
            sheet.words(left - 8, at + size / 3, words, GREY, "end", size)
    names = []
    for name, (color, xy, *dash) in curves.items():
        points = [(position(a, across, left, end), position(b, upward, bottom, top)) for a, b in xy]
        sheet.line(points, color, 2.5 if size > 13 else 2, *dash)
        names.append([*points[-1], name, color])
    names.sort(key=lambda name: name[1])
    for above, below in list(pairwise(names)) * 100:  # names that overlap are moved apart
        overlap = line - (below[1] - above[1])
        if overlap > 0.0 and abs(above[0] - below[0]) < 100.0:
            above[1] -= 0.5 * overlap
            below[1] = min(below[1] + 0.5 * overlap, bottom)
    for at, height, name, color in names:
        sheet.words(at + 6, height + size / 3, name, color, size=size, weight="bold")
