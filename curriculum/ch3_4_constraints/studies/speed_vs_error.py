"""What does it cost to be right?  Each integrator, with its cheapest method and step, beside peers.

The rows are those of --within, found in the same way: right is the worst place of all times up to
2 s, and rods and energy for 20 s. Gauss's rule, XPBD and MuJoCo stand beside the chapter's three.
Work is counted in operations, which the time that one takes makes microseconds; MuJoCo's is timed.
"""

import time
from functools import partial
from typing import NamedTuple

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.rods.choice import Search
from curriculum.ch3_4_constraints.rods.schemes import Rung, Scheme, Stepper, steps_of
from curriculum.ch3_4_constraints.rods.systems import has_loop
from curriculum.ch3_4_constraints.rods.truth import WHOLE
from curriculum.ch3_4_constraints.studies import _mujoco
from curriculum.ch3_4_constraints.studies._schemes import all_schemes, short, wider_chapter
from curriculum.common import cli
from curriculum.common.tracing import vmap
from curriculum.common.words import amount, as_given, in_digits

SCENES = "double", "jansen_leg", "windows"
GOALS = 1e-2, 1e-3, 1e-6, 1e-9  # m
DT = 0.005  # s: steps are powers of 2 times this one
STEPS = 4000  # of it: for so long rods and energy are followed
QUICK = 1e-2  # m: the goal of a --quick run
TIME = 1e-8  # s: stands for an operation where these cannot be counted

PEERS = {  # MuJoCo's rods as what, how hard, if not as it has them, and its integrator
    "hinges": (_mujoco.linkage, "", "RK4"),
    "connect": (_mujoco.linkage, "", "Euler"),
    "connect, hard": (_mujoco.linkage, _mujoco.HARD, "RK4"),
    "tendons": (_mujoco.tendons, "", "Euler"),
    "tendons, hard": (_mujoco.tendons, _mujoco.HARD, "RK4"),
}


class Peer:
    """MuJoCo as a Stepper: by a row of PEERS. Its places are compared; energy is not asked for."""

    time = TIME

    def __init__(self, system, name):
        self.system = system
        self.name = name
        self.scheme = Scheme("MuJoCo", name, None)

    def model(self, dt):
        """MuJoCo's model and data, for steps of dt s."""
        parts_of, hard, integrator = PEERS[self.name]
        options = f'integrator="{integrator}"'
        return _mujoco.started(self.system, parts_of, hard.format(2.0 * dt), dt, options)

    def places(self, model, data):
        """Where it has the particles, (N, 3) in m."""
        import mujoco

        mujoco.mj_kinematics(model, data)  # a step leaves the places of its beginning
        return np.array([data.site(f"s{k}").xpos for k in range(len(self.system["m"]))])

    def take(self, dt, span, path, within, part=WHOLE):
        """The Rung of steps of a `part` of dt s, over a span in s."""
        import mujoco

        mujoco.set_mju_user_warning(lambda text: None)  # else what diverges leaves a file
        step = dt * float(part)
        steps = steps_of(span, step)
        model, data = self.model(step)
        many = max(1, round(path.grid / dt))  # steps from one place that is kept to the next
        found = [self.system["q0"]]
        spent = 0.0
        for _ in range(steps // many):
            clock = time.thread_time()
            mujoco.mj_step(model, data, many)
            spent += time.thread_time() - clock
            found.append(self.places(model, data))
        q = np.array(found)
        kept = path.grid if many > 1 else dt
        rods = float(np.max(vmap(partial(c.constraint_violation, self.system))(q)))
        return Rung(
            scheme=self.scheme,
            dt=step,
            span=span,
            places=path.off(q, kept, part),
            rods=rods,
            energy=None,
            operations=spent / TIME / span,
            held=span if rods <= within else 0.0,
            lost=None,
        )


def peers(system):
    """The Peers that fit a system: `connect` where a loop closes, and else `hinges`."""
    other = "hinges" if has_loop(system) else "connect"
    return [Peer(system, name) for name in PEERS if not name.startswith(other)]


class Measured(NamedTuple):
    """What is known of a scene to several goals."""

    scene: str
    seconds: float  # s, up to which places are compared
    answers: dict  # {goal in m: the Answer}
    lines: dict  # {Scheme: [(error in m, s of computing for a second of motion)], by the step}


def measure(scene, goals):
    """The Measured of a scene, to each of the goals in m."""
    chapter = wider_chapter()
    system = c.rods.check_system(c.build_system(scene), c.PIVOT)
    answers = {}
    lines = {}
    steppers = [Stepper(chapter, system, scheme) for scheme in cli.progress(all_schemes())]
    steppers += peers(system)
    for goal in cli.progress(goals):
        search = Search(chapter, system, goal, DT, STEPS)
        for stepper in steppers:
            search.add(stepper)
        answers[goal] = search.answer()
        for ladders in search.ladders.values():
            for ladder in ladders:
                found = lines.setdefault(ladder.scheme, {})
                for rung in ladder.rungs:
                    cost = rung.operations * ladder.stepper.time
                    found.setdefault(rung.dt, (place_error(rung), cost))
    return Measured(
        scene=scene,
        seconds=search.yardstick.seconds,
        answers=answers,
        lines={scheme: [x[dt] for dt in sorted(x, reverse=True)] for scheme, x in lines.items()},
    )


def place_error(rung):
    """How far the places of a Rung are off, in m."""
    return np.inf if rung.lost or rung.places is None else rung.places


def cell(row):
    """The method of a Row, microseconds of computing for a second of motion, and ms of its step."""
    step = in_digits(1e3 * row.rung.dt, 2)
    return f"{row.rung.scheme.method} {amount(1e6 * row.rung.operations * row.pace, 2)}/{step:g}"


def lines_of(measured):
    """What is printed of a scene: a row for each integrator, a column for each goal."""
    what = "method, us/s of computing / ms a step"
    yield f"{measured.scene}, places to {measured.seconds:g} s: {what}"
    table = [["", *map(as_given, measured.answers)]]
    for name in dict.fromkeys(x.integrator for x in measured.lines):
        cells = [short(name)]
        for answer in measured.answers.values():
            rows = [row for row in answer.rows if row.rung.scheme.integrator == name]
            cells.append(cell(rows[0]) if rows else "-")
        table.append(cells)
    widths = [2 + max(map(len, column)) for column in zip(*table, strict=True)]
    for name, *cells in table:
        line = name.ljust(widths[0])
        yield line + "".join(x.rjust(width) for x, width in zip(cells, widths[1:], strict=True))


def main(argv=None):
    """Measure and print."""
    parser = cli.Parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="one scene, to one goal")
    args = parser.parse_args(argv)
    scenes = SCENES[:1] if args.quick else SCENES
    goals = (QUICK,) if args.quick else GOALS
    for scene in scenes:
        print()
        for line in lines_of(measure(scene, goals)):
            print(line)
    return 0
