"""Who reaches an error soonest: ladders of settings, the best rungs of which are timed in turns.

A job returns (seconds of its steps, positions); a setting is its text.
"""

import time
from functools import cache, partial
from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import NATIVE, make_midpoint, whole_step
from curriculum.ch3_4_constraints.tables import in_turns, spread
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss

import numpy as np


def run_ours(task, per, mode, rule, machine=NATIVE):
    """Our run, `per` steps a sample: the seconds of its steps, and positions.

    What is clocked is one call of the compiled steps for the whole run, in machine code or in
    Python, as a peer's loop in C is: without what `simulate` measures, logs and compares.
    """
    steps, dt, system = per * task.samples, task.every / per, task.system
    step, force = whole_step(system, rule, mode, dt)
    compiled = Compiled(step, steps, check=False)
    compiled.trace(system["q0"], system["v0"], system["m"], force, dt)
    if machine:
        compiled.to_machine()
    start = compiled.alone.traced.columns(system["q0"], system["v0"])[:, 0]
    compiled.alone(start, 1, dt)  # a peer's code has been called before, too
    clock = time.perf_counter()
    rows, why = compiled.alone(start, steps, dt)
    seconds = time.perf_counter() - clock
    q, _ = compiled.alone.traced.states(rows[per - 1 :: per, :, None])
    return seconds, np.full((task.samples, *q.shape[1:2], 2), np.nan) if why else q[..., :2]


def steps_ladder(task, job, low, high, *settings, text=""):
    """{setting: job}: `job` with ever more steps a sample, each rung about a tenth more."""
    count = round(10 * np.log(high / low))
    pers = np.unique(np.geomspace(low, high, count).round().astype(int)).tolist()
    return {f"{text}dt {task.every / per:.3g}": partial(job, task, per, *settings) for per in pers}


def ours(task, gauss, midpoint):
    """Ladders of the rules of high order; `gauss`: its stages, tolerances, steps a sample;
    `midpoint`: its orders, and the range of steps a sample."""
    ladders = {"ours, gauss": {}, "ours, midpoint": {}}
    for stages, tol, per in product(*gauss):
        setting = f"{stages}, {tol:g}, dt {task.every / per:.3g}"
        job = partial(run_ours, task, per, "none", make_gauss(stages, tol=tol))
        ladders["ours, gauss"][setting] = job
    for order in midpoint[0]:
        rule, text = make_midpoint(order), f"{order}, "
        rungs = steps_ladder(task, run_ours, *midpoint[1], "none", rule, text=text)
        ladders["ours, midpoint"] |= rungs
    return ladders


def in_python(ladders):
    """The same ladders, their steps compiled to Python alone."""
    return {
        who: {setting: partial(job, machine=False) for setting, job in ladder.items()}
        for who, ladder in ladders.items()
    }


def around(task, job):
    """Seconds of the steps, and of all there is: a model or a step is made, states are measured.

    Then the error, and the worst rod error in m at the samples.
    """
    clock = time.perf_counter()
    seconds, q = job()
    whole = time.perf_counter() - clock
    error = float(np.nan_to_num(task.error(q), nan=np.inf))
    q = np.concatenate([q, np.zeros((*np.shape(q)[:-1], 1))], axis=-1)
    return seconds, whole, error, float(c.constraint_violation(task.system, q).max())


def climb(measure, ladder, cap):
    """{setting: what was measured} up the ladder; of settings that differ in dt alone, to the first
    run that takes over `cap` s."""
    found, slow = {}, set()
    for setting, job in ladder.items():
        family = setting.partition("dt")[0]
        if family not in slow:
            found[setting] = measure(job)
            if found[setting][0] > cap:
                slow.add(family)
    return found


def cheapest(task, found, ladder, target, clock):
    """The setting that reaches the target soonest, its steps or in all (`clock`: 0 or 1), or None.

    The best three are timed once more, and the first on the ladder: on a busy machine the one of
    the fewest steps may be the best, too.
    """
    reach = [setting for setting, rung in found.items() if rung[2] <= target]
    best = sorted(reach, key=lambda setting: found[setting][clock])[:3]
    again = in_turns({s: partial(around, task, ladder[s]) for s in {*reach[:1], *best}}, 3)
    return min(again, key=lambda s: min(rung[clock] for rung in again[s]), default=None)


def race(title, task, ladders, targets, cap, repeats, rough=None):
    """The cheapest setting of each of `ladders` {who: {setting: job}} for each of `targets`.

    `targets`: {name: (error, {peer: (limit, limit in all)})}. The least time of the quickest whose
    name begins with "ours" is held against the least time of that peer: its steps, and in all. Who
    runs in Python is chosen by its time in all. `rough`: ladders by which to climb in their place.
    """
    jobs, rows, bars, measure = {}, [], [], cache(partial(around, task))
    for who, ladder in ladders.items():
        found, clock = climb(measure, (rough or {}).get(who, ladder), cap), who.endswith("Python")
        for name, (error, _) in targets.items():
            if setting := cheapest(task, found, ladder, error, clock):
                jobs[name, who, setting] = partial(around, task, ladder[setting])
    clocks = in_turns(jobs, repeats)
    for name, (_, limits) in targets.items():
        took = {key[1]: np.array(x) for key, x in clocks.items() if key[0] == name}
        settings = {who: setting for to, who, setting in clocks if to == name}
        least = {who: 1e3 * samples.min(axis=0) for who, samples in took.items()}
        mine = [who for who in took if who.startswith("ours")]
        best = [min(mine, key=lambda who, k=k: least[who][k], default=None) for k in (0, 1)]
        for who in sorted(took, key=lambda who: least[who][0]):
            steps, whole, errors, rods = took[who].T
            row = {"to": name, "who": who, "error": float(errors[0]), "rods m": float(rods[0])}
            row |= spread(1e3 * steps, "ms")
            row["build"] = 1e3 * float(np.median(whole - steps))
            row["in all"] = 1e3 * float(np.median(whole))
            row["ours/it"] = float(least[best[0]][0] / least[who][0]) if mine else "-"
            rows.append(row | {"setting": settings[who]})
        for peer, both in limits.items():
            for k, what in enumerate(("its steps", "in all")):
                if peer in took and mine and both[k]:
                    share = float(least[best[k]][k] / least[peer][k])
                    bars.append((f"{name}: {best[k]}, {what}, over {peer}", share, both[k]))
    return title, rows, bars
