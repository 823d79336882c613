"""Work-precision diagrams: an error across, the time that it takes up, a line a method.

They are drawn by the study that measures them, speed_vs_error --picture.
"""

import math

import numpy as np

from curriculum.ch3_4_constraints.pictures.make_pictures import METHODS, axes

DASHES = {"euler": "2 10", "semi": "12 8", "rk4": "28 8 4 8", "gauss": "", "XPBD": "", "MuJoCo": ""}
MARKS = {  # of a method, about the place; each ends where it begins
    "none": "m-7 0a7 7 0 1 0 14 0a7 7 0 1 0-14 0z",
    "baumgarte": "m-6-6h12v12h-12z",
    "impulse": "m0-9l8 14h-16z",
    "soft": "m0-9l9 9-9 9-9-9z",
    "project": "m-7-7l14 14m0-14l-14 14",
    "XPBD": "m-8 0h16m-8-8v16",
    "MuJoCo": "m-8 0l8 8 8-8",
}
COLOURS = METHODS | {"XPBD": "m5", "MuJoCo": "ink"}
ACROSS = {-15: "", -12: "1 pm", -9: "1 nm", -6: "1 um", -3: "1 mm", 0: "1 m", 1: ""}  # log10
UP = {-6: "1 us", -5: "10 us", -4: "100 us", -3: "1 ms", -2: "10 ms", -1: "100 ms", 0: "1 s"}
GAP = "\N{NO-BREAK SPACE}"


def draw(scene, seconds, found):
    """Draw {name: [Setting, ...]} of a scene that was followed for so many seconds."""
    (left, *_, right), (*_, top) = ACROSS, UP
    fastest = min(x.seconds for settings in found.values() for x in settings)
    bottom = math.floor(math.log10(fastest))
    wide, high = right - left, top - bottom
    ticks = {y: words for y, words in UP.items() if y >= bottom}
    sheet = axes(930, ACROSS, ticks, upright=True)
    words = f"across: the error of {scene} after {seconds:g} s; up: the time to compute them"
    sheet.words((left + 0.5 * wide, bottom), words, "reference", up=-85)
    for order, size in (1, 1.0), (4, 3.0), (16, 3.0):  # as steep as a method of this order
        end = -9.5 - size, bottom + 0.15 + size / order
        sheet.line([(-9.5, bottom + 0.15), end], "reference", 4)
        sheet.words(end, f"order {order}{GAP}", "reference", "end", -10)

    def marks(points, mark):
        places = "".join(f"M{sheet.at(x)}{MARKS[mark]}" for x in points)
        sheet.path([places], COLOURS[mark], 3)

    for name, settings in found.items():
        family, method = name.split(" ", 1)
        mark = family if family in MARKS else method
        least = 3.0 * min(x.error for x in settings)
        points = []
        for x in settings:
            if x.error < 10.0**right:
                points.append(np.log10([x.error, x.seconds]))
            if x.error <= least:
                break  # beyond is rounding
        sheet.line(points, COLOURS[mark], 3, DASHES[family])
        marks(points, mark)
        if family == "MuJoCo" and len(points) > 3:  # one that gets somewhere
            sheet.words(points[-1], method, up=16)

    x, y = left - 0.06 * wide, top + 0.16 * high
    for mark, colour in COLOURS.items():
        marks([(x, y)], mark)
        sheet.words((x, y), GAP + GAP + mark, colour, "start", -10)
        x += (0.065 + 0.016 * len(mark)) * wide
    x, y = left - 0.06 * wide, top + 0.07 * high
    for name in "euler", "semi_implicit", "rk4", "gauss":
        end = x + 0.11 * wide, y
        sheet.line([(x, y), end], "ink", 3, DASHES[name.removesuffix("_implicit")])
        sheet.words(end, GAP + name, "ink", "start", -10)
        x += (0.18 + 0.017 * len(name)) * wide
    sheet.write(f"work_precision_{scene}")
