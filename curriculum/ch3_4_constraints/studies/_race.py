"""Races: how long does an engine take to a given error?  Each climbs ladders of settings.

It goes to the first setting that reaches the error, and still does at the next finer one. These are
timed in turns, and of each engine the quickest is shown.
"""

import time
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import pairwise
from typing import NamedTuple

import constraints as c
from curriculum.ch3_4_constraints.tables import in_turns, show
from curriculum.common import rules

import numpy as np

REPEATS = 9  # timings
OURS, SOON, PYTHON = "ours", "ours, soon built", "ours, Python"
HINGES, TAYLOR, QUICK = "MuJoCo hinges", "heyoka", "heyoka, soon built"
SOONEST = SOON, PYTHON, QUICK  # they are judged in all, and others by their steps
STEPS, ALL = 0, 1  # the first two that `timed` measures


class Rung(NamedTuple):
    """A setting of an engine: go(build()) is a run, (seconds of its steps, positions)."""

    setting: str
    build: object  # () -> what is made once: a compiled step, a model; rungs may share it
    go: object


def steps_ladder(task, low, high, build, go, *words):
    """Rungs of ever more steps a sample, each about a tenth more: go(made, task, per)."""
    pers = np.geomspace(low, high, round(10 * np.log(high / low))).round().astype(int)
    rungs = []
    for per in np.unique(pers).tolist():
        setting = " ".join([*words, f"dt {task.every / per:.3g}"])
        rungs.append(Rung(setting, build, partial(go, task=task, per=per)))
    return rungs


def taylor_ladder(finest, build, go, *words):
    """Rungs of heyoka, four a power of ten: build(tol), go(made)."""
    tols = 10.0 ** -np.arange(1.0, finest, 0.25)
    return [Rung(" ".join([f"tol {tol:.1e}", *words]), partial(build, tol), go) for tol in tols]


def offered(error):
    """The names of our rules among which --tol chooses for an error."""
    families = (rules.offered(family, c.INTEGRATORS, error) for family in rules.FAMILIES)
    return [name for family in families for name in family]


def engines():
    """{name: version} of the other engines that are installed."""
    return {name: version(name) for name in ("mujoco", "heyoka") if find_spec(name)}


def timed(task, rung):
    """Seconds of the steps, and with what there is to build; and the error."""
    clock = time.perf_counter()
    made = rung.build()
    built = time.perf_counter() - clock
    seconds, q = rung.go(made)
    return seconds, seconds + built, np.nan_to_num(task.error(q), nan=np.inf)


def first_there(task, rungs, error):
    """The first of rungs that is as near as `error`, and the next one, too: it is no accident."""
    built = cache(lambda build: build())
    near = (task.error(rung.go(built(rung.build))[1]) <= error for rung in rungs)
    for rung, both in zip(rungs, pairwise(near), strict=False):
        if all(both):
            return rung
    return None


def race(task, racers, targets):
    """Rows and bars: how long each engine takes to each of `targets`.

    racers(error): {engine: ladders of Rungs, each from coarse and quick to fine and slow}.
    """
    rows, bars = [], []
    for error, limits in targets.items():
        jobs = {}
        for engine, climbs in racers(error).items():
            own = ALL if engine in SOONEST else STEPS
            for rung in filter(None, (first_there(task, rungs, error) for rungs in climbs)):
                jobs[engine, rung.setting, own] = partial(timed, task, rung)
        best = {}  # of the ladders of each
        for (engine, setting, own), samples in in_turns(jobs, REPEATS).items():
            times = np.array(samples).T
            if engine not in best or times[own].min() < best[engine][own].min():
                best[engine] = *times, setting
        for engine, (steps, whole, off, setting) in best.items():
            row = {"to": f"{error:.0e}", "engine": engine, "error": off[0]}
            row |= {"us": 1e6 * steps.min(), "median": 1e6 * np.median(steps)}
            row |= {"build, ms": 1e3 * np.min(whole - steps), "in all, ms": 1e3 * whole.min()}
            row["ours/it"] = best[OURS][STEPS].min() / steps.min() if OURS in best else "-"
            rows.append(row | {"setting": setting})
        for engine, peer, k, limit in limits:
            if {engine, peer} <= best.keys():
                text = f"{error:.0e}: {engine}, {('its steps', 'in all')[k]}, over {peer}"
                bars.append((text, best[engine][k].min() / best[peer][k].min(), limit))
    return rows, bars


def show_race(title, rows, bars):
    """Print a table for each error, in columns that fit a terminal, and its bars below it.

    `title`: its braces are for the error.
    """
    times = "us", "build, ms", "in all, ms"
    for error in dict.fromkeys(row["to"] for row in rows):
        own = [row for row in rows if row["to"] == error]
        of_this = [bar for bar in bars if bar[0].startswith(f"{error}: ")]
        shown = []
        for row in own:
            cells = {"engine": row["engine"], "error": f"{row['error']:.1e}"}
            cells |= {key: row[key] for key in times}
            share = row["ours/it"]
            cells["ours/it"] = share if share == "-" else f"{share:.2g}"
            shown.append(cells | {"setting": row["setting"]})
        show(title.format(error), shown, of_this)
