"""A little SVG: lines, arrows, words and charts, on a white sheet that can be read on any
background."""

import math
from itertools import pairwise
from xml.sax.saxutils import escape

INK, GREY, PALE = "#1f2328", "#6e7781", "#dde2e7"
FONT, LINE = "Helvetica, Arial, sans-serif", 16  # pixels from a line of words to the next


class Drawing:
    """A sheet of `width` times `height` pixels, y down, with a title; points are pairs of
    pixels."""

    def __init__(self, width, height, title):
        self.parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}"'
            f' role="img" font-family="{FONT}" font-size="13" stroke-linejoin="round" stroke-linecap="round">',
            f"<title>{escape(title)}</title>",
            f'<rect x="0.5" y="0.5" width="{width - 1}" height="{height - 1}" rx="6" fill="#fff" stroke="{PALE}"/>',
        ]
        self.words(24, 32, title, size=16, weight="bold")

    def line(self, points, color=INK, width=1.5, dash="none"):
        """A line through points."""
        steps = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        style = f'fill="none" stroke="{color}" stroke-width="{width}" stroke-dasharray="{dash}"'
        self.parts.append(f'<polyline points="{steps}" {style}/>')

    def dot(self, at, radius, color=INK):
        """A filled circle."""
        self.parts.append(
            f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="{radius}" fill="{color}"/>'
        )

    def words(self, x, y, text, color=INK, anchor="start", size=13, weight="normal"):
        """A line of words that starts, has its middle or ends at x, on the base line y."""
        style = f'fill="{color}" text-anchor="{anchor}" font-size="{size}" font-weight="{weight}"'
        self.parts.append(f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(text)}</text>')

    def arrow(self, start, end, color, width=3.0, head=11.0):
        """An arrow, if it is long enough to have a head."""
        (x, y), length = end, math.dist(start, end)
        if length < head:
            return
        along, across = ((end[k] - start[k]) * head / length for k in (0, 1))
        neck = x - along, y - across
        self.line([start, neck], color, width)
        corners = [
            end,
            *((neck[0] + s * 0.45 * across, neck[1] - s * 0.45 * along) for s in (1, -1)),
        ]
        self.parts.append(
            f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in corners)}" fill="{color}"/>'
        )

    def text(self):
        """The file."""
        return "\n".join([*self.parts, "</svg>\n"])


class Axis:
    """A scale from values to pixels, logarithmic if `log`; `ticks`: {value: what stands beside
    it}."""

    def __init__(self, title, values, pixels, ticks, log=False):
        self.title, self.pixels = title, pixels
        self.ticks = {
            value: name for value, name in ticks.items() if values[0] <= value <= values[1]
        }
        self.scale = math.log10 if log else float
        self.low, self.high = map(self.scale, values)

    def __call__(self, value):
        share = (self.scale(value) - self.low) / (self.high - self.low)
        return self.pixels[0] + share * (self.pixels[1] - self.pixels[0])


class Chart(Drawing):
    """A drawing with an Axis x and an Axis y, and a grid."""

    def __init__(self, width, height, title, x, y):
        super().__init__(width, height, title)
        self.x, self.y, self.names = x, y, []
        (left, right), (bottom, top) = x.pixels, y.pixels
        for value, name in x.ticks.items():
            self.line([(x(value), bottom), (x(value), top)], PALE, 1)
            self.words(x(value), bottom + LINE + 2, name, GREY, "middle")
        for value, name in y.ticks.items():
            self.line([(left, y(value)), (right, y(value))], PALE, 1)
            self.words(left - 8, y(value) + 4, name, GREY, "end")
        self.words((left + right) / 2, bottom + 2.6 * LINE, x.title, anchor="middle")
        self.words(24, top - 14, y.title)

    def curve(self, name, values, color, dots=False):
        """A curve through pairs (x, y), with its name to come at its end."""
        points = [(self.x(x), self.y(y)) for x, y in values]
        self.line(points, color, 2)
        for point in points if dots else ():
            self.dot(point, 3, color)
        self.names.append([*points[-1], name, color])

    def text(self):
        """The file; the names of curves that end close to each other are moved apart."""
        names = sorted(self.names, key=lambda name: name[1])
        for _ in range(100):
            for above, below in pairwise(names):
                overlap = LINE - (below[1] - above[1])
                if overlap > 0.0 and abs(above[0] - below[0]) < 100.0:
                    above[1], below[1] = above[1] - 0.5 * overlap, below[1] + 0.5 * overlap
        for x, y, name, color in names:
            self.words(x + 8, y + 4, name, color, weight="bold")
        return super().text()
