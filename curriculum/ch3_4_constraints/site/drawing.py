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


def larger(width):
    """A style for a sheet so many units wide: on a phone, its words have 11 px or more."""
    return (
        f"<style>@media (max-width: 500px) {{ text {{ font-size: {width / 31:.0f}px }} }}</style>"
    )


def still(picture):
    """A picture, as text, that moves no more: it is as its motion ends."""
    return MOVES.sub("", picture.replace(MOVING, ""))


class Sheet:
    """A drawing of the box from `low` to `high`, `width` by `height` units, two to a pixel."""

    def __init__(self, width, height, low, high):
        self.size = (width, height)
        self.low = low
        self.scale = np.divide(self.size, np.subtract(high, low))
        self.parts = [
            STYLE,
            larger(width),
            '<rect width="100%" height="100%" rx="12" fill="var(--paper)"/>',
        ]

    def at(self, point):
        x, y = (np.array(point)[:2] - self.low) * self.scale
        return f"{x:.0f} {self.size[1] - y:.0f}"

    def line(self, points, colour, width=6, dash=""):
        style = f"stroke-dasharray:{dash}" if dash else "stroke-linecap:round"
        self.path(["M" + "L".join(map(self.at, points))], colour, width, style)

    def arrow(self, start, end, colour):
        along = np.subtract(end, start)[:2]
        size = np.linalg.norm(along * self.scale)
        if size < 1.0:  # it cannot be seen, and has no direction
            return
        back = -min(22.0, size) / size * along
        aside = 0.5 * np.array([-back[1], back[0]])
        left = end[:2] + back + aside
        right = end[:2] + back - aside
        self.line([start, end, left, end, right], colour)

    def path(self, frames, colour, width, more="", dt=0.0):
        style = f"stroke:var(--{colour});stroke-width:{width};{more}".rstrip(";")
        if len(frames) == 1:
            self.parts.append(f'<path d="{frames[0]}" style="{style}"></path>')
            return
        if MOVING not in self.parts:
            self.parts.insert(0, MOVING)
        move = f'attributeName="d" values="{";".join(frames)}" dur="{len(frames) * dt:g}s"'
        move = f'<animate {move} repeatCount="indefinite"/>'
        self.parts.append(f'<path class="still" d="{frames[-1]}" style="{style}"></path>')
        self.parts.append(f'<path class="moves" d="{frames[0]}" style="{style}">{move}</path>')

    def words(self, point, words, colour="ink", anchor="middle", up=0, style=""):
        x, y = self.at(point).split()
        place = f'x="{x}" y="{int(y) - up}" text-anchor="{anchor}"'
        style = f"{style}fill:var(--{colour})"
        self.parts.append(f'<text {place} style="{style}">{escape(words)}</text>')

    def text(self, width=None):
        """The drawing as SVG, by default half as many pixels wide as it has units."""
        width = width or self.size[0] // 2
        box = 'viewBox="0 0 {} {}" width="{}"'.format(*self.size, width)
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>'
        return "\n".join([head, *self.parts, "</svg>\n"])


def axes(height, x_ticks, y_ticks):
    """A sheet with axes over ticks {place: words}."""
    left, *_, right = x_ticks
    bottom, *_, top = y_ticks
    wide = right - left
    high = top - bottom
    low = (left - 0.16 * wide, bottom - 0.14 * high)
    end = (right + 0.07 * wide, top + 0.24 * high)
    sheet = Sheet(1200, height, low, end)
    for y, words in y_ticks.items():
        sheet.line([(left, y), (right, y)], "reference", 1)
        sheet.words((left - 0.01 * wide, y), words, "reference", "end", -10)
    for x, words in x_ticks.items():
        sheet.words((x, bottom), words, "reference", up=-40)
    return sheet


def chart(curves, x_ticks, y_ticks, y_name, covered=""):
    """Curves (name, colour, x, y) over axes; `covered` names those at 0 that cover each other."""
    left, *_, right = x_ticks
    bottom, *_, top = y_ticks
    sheet = axes(600, x_ticks, y_ticks)
    sheet.words((left, top), y_name, "reference", "start", 64)
    lengths = [len(words) + 2 for words, *_ in curves]
    for k, (words, colour, x, y) in enumerate(curves):
        sheet.line(zip(x, np.clip(y, bottom, top), strict=True), colour)
        share = (sum(lengths[:k]) + 0.5 * lengths[k]) / sum(lengths)  # long names have more room
        sheet.words((left + share * (right - left), top), words, colour, up=18)
    if covered:
        sheet.words((right, 0.0), covered, "ink", "end", 14)
    return sheet.text()
