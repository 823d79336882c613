"""The gallery: each scene under all methods side by side, in motion, and what it is in words."""

from textwrap import fill

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints import rods
from curriculum.ch3_4_constraints.page.scene import MAX_RODS
from curriculum.ch3_4_constraints.rods.systems import is_flat, nodes, rod_parts
from curriculum.ch3_4_constraints.site.drawing import MOVING, Sheet
from curriculum.common import palette
from curriculum.common.words import length

DT = 0.005  # s, of all runs
SECONDS = 6.0  # so long all pictures move
SPANS = {"double": (14.0, 20.0), "triple": (14.0, 20.0), "spin": (0.0, 1.0)}  # s: what they show
USUAL = 0.0, SECONDS  # s: what pictures of other scenes show
FRAMES = 90  # of a picture, at most
RODS = 1800  # in all frames of a tile, at most
WAY = 150  # points of the last particle's way
WIDTH = 1500  # units of a sheet, two to a pixel
HIGHEST = 560  # units of what moves in a tile, from top to bottom
HEAD = 120  # units: two lines of words above it
LINE = 46  # units from one line of words to the next
EDGE = 30  # units around it
FLAT = 0.4  # as high as wide, or less: two tiles side by side, and not three
LOST = 0.25  # of all rods: a run whose rods are off by more may leave its tile
VISIBLE = 3.0  # units: a shorter piece is not drawn
THIN = 4.0  # units: no rod is thinner
COLUMNS = 100  # of a text
METHODS = {name: f"m{k}" for name, k in palette.places(c.make_methods(DT)).items()}  # and colours
CHAINS = {  # what is said of them; scenes have words of their own
    "double": "Let go level: the last 6 of 20 seconds.",
    "triple": "The same with one more rod. No two methods end alike.",
}


def scenes():
    """{name: system} of what is in the gallery: two chains, and all scenes."""
    return {name: c.build_system(name) for name in [*CHAINS, *rods.SHIPPED]}


def picture(name, system, methods=tuple(METHODS)):
    """A scene's picture as SVG: each method in a tile, and in the last one what is seen."""
    begin, end = SPANS.get(name, USUAL)
    first, last = round(begin / DT), round(end / DT)
    runs = {x: c.run_method(system, x, "semi_implicit", DT, last) for x in methods}
    count = min(FRAMES, RODS // len(system["pairs"]))
    shown = tiles(system, runs, spread(first, last, count), spread(first, last, WAY))
    when = [f"{begin:g} to {end:g} s"]
    slower = SECONDS / (end - begin)
    if slower > 1.0:
        when.append(f"{slower:g} times slower")
    return board(shown, [name, *when])


def spread(first, last, count):
    """So many steps from the first to the last, evenly."""
    return np.linspace(first, last, count).round().astype(int)


def tiles(system, runs, frames, way):
    """{method: Sheet} of runs {method: Run}: in motion, the states of some steps, the `frames`.

    A faint line is where the last particle is at the steps `way`. A run that is lost stays where it
    was.
    """
    shortest = np.min(system["lengths"])
    width, height, low, high = box(system, list(runs.values()), frames)
    found = {}
    for method, run in runs.items():
        colour = METHODS[method]
        tile = Sheet(width, height, low, high)
        far = len(run.q) - 1
        ball = min(12.0, 0.35 * shortest * tile.scale[0])  # units: the radius of a particle
        tile.lines([run.tip[np.minimum(way, far)]], colour, 3, "stroke-opacity:0.3")
        draw_rods(tile, system, run.q[np.minimum(frames, far)], colour, ball)
        for anchor in system["anchors"]:
            tile.dot(anchor, "reference", 1.4 * ball)
        off = f"rods off by {length(run.violations.max())}"
        said = run.lost.partition(":")[0] if run.lost else off
        top = 0.5 * (low[0] + high[0]), high[1]
        tile.words(top, method, colour, up=-LINE)
        tile.words(top, said, colour, up=-2 * LINE)
        found[method] = tile
    return found


def box(system, runs, frames):
    """Width and height in units of a tile, and its corners (2,) in m: all that holds is seen."""
    whole = np.sum(system["lengths"])
    held = [run for run in runs if not run.lost and run.violations.max() < LOST * whole]
    places = [run.q[frames[frames < len(run.q)]].reshape(-1, 3) for run in held or runs]
    seen = np.vstack([system["anchors"], *places])[:, :2]
    middle = 0.5 * (np.min(seen, axis=0) + np.max(seen, axis=0))
    wide, tall = np.maximum(np.ptp(seen, axis=0), 0.5 * np.min(system["lengths"]))
    width = WIDTH / (2 if tall < FLAT * wide else 3)
    scale = min((width - 2 * EDGE) / wide, HIGHEST / tall)  # units a metre
    height = tall * scale + 2 * EDGE
    half = 0.5 * np.array([width, height]) / scale
    head = np.array([0.0, HEAD / scale])
    return width, height + HEAD, middle - half, middle + half + head


def draw_rods(tile, system, q, colour, ball):
    """The rods in all states q (frames, N, 3) on a Sheet, with what they have too much and lack.

    Particles are discs of radius `ball`, in units.
    """
    disc = f'<circle r="{ball:.3g}" fill="var(--{colour})"/>'
    kind = 'markerUnits="userSpaceOnUse" overflow="visible"'
    tile.parts.append(f'<marker id="{colour}" {kind}>{disc}</marker>')
    places = nodes(q, system["anchors"])
    trails = trails_of(system["pairs"])
    width = min(9.0, max(THIN, 0.75 * ball))
    shown = [[state[trail] for trail in trails] for state in places]
    tile.moving(shown, SECONDS, colour, width, f"marker:url(#{colour})")
    _, much, missing = rod_parts(system, q)
    draw_pieces(tile, much, "long", 1.6 * width)
    draw_pieces(tile, missing, "short", width, "stroke-dasharray:6")


def draw_pieces(tile, pieces, *style):
    """Pieces of rods (frames, C, 2, 3), of those rods only whose piece can be seen some time."""
    size = np.linalg.norm(pieces[:, :, 1] - pieces[:, :, 0], axis=-1) * tile.scale[0]
    seen = np.max(size, axis=0) > VISIBLE
    if np.any(seen):
        tile.moving(pieces[:, seen], SECONDS, *style)


def trails_of(pairs):
    """The rods (i, j) as lines of nodes: one that begins where the last one ends goes on."""
    trails = []
    for i, j in pairs:
        if trails and trails[-1][-1] == j:
            trails[-1].append(i)
        else:
            trails.append([j, i])
    return trails


def board(tiles, about):
    """Tiles {method: Sheet}, row by row, as SVG; the last one has words `about` it, in lines."""
    size = next(iter(tiles.values())).size
    legend = Sheet(*size, (0.0, 0.0), size)
    lines = [(words, "ink") for words in about]
    lines += [("red: too long", "long"), ("blue: too short", "short")]
    width, height = size
    for k, (words, colour) in enumerate(lines):
        legend.words((0.5 * width, 0.5 * height + 2 * LINE), words, colour, up=-LINE * k)
    columns = round(WIDTH / width)
    total = round(height * np.ceil((len(tiles) + 1) / columns))
    sheet = Sheet(WIDTH, total, (0.0, 0.0), (WIDTH, total))
    sheet.parts.append(MOVING)
    for k, tile in enumerate([*tiles.values(), legend]):
        row, column = divmod(k, columns)
        sheet.place(tile, column * width, row * height)
    return sheet.text()


def text():
    """The gallery in Markdown: of each scene its own words, its picture, and its command."""
    parts = []
    for name, system in scenes().items():
        words = CHAINS.get(name) or system.get("about", "")
        command = f"python constraints.py --system {name}"
        if is_flat(system) and len(system["pairs"]) <= MAX_RODS:
            command += " --within 1mm"
        said = fill(f"**{name}**: {words}", COLUMNS, break_long_words=False)
        parts.append(f"{said}\n\n![{name} under each method]({name}.svg)\n\n    {command}\n")
    return "\n".join(parts)


def drawn():
    """Yield (name, text) of each picture."""
    for name, system in scenes().items():
        yield name, picture(name, system)
