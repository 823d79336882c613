"""Who reaches an error soonest: ladders of settings, the best rungs of which are timed in turns.

A job returns (seconds of its steps, positions); a setting is its text.
"""

import time
from functools import partial
from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import make_midpoint, run
from curriculum.ch3_4_constraints.tables import in_turns, spread
from curriculum.common.gauss import make_gauss

import numpy as np


def run_ours(task, per, mode, rule):
    """Our run, `per` steps a sample: the seconds of its steps, and positions."""
    steps = per * task.samples
    found = run(task.system, rule, mode, task.every / per, steps, range(per, steps + 1, per))
    return found.seconds, np.full(1, np.nan) if found.stopped else found.q[..., :2]


def steps_ladder(task, job, low, high, *settings, text=""):
    """{setting: job}: `job` with ever more steps a sample, each rung about a tenth more."""
    count = round(10 * np.log(high / low))
    pers = np.unique(np.geomspace(low, high, count).round().astype(int)).tolist()
    return {f"{text}dt {task.every / per:.3g}": partial(job, task, per, *settings) for per in pers}


def ours(task, gauss, midpoint):
    """Ladders of the rules of high order; `gauss`: its stages, steps a sample, tolerances;
    `midpoint`: its orders, and the range of steps a sample."""
    ladders = {"ours, gauss": {}, "ours, midpoint": {}}
    for stages, per, tol in product(*gauss):
        setting = f"{stages}, {tol:g}, dt {task.every / per:.3g}"
        job = partial(run_ours, task, per, "none", make_gauss(stages, tol=tol))
        ladders["ours, gauss"][setting] = job
    for order in midpoint[0]:
        rule, text = make_midpoint(order), f"{order}, "
        rungs = steps_ladder(task, run_ours, *midpoint[1], "none", rule, text=text)
        ladders["ours, midpoint"] |= rungs
    return ladders


def climb(task, ladder, cap):
    """[(seconds, setting, error)] up the ladder; of settings that differ in dt alone, to the first
    run that takes over `cap` s."""
    found, slow = [], set()
    for setting, job in ladder.items():
        family = setting.partition("dt")[0]
        if family in slow:
            continue
        seconds, q = job()
        found.append((seconds, setting, float(np.nan_to_num(task.error(q), nan=np.inf))))
        if seconds > cap:
            slow.add(family)
    return found


def cheapest(found, ladder, target):
    """(setting, error) of what reaches the target soonest; None if nothing does.

    The best three are timed once more, and the first on the ladder: on a busy machine the one of
    the fewest steps may be the best, too.
    """
    reach = [rung for rung in found if rung[2] <= target]
    error = {setting: e for _, setting, e in [*reach[:1], *sorted(reach)[:3]]}
    again = in_turns({setting: ladder[setting] for setting in error}, 3)
    least = {setting: min(seconds for seconds, _ in jobs) for setting, jobs in again.items()}
    return min(error.items(), key=lambda rung: least[rung[0]], default=None)


def around(task, job):
    """Seconds of the steps, and of all there is: a model or a step is made, states are measured.

    Third, the worst rod error in m at the samples.
    """
    clock = time.perf_counter()
    seconds, q = job()
    whole = time.perf_counter() - clock
    q = np.concatenate([q, np.zeros((*np.shape(q)[:-1], 1))], axis=-1)
    return seconds, whole, float(c.constraint_violation(task.system, q).max())


def race(title, task, ladders, targets, cap, repeats):
    """The cheapest setting of each of `ladders` {who: {setting: job}} for each of `targets`.

    `targets`: {name: (error, {peer: (limit, limit in all)})}. The least time of the quickest whose
    name begins with "ours" is held against the least time of that peer: its steps, and in all.
    """
    chosen, rows, bars = {}, [], []
    for who, ladder in ladders.items():
        found = climb(task, ladder, cap)
        for name, (error, _) in targets.items():
            if rung := cheapest(found, ladder, error):
                chosen[name, who] = rung
    jobs = {
        (name, who): partial(around, task, ladders[who][setting])
        for (name, who), (setting, _) in chosen.items()
    }
    clocks = in_turns(jobs, repeats)
    for name, (_, limits) in targets.items():
        took = {who: np.array(clocks[name, who]) for who in ladders if (name, who) in chosen}
        least = {who: 1e3 * samples.min(axis=0) for who, samples in took.items()}
        mine = [who for who in took if who.startswith("ours")]
        best = [min(mine, key=lambda who, k=k: least[who][k], default=None) for k in (0, 1)]
        for who in sorted(took, key=lambda who: least[who][0]):
            steps, whole, rods = took[who].T
            row = {"to": name, "who": who, "error": chosen[name, who][1], "rods m": float(rods[0])}
            row |= spread(1e3 * steps, "ms")
            row["build"] = 1e3 * float(np.median(whole - steps))
            row["in all"] = 1e3 * float(np.median(whole))
            row["ours/it"] = float(least[best[0]][0] / least[who][0]) if mine else "-"
            rows.append(row | {"setting": chosen[name, who][0]})
        for peer, both in limits.items():
            for k, what in enumerate(("its steps", "in all")):
                if peer in took and mine and both[k]:
                    share = float(least[best[k]][k] / least[peer][k])
                    bars.append((f"{name}: {best[k]}, {what}, over {peer}", share, both[k]))
    return title, rows, bars
