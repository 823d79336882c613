"""Exercise 5: your own linkage, one that a remedy holds and another does not. (30 minutes)

    python -m curriculum.ch3_4_constraints.exercises.ex5_linkage

First a leg that is designed already; then edit my_linkage.json until one of the remedies
baumgarte, impulse, soft and project holds it and another does not. `none` would be too easy.
"""

from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.exercises.checks import blank, judge
from curriculum.ch3_4_constraints.studies import _runs

SCENE = Path(__file__).with_name("my_linkage.json")
DT, STEPS = 0.005, 400  # s; 2 s in all
SHARE = 0.01  # of the shortest rod: a remedy holds a scene if no rod is ever off by more
WHY = "What in your scene hurts one remedy and not the other?"


def ship():
    """The mode you would ship for Jansen's leg: 200 steps a second, rods 1 mm off, few us a step.

    See what the modes make of it: python constraints.py --system jansen_leg --no-rerun
    That is 20 s. The check goes by the first 2 s, and finds no larger errors.
    """
    return blank("the mode you would ship, by its name, such as 'none'")


def worst(system, mode):
    """The worst rod error by semi_implicit, as a share of the shortest rod; inf if it stopped."""
    ran = _runs.run(system, "semi_implicit", mode, DT, STEPS)
    return float("inf") if ran.stopped else ran.violations.max() / system["lengths"].min()


def main():
    """What every mode makes of your scene: {mode: the worst rod error, as a share}."""
    system = c.build_system(str(SCENE))
    found = {mode: worst(system, mode) for mode in c.hold_table(DT)}
    print(f"{SCENE.name}: {len(system['pairs'])} rods, 2 s by semi_implicit")
    print("worst rod error, in % of the shortest rod")
    for mode, share in found.items():
        print(f"{mode:<10} {100.0 * share:10.4f}   {'holds it' if share <= SHARE else 'loses it'}")
    return found


if __name__ == "__main__":
    judge(main)
