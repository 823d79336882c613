"""Sheets: drawings and charts as SVG, in the palette of the pages, in light and dark."""

import re
from html import escape

import numpy as np

from curriculum.ch3_4_constraints.page.scene import palette_css

STYLE = f"""<style>{palette_css()}path {{ fill: none; stroke-linejoin: round }}
text {{ font: 30px system-ui, sans-serif }}</style>"""
MOVING = """<style>.still { display: none }
@media (prefers-reduced-motion: reduce), print {
.still { display: inline } .moves { display: none } }</style>"""
MOVES = re.compile('<path class="moves".*?</path>\n')
PHONE = "<style>@media (max-width: 500px) {{ text {{ font-size: {:.0f}px }} }}</style>"
PAPER = '<rect width="100%" height="100%" rx="12" fill="var(--paper)"/>'


def still(picture):
    """A picture, as text, that moves no more: it is as its motion ends."""
    return MOVES.sub("", picture.replace(MOVING, ""))


class Sheet:
    """A drawing of the box from `low` to `high`, (2,) each, as `width` by `height` units.

    Two units are a pixel. A point is (2,) or (3,), of which x and y are drawn, in the box's own
    unit; widths are in units. A colour is a name that palette_css has, as "m0" or "ink".
    """

    def __init__(self, width, height, low, high):
        self.size = (width, height)
        self.low = low
        self.scale = np.divide(self.size, np.subtract(high, low))
        self.parts = []

    def at(self, point):
        """The place of a point as SVG has it, a text: x and y in whole units, y down."""
        x, y = (np.array(point)[:2] - self.low) * self.scale
        return f"{x:.0f} {self.size[1] - y:.0f}"

    def line(self, points, colour, width=6, dash=""):
        """A line through points (n, 2) or (n, 3), so many units wide.

        `dash`: the lengths of dashes and gaps in units, as "9 9"; solid if it is "".
        """
        style = f"stroke-dasharray:{dash}" if dash else "stroke-linecap:round"
        self.lines([points], colour, width, style)

    def dot(self, point, colour, width):
        """A disc so many units wide."""
        self.line([point, point], colour, width)

    def lines(self, lines, *style):
        """Several lines of points (n, 2) or (n, 3). `style`: colour, width, more of `path`."""
        self.parts.append(path(self.outline(lines), *style))

    def moving(self, frames, seconds, *style):
        """Lines that move: `frames` are those of one moment after the other, as `lines` takes them.

        They take so many seconds, again and again. Where nothing should move, and on paper, it is
        the last frame; a single one is drawn as it is.
        """
        if len(frames) == 1:
            self.lines(frames[0], *style)
            return
        shown = ";".join(map(self.outline, frames))
        last = self.outline(frames[-1])
        move = f'attributeName="d" values="{shown}" dur="{seconds:g}s" repeatCount="indefinite"'
        self.parts.append(path(last, *style, kind='class="still" '))
        self.parts.append(path(last, *style, kind='class="moves" ', inside=f"<animate {move}/>"))

    def outline(self, lines):
        """Lines of points as SVG's path."""
        return "".join("M" + "L".join(map(self.at, line)) for line in lines)

    def arrow(self, start, end, colour):
        """An arrow between two points, unless it is too short to be seen, and has no direction."""
        along = np.subtract(end, start)[:2]
        size = np.linalg.norm(along * self.scale)
        if size < 1.0:
            return
        back = -min(22.0, size) / size * along
        aside = 0.5 * np.array([-back[1], back[0]])
        left = end[:2] + back + aside
        right = end[:2] + back - aside
        self.line([start, end, left, end, right], colour)

    def words(self, point, words, colour="ink", anchor="middle", up=0, style=""):
        """Words at a point, or `up` units above it; `anchor` and `style` are SVG's."""
        x, y = self.at(point).split()
        place = f'x="{x}" y="{int(y) - up}" text-anchor="{anchor}"'
        style = f"{style}fill:var(--{colour})"
        self.parts.append(f'<text {place} style="{style}">{escape(words)}</text>')

    def place(self, other, x, y):
        """Another sheet on this one, so many units from its upper left corner; it is cut off."""
        width, height = other.size
        box = f'x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}"'
        self.parts += [f"<svg {box}>", *other.parts, "</svg>"]

    def text(self, width=None):
        """The drawing as SVG, by default half as many pixels wide as it has units.

        On a phone its words have 11 px or more.
        """
        units, height = self.size
        box = f'viewBox="0 0 {units} {height}" width="{width or units // 2}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>'
        return "\n".join([head, STYLE, PHONE.format(units / 31), PAPER, *self.parts, "</svg>\n"])


def path(outline, colour, width, more="", kind="", inside=""):
    """An element of SVG, a text: lines with an `outline`, so many units wide, in a colour.

    `more` is CSS; `kind`, attributes; `inside`, other elements.
    """
    style = f"stroke:var(--{colour});stroke-width:{width:.3g};{more}".rstrip(";")
    return f'<path {kind}d="{outline}" style="{style}">{inside}</path>'


def chart(curves, x_ticks, y_ticks, y_name, covered=""):
    """Curves (name, colour, x (n,), y (n,)) over axes, whose ticks are {place: words}: SVG.

    x and y are in the units of the ticks' places, which go up. `covered` names those at 0 that
    cover each other.
    """
    left, *_, right = x_ticks
    bottom, *_, top = y_ticks
    wide = right - left
    high = top - bottom
    low = (left - 0.16 * wide, bottom - 0.14 * high)
    sheet = Sheet(1200, 600, low, (right + 0.07 * wide, top + 0.24 * high))
    for y, words in y_ticks.items():
        sheet.line([(left, y), (right, y)], "reference", 1)
        sheet.words((left - 0.01 * wide, y), words, "reference", "end", -10)
    for x, words in x_ticks.items():
        sheet.words((x, bottom), words, "reference", up=-40)
    sheet.words((left, top), y_name, "reference", "start", 64)
    lengths = [len(words) + 2 for words, *_ in curves]
    for k, (words, colour, x, y) in enumerate(curves):
        sheet.line(zip(x, np.clip(y, bottom, top), strict=True), colour)
        share = (sum(lengths[:k]) + 0.5 * lengths[k]) / sum(lengths)  # long names have more room
        sheet.words((left + share * wide, top), words, colour, up=18)
    if covered:
        sheet.words((right, 0.0), covered, "ink", "end", 14)
    return sheet.text()
