"""Who reaches an error soonest: a ladder of settings each, its cheapest rungs timed in turns. For the study real_thing.

A job returns (seconds of the work, seconds with all around it, positions); a setting is its text.
"""

import time
from functools import partial
from itertools import product

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.studies.benchmark import show, spread
from curriculum.common.gauss import make_gauss


def run_ours(task, per, mode, rule, *settings):
    """Our simulate, `per` steps a sample: the clock of its loop, and with making the rule and measuring every state."""
    dt, clock, steps = task.every / per, time.perf_counter(), per * task.samples
    rule = make_gauss(*settings) if settings else rule
    run = c.simulate(task.system, rule, c.hold_table(dt)[mode], dt, steps, range(per, steps + 1, per))
    q = np.full(1, np.nan) if run["stopped"] else run["kept"]["q"][..., :2]
    return run["seconds_per_step"] * run["steps"], time.perf_counter() - clock, q


def gauss_ladder(task, *choices):
    """{setting: job} of gauss with all combinations of modes, steps a sample, stages, windows and tolerances."""
    ladder, text = {}, "{}, dt {:.4g}, {} stages, window {}, tol {:g}"
    for mode, per, *rule in product(*choices):
        ladder[text.format(mode, task.every / per, *rule)] = partial(run_ours, task, per, mode, "gauss", *rule)
    return ladder


def steps_ladder(task, text, run, low, high, *settings):
    """{setting: job}: `run` with ever more steps a sample, each rung about a tenth more than the one before."""
    pers = np.unique(np.geomspace(low, high, round(10 * np.log(high / low))).round().astype(int)).tolist()
    return {f"{text}dt {task.every / per:.4g}": partial(run, task, per, *settings) for per in pers}


def climb(task, ladder, cap, least):
    """[(seconds, error, setting)] in the order of the ladder, up to a run over `cap` s or an error under `least`."""
    found = []
    for setting, job in ladder.items():
        seconds, _, q = job()
        found.append((seconds, float(np.nan_to_num(task.error(q), nan=np.inf)), setting))
        if seconds > cap or found[-1][1] < least:
            break
    return found


def in_turns(jobs, repeats):
    """{name: (repeats, 2)}: what jobs called A B A B return first: seconds of the work, and with all around it."""
    seconds = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            seconds[name].append(job()[:2])
    return {name: np.array(s) for name, s in seconds.items()}


def cheapest(found, ladder, target):
    """(setting, error) of what reaches the target soonest; () if nothing does. The few best are timed once more."""
    reach = sorted(rung for rung in found if rung[1] <= target)[:4]
    error = {setting: e for seconds, e, setting in reach if seconds < 1.5 * reach[0][0]}
    again = in_turns({setting: ladder[setting] for setting in error}, 3 if len(error) > 1 else 1)
    return min(error.items(), key=lambda rung: np.median(again[rung[0]][:, 0]), default=())


def race(title, task, ladders, targets, cap, repeats, limits):
    """The cheapest setting of each of `ladders` {who: {setting: job}}, ours first, for each of `targets`, side by side.

    `limits`: (target, rivals, limit) of the time of ours over that of the quickest of these rivals.
    """
    rows, bars, chosen, climbs, ours = [], [], {}, {}, next(iter(ladders))
    for who, ladder in ladders.items():
        climbs[who] = climb(task, ladder, cap, 0.0 if who == ours else min(targets.values()))
        for name, target in targets.items():
            if found := cheapest(climbs[who], ladder, target):
                chosen[name, who] = found
    clocks = in_turns({(name, who): ladders[who][s] for (name, who), (s, _) in chosen.items()}, repeats)
    alike = {key: clocks[key[0], ours][:, 0] / s[:, 0] for key, s in clocks.items() if (key[0], ours) in clocks}
    ratio = {key: float(np.median(samples)) for key, samples in alike.items()}
    for name, who in sorted(chosen, key=lambda key: list(targets).index(key[0])):
        setting, error = chosen[name, who]
        row = {"target": name, "who": who, "error": error, **spread(1e3 * clocks[name, who][:, 0], "ms")}
        row["with all around it"] = 1e3 * float(np.median(clocks[name, who][:, 1]))
        rows.append(row | {"ours/this": ratio.get((name, who), "-"), "setting": setting})
    for name, rivals, limit in limits:
        present = {who: ratio[name, who] for who in rivals if (name, who) in ratio}
        if present:
            who = max(present, key=present.get)
            bars.append((f"{name}: time of ours as a share of {who}", present[who], limit))
        else:
            late = [who for who in (ours, *rivals) if (name, who) not in chosen]
            print(f"{name}: in {cap:g} s a run, not reached by {', '.join(late)}")
    rungs = {who: [[s, e if np.isfinite(e) else None, text] for s, e, text in found] for who, found in climbs.items()}
    return show(title, rows, bars) | {"ladders, s, m, setting": rungs}
