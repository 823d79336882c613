"""Work-precision diagrams: the error to the right, ever smaller, and up the work that it takes.

Drawn of what the study speed_vs_error has measured. A line is an integrator with a method. Those
that it advises for some tolerance are in colour, each with its name. A dot, and a sentence above,
are for the cheapest of the chapter's own that is right to a millimetre.
"""

import math

import constraints as c
from curriculum.ch3_4_constraints.site.drawing import Sheet
from curriculum.common import palette
from curriculum.common.words import as_given, milliseconds

WIDE = 900  # units, two to a pixel: letters of 30 have 12 pixels where the whole has 360
HIGH = 900
LEFT = 130  # edges of the plot
RIGHT = 880
BOTTOM = 190
TOP = 760
COARSE = 0.5  # -log10 of the errors in m at these edges
FINE = 11.0
MAIN = 1e-3  # m: the tolerance that is named
DASHES = {"euler": "2 9", "semi_implicit": "14 8", "rk4": ""}  # others: dots and dashes
TIMES = {
    -7: "0.1 µs",
    -6: "1 µs",
    -5: "10 µs",
    -4: "0.1 ms",
    -3: "1 ms",
    -2: "10 ms",
    -1: "0.1 s",
    0: "1 s",
}


def style_of(scheme):
    """The colour and the dashes of a Scheme's line."""
    places = palette.places(c.make_methods())
    colour = f"m{places[scheme.method]}" if scheme.method in places else "reference"
    return colour, DASHES.get(scheme.integrator, "28 8 4 8")


def diagram(measured):
    """The SVG of what was measured of a scene."""
    advised = {row.rung.scheme for answer in measured.answers.values() for row in answer.rows}
    costs = [cost for line in measured.lines.values() for error, cost in line if error < 1.0]
    low = math.floor(math.log10(min(costs)))
    high = math.ceil(math.log10(max(costs)))

    def at(error, cost):
        across = (-math.log10(max(error, 1e-300)) - COARSE) / (FINE - COARSE)
        up = (math.log10(cost) - low) / (high - low)
        return LEFT + across * (RIGHT - LEFT), BOTTOM + up * (TOP - BOTTOM)

    sheet = Sheet(WIDE, HIGH, (0, 0), (WIDE, HIGH))
    for power in range(low, high + 1):
        _, y = at(1.0, 10.0**power)
        sheet.line([(LEFT, y), (RIGHT, y)], "reference", 1)
        words = TIMES.get(power, f"{10.0**power:g} s")
        sheet.words((LEFT - 10, y), words, "reference", "end", -10)
    for goal in measured.answers:
        x, _ = at(goal, 1.0)
        sheet.line([(x, BOTTOM), (x, TOP)], "ink" if goal == MAIN else "reference", 2)
        sheet.words((x, BOTTOM), as_given(goal), "ink", up=-40)
    ends = []
    for scheme, line in measured.lines.items():
        points = [at(error, cost) for error, cost in line if 10.0**-FINE < error < 10.0**-COARSE]
        if len(points) < 2:
            continue
        colour, dash = style_of(scheme)
        if scheme in advised:
            sheet.line(points, colour, 5, dash)
            ends.append((points[-1], scheme, colour))
        else:
            sheet.lines([points], "reference", 2, "stroke-linecap:round;opacity:0.4")
    draw_names(sheet, ends)
    draw_words(sheet, measured, at)
    return sheet.text(450)


def draw_names(sheet, ends):
    """The name of each line that is in colour, at its end, and apart from the others."""
    above = math.inf
    for (x, y), scheme, colour in sorted(ends, key=lambda end: -end[0][1]):
        above = min(y, above - 34)
        anchor = "end" if x > 0.5 * (LEFT + RIGHT) else "start"
        name = f"{scheme.integrator.removesuffix('_implicit')} {scheme.method}"
        halo = "paint-order:stroke;stroke:var(--paper);stroke-width:9px;"
        sheet.words((x + (-12 if anchor == "end" else 12), above), name, colour, anchor, 0, halo)


def draw_words(sheet, measured, at):
    """What is seen, above, and what is advised; its place is a dot."""
    answer = measured.answers.get(MAIN)
    sheet.words((30, HIGH - 50), measured.scene, "ink", "start", style="font-weight:bold;")
    if answer and answer.rows:
        row = next(x for x in answer.rows if x.rung.scheme.integrator in c.INTEGRATORS)
        rung = row.rung
        point = at(rung.places, rung.operations * row.pace)
        sheet.dot(point, style_of(rung.scheme)[0], 26)
        said = f"right to {as_given(MAIN)}: {rung.scheme}, {milliseconds(rung.dt)}"
        sheet.words((30, HIGH - 92), said, "ink", "start")
    how = f"to the right: nearer, at worst, to {measured.seconds:g} s"
    sheet.words((30, 66), how, "reference", "start")
    sheet.words((30, 28), "up: more computing, for a second of motion", "reference", "start")
