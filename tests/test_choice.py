"""Which method, at which step: the answer is right, and the next cheaper one is not."""

import json
import textwrap
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BARE, ROOT
from independent import motion

import constraints as c
from curriculum.ch3_4_constraints.mechanics import choice, systems
from curriculum.ch3_4_constraints.mechanics.reference import Reference
from curriculum.ch3_4_constraints.results import advice
from curriculum.common import cli
from curriculum.common.gauss import make_gauss
from curriculum.common.tracing import counting, llvm, vmap, while_loop
from curriculum.common.tracing.steps import nonzero
from curriculum.common.tracing.trace import trace_loop

KNOBS = {"baumgarte": 20.0, "time_constant": 0.02}
REFERENCE = json.loads((ROOT / "tests/reference.json").read_text(encoding="utf-8"))
TRIED = tuple(c.make_methods())


def choose(system, within, steps=800, dt=0.005, chapter=c):
    args = SimpleNamespace(within=within, dt=dt, steps=steps, knobs=KNOBS)
    return choice.choose(chapter, system, args)


@pytest.fixture(scope="module")
def double():
    """The Choice for 4 s of the double pendulum, right to a millimetre."""
    return choose(c.build_system("double"), 1e-3)


def loaded():
    """A four-bar of 0.3 m with a bob on its coupler, which a force pulls sideways."""
    left = np.array([0.05, -0.0866025403784, 0.0])
    right = np.array([0.3, -0.2, 0.0])
    bob = np.array([0.2, -0.35, 0.0])
    anchors = np.array([[0.0, 0.0, 0.0], [0.3, 0.05, 0.0]])
    ends = [(left, anchors[0]), (right, anchors[1]), (right, left), (bob, left), (bob, right)]
    rows = {
        "q0": np.array([left, right, bob]),
        "v0": np.zeros((3, 3)),
        "m": np.array([[0.2], [0.3], [0.5]]),
        "pairs": [(0, -1), (1, -2), (1, 0), (2, 0), (2, 1)],
        "lengths": [np.linalg.norm(one - other) for one, other in ends],
        "anchors": anchors,
        "load": np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [4.0, 1.0, 0.0]]),
    }
    return systems.check_system(rows, c.PIVOT, fit=1e-9)


def off(system, x, known, seconds):
    """How far a setting ends from what is known after so many seconds, and its worst rod till
    then, in m, as run by itself."""
    run = c.run_method(system, x.method, x.integrator, x.dt, round(seconds / x.dt), **KNOBS)
    if len(run.q) <= round(seconds / x.dt):
        return np.inf, np.inf
    return np.linalg.norm(run.q[-1] - known, axis=1).max(), run.violations.max()


def next_cheaper(found, x):
    """The setting of the same pair that takes a little less work, or None if there is none."""
    pair = [y for y in found.settings if (y.integrator, y.method) == (x.integrator, x.method)]
    less = [y for y in pair if y.operations < x.operations]
    return max(less, key=lambda y: y.operations, default=None)


def is_cheapest(system, x, cheaper, known, seconds, within):
    """Whether x puts every place right, and the setting that is cheaper does not.

    If x holds the rods, too, a setting that does not hold them is no match for it.
    """
    place, rods = off(system, x, known, seconds)
    if cheaper is None or cheaper.lost:
        return place <= within
    other_place, other_rods = off(system, cheaper, known, seconds)
    return place <= within and (other_place > within or other_rods > within >= rods)


# --- the answer ---
@pytest.mark.parametrize("within", [1e-2, 1e-3, 1e-6])
def test_what_is_chosen_for_places_is_right_beside_joint_angles_and_longer_steps_are_not(within):
    system = c.build_system("double")
    found = choose(system, within, steps=400)
    known = np.zeros((2, 3))
    place = REFERENCE["times"].index(found.error_at)
    known[:, :2] = REFERENCE["cases"]["double"]["positions"][place]
    assert found.error_at == 2.0 and found.places
    for x in found.places:
        cheaper = next_cheaper(found, x)  # gauss takes steps that are too long in parts
        assert cheaper is not None or x.integrator == "gauss"
        assert is_cheapest(system, x, cheaper, known, 2.0, within)


def test_in_a_loop_under_a_load_what_is_chosen_is_right_beside_an_independent_motion():
    system = loaded()
    found = choose(system, 1e-4, steps=100)
    known = motion(system, found.error_at)
    assert found.error_at == 0.5 and {x.method for x in found.places} > {"project"}
    for x in found.places:
        cheaper = next_cheaper(found, x)
        assert cheaper is not None
        assert is_cheapest(system, x, cheaper, known, 0.5, 1e-4)
    for x in found.rods_hold:
        cheaper = next_cheaper(found, x)
        assert off(system, x, known, 0.5)[1] <= 1e-4
        assert cheaper is None or cheaper.lost or off(system, cheaper, known, 0.5)[1] > 1e-4


def test_rods_are_held_for_the_whole_run_not_only_as_long_as_places_are_compared(double):
    """rk4 with none has right places at 2 s, but its rods drift until 4 s."""
    system = c.build_system("double")
    (x,) = [x for x in double.settings if (x.integrator, x.method, x.dt) == ("rk4", "none", 0.02)]
    run = c.run_method(system, "none", "rk4", 0.02, 200)
    assert x.rods == pytest.approx(run.violations.max(), rel=1e-5)
    assert run.violations[:101].max() < 0.9 * x.rods
    m_g_L = 2.0 * 9.81 * 2.0
    assert x.energy == pytest.approx(np.abs(run.energies - run.energies[0]).max() / m_g_L, rel=1e-5)
    assert double.span == 4.0


def test_rods_are_the_worst_of_all_states_and_energy_the_largest_change(double):
    system = c.build_system("double")
    rows = [x for x in double.settings if (x.integrator, x.dt) == ("semi_implicit", 0.005)]
    better_at_the_end = []
    for x in rows:
        run = c.run_method(system, x.method, x.integrator, x.dt, 800, **KNOBS)
        assert x.rods == pytest.approx(run.violations.max(), rel=1e-5, abs=1e-15)
        change = np.abs(run.energies - run.energies[0]).max() / (2.0 * 9.81 * 2.0)
        assert x.energy == pytest.approx(change, rel=1e-5)
        if run.violations[-1] < 0.5 * x.rods:
            better_at_the_end.append(x.method)
    assert {"impulse", "soft"} <= {*better_at_the_end} and len(rows) == len(TRIED)


def test_all_methods_are_tried_under_integrators_of_different_orders(double):
    tried = {(x.integrator, x.method) for x in double.settings}
    integrators = {integrator for integrator, _ in tried}
    assert {"semi_implicit", "rk4"} <= integrators
    assert tried == set(choice.pairs_of(c, integrators))
    assert {method for _, method in tried} == {*TRIED}


def test_what_swings_a_spring_ever_wider_is_left_out_if_another_costs_as_much_and_does_not():
    def heun_step(q, v, m, force, dt):
        q_next, v_next = c.euler_step(q, v, m, force, dt)
        a = force(q, v) / m
        return q + 0.5 * dt * (v + v_next), v + 0.5 * dt * (a + force(q_next, v_next) / m)

    named = {"semi": c.semi_implicit_step, "other": c.euler_step, "rk4": c.rk4_step}
    midpoint = make_gauss(1)
    assert choice.worth_trying(named) == (["semi", "rk4"], [])
    del named["semi"]
    named |= {"heun": heun_step, "midpoint": midpoint}
    assert choice.worth_trying(named) == (["other", "rk4", "heun"], ["midpoint"])


def test_gauss_is_tried_where_nothing_else_is_right_and_else_it_is_said_that_it_was_not(double):
    assert "gauss" in double.untried
    tight = choose(c.build_system("double"), 1e-11, steps=100)
    assert tight.places[0].integrator == "gauss" and not tight.untried
    assert tight.places[0].error <= 1e-11


def test_a_short_time_is_the_least_of_some_and_a_long_one_is_taken_as_it_is():
    class Run:
        def __init__(self, first, *others):
            self.seconds = first
            self.left = iter(others)

        def __call__(self, *_):
            self.seconds = next(self.left)

    def least(*times):
        return choice.least_time(SimpleNamespace(start=None, run=Run(*times)), 10, 0.1)

    assert least(1e-3, 4e-4, 9e-4, 8e-4) == 4e-4
    assert least(1.0, 0.5, 0.5, 0.5) == 1.0


# --- luck, ties, and what counts ---
def setting(dt, error=0.0, rods=0.0, operations=None, lost=None, names=("rk4", "none")):
    operations = 1.0 / dt if operations is None else operations
    return choice.Setting(*names, dt, rods, 0.0, error, operations, 0.0, lost)


def test_a_step_that_is_right_by_luck_does_not_win():
    errors = {0.04: 0.5, 0.02: 1e-5, 0.01: 0.3, 0.005: 9e-4, 0.0025: 1e-4}
    pair = [setting(dt, error) for dt, error in errors.items()]
    assert choice.reached(pair, {"error": 1e-3}).dt == 0.005
    assert choice.reached(pair[:3], {"error": 1e-3}) is None
    assert choice.reached(pair[:4], {"error": 1e-3}) is None  # nothing shows that this is not luck


def test_a_step_between_right_ones_that_is_not_right_shows_that_longer_ones_are_luck():
    errors = {0.04: 1e-4, 0.02: 1e-4, 0.01: 0.3, 0.005: 1e-4, 0.0025: 1e-5}
    pair = [setting(dt, error) for dt, error in errors.items()]
    assert choice.reached(pair, {"error": 1e-3}).dt == 0.005
    pair[-1] = pair[-1]._replace(lost="at 3 s: diverged")
    assert choice.reached(pair, {"error": 1e-3}) is None


def test_what_loses_its_rods_later_takes_a_shorter_step_or_is_not_right():
    """Cheaper, and right as long as the motion is known; but not for the whole run."""
    drifting = [setting(dt, 1e-4, 0.02, names=("rk4", "none")) for dt in (0.04, 0.02, 0.01)]
    worst = {0.02: 5e-3, 0.01: 5e-4, 0.005: 5e-5}
    better = [setting(dt, 1e-4, x, names=("rk4", "baumgarte")) for dt, x in worst.items()]
    held = [setting(dt, 1e-4, 0.0, names=("rk4", "project")) for dt in (0.005, 0.0025)]
    found = choice.chosen(drifting + better + held, "error", 1e-3)
    assert [(x.method, x.dt) for x in found] == [("baumgarte", 0.01), ("project", 0.005)]
    assert [x.method for x in choice.chosen(drifting + held, "rods", 1e-3)] == ["project"]


@pytest.mark.parametrize("key", ["error", "rods"])
def test_a_stricter_tolerance_never_gives_a_longer_step(double, key):
    """Not even where places are right in long steps, whose rods drift."""
    drifts = [setting(dt, 1e-9, dt**2, names=("rk4", "drifts")) for dt in (0.04, 0.02, 0.01)]
    steps = {}
    taken = set()
    for power in np.arange(-1.0, -9.0, -0.25):
        now = choice.chosen(double.settings + drifts, key, 10.0**power)
        found = {(x.integrator, x.method): x.dt for x in now}
        for pair, dt in found.items():
            assert dt <= steps.get(pair, np.inf)
        for pair in {*steps} - {*found}:
            found[pair] = 0.0  # what no step is right to is not right to less
        taken |= {*found.items()}
        steps = found
    assert len({dt for pair, dt in taken if pair == ("rk4", "none")}) > 3


def test_what_holds_its_rods_but_not_its_energy_takes_a_shorter_step_or_comes_last():
    changes = {0.08: 0.23, 0.04: 0.04, 0.02: 0.01}
    pair = [setting(dt)._replace(energy=x) for dt, x in changes.items()]
    cheap = [setting(dt, operations=1.0, names=("rk4", "soft")) for dt in (0.08, 0.04)]
    cheap = [x._replace(energy=0.3) for x in cheap]
    found = choice.chosen(pair + cheap, "rods", 1e-3)
    assert [(x.method, x.dt) for x in found] == [("none", 0.04), ("soft", 0.08)]


def test_energy_counts_only_where_it_should_stay():
    def braked(system, q, v=None):
        return c.external_force(system, q, v) - 0.5 * v

    def make_methods(dt=0.005, **knobs):
        return {"none": c.Method(lambda system: lambda q, v: braked(system, q, v), "free")}

    own = SimpleNamespace(**vars(c) | {"external_force": braked, "make_methods": make_methods})
    found = choose(c.build_system("pendulum"), 1e-3, steps=40, chapter=own)
    assert {x.energy for x in found.settings} == {None}
    assert "energy" not in advice.rods_row(found.settings[0]._replace(rods=0.0))


def test_what_is_lost_or_unknown_never_counts():
    lost = [setting(0.02, lost="at 1 s: diverged"), setting(0.01), setting(0.005)]
    assert choice.reached(lost, {"error": 1.0}).dt == 0.01
    unknown = [setting(0.02, error=None), setting(0.01, error=None)]
    assert choice.reached(unknown, {"error": 1.0}) is None
    assert choice.reached(unknown, {"rods": 1.0}).dt == 0.02


@pytest.mark.parametrize(
    ("work", "error", "first"),
    [(104.0, 0.9e-4, 1), (106.0, 0.9e-4, 0), (104.0, 1.1e-4, 0), (99.0, 1e-3, 1), (99.0, 1.0, 0)],
)
def test_as_cheap_and_ten_times_as_right_comes_first(work, error, first):
    """Less than 5 % more work, and a tenth of the error or less."""
    both = [
        setting(0.01, 1e-3, operations=100.0),
        setting(0.01, error, operations=work, names=("rk4", "project")),
    ]
    assert choice.in_order(both, "error")[0] is both[first]
    assert choice.in_order(both[::-1], "error")[0] is both[first]


def climbed(errors, counts=(10, 20, 40), work=lambda count: count):
    """The counts that ladder takes where errors(count) are so large, within 1e-3."""
    taken = []

    def take(count):
        taken.append(count)
        return setting(1.0 / count, errors(count), 1.0, work(count))

    found = choice.ladder(take, counts, lambda count: len(str(1.0 / count)), 1e-3)
    assert [x.dt for x in found] == sorted((1.0 / x for x in taken), reverse=True)
    return sorted(taken)


def test_the_ladder_goes_on_to_longer_steps_while_they_are_right_and_cheaper():
    assert climbed(lambda count: 1.0) == [10, 20, 40]
    assert climbed(lambda count: 1e-4) == [1, 2, 5, 10, 20, 40]
    assert climbed(lambda count: 1e-4, work=lambda count: abs(count - 5)) == [2, 5, 10, 20, 40]


def test_the_ladder_asks_once_more_whether_its_last_step_is_right_by_luck():
    assert climbed(lambda count: 1.0 if count < 40 else 1e-4) == [10, 20, 40, 80]
    assert climbed(lambda count: 1.0 if count < 20 else 1e-4) == [10, 20, 40]


def scaled(factor):
    system = c.build_system("double")
    parts = {key: factor * np.asarray(system[key]) for key in ("q0", "lengths", "anchors")}
    return systems.check_system(system | parts, c.PIVOT)


@pytest.mark.parametrize(("factor", "longest"), [(1.0, 0.04), (16.0, 0.16), (1.0 / 64.0, 0.005)])
def test_steps_are_as_long_as_the_scene_is_slow(factor, longest):
    """Times go with the root of lengths: a crane's are long, a watch's short."""
    system = scaled(factor)
    force = c.make_force(system)
    last = 512
    seconds = 512 * 0.005
    count = choice.first_count(system, force, 0.005, last)
    assert seconds / count == pytest.approx(longest, rel=0.5) and seconds / count <= 1.7 * longest


def test_the_usual_ladder_is_from_40_to_1_25_ms():
    for name in "double", "jansen_leg", "windows":
        system = c.build_system(name)
        count = choice.first_count(system, c.make_force(system), 0.005, 400)
        assert [2.0 / (count << k) for k in range(choice.RUNGS)] == [
            0.04,
            0.02,
            0.01,
            0.005,
            0.0025,
            0.00125,
        ]


# --- work ---
def counter_of(step, state, knobs=0):
    program, _ = trace_loop(step, nonzero(state), knobs)
    return counting.Counter(program)


def test_operations_are_counted_as_they_are_done_loops_as_often_as_they_turn():
    """A step that doubles x until it is 100, then adds 1: a test is 1, a turn 1 more."""

    def step(x):
        (x,) = np.ravel(while_loop(lambda x: x[0] < 100.0, lambda x: x + x, x, most=20, failure=""))
        return np.array([x + 1.0])

    count = counter_of(step, [np.array([3.0])])
    for start, turns in ((60.0, 1), (3.0, 6), (200.0, 0)):
        assert count([np.array([start])]) == 2 * turns + 1 + 1
    assert count.varies


def test_rows_side_by_side_are_one_operation_and_wait_for_the_one_that_turns_longest():
    """Three rows: a product each, then each is doubled until it is 100, then a sum of all."""

    def row(x):
        return while_loop(lambda x: x < 100.0, lambda x: x + x, 3.0 * x, most=20, failure="")

    def step(x):
        return np.sum(vmap(row)(x)) + 0.0 * x

    count = counter_of(step, [np.ones(3)])
    for start, turns in (([1.0, 30.0, 10.0], 6), ([40.0, 20.0, 30.0], 1), ([99.0] * 3, 0)):
        assert count([np.array(start)]) == 1 + 2 * turns + 1 + 2


def test_a_second_takes_the_steps_of_a_second_and_half_the_step_twice_the_work(double):
    system = c.build_system("double")
    rows = [x for x in double.settings if (x.integrator, x.method) == ("rk4", "none")]
    step = choice.step_of(c, system, "rk4", "none", KNOBS)
    count = counter_of(step, [system["q0"], system["v0"]], knobs=1)
    each = count([system["q0"], system["v0"]], 0.005)
    assert not count.varies and each > 4 * 50
    for x in rows:
        assert x.operations == pytest.approx(each / x.dt, rel=1e-5)


def test_newtons_rounds_are_those_of_the_run_on_average(double):
    """Longer steps take more of them; so a step costs more, and a second is more than in
    proportion."""
    rows = [x for x in double.settings if (x.integrator, x.method) == ("semi_implicit", "project")]
    by_step = {x.dt: x.operations * x.dt for x in rows if not x.lost}
    assert by_step[0.04] > 1.1 * by_step[0.00125]
    system = c.build_system("double")
    run = c.run_method(system, "project", "semi_implicit", 0.005, 800)
    (row,) = [x for x in rows if x.dt == 0.005]
    assert run.operations == pytest.approx(row.operations, rel=1e-5)


def test_a_row_of_the_results_has_its_operations_but_not_where_nothing_is_compiled(tmp_path):
    run = "--smoke", "--stabilization", "none", *BARE, "--out", str(tmp_path)
    c.main([*run])
    row = json.loads((tmp_path / "metrics.json").read_bytes())["results"]["none"]
    system = c.build_system("double")
    step = choice.step_of(c, system, "semi_implicit", "none", KNOBS)
    each = counter_of(step, [system["q0"], system["v0"]], knobs=1)
    assert row["operations"] == each([system["q0"], system["v0"]], 0.005) / 0.005
    c.main([*run, "--plain"])
    row = json.loads((tmp_path / "metrics.json").read_bytes())["results"]["none"]
    assert row["operations"] is None


def test_what_would_take_long_is_shortened_by_counting_and_says_so(monkeypatch):
    system = c.build_system("double")
    full = choose(system, 1e-2)
    work = sum(x.operations for x in full.settings if x.dt in (0.04, 0.02, 0.01, 0.005, 0.0025))
    monkeypatch.setattr(choice, "BUDGET", 2.6 * work)
    less = choose(system, 1e-2)
    assert less.span == less.error_at == 2.0 and less.whole == 4.0
    assert less.left_out == ["the ladder of steps ends at 2.5 ms: more would take long"]
    assert min(x.dt for x in less.settings) >= 0.00125  # where it is asked whether 2.5 ms is luck
    assert "for the first 2 s (all would take long)" in "".join(
        x for _, x in advice.sentences(less)
    )
    shortened = choice.as_metrics(less, [])["shortened"]
    assert "first 2 s" in shortened and less.left_out[0] in shortened


def test_what_is_lost_says_when_and_why_in_the_words_of_the_loop_that_failed():
    found = choose(scaled(1.0 / 64.0), 1e-3, steps=200, dt=0.02)
    reasons = {x.lost.split(": ")[1] for x in found.settings if x.lost}
    assert "no way back onto the rods" in reasons
    for x in found.settings:
        if x.lost:
            assert (x.rods, x.energy) == (None, None) and x.lost.startswith("at ")
            assert x not in found.places and x not in found.rods_hold


# --- where the motion is not known ---
def test_a_time_that_nobody_knows_is_halved_until_it_is(monkeypatch):
    asked = []

    def true_motion(system, force, project, dt, last):
        asked.append(last)
        q = None if last > 100 else system["q0"]
        return Reference(last, "", q, 0.0, "" if last <= 100 else "shorter steps do not agree")

    monkeypatch.setattr(choice.truth, "true_motion", true_motion)
    found = choose(c.build_system("pendulum"), 1e-3, steps=400)
    assert asked == [400, 200, 100] and found.error_at == 0.5
    assert found.left_out == ["places later than at 0.5 s are not known"]


def test_where_nobody_knows_the_motion_rods_have_an_answer_and_places_a_reason(monkeypatch):
    nobody = Reference(40, "at 0.2 s", why="shorter steps do not agree to a nanometre")
    monkeypatch.setattr(choice.truth, "true_motion", lambda *_: nobody)
    found = choose(c.build_system("pendulum"), 1e-3, steps=80)
    said = [text for _, text in advice.sentences(found)]
    assert not found.places and found.rods_hold
    assert said[0] == "Nobody knows which places are right: " + nobody.why
    row = choice.as_metrics(found, said)
    assert row["why"] == nobody.why and row["uncertainty"] is None
    assert {x["error"] for x in row["settings"]} == {None}


# --- what is said ---
def test_that_energy_is_kept_is_said_of_right_rods_only_where_the_first_setting_keeps_it(double):
    best = double.rods_hold[0]
    for energy, said in ((0.049, True), (0.051, False), (None, False)):
        found = double._replace(rods_hold=[best._replace(energy=energy)])
        assert ("energy to 5 %" in advice.rods_head(found)) == said


LENGTHS = [
    ("1mm", 1e-3),
    ("0.5mm", 5e-4),
    ("1um", 1e-6),
    ("1µm", 1e-6),
    ("1\N{GREEK SMALL LETTER MU}m", 1e-6),
    ("2cm", 0.02),
    ("2 cm", 0.02),
    ("3nm", 3e-9),
    ("1m", 1.0),
    ("0.001", 1e-3),
    ("1e-6", 1e-6),
]


@pytest.mark.parametrize(("text", "metres"), LENGTHS)
def test_a_tolerance_is_a_length_with_a_unit_or_a_number_of_metres(text, metres):
    assert cli.length(text) == metres


@pytest.mark.parametrize("text", ["1 foot", "mm", "", "0", "-1mm", "nan", "1e9", "0.1pm", "1mmm"])
def test_a_wrong_tolerance_is_refused_by_flag_and_value(text, refused):
    said = refused(f"--within={text}")
    assert f"argument --within: {text!r} must be a length such as 1mm" in said


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (1e-3, "1 mm"),
        (5e-4, "500 µm"),
        (0.02, "2 cm"),
        (1e-6, "1 µm"),
        (2e-12, "2 pm"),
        (3.0, "3 m"),
    ],
)
def test_a_tolerance_is_said_as_one_would_say_it(metres, text):
    assert advice.spoken(metres) == text


def test_numbers_have_three_digits_and_thousands():
    assert [advice.thousands(x) for x in (7065.6, 149312.0, 1163800.0)] == [
        "7,070",
        "149,000",
        "1,160,000",
    ]
    assert [advice.microseconds(x) for x in (3.5612e-6, 31.66e-6, 1.391e-3)] == [
        "3.56",
        "31.7",
        "1,390",
    ]
    assert [advice.milliseconds(x) for x in (0.04, 0.00015625, 1.0)] == [
        "40 ms",
        "0.156 ms",
        "1000 ms",
    ]


def test_where_rods_are_right_and_places_are_not_a_sentence_says_why(double):
    (first, *_) = (x for x in double.rods_hold if x.error > 1e-3)
    said = advice.why_they_differ(double._replace(rods_hold=[first]))
    assert said.startswith("Right rods are not yet right places")
    assert advice.length(first.error) in said
    right = double._replace(rods_hold=[double.places[0]])
    assert advice.why_they_differ(right) is None


def test_what_is_said_is_right_and_fits_ten_lines(double):
    said = advice.sentences(double)
    text = "\n".join(advice.line(x, words) for x, words in said)
    best = double.places[0]
    assert f"{advice.thousands(best.operations)} (0.000 µs): {advice.name_of(best)}" in text
    shown = [x for x, _ in said if x]
    assert shown[0] is best and double.rods_hold[0] in shown
    names = "semi_implicit", "baumgarte"
    bad = setting(0.00015625, 0.011, 0.011, 1.16e6, names=names)
    worst = double._replace(
        places=[bad, bad._replace(method="project"), bad._replace(integrator="rk4")],
        rods_hold=[bad, bad._replace(method="project"), bad._replace(integrator="rk4")],
        settings=[bad._replace(lost="at 0.456 s: no way back onto the rods")] * 5,
        left_out=[
            "places later than at 0.5 s are not known",
            "the ladder of steps ends at 2.5 ms: more would take long",
        ],
        span=1.0,
    )
    lines = []
    for x, words in advice.sentences(worst):
        lines += textwrap.wrap(advice.line(x, words), 80, subsequent_indent="  ")
    assert len(lines) <= 10 and max(map(len, lines)) <= 80


def test_what_is_nearest_says_what_its_rods_do_later(double):
    drifting = [x for x in double.settings if x.method == "none"]
    none = double._replace(within=1e-9, settings=drifting, places=[], rods_hold=[])
    best = min(drifting, key=lambda x: max(x.error, x.rods))
    said = advice.places_head(none)
    assert "right to 1 nm at 2 s and holds its rods; nearest, rk4 with none" in said
    assert said.endswith(f" off; rods, {advice.length(best.rods)} later")


def test_with_the_flag_terminal_and_metrics_say_the_same(tmp_path, capsys):
    run = "--smoke", "--stabilization", "project", *BARE, "--out", str(tmp_path)
    c.main([*run, "--within", "1mm"])
    printed = " ".join(capsys.readouterr().out.split())
    found = json.loads((tmp_path / "metrics.json").read_bytes())["choice"]
    first = found["settings"][found["places"][0]]
    second = found["settings"][found["rods_hold"][0]]
    assert found["within"] == 1e-3 and found["span"] == 4.0 and found["error_at"] == 2.0
    assert first["error"] <= 1e-3 and second["rods"] <= 1e-3 and "seconds" not in first
    name = f"{first['integrator']} with {first['method']} at {1e3 * first['dt']:g} ms"
    assert name in found["advice"][1] and name in printed
    for text in found["advice"]:
        if "operations" not in text and ":" in text:
            assert text.split(": ")[-1] in printed
    assert "add --within" not in printed


def test_without_the_flag_nothing_is_sought_and_the_last_line_names_it(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(choice, "choose", None)
    monkeypatch.setattr(choice, "Pair", None)
    c.main(["--steps", "20", *BARE, "--out", str(tmp_path)])
    assert capsys.readouterr().out.splitlines()[-1].endswith("add --within 1mm")
    assert json.loads((tmp_path / "metrics.json").read_bytes())["choice"] is None


def edited_loop(step_fn, system, force, dt, steps):
    """simulate with a kick at its third step."""
    q = [system["q0"]]
    v = [system["v0"]]
    for k in range(steps):
        speed = 1.5 * v[-1] if k == 3 else v[-1]
        state = step_fn(q[-1], speed, system["m"], force, dt)
        q.append(state[0])
        v.append(state[1])
    return c.Run(system, np.stack(q), np.stack(v))


def branching(system, q, v=None):
    pull = system["m"] * c.GRAVITY
    return pull + 1.0 if v is not None and v[0, 0] > 1e3 else pull + 0.0 * q


NO_ANSWERS = [
    ({}, ["--plain"], "steps are not compiled"),
    ({"simulate": edited_loop}, [], "the loop edits"),
    ({"external_force": branching}, [], "steps are not compiled"),
    ({"INTEGRATORS": c.INTEGRATORS | {"mine": lambda *_: 1 / 0}}, [], "steps cannot be compiled"),
    ({}, ["--system", "upright"], "nothing moves"),
]


@pytest.mark.parametrize(("edits", "flags", "why"), NO_ANSWERS)
def test_where_there_is_no_answer_a_line_says_why(edits, flags, why, tmp_path, capsys, monkeypatch):
    for name, function in edits.items():
        monkeypatch.setattr(c, name, function)
    c.main(["--steps", "20", "--within", "1mm", *flags, *BARE, "--out", str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    (line,) = [x for x in lines if "--within" in x]
    assert line.startswith(f"no answer to --within 1 mm: {why}")
    assert json.loads((tmp_path / "metrics.json").read_bytes())["choice"] is None


def test_the_answer_has_the_same_bytes_without_llvmlite(tmp_path, monkeypatch):
    pytest.importorskip("llvmlite", reason="llvmlite is not installed: pip install -e '.[fast]'")
    run = "--system", "braced", "--steps", "60", "--within", "1mm", *BARE, "--out"
    system = c.build_system("braced")
    pair = "rk4", "project", KNOBS
    assert choice.Pair(c, system, *pair).run.how == "machine code"
    c.main([*run, str(tmp_path)])
    with_it = (tmp_path / "metrics.json").read_bytes()
    monkeypatch.setattr(llvm, "find_spec", lambda name: None)
    assert choice.Pair(c, system, *pair).run.how == "compiled to Python"
    c.main([*run, str(tmp_path)])
    without = (tmp_path / "metrics.json").read_bytes()
    assert with_it == without and json.loads(without)["choice"]["places"]


# --- a chapter that its reader has changed ---
def test_an_integrator_or_a_method_of_ones_own_is_tried_like_the_others():
    def rk2_step(q, v, m, force, dt):
        a = force(q, v) / m
        return q + dt * v + 0.5 * dt * dt * a, v + dt * force(
            q + 0.5 * dt * v, v + 0.5 * dt * a
        ) / m

    def make_methods(dt=0.005, **knobs):
        every = c.make_methods(dt, **knobs)
        return every | {"stiff": c.Method(lambda system: c.make_force(system, 40.0), "stiffer")}

    own = SimpleNamespace(**vars(c))
    own.INTEGRATORS = c.INTEGRATORS | {"rk2": rk2_step}
    own.make_methods = make_methods
    found = choose(c.build_system("pendulum"), 1e-3, steps=100, chapter=own)
    tried = {(x.integrator, x.method) for x in found.settings}
    assert {("rk2", "none"), ("rk2", "stiff"), ("semi_implicit", "stiff")} < tried
    assert ("rk2", "impulse") not in tried
    assert any(x.integrator == "rk2" for x in found.places)
