"""Which method holds it when it gets hard, at which step, and for how much?

For every scene of `scenes/` the largest dt of a ladder at which each method holds it for two seconds, and what a
simulated second costs there. A scene is held if the run ends, no rod is ever off by more than 1 % of the shortest, and
the energy by no more than 10 % of the larger of its scale, sum m |g| sum L, and the kinetic energy at the start. A cell
is `-` where no step of the ladder does; `~` marks a borderline: half the allowance was used there, or twice was not
reached one step up.
"""

import numpy as np

import constraints as c
from curriculum.common.cli import Parser, run_script, writable
from curriculum.common.device import processor
from curriculum.common.files import write_json
from curriculum.common.scenes import SceneError

LADDER = [0.02, 0.01, 0.005, 0.002, 0.001, 0.0005]
SECONDS = 2.0
RODS, ENERGY = 0.01, 0.1  # what holding allows, see above
SCENES = ["long_chain", "heavy_tip", "light_tip", "spin", "upright", "windows", "braced", "cable", "taut_cable"]
METHODS = [("semi_implicit", mode) for mode in c.hold_table()] + [
    ("rk4", "baumgarte"),
    ("rk4", "project"),
    ("gauss", "project"),
]
METHODS = [(integrator, mode) for integrator, mode in METHODS if integrator in c.INTEGRATORS]


def strain(system, integrator, mode, dt):
    """How much of the allowance a run uses, rods or energy, whichever is more: held if <= 1; and seconds a step."""
    run = c.simulate(system, integrator, c.hold_table(dt)[mode], dt, round(SECONDS / dt))
    if run["stopped"]:
        return np.inf, run["seconds_per_step"]
    scale = c.energy_scale(system)
    kinetic = float(c.energy(system, system["q0"], system["v0"]) - c.energy(system, system["q0"], 0.0 * system["v0"]))
    rods = float(run["max_violation"]) / (RODS * system["lengths"].min())
    return max(rods, float(run["energy_rel_max"]) * scale / (ENERGY * max(scale, kinetic))), run["seconds_per_step"]


def cell(system, integrator, mode):
    """The largest dt that holds the scene (None: none does), ms a simulated second there, and whether it was close."""
    above = np.inf
    for dt in LADDER:
        used, per_step = strain(system, integrator, mode, dt)
        if used <= 1.0:
            return {"dt": dt, "ms": 1e3 * per_step / dt, "borderline": bool(used > 0.5 or above < 2.0)}
        above = used
    return {"dt": None, "ms": None, "borderline": bool(above < 2.0)}


def text(entry):
    """A cell as printed: dt, the mark, the cost."""
    if entry["dt"] is None:
        return "-" + "~" * entry["borderline"]
    return f"{entry['dt']:g}{'~' * entry['borderline']} {entry['ms']:.3g} ms"


def study(scenes=SCENES, methods=METHODS, show=lambda line: None):
    """{scene: {"integrator mode": cell} or {"refused": why}}; show(line) is called with each row as it is finished."""
    names = [f"{integrator} {mode}".replace("semi_implicit ", "") for integrator, mode in methods]
    show("scene       " + "".join(f"{name:>18}" for name in names))
    table = {}
    for scene in scenes:
        try:
            system = c.build_system(str(c.HERE / c.CHAPTER / f"scenes/{scene}.json"))
        except SceneError as error:
            table[scene] = {"refused": str(error).split(": ", 1)[1]}
            show(f"{scene:<12}  refused: {table[scene]['refused']}")
            continue
        table[scene] = {name: cell(system, *method) for name, method in zip(names, methods, strict=True)}
        show(f"{scene:<12}" + "".join(f"{text(entry):>18}" for entry in table[scene].values()))
    return table


def main(argv=None):
    """Print the table, one row at a time; `--json` also writes it."""
    parser = Parser(prog="hard_cases", description="Which method holds it when it gets hard, and for how much?")
    parser.add_argument("scenes", nargs="*", choices=[*SCENES, []], help="only these; all of them by default")
    parser.add_argument("--json", type=writable, metavar="PATH", help="also write the table here, times and all")
    args = parser.parse_args(argv)
    print(
        "largest dt that holds the scene for 2 s, and what a simulated second costs there; semi_implicit unless named"
    )
    table = study(args.scenes or SCENES, show=lambda line: print(line, flush=True))
    if args.json:
        write_json(args.json, {"host": processor(), "ladder": LADDER, "seconds": SECONDS, "scenes": table})
    return 0


if __name__ == "__main__":
    run_script(main)
