"""What does an error cost?  Every integrator with every way to hold a rod, over a ladder of steps, against the truth.

Error is the largest distance of a particle, at twenty times, from where it should be. The truth is the ruler, gauss
with 12 stages, run at two steps whose difference is its own error. The horizon is chosen so that the methods decide and
not chaos: the longest of 5, 2, 1, 0.5 s in which two starts 1e-9 m apart stay within 1e-7.
"""

import math
import statistics
import sys

import numpy as np

import constraints as c
from curriculum.common.cli import Parser, number, run_script, writable
from curriculum.common.device import processor
from curriculum.common.files import write_json, write_whole
from curriculum.common.gauss import make_gauss

SAMPLES = 20
TARGETS = [1e-2, 1e-4, 1e-6, 1e-9, 1e-12]  # m
GAUSS = {
    f"gauss{stages}": (stages, window, tol) for stages, window, tol in ((6, 3, 1e-6), (8, 3, 5e-8), (10, 4, 1e-11))
}
GAUSS["gauss12"] = (12, 4, 1e-13)  # stages, steps ahead, where to stop iterating
SLOWEST = 150.0  # ms a simulated second: the ladder of a method ends where it costs more


def ruler(system, seconds, steps):
    """Positions (20, N, 3) at the sample times by 12 Gauss stages, `steps` steps between two; None if it fails."""
    keep = range(steps, SAMPLES * steps + 1, steps)
    hold, rule = c.hold_table()["project"], make_gauss(12, 4, 1e-14)
    run = c.simulate(system, rule, hold, seconds / (SAMPLES * steps), SAMPLES * steps, keep)
    return None if run["stopped"] else run["kept"]["q"]


def horizon(system):
    """Seconds, how far neighbouring starts have parted by then, the true positions, how well they are known (m)."""
    aside = 1e-9 * np.array([0.6, 0.8, 0.0]) * np.arange(1, len(system["q0"]) + 1)[:, None]
    start = c.project(system, system["q0"], system["q0"] + aside, system["v0"], 1.0)
    near = system | dict(zip(("q0", "v0"), start, strict=True))
    apart = c.distance(near["q0"], system["q0"])
    for seconds in (5.0, 2.0, 1.0, 0.5):
        steps = math.ceil(seconds / SAMPLES / 0.02)
        truth, check = (ruler(system, seconds, n) for n in (2 * steps, steps))
        other = ruler(near, seconds, steps)
        if truth is None or check is None or other is None:
            continue
        growth = c.distance(other, check) / apart
        if growth < 100.0:
            return seconds, growth, truth, c.distance(truth, check)
    raise SystemExit("speed_vs_error: this scene is chaotic or unruly within half a second: nothing to compare")


def methods():
    """{name: (rule, mode)}: the rules of the chapter with every mode they take, gauss with what it is good for."""
    rules = [name for name in c.INTEGRATORS if name != "gauss"]
    pairs = {f"{rule} {mode}": (rule, mode) for rule in rules for mode in c.hold_table()}
    pairs = {name: pair for name, pair in pairs.items() if pair[1] != "impulse" or pair[0] in c.ONE_FORCE}
    return pairs | {f"{rule} {mode}": (rule, mode) for rule in GAUSS for mode in ("none", "project")}


def measure(system, rule, mode, dt, steps, truth, repeats):
    """One row: error, rods, energy, and the median, least and most of `repeats` timings; None if the run fails."""
    pace = []
    for _ in range(repeats):
        stepper = make_gauss(*GAUSS[rule]) if rule in GAUSS else rule
        keep = range(steps // SAMPLES, steps + 1, steps // SAMPLES)
        run = c.simulate(system, stepper, c.hold_table(dt)[mode], dt, steps, keep)
        if run["stopped"]:
            return None
        pace.append(run["seconds_per_step"])
        if sum(pace) * steps > 0.5:
            break  # half a second is long enough to be sure of
    low, middle, high = min(pace), statistics.median(pace), max(pace)
    row = {"dt": dt, "error": c.distance(run["kept"]["q"], truth), "rods": float(run["max_violation"])}
    row |= {"energy": float(run["energy_rel_max"]), "us_step": 1e6 * middle, "us_step_spread": [1e6 * low, 1e6 * high]}
    return row | {"ms_per_s": 1e3 * middle / dt, "repeats": len(pace)}


def ladder(system, seconds, name, truth, repeats):
    """The rows of one method: the number of steps doubles until the cost runs away or the error stops to fall."""
    rule, mode = methods()[name]
    rows, steps = [], SAMPLES
    while not rows or rows[-1]["ms_per_s"] < SLOWEST:
        row = measure(system, rule, mode, seconds / steps, steps, truth, repeats)
        if row:
            rows.append({"method": name} | row)
        if steps * 2 > 2**18 or len(rows) > 3 and row["error"] > 0.7 * rows[-3]["error"] and row["error"] < 1e-9:
            break
        if len(rows) > 5 and row["error"] > 0.9 * rows[-4]["error"]:
            break  # a method that has stopped converging: soft, whose rods give by design
        steps *= 2
    return rows


def frontier(rows, known):
    """Those rows than which no other is both faster and more accurate, cheapest first; below `known` all are equal."""
    front, best = [], math.inf
    for row in sorted(rows, key=lambda row: (row["ms_per_s"], row["error"])):
        if max(row["error"], known) < best:
            front.append(row)
            best = max(row["error"], known)
    return front


STRETCH = 4.0  # a decade of time is drawn as wide as so many decades of error are high
COLORS = {"euler": [120, 120, 120], "semi_implicit": [225, 150, 60], "rk4": [90, 150, 235], "gauss": [110, 205, 110]}


def picture(path, table, front):
    """A recording with the log-log picture: one line a method, the frontier white, axes labelled with real values."""
    import rerun as rr
    import rerun.blueprint as rrb

    def place(row):
        return [STRETCH * math.log10(row["ms_per_s"]), -math.log10(max(row["error"], 1e-16))]

    spots = [place(row) for row in table]
    left, high = (math.floor(min(spot[k] for spot in spots) / (STRETCH, 1)[k]) for k in (0, 1))
    right, low = (math.ceil(max(spot[k] for spot in spots) / (STRETCH, 1)[k]) for k in (0, 1))
    grid = [
        ([[STRETCH * k, high], [STRETCH * k, low]], [STRETCH * k, low + 0.6], f"{10.0**k:g} ms")
        for k in range(left, right + 1)
    ]
    grid += [
        ([[STRETCH * left, k], [STRETCH * right, k]], [STRETCH * left - 0.8, k - 0.35], f"{10.0**-k:.0e} m")
        for k in range(high, low + 1)
    ]
    lines, points, labels = (list(column) for column in zip(*grid, strict=True))
    values = rr.Points2D(points, labels=labels, radii=0.001, colors=[200, 200, 200], show_labels=True)
    entities = {"axes": rr.LineStrips2D(lines, colors=[60, 60, 66], radii=0.008), "values": values}
    for name in dict.fromkeys(row["method"] for row in table):
        color = next(value for rule, value in COLORS.items() if name.startswith(rule))
        line = [place(row) for row in table if row["method"] == name]
        entities[f"{name}/line"] = rr.LineStrips2D([line], colors=color, radii=0.012)
        entities[f"{name}/rows"] = rr.Points2D(line, colors=color, radii=0.035)
        entities[f"{name}/name"] = rr.Points2D(line[-1:], colors=color, labels=[name], radii=0.035, show_labels=True)
    entities["frontier"] = rr.LineStrips2D([[place(row) for row in front]], colors=[255, 255, 255], radii=0.03)

    def write(temporary):
        recording = rr.RecordingStream("speed_vs_error", recording_id="speed_vs_error", send_properties=False)
        title = "error (lower is better) against ms a simulated second; white: the frontier"
        view = rrb.Spatial2DView(origin="picture", name=title, background=[16, 16, 20])
        recording.save(temporary, default_blueprint=rrb.Blueprint(view, collapse_panels=True))
        for name, entity in entities.items():
            recording.log(f"picture/{name.replace(' ', '_')}", entity, static=True)
        recording.flush()
        recording.disconnect()

    write_whole(path, write)


def show(rows, front):
    """Print rows, the most accurate first; a star marks the frontier."""
    print("  method                     dt        error    rods    energy       a step   a simulated second")
    for row in sorted(rows, key=lambda row: row["error"]):
        star = "*" if row in front else " "
        errors = f"{row['error']:9.1e} m {row['rods']:8.0e} m {row['energy']:8.0e}"
        print(
            f"{star} {row['method']:<22} {row['dt']:9.2e} {errors} {row['us_step']:9.1f} us {row['ms_per_s']:10.3g} ms"
        )


def main(argv=None):
    """Print the frontier (or every row), the cheapest method for each target; write JSON and the picture if asked."""
    parser = Parser(prog="speed_vs_error", description="What does an error cost?")
    add = parser.add_argument
    add("--system", default="double", metavar="NAME", help="a chapter scene or a scene file (double)")
    add("--links", type=number(int, 1), default=5, help="rods of --system chain (5)")
    add("--all", action="store_true", help="print every row, not the frontier alone")
    add("--repeats", type=number(int, 1), default=5, help="timings of each row, of which the median counts (5)")
    add(
        "--json",
        type=writable,
        metavar="PATH",
        help="write every row here, with host and spread of timings",
    )
    add("--rerun", type=writable, metavar="PATH", help="write the picture here: one line a method, log-log")
    args = parser.parse_args(argv)
    system = parser.attempt("--system", c.SceneError, c.build_system, args.system, 0, args.links)
    seconds, growth, truth, known = horizon(system)
    print(
        f"{args.system}, {seconds:g} s: neighbours part {growth:.0f}-fold by then; the truth is known to {known:.0e} m"
    )
    table = [row for name in methods() for row in ladder(system, seconds, name, truth, args.repeats)]
    front = frontier(table, known)
    show(table if args.all else front, front)
    print("\nthe cheapest that is good to   is")
    for target in TARGETS:
        row = next((row for row in front if row["error"] <= target), None)
        answer = (
            f"{row['method']}, dt {row['dt']:.2g} s, {row['ms_per_s']:.3g} ms a simulated second" if row else "none"
        )
        print(f"{target:>22.0e} m       {answer}")
    if args.json:
        content = {"system": args.system, "seconds": seconds, "growth": growth, "known_to": known, "host": processor()}
        content |= {"numpy": np.__version__, "python": sys.version.split()[0], "frontier": front, "rows": table}
        write_json(args.json, content)
    if args.rerun:
        picture(args.rerun, table, front)
    return 0


if __name__ == "__main__":
    run_script(main)
