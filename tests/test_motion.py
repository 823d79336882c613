"""The motion: the chapter's numbers, orders and limits; and the ruler, by foreign references."""

import json
import math
from argparse import ArgumentTypeError
from functools import partial
from itertools import product
from types import SimpleNamespace

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import drift, energy_scale, make_system, run
from curriculum.common import aim, ruler, rules
from curriculum.common.compiled import Compiled
from curriculum.common.gauss import make_gauss
from curriculum.common.ruler import true_position
from curriculum.common.runs import distance
from curriculum.common.tape import Untraceable

import numpy as np
import pytest
from conftest import feel, held, true_run

EXACT = make_gauss(8, tol=1e-16)  # as rounding allows: the rule's own error is left
REFERENCE = json.loads((c.HERE / c.CHAPTER / "studies/reference.json").read_text(encoding="utf-8"))


def measured(name, rule, dt, until=5.0, mode="project", way=Compiled):
    """The largest distance of a particle from the reference up to `until`, in m; and the Run."""
    keep = [round(t / dt) for t in REFERENCE["times"] if t <= until]
    found = run(c.build_system(name), rule, mode, dt, keep[-1], keep, way)
    assert not found.stopped
    truth = np.array(REFERENCE["cases"][name]["positions"])[: len(keep)]
    return np.linalg.norm(found.q[..., :2] - truth, axis=-1).max(), found


def test_the_published_script_finds_the_same_digits_of_the_worst_rod_error():
    double = {"none": "0.384014620396", "baumgarte": "0.023470285993"}
    for name, published in {"double": double, "triple": {"none": "0.403663129450"}}.items():
        worst = {mode: run(c.build_system(name), hold=mode).violations.max() for mode in published}
        assert {mode: f"{x:.12f}" for mode, x in worst.items()} == published


def test_a_generator_is_as_good_as_a_seed():
    drawn, seeded = (c.build_system("double", x)["q0"] for x in (np.random.default_rng(1), 1))
    assert np.array_equal(drawn, seeded)


LADDERS = [  # the longest step of each, in s, is halved twice; then what the order lies between
    ("euler", "none", 0.001, 0.9, 1.2),
    ("semi_implicit", "none", 0.001, 0.9, 1.1),
    ("semi_implicit", "project", 0.001, 0.9, 1.1),
    ("rk4", "none", 0.005, 3.9, 4.6),
    ("rk4", "project", 0.0025, 3.9, 4.6),
    ("midpoint", "none", 0.05, 7.3, 8.1),
    ("midpoint:2", "none", 0.0125, 1.6, 2.4),
    ("midpoint:6", "none", 0.05, 5.6, 6.4),
    (make_gauss(1, tol=1e-16), "none", 0.005, 1.6, 2.4),
    ("gauss:2", "none", 0.0125, 3.6, 4.4),
    ("gauss:3:1e-16", "none", 0.025, 5.6, 6.4),
]


@pytest.mark.parametrize(("rule", "mode", "dt", "low", "high"), LADDERS)
def test_halving_the_step_shows_the_order(rule, mode, dt, low, high):
    """Of the distance from where angles put the particles, which know of no rods."""
    asked = partial(measured, "double", rule, mode=mode, way=ruler.once_for_all(Compiled))
    errors = [asked(step, 2.0)[0] for step in (dt, dt / 2, dt / 4)]
    found = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (low < found).all() and (found < high).all(), found


def test_semi_implicit_with_project_keeps_rods_their_rates_and_energy_without_a_trend():
    """100 s: within 6e-3, no slope beyond the noise of block means, half at half the step."""
    system, worst = c.build_system("double"), []
    for dt in (0.005, 0.0025):
        found = run(system, hold="project", dt=dt, steps=round(100 / dt))
        assert found.violations.max() < 1e-10 and not found.halved
        assert np.abs(c.constraint_terms(system, found.q[-1], found.v[-1])[2]).max() < 1e-10
        worst.append(drift(system, found))
        error = found.energies[1:] / energy_scale(system)
        blocks = error.reshape(20, -1).mean(axis=1)  # 5 s each: their scatter is the noise
        (slope, _), spread = np.polyfit(np.arange(20), blocks, 1, cov=True)
        assert abs(slope) < 3.0 * np.sqrt(spread[0, 0])
    assert worst[0] < 6e-3 and 0.4 < worst[1] / worst[0] < 0.6
    for rule, dt in (("semi_implicit", 0.05), ("rk4", 0.1)):  # from so far it finds back
        found = run(system, rule, "project", dt, 200)
        assert found.violations.max() < 1e-10 and not found.stopped and not found.halved


@pytest.mark.parametrize("rule", c.STABILITY_LIMIT)
def test_baumgarte_holds_up_to_the_stability_limit(rule):
    """At rest, the rod 1e-9 m too long: below dt w = limit the error dies, above it grows."""
    hanging = make_system([[0.0, -1.0 - 1e-9, 0.0]], [[0.0, 0.0, 0.0]], [1.0], [(0, -1)], [1.0])
    for share in (0.999, 1.001):
        found = run(hanging, rule, share * c.STABILITY_LIMIT[rule] / 0.005, 0.005, 20000)
        assert (found.violations[-1] < 1e-9) == (share < 1.0)


# --- the ruler ---
TRUE = [*product(REFERENCE["cases"], ["project"]), ("double", "none")]


@pytest.mark.parametrize(("name", "mode"), TRUE)
def test_gauss_is_true_to_a_trillionth_of_a_metre(name, mode):
    error, found = measured(name, EXACT, 0.025, mode=mode)
    assert error < 1e-12 and found.halved == 0


@pytest.mark.parametrize(("name", "mode"), [("double", "project"), ("triple", "none")])
def test_a_step_too_long_for_its_stages_is_taken_in_halves_if_that_helps(name, mode):
    error, found = measured(name, "gauss", 0.25, mode=mode)
    assert error < 1e-4 and 0 < found.halved < len(found.tip) - 1
    assert found.violations.max() < 1e-4
    hopeless = held(name, mode)("gauss", 100.0, 20).stopped
    assert hopeless.startswith("stopped at step 1: the Gauss stages do not ")
    few, enough = (held("pendulum", "none")(rule, 0.5, 2).halved for rule in ("gauss:5", "gauss:6"))
    assert few == 0 < enough  # with six stages the last terms tell


def test_the_ruler_knows_a_place_by_odd_numbers_of_steps():
    truth, known = true_position(true_run("double"), 2.0)
    reference = np.array(REFERENCE["cases"]["double"]["positions"])[REFERENCE["times"].index(2.0)]
    assert distance(truth[:, :2], reference) < 1e-12 and known < 1e-11
    assert true_position(true_run("triple"), 8.0)[1] < 1e-9
    for seconds in (0.01, 0.1):
        counts = np.array(ruler.rungs(seconds))
        assert np.diff(counts).min() > 0 and np.all(counts % 2)
    assert max(ruler.rungs(100.0)) <= ruler.MOST + 1 and not ruler.rungs(1e4)


LONG = make_system([[1e9, 0.0, 0.0]], np.zeros((1, 3)), [1.0], [(0, -1)])
PAIR = np.array([[1e8, 0.0, 0.0], [1e8 + 1.0, 0.0, 0.0]])  # far away
FAR = make_system(PAIR, [[0.0, 0.0, 0.0], [0.0, 1e-7, 0.0]], [1.0, 1.0], [(0, 1)])


@pytest.mark.parametrize(("name", "dt"), [("heavy_tip", 0.002), ("spin", 0.001)])
def test_a_place_is_known_where_rods_buzz_and_spin_and_another_rule_finds_it(name, dt):
    q, known = true_position(true_run(name), 2.0)
    other = held(name, "project")(EXACT, dt, round(2.0 / dt))
    assert known < 1e-9 and distance(other.q[-1], q) < 2e-12 and other.halved == 0


def test_what_is_known_is_not_sought_further_than_it_helps():
    """Steps become finer until two are near enough, and no more where rounding parts them."""
    tried = []

    def run_to(*gaps):  # the places that ever finer steps find are so far from one to the next
        places = np.cumsum([0.0, *gaps])
        tried.clear()

        def run(dt, steps, nudge=False):
            if not nudge:
                tried.append(dt)
            number = tried.index(dt)
            return SimpleNamespace(q=np.full((1, 1, 3), places[number]), stopped=None)

        return true_position(run, 2.0, 1e-11)

    _, falling = run_to(1e-3, 1e-6, 1e-9, 1e-12, 1.0)
    assert falling == pytest.approx(3**0.5 * 5e-11, rel=1e-3) and len(tried) == 6
    _, rounded = run_to(1e-3, 1e-6, 1e-9, 1e-12, 1e-12, 1.0)
    assert rounded == pytest.approx(3**0.5 * 3e-12, rel=1e-3) and len(tried) == 6
    by_chance = run_to(1e-4, 3e-7, 1e-12, 1e-7, *[3e-8] * 6)
    assert by_chance == (None, math.inf) and len(tried) == len(ruler.LADDER)
    exact, starts = {"gauss:12": make_gauss(12, tol=1e-16)}, [held("triple", "none")]
    for tol, known in ((None, 1e-11), (1e-12, 1e-12)):  # a small error wants a truth that is better
        plan = aim.settle(true_run("triple"), starts, exact, 0.01, 200, tol)
        assert plan.truth.uncertainty < known
    many = [1e-8] * len(ruler.LADDER)
    assert run_to(*many) == (None, math.inf) and len(tried) == len(ruler.LADDER)


WILD = make_system([[1.0, 0.0, 0.0]], [[0.0, 1e5, 0.0]], [1.0], [(0, -1)])
UNKNOWN = [("triple", 20.0), (WILD, 0.02), ("peaucellier", 2.0), (LONG, 2.0), (FAR, 2.0)]


@pytest.mark.parametrize(("system", "seconds"), UNKNOWN)
def test_a_place_that_is_not_known_to_a_nanometre_is_not_known(system, seconds):
    """Of what is chaotic or too fast no two steps agree; and two may agree where the numbers they
    begin with have no such digits."""
    assert true_position(true_run(system), seconds) == (None, math.inf)


def test_behind_a_kink_of_the_force_it_is_known_how_well_a_place_is_known(monkeypatch):
    """Steps gain little there, and now and then two meet by chance."""
    for drag in np.geomspace(0.05, 0.3, 12)[[2, 8, 9]]:  # with others a careless doubt is right
        feel(monkeypatch, lambda q, v, drag=drag: -drag * np.abs(v) * v)
        q, known = true_position(true_run("pendulum"), 2.0)
        other = held("pendulum", "project")("rk4", 1e-4, 20_000)
        assert known < 1e-9 and distance(q, other.q[-1]) < 3.0 * known + 1e-12


def test_of_a_force_that_is_another_each_time_no_truth_is_sought(monkeypatch):
    """It would not be found, and looking for it takes minutes without compiled steps."""
    calls = []
    feel(monkeypatch, lambda q, v: calls.append(1) or 1e-6 * len(calls) * c.GRAVITY)
    plan = aim.settle(true_run("double"), [], {"rk4": c.rk4_step}, 0.01, 10, None)
    assert plan.truth.q is None and len(calls) < 100
    assert plan.truth.unsought.endswith("not compiled: it changes the list calls")
    feel(monkeypatch, lambda q, v: -v if q.dtype == float else 0.0 * q)  # not so when it is traced
    with pytest.raises(Untraceable, match="something else when it is compiled"):
        true_position(true_run("double"), 0.1)


def test_a_bob_between_two_long_rods_moves_as_a_pendulum_of_their_sag():
    bob, v = [15000.0, -1.0, 0.0], [[0.0, 0.0, 7.5]]
    anchors = [[0.0, 0.0, 0.0], [30000.0, 0.0, 0.0]]
    taut = make_system([bob], v, [1.0], [(0, -1), (0, -2)], None, anchors)
    short = make_system([[0.0, -1.0, 0.0]], v, [1.0], [(0, -1)])
    (q, known), (expected, _) = (true_position(true_run(x), 2.0) for x in (taut, short))
    assert known < 2e-11 and np.abs(q - expected - [15000.0, 0.0, 0.0]).max() < 1e-11


@pytest.mark.parametrize(("steps", "dt", "at"), [(2001, 0.001, 2000), (300, 0.005, 300)])
def test_what_is_settled_covers_what_was_asked_for(steps, dt, at):
    """As many steps; a truth after 2 s or at the end; for an error, a step twice as large fails."""
    true, run_of = true_run("double"), held("double", "none")
    plan = aim.settle(true, [], {"rk4": c.rk4_step}, dt, steps, None)
    assert plan[:3] == ("rk4", dt, steps)
    assert plan.truth.step == at and plan.truth.uncertainty < 1e-9
    offered = rules.offered("gauss:6", c.INTEGRATORS, 1e-9)
    name, found, count, truth = aim.settle(true, [run_of], offered, dt, steps, 1e-9)
    assert found > dt and 0.0 <= count * found - steps * dt < found
    assert truth.step * found == pytest.approx(at * dt, abs=0.5 * found)
    ends = [run_of(offered[name], h, round(at * dt / h)) for h in (found, 2.0 * found)]
    near, far = (distance(end.q[-1], truth.q) for end in ends)
    assert near <= 1e-9 and (far > 1e-9 or ends[1].halved)


def test_a_rule_that_is_compiled_once_feels_the_hold_of_each_length_of_step():
    """soft is no stiffer than its steps allow. A number of a Hold may be an array, one a rod."""
    by_rods = c.Hold(1.0, np.array([20.0, 30.0]), np.array([100.0, 200.0]), 0.0)
    for hold in ("soft", by_rods):
        way, asked = ruler.once_for_all(Compiled), held("double", hold)
        for dt in (0.04, 0.02, 0.04):
            ends = [asked(c.rk4_step, dt, 20, way=each).q for each in (way, Compiled)]
            assert np.array_equal(*ends)
    system, way, ends = c.build_system("double"), ruler.once_for_all(Compiled), []
    for each, dt in ((way, 0.02), (way, 0.04), (Compiled, 0.04)):
        soft = c.make_force(system, c.hold_table(dt)["soft"])
        own = partial(lambda force, q, v: force(q, v), soft)  # which has no hold
        ends.append(c.simulate(c.rk4_step, system, own, dt, 20, way=each).tip)
    assert np.array_equal(*ends[1:])


def test_an_error_is_reached_by_the_rule_that_asks_for_the_fewest_forces():
    """midpoint: (order / 2)^2 + 1 of them a step; those of gauss are counted at states of a run."""
    asked, found = held("double", "none"), {}

    def once(rule, dt, steps, keep=(), way=Compiled):
        key = rule, dt, steps, keep
        if key not in found:
            found[key] = asked(rule, dt, steps, keep, way)
        return found[key]

    runs, costs = [once], {}
    q, _ = true_position(true_run("double"), 2.0)
    for order in (4, 8, 12):
        rule = rules.named(f"midpoint:{order}", c.INTEGRATORS)
        error, dt, (reached, states) = aim.climb(1e-7, 2.0, q, runs, rule)
        forces = aim.cost(reached, rule, dt, states)
        assert error <= 1e-7 and forces == (order / 2) ** 2 + 1
        costs[f"midpoint:{order}"] = forces / dt
    table = {name: rules.named(name, c.INTEGRATORS) for name in costs}
    for names in (list(table), list(table)[::-1]):
        name, dt = aim.step_for(1e-7, 2.0, q, runs, {name: table[name] for name in names})
        assert name == min(costs, key=costs.get) not in ("midpoint:4", "midpoint:12")
    rule = rules.named("gauss:6:1e-8", c.INTEGRATORS)  # longer steps are near enough, in halves
    _, dt, _ = aim.climb(1e-6, 2.0, q, runs, rule)
    assert dt < 0.15 and not runs[0](rule, dt, round(2.0 / dt)).halved
    loose, strict = (rules.named(f"gauss:6:{tol}", c.INTEGRATORS) for tol in ("1e-4", "1e-12"))
    few, many = (aim.cost(runs[0], rule, 0.02, [(q, 0.0 * q)]) for rule in (loose, strict))
    assert few < many and few % 6 == many % 6 == 0  # one a stage in every round


def sought(place, shown, dt, system="double"):
    """The true motion that is found, and [(s, how many)] of the steps that were asked for, where
    steps of so many s have a particle at x = place(s, times)."""
    asked = []

    def run(step, steps, keep):
        asked.append((step, steps))
        q = np.zeros((len(keep), 1, 3))
        q[:, 0, 0] = place(step, step * keep)
        return SimpleNamespace(q=q, kept=keep)

    system = c.build_system(system) if isinstance(system, str) else system
    return ruler.true_motion(run, system, dt, shown, ruler.Truth(0)), asked


def test_a_motion_is_shown_no_further_than_where_two_steps_part():
    """Though later they may meet again, by chance."""

    def place(step, times):
        return 100.0 * step * (times > 2.5) * (times < 8.5)

    found, _ = sought(place, np.arange(20), 1.0)
    assert len(found) == 3


def test_where_two_steps_agree_to_the_end_no_third_is_tried():
    """Though the coarse one has few of the frames, and not the last."""
    for frames in (17, 18, 19, 20):
        found, asked = sought(lambda step, times: times, np.arange(frames), ruler.FIRST)
        assert len(found) == frames and len(asked) == 2


def test_of_frames_that_are_long_the_last_are_compared_too():
    def place(step, times):
        return 100.0 * step * (times > 5.5 * many * ruler.FIRST)

    for many in (4, 5, 60):  # parts of a frame, to begin with
        found, _ = sought(place, np.arange(8), many * ruler.FIRST)
        assert len(found) == 6


def test_halves_that_agree_with_steps_half_as_long_are_no_proof():
    def place(step, times):  # what is longer is taken in halves, and these in halves again
        while step > 0.1 * ruler.FIRST:
            step *= 0.5
        return 100.0 * step * (times > 2.5 * ruler.FIRST)

    for many in (1, 2):  # parts of a frame, to begin with
        found, _ = sought(place, np.arange(6), many * ruler.FIRST)
        assert len(found) == math.ceil(2.6 / many)


def test_finer_steps_are_tried_while_they_gain_something_and_do_not_take_too_long():
    def tried(links, gain):
        def place(step, times):  # the longer they are, the sooner they part
            return (times > 0.01 * (round(20 * (0.01 / step) ** gain) - 0.5)) / step

        system = c.build_system("chain", links=links)
        found, asked = sought(place, np.arange(2001), 0.01, system)
        return len(found), sorted({step for step, _ in asked})[::-1], max(x for _, x in asked)

    known, lengths, _ = tried(2, gain=1.0)
    assert lengths[-1] < ruler.FINEST <= lengths[-2] and known == round(20 * 0.01 / lengths[-2])
    known, lengths, most = tried(30, gain=1.0)
    assert lengths[-1] > ruler.FINEST and 30 * most <= ruler.BUDGET
    assert known > 20
    _, lengths, _ = tried(2, gain=0.05)
    assert len(lengths) == 4  # the last gains nothing


def test_a_motion_is_sought_no_more_than_twice_as_far_as_it_is_known():
    """Frames of a long run that lie far apart, too, are where they were."""
    dt, known = ruler.FIRST, 1200  # steps
    shown = np.concatenate([np.arange(1500), np.arange(1500, 100_000, 250)])

    def place(step, times):
        return np.where(times > known * dt, 1.0 / step, times)

    found, asked = sought(place, shown, dt, "pendulum")
    assert np.allclose(found[:, 0, 0], dt * shown[: known + 1])
    seconds = [step * steps for step, steps in asked]
    assert ruler.HORIZON - 4.0 * dt < min(seconds) <= ruler.HORIZON
    assert ruler.HORIZON < max(seconds) <= 2.0 * known * dt


def test_a_start_alone_is_no_true_motion():
    drawn = np.random.default_rng(0)

    def place(step, times):  # no two agree, but in the start
        return drawn.normal(size=len(times)) * (times > 0.0)

    found, _ = sought(place, np.arange(0, 40, 10), 0.01, "pendulum")
    assert not found.size


def ending(far):
    """A run whose particle ends far(dt) m from where it should; if that is NaN, it has stopped."""

    def run(rule, dt, steps, keep, way):
        ends = np.zeros((2, 1, 3))
        ends[-1, 0, 0] = far(dt)
        return SimpleNamespace(stopped=math.isnan(far(dt)), q=ends, v=ends)

    return run


def test_where_no_mode_gets_through_no_step_is_chosen():
    lost = ending(lambda dt: math.nan)
    with pytest.raises(ArgumentTypeError, match="no mode gets through 2 s whole, in steps of"):
        aim.step_for(1e-6, 2.0, np.zeros((1, 3)), [lost, lost], {"gauss:6": None})


def test_a_slow_rule_is_followed_as_long_as_half_the_step_gains_something():
    def slow(dt):  # of order 1.2: half as long is less than half as wrong
        return dt**1.2

    error, dt, reached = aim.climb(1e-4, 2.0, np.zeros((1, 3)), [ending(slow)], None)
    assert reached and slow(dt) == error <= 1e-4
    biased = ending(lambda dt: 0.1)  # it is soon as near as it gets
    stalled = ending(lambda dt: 1e-3)  # nearer at first, and no nearer then
    rough = ending(lambda dt: slow(dt) + 3.0 * (dt > 0.05))  # lost at first
    lucky = ending(lambda dt: slow(dt) * (0.1 if 0.004 < dt < 0.005 else 1.0))  # once by chance
    failing = ending(lambda dt: math.nan if 0.003 < dt < 0.005 else slow(dt))  # at some steps
    for other, late in ((biased, rough), (stalled, lucky), (stalled, failing)):
        error, _, reached = aim.climb(1e-4, 2.0, np.zeros((1, 3)), [other, late], None)
        assert error <= 1e-4 and reached[0] is late
