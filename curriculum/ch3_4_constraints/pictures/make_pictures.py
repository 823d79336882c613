"""Make the pictures:  python -m curriculum.ch3_4_constraints.pictures.make_pictures [NAME ...]

They are computed, and are the same bytes each time. Drawings without a number are not among them;
nor is page.png, which a browser of 1100 x 820 pixels shows of the page of `double` after 9 s, when
a hand has pulled the first bob of the third tile for 0.7 s.
"""

import contextlib
import io
import tempfile
from functools import partial
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints import svg
from curriculum.ch3_4_constraints.picture import DECADES
from curriculum.ch3_4_constraints.studies import _runs, speed_vs_error
from curriculum.ch3_4_constraints.studies import chaos as thousand
from curriculum.ch3_4_constraints.studies import hard_cases as hard
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.ch3_4_constraints.studies.shown import swinging
from curriculum.ch3_4_constraints.svg import EXCESS, GREY, INK, MODES, PULL, Drawing
from curriculum.common.cli import Parser, one_of, run_script
from curriculum.common.files import write_whole

import numpy as np

FOLDER = Path(__file__).parent
METHODS = [("euler", "none"), ("rk4", "soft"), ("rk4", "baumgarte")]
METHODS += [("semi_implicit", mode) for mode in ("none", "baumgarte", "project", "impulse")]
METHODS += [("midpoint:8", "project"), ("gauss:12:1e-14", "project")]
DASHES = {"semi_implicit": "none", "euler": "1 6", "rk4": "10 5"}  # modes are told by colours
DASHES |= {"midpoint:8": "2 5", "gauss:12:1e-14": "14 4 2 4"}
SOLVES = {100.0: "100", 1000.0: "1 000", 10_000.0: "10 000"}
LENGTHS = DECADES | {1e-15: "1 fm"}


def turned(degrees, length):
    """(x, y) on a sheet, y down, of an arrow that hangs down and is then turned to the right."""
    return length * np.array([np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])


def arc(sheet, middle, radius, begin, end):
    """A dashed circle's part between two angles in degrees, and its middle, (x, y)."""
    sheet.line([middle + turned(a, radius) for a in np.linspace(begin, end, 90)], GREY, 1.5, "2 6")
    sheet.dot(middle, 7, GREY)


def two_pendulums():
    """The same pendulum held by two modes, after the same time."""
    dt, steps, metre = 0.005, 3800, 105
    seconds = f"{dt * steps:.0f} s"
    sheet = Drawing(480, 170, f"Two pendulums after {seconds}")
    for x, mode in ((112, "project"), (342, "none")):
        end = run(c.build_system("pendulum"), "semi_implicit", mode, dt, steps).q[-1][0, :2]
        size, pivot, color = np.linalg.norm(end), np.array([x, 26]), MODES[mode]
        right, bob = (pivot + metre * end * [1, -1] / over for over in (size, 1.0))
        arc(sheet, pivot, metre, -85, 85)
        sheet.line([right, bob], EXCESS, 8)
        sheet.line([pivot, right], color, 5)
        sheet.dot(bob, 11, color)
        sheet.words(x - 26, 72, mode, color, "middle", 20, "bold")
        sheet.words(x - 26, 98, f"{size:.2f} m", color, "middle", 20, "bold")
    sheet.words(240, 160, f"after {seconds}", INK, "middle", 17)
    return sheet.text()


def eigenvalue():
    """The eigenvalues of Baumgarte's spring under semi-implicit Euler, which are real."""
    limit, z = c.STABILITY_LIMIT["semi_implicit"], np.linspace(0.0, 0.9, 91)
    step = np.array([[1.0 - z * z, 1.0 - 2.0 * z], [-z * z, 1.0 - 2.0 * z]])
    first, other = np.sort(np.linalg.eigvals(np.moveaxis(step, 2, 0)).real).T
    curves = {"leaves": (EXCESS, zip(z, first, strict=True))}
    curves["stays"] = INK, zip(z, other, strict=True)
    x = "dt w", (0.0, 0.9), {0.0: "0", 0.4: "0.4", limit: f"{limit:.3f}"}
    y = "eigenvalue of a step", (-1.4, 1.1), {-1.0: "-1", 0.0: "0", 1.0: "1"}
    return svg.chart("An eigenvalue leaves through -1", x, y, curves)


def forces():
    """Weight, pull and their sum at four angles of a pendulum, with the numbers."""
    sheet, metre, newton = Drawing(480, 500, "What force does a rod exert?"), 235, 5.0  # pixels
    arc(sheet, pivot := np.array([60.0, 60.0]), metre, -12, 90)
    for degrees in (90, 60, 30, 0):
        system, bob = swinging(degrees), pivot + turned(degrees, metre)
        weight = c.external_force(system, system["q0"])[0]
        pull = c.constraint_force(system, system["q0"], system["v0"])[0]
        aside = [10 * (degrees in (0, 90)), 0]  # there they are on one line
        sheet.line([pivot, bob], GREY, 2)
        for force, color, at in ((pull, PULL, 0), (weight, GREY, 0), (pull + weight, INK, aside)):
            sheet.arrow(bob + at, bob + at + newton * force[:2] * [1, -1], color)
        sheet.dot(bob, 8, INK)
        words = f"{degrees}\u00b0: {np.linalg.norm(pull):.2f} N"
        below = {0: 48, 90: -10}.get(degrees, 22)  # pixels: off all arrows
        sheet.words(bob[0] + 16, bob[1] + below, words, size=19)
    what = {"weight, m g": GREY, "pull of the rod": PULL, "their sum, m a": INK}
    for k, (name, color) in enumerate(what.items()):
        sheet.words(270, 420 + 28 * k, name, color, size=20, weight="bold")
    return sheet.text()


def drift():
    """The worst rod error of the five modes over the default run."""
    dt, steps, every, curves = 0.005, 4000, 20, {}
    times = dt * every * np.arange(1, steps // every + 1)
    for mode in c.hold_table():
        found = run(c.build_system("double"), "semi_implicit", mode, dt, steps).violations[1:]
        worst = np.maximum(np.max(found.reshape(-1, every), axis=1), 1e-12)  # its tolerance
        curves[mode] = MODES[mode], list(zip(times, worst, strict=True))
    x = "time, s", (0.0, 20.0), {float(t): f"{t}" for t in range(0, 21, 5)}
    return svg.chart("What keeps the rods?", x, ("worst rod error", (1e-13, 3.0), DECADES), curves)


def cost():
    """Error against counted cost, from the study speed_vs_error."""
    task, curves = _runs.double(), {}
    for rule, mode in METHODS:
        rows = speed_vs_error.ladder(task, rule, mode)
        spots = ((row["solves"], row["error"]) for row in rows)
        spots = [(x, error) for x, error in spots if x > 28.0 and 1e-14 < error < 20.0]
        curves[f"{rule} {mode}"] = MODES[mode], spots, DASHES[rule]
    x = "linear systems solved for a simulated second", (28.0, 20_000.0), SOLVES
    y = "largest error of a particle within 5 s", (1e-14, 20.0), LENGTHS
    return svg.chart("What does an error cost?", x, y, curves, (600, 520), 190)


def hard_cases():
    """The table of the study hard_cases, as the studies' page shows it: the larger the better."""
    page = (_runs.SCENES.parent / "studies/README.md").read_text(encoding="utf-8")
    table = page.partition("hard_cases -->")[2].partition("\n```\n")[0]
    lines = (line.split() for line in table.splitlines())
    rows = [x for x in lines if len(x) == 1 + len(hard.TITLES) and x[0] in hard.NAMES]
    sizes = {dt: 3 + 2 * k for k, dt in enumerate(hard.LADDER[::-1])}
    sheet = Drawing(760, 470, "What holds when it gets hard?")
    sheet.words(16, 26, "a dot: the largest step that holds all starts; a ring: some starts only")
    columns = [(160 + 78 * k, MODES[title.split()[-1]]) for k, title in enumerate(hard.TITLES)]
    for (x, color), title in zip(columns, hard.TITLES, strict=True):
        for line, word in enumerate(title.split()):
            sheet.words(x, 52 + 17 * line, word, color, "middle", 14, "bold")
    for row, (name, *cells) in enumerate(rows):
        y = 96 + 28 * row
        sheet.words(110, y + 5, name, INK, "end", 14)
        for (x, color), cell in zip(columns, cells, strict=True):
            if "/" in cell:
                sheet.add("circle", cx=x, cy=y, r=4, fill="none", stroke=color)
            elif cell != "-":
                sheet.dot((x, y), sizes[float(cell)], color)
    y = 96 + 28 * len(rows) + 8
    sheet.words(110, y + 5, "steps, s", GREY, "end", 14)
    for k, dt in enumerate(hard.LADDER):
        sheet.dot((160 + 98 * k, y), sizes[dt], GREY)
        sheet.words(178 + 98 * k, y + 5, f"{dt:g}", GREY, size=14)
    return sheet.text()


def chaos():
    """How much energy a thousand double pendulums have gained after 20 s, with rods that leak."""
    system, curves = thousand.ensemble("double", range(1000)), {}
    for rule, mode in thousand.RUNS:
        gained = np.sort(thousand.follow(system, rule, mode, 4000).gained)
        points = zip(np.clip(gained, -0.6, 1.0), np.linspace(0.0, 1.0, len(gained)), strict=True)
        name = mode if rule == "semi_implicit" else f"{rule} {mode}"
        curves[name] = MODES[mode], list(points)[::10], DASHES[rule]
    shares = {-0.5: "-50 %", 0.0: "0", 0.5: "+50 %", 1.0: "+100 %"}
    x = "energy gained, of m g L", (-0.6, 1.0), shares
    y = "share of the seeds below", (0.0, 1.0), {0.0: "0", 0.5: "half", 1.0: "all"}
    return svg.chart("What do leaky rods do to a crowd?", x, y, curves, (560, 380), 110)


def moving(name):
    """The moving picture that a run of a scene writes."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        steps = "4000" if name == "double" else "1000"  # a gallery is to be light
        c.main(["--system", name, "--steps", steps, "--no-rerun", "--out", folder])
        return Path(folder, "motion.svg").read_text(encoding="utf-8")


DRAWN = two_pendulums, eigenvalue, forces, drift, cost, hard_cases, chaos
PICTURES = {x.__name__: x for x in DRAWN}
PICTURES |= {name: partial(moving, name) for name in (*c.SYSTEMS, "chain", *_runs.SHIPPED)}


def main(argv=None):
    """Make the pictures that `argv` names, or all."""
    parser = Parser(prog="make_pictures", description=__doc__)
    names = {"nargs": "*", "metavar": "NAME", "type": one_of(PICTURES)}
    parser.add_argument("names", **names, help=f"some of {', '.join(PICTURES)}")
    for name in parser.parse_args(argv).names or PICTURES:
        made = PICTURES[name]().encode()
        write_whole(FOLDER / f"{name}.svg", made)
        print(f"wrote {name}.svg, {len(made) / 1e3:.0f} kB")


if __name__ == "__main__":
    run_script(main)
