"""Scenes of many rods: the chapter's numbers by other means; solves that end by what they leave."""

import constraints as c
from curriculum.ch3_4_constraints import large
from curriculum.ch3_4_constraints.studies._runs import make_system, run
from curriculum.ch3_4_constraints.tables import UNHELD
from curriculum.common.trace import Stop

import numpy as np
import pytest
from test_force import TABLE, assert_close, cantilever, moving, row, tree

STAR = [(0, -1), *((k, 0) for k in range(1, 30))]
PAIRS = {f"chain of {n}": row(n) for n in (large.CHAIN + 1, 162)}
PAIRS |= {"tree": tree(large.LINKAGE + 1), "loops": tree(large.LINKAGE, 8)}
PAIRS |= {"wheel": STAR + row(30)[2:]}


@pytest.mark.parametrize("pairs", PAIRS.values(), ids=PAIRS)
def test_large_scenes_equal_the_chapters_lines(pairs):
    """Forces, tensions and the way back, of one state and of a stack of them."""
    system = moving(pairs, 0.001)
    q, v, moved = system["q0"], system["v0"], system["q0"] + 1e-3 * system["v0"]
    two = np.stack([q, moved]), np.stack([v, 0.5 * v])
    for hold in TABLE.values():
        force = c.make_force(system, hold)
        assert isinstance(force, large.LargeForce)
        expected = c.external_force(system, *two) + c.constraint_force(system, *two, hold)
        assert_close(force(*two), expected)
        assert_close(force(q, v), expected[0])
    assert_close(force.tensions(*two), c.tensions(system, *two, hold))
    system = system | {"lengths": system["lengths"] / 0.999}  # the start is on its rods
    back = c.make_force(system, TABLE["project"]).after(q, moved, v, 1e-3)
    for ours, theirs in zip(back, c.project(system, q, moved, v, 1e-3), strict=True):
        assert_close(ours, theirs, 1e-10)


def test_rods_too_many_stay_put_and_long_chains_find_their_way_back():
    """With less slack, what rounding leaves between the rods of a braced truss blows up."""
    assert run(cantilever(20, both=True), steps=40).violations.max() < 1e-8
    chain = c.build_system("chain", links=10_000)
    lost, back = (run(chain, hold=mode, steps=1).violations[-1] for mode in ("none", "project"))
    assert lost > 1e-8 and back < 1e-11


def test_what_no_tension_can_hold_is_let_go_and_told():
    """A straight line in motion between two anchors; numbers that are none end a run."""
    q = np.arange(71.0)[:, None] * [1.0, 0.0, 0.0]
    v = np.outer(np.arange(69) == 34, [0.0, 1.0, 0.0])
    line = make_system(q[1:-1], v, np.ones(69), [*row(69), (68, -2)], None, q[[0, -1]])
    force = c.make_force(line, 0.0)
    assert force.unheld(line["q0"], line["v0"]) > UNHELD
    with np.errstate(all="ignore"), pytest.raises(Stop, match="no finite tensions"):
        force(np.nan * line["q0"], line["v0"])


def test_what_is_large():
    """Many rods in a row, few that all feel each other, many particles; a loose one just falls."""
    loose = moving(row(large.CHAIN - 5), loose=100)
    scenes = moving(STAR), moving(STAR[:10]), moving(row(large.CHAIN + 5)), loose
    assert [large.takes(some) for some in scenes] == [True, False, True, True]
    assert_close(c.make_force(loose, 0.0)(loose["q0"], loose["v0"])[-1], loose["m"][-1] * c.GRAVITY)


def test_an_edit_of_the_chapter_counts_for_many_rods(monkeypatch):
    system, original = moving(PAIRS["tree"]), c.right_side
    q, v = system["q0"], system["v0"]
    monkeypatch.setattr(c, "right_side", lambda *terms: original(*terms[:-1], 0.0 * terms[-1]))
    monkeypatch.setattr(c, "external_force", lambda *_: [0.0, -9.0, 0.0])  # a list will do
    after, g = c.make_force(system, 0.0)(q, v), np.array([0.0, -9.0, 0.0])
    monkeypatch.setattr(c, "external_force", lambda *_: g)
    assert_close(after, g + c.constraint_force(system, q, v, 0.0))
    monkeypatch.undo()
    assert np.abs(after - c.make_force(system, 0.0)(q, v)).max() > 1.0


@pytest.mark.parametrize("mode", ["none", "soft"])
@pytest.mark.parametrize("name", ["chain of 41", "loops"])
def test_what_tensions_leave_unanswered_is_measured_alike(name, mode, monkeypatch):
    """Tensions nine tenths of what they should be leave a tenth, whichever way they are found."""
    system = moving(PAIRS[name], 0.001)
    large_one, small = (c.make_force(system, mode, plain) for plain in (False, True))
    for owner, solver in ((c, "solve"), (type(large_one.rods), "multipliers")):
        exact = getattr(owner, solver)
        monkeypatch.setattr(owner, solver, lambda *terms, exact=exact: 0.9 * exact(*terms))
    left = large_one.unheld(system["q0"], system["v0"])
    assert left > 0.1
    assert_close(left, small.unheld(system["q0"], system["v0"]))
