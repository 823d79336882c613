"""Work-precision diagrams: the error to the right, ever smaller, and up the time that it takes.

They are drawn by the study that measures them, speed_vs_error. What is quickest to a goal is in
colour and has its name below the goal; all else is grey, and peers have open marks.
"""

import math
from typing import NamedTuple

import constraints as c
from curriculum.ch3_4_constraints.pictures.make_pictures import FOLDER, Sheet
from curriculum.ch3_4_constraints.results import palette
from curriculum.ch3_4_constraints.results.advice import milliseconds, spoken

WIDTH = 900  # units, two to a pixel: letters of 30 have 12 pixels where the whole has 360
LEFT = 120  # edges of the plot
RIGHT = 860
LINE = 42  # from a line of words to the next
HIGH = 560  # of the plot
COARSE = 0.5  # -log10 of the errors in m at these edges
FINE = 13.5
NEAR = 100  # from one length below the plot to the next, at least
BOLD = "font-weight:bold;"
HALO = "paint-order:stroke;stroke:var(--paper);stroke-width:9px;"  # words over lines
DOT = "m-12 0a12 12 0 1 0 24 0a12 12 0 1 0-24 0z"  # at what is quickest
LONGEST = 16  # letters of a scene's name
MAIN = 1e-3  # m: the goal that is marked
DASHES = ["2 9", "14 8", "", "28 8 4 8", "28 8 4 8 4 8", "36 14"]  # of integrators, by their place
MARKS = [  # of methods, by their place, about a point; each ends where it begins
    "m-9 0a9 9 0 1 0 18 0a9 9 0 1 0-18 0z",
    "m-8-8h16v16h-16z",
    "m0-11l10 17h-20z",
    "m0-12l12 12-12 12-12-12z",
    "m-9-9l18 18m0-18l-18 18",
    "m-10 0h20m-10-10v20",
]
OPEN = "m-6 0a6 6 0 1 0 12 0a6 6 0 1 0-12 0z"  # of a peer
TIMES = {-6: "1 µs", -5: "10 µs", -4: "0.1 ms", -3: "1 ms", -2: "10 ms", -1: "0.1 s", 0: "1 s"}


class Look(NamedTuple):
    """How a line is drawn that is quickest to some goal."""

    colour: str
    dash: str
    mark: str


def look(solver):
    """The Look of a Solver of the chapter's, by the places of its integrator and its method in the
    tables; or that of another one."""
    integrators = list(c.INTEGRATORS)
    methods = list(c.make_methods())
    if solver.integrator not in integrators or solver.method not in methods:
        return Look("ink", "", MARKS[-1])
    dash = DASHES[integrators.index(solver.integrator) % len(DASHES)]
    mark = MARKS[methods.index(solver.method) % len(MARKS)]
    return Look(f"m{palette.places(methods)[solver.method]}", dash, mark)


def is_peer(solver):
    return solver.integrator == "MuJoCo"


def shown(timings):
    """Those of a line that are drawn: none that is far off, or finer than rounding allows."""
    least = 3.0 * min(x.error for x in timings)
    found = []
    for x in timings:
        if x.error < 10.0**-COARSE:
            found.append(x)
        if x.error <= max(least, 10.0**-FINE):
            break
    return found


class Diagram:
    """The sheet of a scene that was measured, and where an error and a time are on it."""

    def __init__(self, measured, winners):
        self.measured = measured
        self.goals = measured.goals
        self.main = MAIN if MAIN in self.goals else self.goals[0]
        self.winners = winners
        self.best = {}  # {goal: the Timing that is quickest to it}
        for goal in self.goals:
            for first in winners(measured.found, goal)[:1]:
                self.best[goal] = first
        self.lines = {solver: shown(timings) for solver, timings in measured.found.items()}
        times = [x.seconds for line in self.lines.values() for x in line] or [1e-3]  # none is near
        self.fastest = math.floor(math.log10(min(times)))
        self.slowest = max(self.fastest + 1, math.ceil(math.log10(max(times))))
        self.rows = LINE * len(self.best)
        self.bottom = self.rows + 5.5 * LINE
        self.height = round(self.bottom + HIGH + 4 * LINE)
        self.sheet = Sheet(WIDTH, self.height, (0, 0), (WIDTH, self.height))

    def x(self, error):
        share = (-math.log10(max(error, 1e-300)) - COARSE) / (FINE - COARSE)
        return LEFT + min(share, 1.0) * (RIGHT - LEFT)

    def y(self, seconds):
        share = (math.log10(seconds) - self.fastest) / (self.slowest - self.fastest)
        return self.bottom + share * HIGH

    def at(self, timing):
        return self.x(timing.error), self.y(timing.seconds)

    def draw(self):
        """Draw all of it, and return the sheet."""
        self.draw_axes()
        chosen = {x.solver for x in self.best.values()}
        for solver in self.lines:
            if solver not in chosen:
                self.draw_other(solver)
        for solver in self.lines:
            if solver in chosen:
                self.draw_line(solver)
        self.draw_names()
        self.draw_best_peer()
        self.draw_words()
        return self.sheet

    def draw_axes(self):
        for power in range(self.fastest, self.slowest + 1):
            y = self.y(10.0**power)
            self.sheet.line([(LEFT, y), (RIGHT, y)], "reference", 1)
            self.sheet.words(
                (LEFT - 10, y), TIMES.get(power, f"{10.0**power:g} s"), "reference", "end", -10
            )
        for goal in self.goals:
            x = self.x(goal)
            top = self.bottom + HIGH
            if goal == self.main:
                self.sheet.line([(x, self.bottom), (x, top)], "ink", 4)
            else:
                self.sheet.line([(x, self.bottom), (x, top)], "reference", 1)

    def draw_other(self, solver):
        """A line that is quickest to nothing."""
        points = [self.at(x) for x in self.lines[solver]]
        if not points:
            return
        style = "stroke-linecap:round;opacity:0.45"
        path = "M" + "L".join(self.sheet.at(x) for x in points)
        self.sheet.path([path], "reference", 2, style)
        if is_peer(solver):
            marks = "".join(f"M{self.sheet.at(x)}{OPEN}" for x in points)
            self.sheet.path([marks], "reference", 3)

    def draw_line(self, solver):
        """A line that is quickest to something."""
        colour, dash, mark = look(solver)
        points = [self.at(x) for x in self.lines[solver]]
        self.sheet.line(points, colour, 5, dash)
        marks = "".join(f"M{self.sheet.at(x)}{mark}" for x in points)
        self.sheet.path([marks], colour, 4)

    def draw_names(self):
        """Below each length what is quickest to it, and at which step: a row each."""
        names = []
        for goal in self.goals:
            self.draw_goal(goal)
        under = self.bottom - LINE - 14
        for k, (goal, best) in enumerate(self.best.items()):
            row = under - (k + 1) * LINE
            x = self.x(goal)
            colour = look(best.solver).colour
            self.sheet.line([(x, self.at(best)[1]), (x, self.bottom)], colour, 2, "4 6")
            self.sheet.line([(x, under), (x, row + 10)], colour, 2, "4 6")
            self.sheet.path(
                [f"M{self.sheet.at(self.at(best))}{DOT}"], colour, 2, f"fill:var(--{colour})"
            )
            style = HALO + BOLD if goal == self.main else HALO
            text = f"{best.solver}, {milliseconds(best.dt)}"
            if x < 0.5 * (LEFT + RIGHT):
                names.append(((x + 10, row), text, colour, "start", 0, style))
            else:
                names.append(((x - 10, row), text, colour, "end", 0, style))
        for name in names:  # last, so that no line crosses them
            self.sheet.words(*name)

    def draw_best_peer(self):
        """The name of the peer that is quickest to the main goal, at the end of its line."""
        peers = {x: timings for x, timings in self.measured.found.items() if is_peer(x)}
        there = self.winners(peers, self.main)
        if not there or there[0].solver in {x.solver for x in self.best.values()}:
            return
        solver = there[0].solver
        x, y = self.at(self.lines[solver][-1])
        if x < 0.5 * (LEFT + RIGHT):
            self.sheet.words((x + 14, y + 12), str(solver), "reference", "start", style=HALO)
        else:
            self.sheet.words((x - 14, y + 12), str(solver), "reference", "end", style=HALO)

    def draw_goal(self, goal):
        """The length itself, beside its line where another one is near."""
        x = self.x(goal)
        gaps = [self.x(other) - x for other in self.goals if other != goal]
        anchor = "middle"
        if any(0.0 < gap < NEAR for gap in gaps):
            anchor = "end"
            x += 16
        elif any(-NEAR < gap < 0.0 for gap in gaps):
            anchor = "start"
            x -= 16
        bold = BOLD if goal == self.main else ""
        self.sheet.words((x, self.bottom - LINE), spoken(goal), "ink", anchor, style=bold)

    def draw_words(self):
        """What is seen, above, and how it was measured, below."""
        scene = short_name(self.measured.scene)
        top = self.height - LINE
        title = f"{scene}: quickest to {spoken(self.main)} is nobody"
        if self.main in self.best:
            title = f"{scene}: quickest to {spoken(self.main)} is {self.best[self.main].solver}"
        self.sheet.words((30, top), title, "ink", "start", style=BOLD)
        said = ["colour: quickest to a length; grey: all others"]
        if any(map(is_peer, self.lines)):
            said.append("open circles: MuJoCo")
        for k, text in enumerate(said):
            self.sheet.words((30, top - (k + 1) * LINE), text, "ink", "start")
        how = [
            f"to the right: how far the worst particle is off after {self.measured.seconds:g} s",
            "up: the time to compute that; a point for each step",
            f"machine code, one core, medians of {self.measured.turns} turns",
        ]
        for k, text in enumerate(reversed(how)):
            self.sheet.words((30, (k + 1) * LINE - 6), text, "reference", "start")


def short_name(name):
    return name if len(name) <= LONGEST else name[: LONGEST - 3] + "..."


def text_of(measured, winners):
    """The diagram as an SVG; winners(found, goal) are Timings in order, the quickest first."""
    return Diagram(measured, winners).draw().text(640)


def draw_for_the_chapter(measured, winners):
    """Write the diagram of a shipped scene beside the other pictures."""
    path = FOLDER / f"work_precision_{measured.scene}.svg"
    path.write_text(text_of(measured, winners), encoding="utf-8")
