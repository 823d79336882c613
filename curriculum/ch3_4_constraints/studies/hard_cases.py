"""Which method holds it when it gets hard, and at which step?

A single trajectory may be held by luck. So each scene but two easy ones, and one that is refused,
is started many times: as it is, by turns with masses and speeds wrong by a rounding error, and with
other masses (within 30 %) and speeds, all consistent with the rods and drawn by a seed. What is at
rest and in line stays at rest: pushes go along axes that a scene uses, and there rods let none
pass. A start is held if no rod is ever off by more than 1 % of the shortest, and the energy by no
more than 10 % of the larger of its scale, sum m |g| sum L, and the kinetic energy at the start. A
cell is the largest step of a ladder, 0.02 to 0.0005 s, at which all starts are held; where there is
none, how many the smallest holds.
"""

from functools import partial
from itertools import product
from multiprocessing import Pool
from signal import SIG_IGN, SIGINT, signal

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import SHIPPED, energy_scale, run, study_parser
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.cli import number, one_of
from curriculum.common.compiled import Compiled
from curriculum.common.progress import work
from curriculum.common.ruler import once_for_all

import numpy as np

LADDER = [0.02, 0.01, 0.005, 0.002, 0.001, 0.0005]  # s
RODS, ENERGY = 0.01, 0.1  # what holding allows, see above
ROUNDING, OTHER = 1e-14, 0.3  # by what share masses and speeds are wrong, or other ones
EASY = "jansen_leg", "fourbar_coupler"
NAMES = [name for name in SHIPPED if name not in EASY]
METHODS = [("semi_implicit", mode) for mode in c.hold_table()]
METHODS += [("rk4", "baumgarte"), ("rk4", "project"), ("gauss", "project")]
TITLES = {" ".join(method).removeprefix("semi_implicit "): method for method in METHODS}


def starts(system, count, seed=0):
    """`count` systems: this one, then by turns one that differs by rounding errors and one that
    differs a lot."""
    rng, q, v = np.random.default_rng(seed), system["q0"], system["v0"]
    moves = np.any([q, v], axis=(0, 1))  # axes that the scene leaves alone are left alone
    found = [system]
    for k in range(1, count):
        size = ROUNDING if k % 2 else OTHER
        other = system | {"m": system["m"] * (1.0 + size * rng.uniform(-1.0, 1.0, (len(q), 1)))}
        if k % 2:
            other["v0"] = v * (1.0 + size * rng.uniform(-1.0, 1.0))
        else:
            push = moves * rng.normal(0.0, 0.5, v.shape)  # m/s; what the rods let pass is taken
            other["v0"] = c.project(other, q, q, v * rng.uniform(0.5, 2.0) + push, 1.0)[1]
        found.append(other)
    return found


def held(system, rule, mode, dt, seconds):
    """Whether a method holds a start; most that it loses it loses soon."""
    v, way = system["v0"], once_for_all(Compiled)  # compiled once for both of the runs below
    scale = max(energy_scale(system), 0.5 * float(np.sum(system["m"] * v * v)))
    for steps in (round(0.1 * seconds / dt), round(seconds / dt)):
        found = run(system, rule, mode, dt, steps, way=way)
        energy = np.abs(found.energies - found.energies[0]) / scale
        good = (found.violations <= RODS * np.min(system["lengths"])) & (energy <= ENERGY)
        if found.stopped or not good.all():
            return False
    return True


def cell(crowd, rule, mode, seconds, ladder=LADDER):
    """What the table says of a method and the starts of a scene."""
    for dt in ladder:
        if all(held(start, rule, mode, dt, seconds) for start in crowd):
            return f"{dt:g}"
    share = sum(held(start, rule, mode, ladder[-1], seconds) for start in crowd)
    return f"{share}/{len(crowd)}" if share else "-"


def job(where, args):
    """A cell of (scene, title of a method)."""
    name, title = where
    return cell(starts(c.build_system(name), args.starts), *TITLES[title], args.seconds)


def main(argv=None):
    """Print the table, all processors at work."""
    quick = {"starts": 2, "seconds": 1.0, "names": ["cable", "spin", "windows"]}
    parser = study_parser("hard_cases", __doc__, quick, names=NAMES)
    add, scenes = parser.add_argument, f"only these, of {', '.join(NAMES)}"
    add("scenes", nargs="*", type=one_of(NAMES), metavar="SCENE", help=scenes)
    add("--starts", type=number(int, 1, 10**4), default=40, help="of each scene (40)")
    add("--seconds", type=number(float, 0.1, 1e4), default=10.0, help="to be held (10)")
    add("--methods", default="", metavar="WORD", help="only those that contain this word")
    args = parser.parse_args(argv)
    asked = [title for title in TITLES if args.methods in title]
    if not asked:
        known = ", ".join(TITLES)
        parser.error(f"argument --methods: none contains {args.methods!r}; there are {known}")
    rows = {name: {"scene": name} for name in sorted(args.scenes or args.names)}
    jobs = list(product(rows, asked))
    # Ctrl-C is for this process alone
    with Pool(initializer=signal, initargs=(SIGINT, SIG_IGN)) as pool:
        cells = pool.imap(partial(job, args=args), jobs)
        for name, title in work.through("hard cases", jobs):
            rows[name][title] = next(cells)
    about = f"{args.starts} starts of each scene, {args.seconds:g} s"
    show(f"largest step in s at which all are held: {about}", list(rows.values()))
