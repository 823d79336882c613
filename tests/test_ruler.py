"""The ruler: gauss against high-precision references that share neither its form nor its rule."""

import json
import math
from functools import partial
from itertools import product

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import run
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import collocation, make_gauss
from curriculum.common.ruler import settle, step_for, true_position
from curriculum.common.runs import distance

import numpy as np
import pytest
from numpy.polynomial import legendre

EXACT = make_gauss(8, tol=1e-16)  # as rounding allows: the rule's own error is left
REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def measured(name, rule, dt, until=5.0, mode="project"):
    """The largest distance of a particle from the reference up to `until`, in m; and the Run."""
    keep = [round(t / dt) for t in REFERENCE["times"] if t <= until]
    found = run(c.build_system(name), rule, mode, dt, keep[-1], keep)
    assert not found.stopped
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(keep)]
    return np.linalg.norm(found.q[..., :2] - truth, axis=-1).max(), found


def asked(name, mode, rule, dt, steps, way=Compiled):
    """A Run of a chapter scene, as the ruler asks for it."""
    return run(c.build_system(name), rule, mode, dt, steps, way=way)


TRUE = [*product(REFERENCE["cases"], ["project"]), ("double", "none"), ("triple", "none")]


@pytest.mark.parametrize(("name", "mode"), TRUE)
def test_gauss_is_true_to_a_trillionth_of_a_metre(name, mode):
    error, found = measured(name, EXACT, 0.025, mode=mode)
    assert error < 1e-12 and found.halved == 0


@pytest.mark.parametrize("stages", [1, 2, 5, 8, 12])
def test_collocation_integrates_every_polynomial_it_claims_to(stages):
    """t^p to the nodes, once and twice; over a step up to 2 * stages - 1; and its last terms."""
    nodes, weights, once, twice, last = collocation(stages)
    p, t = np.arange(2 * stages), nodes[:, None]
    assert np.abs(weights @ t**p - 1.0 / (p + 1)).max() < 1e-15
    p = p[:stages]
    assert np.abs(once @ t**p - t ** (p + 1) / (p + 1)).max() < 1e-15
    p = p[: stages - 1]
    found = twice @ t**p - t ** (p + 2) / ((p + 1) * (p + 2))
    assert np.abs(found).max(initial=0.0) < 1e-15
    terms = last @ legendre.legvander(2.0 * nodes - 1.0, stages - 1)
    assert np.abs(terms - np.eye(stages)[-2:]).max() < 1e-14


@pytest.mark.parametrize(("stages", "dt"), [(1, 0.01), (2, 0.025), (3, 0.05), (4, 0.0625)])
def test_order_is_twice_the_stages(stages, dt):
    rule = make_gauss(stages, tol=1e-16)
    long, short = (measured("double", rule, h, 1.0, "none")[0] for h in (dt / 2, dt / 4))
    assert abs(math.log2(long / short) - 2 * stages) < 0.4


@pytest.mark.parametrize(("name", "mode"), [("double", "project"), ("triple", "none")])
def test_a_step_too_long_for_its_stages_is_taken_in_halves_if_that_helps(name, mode):
    error, found = measured(name, "gauss", 0.25, mode=mode)
    assert error < 1e-4 and 0 < found.halved < len(found.tip) - 1
    assert found.violations.max() < 1e-4
    hopeless = asked(name, mode, "gauss", 100.0, 20).stopped
    assert hopeless.startswith("stopped at step 1: the Gauss stages do not ")


def test_the_ruler_knows_a_place_to_a_nanometre_or_not_at_all():
    """Chaos decides: after 20 s no two of its steps are so near each other.

    Its budget counts whole steps before they are begun, those of halves as they come.
    """
    taken, unknown = [], (None, math.inf)

    def counted(name, rule, dt, steps, way):
        taken.append(steps)
        return asked(name, "project", rule, dt, steps, way)

    double, triple = partial(counted, "double"), partial(counted, "triple")
    assert true_position(double, 2.0, 119) == unknown and not taken
    truth, known = true_position(double, 2.0, 120)
    reference = np.array(REFERENCE["cases"]["double"]["positions"])[REFERENCE["times"].index(2.0)]
    assert distance(truth[:, :2], reference) < 1e-12 and known < 1e-11 and taken == [40, 80]
    assert true_position(triple, 8.0)[1] < 1e-9
    for budget, most in ((1700, 800), (math.inf, 3200)):
        assert true_position(triple, 20.0, budget) == unknown and taken[-1] == most


@pytest.mark.parametrize("tol", [1e-6, 1e-9])
def test_the_step_for_an_error_is_the_largest_that_will_do(tol):
    truth, _ = true_position(partial(asked, "double", "project"), 2.0)
    rule, dt = step_for(tol, 2.0, truth, [partial(asked, "double", "none")])
    ends = [asked("double", "none", rule, h, round(2.0 / h)).q[-1] for h in (dt, 2.0 * dt)]
    assert distance(ends[0], truth) <= tol < distance(ends[1], truth)


@pytest.mark.parametrize(("steps", "dt", "at"), [(2001, 0.001, 2000), (300, 0.005, 300)])
def test_what_is_settled_covers_what_was_asked_for(steps, dt, at):
    """As many steps as asked; the truth is that of a step, after 2 s or at the end."""
    runs = [partial(asked, "double", mode) for mode in ("project", "none")]
    rule, found, count, truth = settle(runs, c.rk4_step, dt, steps, None, 5000)
    assert (rule, found, count, truth.step) == (c.rk4_step, dt, steps, at)
    assert truth.known < 1e-9
    _, found, count, truth = settle(runs, c.INTEGRATORS["gauss"], dt, steps, 1e-6, 5000)
    assert found > dt and 0.0 <= count * found - steps * dt < found
    assert truth.step * found == pytest.approx(at * dt, abs=0.5 * found)
