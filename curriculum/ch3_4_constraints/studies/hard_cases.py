"""Which method holds it when it gets hard, at which step, and for how much?

A single trajectory may be held by luck. So every scene of `scenes/` is started many times over: as
it is, with masses and speeds wrong by a rounding error, and with other masses (within 30 %) and
speeds, all consistent with the rods and drawn by a seed. A start is held for 2 s, or 10 s, if no
rod is ever off by more than 1 % of the shortest, and the energy by no more than 10 % of the larger
of its scale, sum m |g| sum L, and the kinetic energy at the start. The answer is the largest step
of a ladder, 0.02 to 0.0005 s, at which all starts are held; beside it stands how many are at the
next larger one. Of the runs at the answer for 10 s: the worst energy error, the largest share of
steps taken in halves, and what a simulated second costs, in the median.
"""

from argparse import RawDescriptionHelpFormatter
from functools import cache
from multiprocessing import Pool
from signal import SIG_IGN, SIGINT, signal
from textwrap import fill
from typing import NamedTuple

import constraints as c
from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.ch3_4_constraints.studies._runs import SCENES, energy_scale, run, scene
from curriculum.ch3_4_constraints.tables import show
from curriculum.common.banner import processor, progress
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.files import write_json

import numpy as np

LADDER = [0.02, 0.01, 0.005, 0.002, 0.001, 0.0005]  # s
HORIZONS = [2.0, 10.0]  # s
RODS, ENERGY = 0.01, 0.1  # what holding allows, see above
ROUNDING, OTHER = 1e-14, 0.3  # by what share masses and speeds are wrong, or other ones
NAMES = sorted(
    path.stem
    for path in SCENES.glob("*.json")
    if path.stem not in ("jansen_leg", "fourbar_coupler")
)
METHODS = [("semi_implicit", mode) for mode in c.hold_table()]
METHODS += [("rk4", "baumgarte"), ("rk4", "project"), ("gauss", "project")]


def starts(system, count, seed=0):
    """`count` systems: this one, then by turns one that differs by rounding errors and one that
    differs a lot."""
    rng, q, v = np.random.default_rng(seed), system["q0"], system["v0"]
    moves = np.any([q, v], axis=(0, 1))  # axes that the scene leaves alone are left alone
    found = [system]
    for k in range(1, count):
        size = ROUNDING if k % 2 else OTHER
        other = system | {
            "m": system["m"] * (1.0 + size * rng.uniform(-1.0, 1.0, system["m"].shape))
        }
        if k % 2:
            other["v0"] = v * (1.0 + size * rng.uniform(-1.0, 1.0))
        else:
            push = moves * rng.normal(
                0.0, 0.5, v.shape
            )  # m/s, of which the rods let pass what keeps their lengths
            other["v0"] = c.project(other, q, q, v * rng.uniform(0.5, 2.0) + push, 1.0)[1]
        found.append(other)
    return found


class Life(NamedTuple):
    """How a start fared: steps it was held, its worst energy error in that time, steps in halves,
    ms a second."""

    steps: int
    energy: float  # as a share of what it is measured by
    halved: float  # as a share of all
    cost: float


def life(system, rule, mode, dt, seconds):
    """The Life of a system under a method, with steps of `dt` s, for so many seconds."""
    found, v = run(system, rule, mode, dt, round(seconds / dt)), system["v0"]
    scale = max(energy_scale(system), 0.5 * float(np.sum(system["m"] * v * v)))
    energy = np.abs(found.energies - found.energies[0]) / scale
    good = (found.violations <= RODS * np.min(system["lengths"])) & (energy <= ENERGY)
    steps = int(np.sum(np.logical_and.accumulate(good))) - 1
    share = found.halved / max(1, len(good) - 1)
    return Life(steps, float(np.max(energy[: steps + 1])), share, 1e-3 * found.pace / dt)


def row(crowd, rule, mode, ladder=LADDER):
    """What the table says of a method and the starts of a scene: none is run that the answer does
    not need."""
    fates = cache(lambda k, dt: life(crowd[k], rule, mode, dt, HORIZONS[-1]))
    fragile = list(range(len(crowd)))
    said = {"method": f"{rule} {mode}".removeprefix("semi_implicit ")}

    def held(k, dt, seconds):
        return fates(k, dt).steps >= round(seconds / dt)

    def all_held(dt, seconds):
        lost = next((k for k in fragile if not held(k, dt, seconds)), None)
        if lost is not None:
            fragile.insert(0, fragile.pop(fragile.index(lost)))  # who is lost once is asked first
        return lost is None

    for seconds in HORIZONS:
        place = next((n for n, dt in enumerate(ladder) if all_held(dt, seconds)), None)
        share = (
            f"{sum(held(k, ladder[place - 1], seconds) for k in fragile)} of {len(crowd)}"
            if place
            else ""
        )
        said |= {
            f"{seconds:g} s": "-" if place is None else f"{ladder[place]:g}",
            f"larger, {seconds:g} s": share,
        }
    if place is None:
        return said | {"energy": "", "halved": "", "a second": ""}
    lives = [fates(k, ladder[place]) for k in fragile]
    energy, halved = (max(getattr(one, what) for one in lives) for what in ("energy", "halved"))
    cost = np.median([one.cost for one in lives])
    return said | {
        "energy": f"{energy:.0e}",
        "halved": f"{halved:.1%}" if halved else "",
        "a second": f"{cost:.3g} ms",
    }


def job(what):
    """A row of the table, of (scene, rule, mode, count, seed)."""
    name, rule, mode, count, seed = what
    return {"scene": name} | row(starts(scene(name), count, seed), rule, mode)


def study(names, methods, count, seed=0):
    """Rows, a scene after the other, from all processors at once, and {scene: why it is
    refused}."""
    refused, jobs, rows = {}, [], []
    for name in names:
        try:
            scene(name)
            jobs += [(name, rule, mode, count, seed) for rule, mode in methods]
        except SceneError as error:
            refused[name] = str(error).split(": ", 1)[1]
    tick = progress("hard cases", len(jobs))
    with Pool(
        initializer=signal, initargs=(SIGINT, SIG_IGN)
    ) as pool:  # Ctrl-C is for this process alone
        for found in pool.imap(job, jobs):
            rows.append(found)
            tick(len(rows))
    return rows, refused


def main(argv=None):
    """Print the table; `--json` also writes it."""
    parser = Parser(
        prog="hard_cases", description=__doc__, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "scenes", nargs="*", choices=[*NAMES, []], help="only these; all of them by default"
    )
    parser.add_argument(
        "--starts", type=number(int, 1, 10**4), default=20, help="of each scene (20)"
    )
    parser.add_argument("--seed", type=number(int, 0), default=0, help="draws them (0)")
    parser.add_argument(
        "--methods", default="", metavar="WORD", help="only those that contain this word"
    )
    parser.add_argument(
        "--json", type=writable, metavar="PATH", help="also write the table here, times and all"
    )
    args = parser.parse_args(argv)
    methods = [method for method in METHODS if args.methods in " ".join(method)]
    rows, refused = study(args.scenes or NAMES, methods, args.starts, args.seed)
    table = {}
    if rows:
        table = show(
            f"largest step in s at which all of {args.starts} starts are held, for 2 s and for 10 s",
            rows,
        )
    for name, why in refused.items():
        print(fill(f"{name} is refused: {why}", 100, subsequent_indent="    "))
    if args.json:
        what = {"host": processor(), "starts": args.starts, "seed": args.seed, "refused": refused}
        write_json(args.json, table | what)
    return 0


if __name__ == "__main__":
    run_script(main)
