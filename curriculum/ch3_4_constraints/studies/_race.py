"""Who reaches an error soonest: ladders of settings, the cheapest rungs of which are timed in
turns. For real_thing.

A job returns (seconds of its steps, positions); a setting is its text.
"""

import time
from functools import partial
from itertools import pairwise

from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.ch3_4_constraints.tables import in_turns, say, spread

import numpy as np


def extrapolated_midpoint(order):
    """An explicit rule (q, v, m, force, dt) -> (q, v) of any even `order`, with (order / 2)^2 + 1
    forces a step.

    The midpoint rule goes the way in 2, 4, ... `order` parts. Its error is a series in the square
    of a part (W. Gragg, SIAM J. Numer. Anal. 2 (1965) 384); each round of Aitken's and Neville's
    scheme takes away a term of it.
    """
    parts = range(2, order + 1, 2)

    def step(q, v, m, force, dt):
        def rate(x):
            return np.stack([x[1], force(*x) / m])

        start, row = np.stack([q, v]), []
        first = rate(start)
        for n in parts:
            before, x = start, start + (dt / n) * first
            for _ in range(n - 1):
                before, x = x, before + (2.0 * dt / n) * rate(x)
            row.append(x)
        for k in range(1, len(parts)):
            row = [
                b + (b - a) / ((n + 2 * k) ** 2 / n**2 - 1.0)
                for n, (a, b) in zip(parts, pairwise(row), strict=False)
            ]
        return tuple(row[0])

    return step


def run_ours(task, per, mode, rule):
    """Our run, `per` steps a sample. Its seconds are those of the steps, without tracing, compiling
    and measuring."""
    steps = per * task.samples
    found = run(task.system, rule, mode, task.every / per, steps, range(per, steps + 1, per))
    return found.seconds, np.full(1, np.nan) if found.stopped else found.q[..., :2]


def steps_ladder(task, text, job, low, high, *settings):
    """{setting: job}: `job` with ever more steps a sample, each rung about a tenth more than the
    one before."""
    pers = np.unique(
        np.geomspace(low, high, round(10 * np.log(high / low))).round().astype(int)
    ).tolist()
    return {f"{text}dt {task.every / per:.3g}": partial(job, task, per, *settings) for per in pers}


def climb(task, ladder, cap):
    """[(seconds, setting, error)] in the order of the ladder, up to the first run that takes over
    `cap` s."""
    found = []
    for setting, job in ladder.items():
        seconds, q = job()
        found.append((seconds, setting, float(np.nan_to_num(task.error(q), nan=np.inf))))
        if seconds > cap:
            break
    return found


def cheapest(found, ladder, target):
    """(setting, error) of what reaches the target soonest; None if nothing does.

    The best three are timed once more, and the first on the ladder: it has the fewest steps, on a
    busy machine, too.
    """
    reach = [rung for rung in found if rung[2] <= target]
    error = {setting: e for _, setting, e in [*reach[:1], *sorted(reach)[:3]]}
    again = in_turns({setting: ladder[setting] for setting in error}, 3)
    return min(
        error.items(), key=lambda rung: min(seconds for seconds, _ in again[rung[0]]), default=None
    )


def around(job):
    """Seconds of the steps, and with all around them: building a model, or tracing, compiling,
    measuring states."""
    clock = time.perf_counter()
    seconds, _ = job()
    return seconds, time.perf_counter() - clock


def race(title, task, ladders, targets, cap, repeats):
    """The cheapest setting of each of `ladders` {who: {setting: job}} for each of `targets`, side
    by side.

    `targets`: {name: (error, limit)}. The quickest of those whose names begin with "ours" is held
    against the quickest of the others: the time of its steps is at most `limit` times theirs.
    """
    chosen, rows, bars = {}, [], []
    for who, ladder in ladders.items():
        found = climb(task, ladder, cap)
        chosen |= {
            (name, who): cheapest(found, ladder, error) for name, (error, _) in targets.items()
        }
    jobs = {
        (name, who): partial(around, ladders[who][rung[0]])
        for (name, who), rung in chosen.items()
        if rung
    }
    clocks = in_turns(jobs, repeats)
    for name, (_, limit) in targets.items():
        steps, whole = (
            {who: 1e3 * np.array(clocks[name, who])[:, k] for who in ladders if chosen[name, who]}
            for k in (0, 1)
        )
        ours, theirs, share = quickest(steps)
        for who, ms in sorted(steps.items(), key=lambda item: np.min(item[1])):
            row = {"to": name, "who": who, "error": chosen[name, who][1], **spread(ms, "ms")}
            row |= {
                "in all": float(np.median(whole[who])),
                "ours/it": float(np.min(steps[ours]) / np.min(ms)),
            }
            rows.append(row | {"setting": chosen[name, who][0]})
        bars.append((f"{name}: {ours}, its time as a share of that of {theirs}", share, limit))
        say(
            "{}: in all, with all around the steps, {}, as a share of {}: {:.3g}".format(
                name, *quickest(whole)
            )
        )
        if late := [who for who in ladders if who not in steps]:
            say(f"{name}: not reached in {cap:g} s a run by {'; '.join(late)}")
    return title, rows, bars


def quickest(samples):
    """The quickest of ours, the quickest of the others, and the least time of the former as a share
    of the latter's."""
    sides = [[who for who in samples if who.startswith("ours") == mine] for mine in (True, False)]
    ours, theirs = (min(side, key=lambda who: np.min(samples[who])) for side in sides)
    return ours, theirs, float(np.min(samples[ours]) / np.min(samples[theirs]))
