"""Which starts are refused: those that no finite tension can hold, and no others."""

from itertools import combinations, product
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.statics import in_line, refusal
from curriculum.ch3_4_constraints.studies._runs import make_system, run, scene
from curriculum.ch3_4_constraints.studies.hard_cases import METHODS

import numpy as np
import pytest

LINE, LOOP = [(1, 0), (2, 0)], [(0, -1), (1, 0), (1, -2)]
STARTS = {  # points, rods, anchors, speeds upward; whether finite tensions can hold them
    "a taut cable": (LINE, LOOP, [(0, 0), (3, 0)], [0, 0], False),
    "plucked": (LINE, LOOP, [(0, 0), (3, 0)], [1, 0], False),
    "beside a bob": ([*LINE, (4, 0)], [*LOOP, (2, -3)], [(0, 0), (3, 0), (5, 0)], [0, 0, 1], False),
    "a four-bar folded flat, at rest": (LINE, LOOP, [(0, 0), (1, 0)], [0, 0], True),
    "unfolding": (LINE, LOOP, [(0, 0), (1, 0)], [1, 1], True),
    "torn": (LINE, LOOP, [(0, 0), (1, 0)], [0.5, 1], False),
    "3 legs for 2": ([(1, 2)], [(0, -1), (0, -2), (0, -3)], [(0, 0), (1, 0.3), (3, 0)], [0], True),
    "a loose particle": ([*LINE, (9, 9)], LOOP, [(0, 0), (1, 0)], [0, 0, 5], True),
}  # fmt: skip
for sag in (1e-2, 1e-4, 1e-6, 1e-9, 0.0):  # tensions of m g / (2 sag), until doubles see none
    ends = [(0, 0), (2.0 * np.sqrt(1.0 - sag * sag), 0)]
    weight = [(0.5 * ends[1][0], -sag)], [(0, -1), (0, -2)], ends, [0], sag > 1e-8
    STARTS[f"a weight on a line that sags by {sag:g}"] = weight


@pytest.mark.parametrize("name", STARTS)
def test_a_start_that_tears_is_refused_and_no_other(name):
    """Without gravity no loop does that is at rest; the loops are of the first two particles."""
    points, rods, anchors, speeds, ok = STARTS[name]
    points, anchors = (np.pad(np.array(x, float), ((0, 0), (0, 1))) for x in (points, anchors))
    upward = np.outer(speeds, [0.0, 1.0, 0.0])
    system = make_system(points, upward, np.ones(len(points)), rods, anchors=anchors)
    assert (refusal(system, c.GRAVITY) is None) == ok
    assert (refusal(system, 0.0 * c.GRAVITY) is None) == (ok or not any(speeds[:2]))


@pytest.mark.parametrize("wide", [2, 3])
def test_a_strip_of_plates_sags_and_a_square_of_them_cannot(wide):
    """Braced squares hung by outer corners: a joint amid flat plates cannot leave them."""
    at, sides = list(product(range(3), range(wide))), ((1, 0), (0, 1), (1, 1))
    steps = {(j, i): tuple(np.subtract(at[j], at[i])) for i, j in combinations(range(len(at)), 2)}
    rods = [pair for pair, step in steps.items() if step in sides]
    corners = list(product((0, 2), (0, wide - 1)))
    rods += [(at.index(corner), -1 - k) for k, corner in enumerate(corners)]
    q, anchors = ([(x, y, z) for x, z in places] for y, places in ((0.0, at), (1.0, corners)))
    system = make_system(q, np.zeros((len(q), 3)), np.ones(len(q)), rods, anchors=anchors)
    assert (refusal(system, c.GRAVITY) is None) == (wide == 2)


def test_nothing_but_rounding_could_move_what_is_in_balance_and_it_does_not():
    cable = scene("tight_cable")  # 0.1 % longer than its span
    assert np.sum(cable["lengths"]) / cable["anchors"][1, 0] == pytest.approx(1.001, rel=1e-15)
    for method in METHODS:
        assert np.abs(run(scene("upright"), *method, 0.005, 400).tip[:, 0]).max() < 1e-9
        if "soft" not in method:  # whose rods are longer under load
            assert np.ptp(run(cable, *method, 0.005, 100).tip, axis=0).max() < 1e-9


def test_a_run_that_ends_where_rods_are_in_line_is_told_so():
    system = scene("windows")
    flat = system["q0"] * [1.0, 0.0, 1.0] + [1.0, 0.0, 0.0]  # all bars on the ground
    for kind in ("loop", "diverged", None):
        end = SimpleNamespace(kind=kind, q=flat[None], v=system["v0"][None])
        told = "nearly in line there" in in_line(c.constraint_terms, system, end)
        assert told == (kind == "loop")
