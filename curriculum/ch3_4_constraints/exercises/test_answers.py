"""The checks, one an exercise:  python -m pytest curriculum/ch3_4_constraints/exercises

A check takes the module of an exercise. It raises Blank where something is left to do, Wrong where
an answer is not so. What is right it finds out by itself, from the engine or from theory.
"""

import importlib
import json
import math

import constraints as c
from curriculum.ch3_4_constraints.exercises import Blank, Wrong
from curriculum.ch3_4_constraints.scene_files import SceneError
from curriculum.ch3_4_constraints.studies._runs import SCENES, make_system
from curriculum.common.graph import has_loop

import numpy as np

FOLDER = "curriculum.ch3_4_constraints.exercises"


def need(true, otherwise):
    """Raise Wrong, saying what is otherwise, unless `true`."""
    if not true:
        raise Wrong(otherwise)


def near(x, y, tolerance):
    """Whether x is a number within `tolerance`, a share of y, of y."""
    return isinstance(x, (int, float, np.number)) and bool(abs(x - y) <= tolerance * abs(y))


def explained(sentence):
    """What nobody can check of a reason: that it is one."""
    said = f"why: {sentence!r} is no sentence yet; say it in your words"
    need(len(str(sentence).split()) > 5, said)


def noted(exercise):
    """The guess is the one that was written down before the first run."""
    guess = exercise.predict()
    if not exercise.NOTE.exists():
        raise Blank(f"python -m {exercise.__name__} writes your guess down, then shows it: run it")
    note = json.loads(exercise.NOTE.read_text(encoding="utf-8"))
    said = f"before the run you wrote down {note}; put that back: a wrong guess costs nothing"
    need(guess == note, said)


def check_drift(exercise):
    """The findings are what the runs do, and g is explained."""
    noted(exercise)
    found, (pendulum, heavy) = exercise.found(), (c.build_system("pendulum") for _ in range(2))
    heavy["m"] = 10.0 * heavy["m"]
    ran, other = (exercise.naive(x, "semi_implicit", 0.005, 4000) for x in (pendulum, heavy))
    said = f"rod: not {found['rod']!r}: compare the errors from line to line"
    need((found["rod"] == "grows") == np.all(np.diff(ran.violations) > 0), said)
    double, steps = c.build_system("double"), {0.01: 1000, 0.005: 2000}
    worst = [np.max(exercise.naive(double, "rk4", *x).violations) for x in steps.items()]
    said = f"factor: not {found['factor']}: divide one error by the other"
    need(near(found["factor"], worst[0] / worst[1], 0.1), said)
    same = near(other.violations[-1], ran.violations[-1], 1e-6)
    said = f"heavy: not {found['heavy']!r}: compare the columns"
    need((found["heavy"] == "the same") == same, said)
    for steps in (200, 4000):
        v = ran.v[1 : steps + 1]
        g = c.constraint_terms(pendulum, ran.q[steps], ran.v[steps])[1][0]
        line = exercise.expected_g(np.sqrt(c.dot(v, v))[:, 0], 0.005)
        said = f"expected_g says {line} m^2 after {steps} steps, where the run has {g:.9f}"
        need(near(line, g, 1e-6), said)
    explained(found["why"])


# Typical wrong answers of exercise 2, and what is to be said of them. Of Jdot v, from d and rate:
TURNING = {
    "zero: right at rest, wrong in motion. gddot = d . d'' + something": lambda d, rate: 0.0,
    "the other sign: in gddot, on the left, it has a plus": lambda d, rate: -(rate @ rate),
    "twice as much: g has a factor 1/2": lambda d, rate: 2.0 * (rate @ rate),
    "half as much: (d . d')' has no factor 1/2 left": lambda d, rate: 0.5 * (rate @ rate),
    "gdot. Differentiate once more, by the product rule": lambda d, rate: d @ rate,
}
# of A, from J and 1/m,
MOBILITY = {
    "right where all masses are 1 kg: the mass is missing": lambda jac, share: jac @ jac.T,
    "it multiplies by the mass: M^-1 divides by it": lambda jac, share: (jac / share) @ jac.T,
    "it divides by the mass twice": lambda jac, share: (jac * share**2) @ jac.T,
}
# and of what is wanted, from the spring's coefficients of gdot and of g, w being 3.
WANTED = {
    (0.0, 0.0): "nothing: right at w = 0 only. The spring is missing",
    (6.0, -9.0): "the damping has the wrong sign: it must act against gdot",
    (-6.0, 9.0): "the stiffness has the wrong sign: it must act against g",
    (-3.0, -9.0): "half the damping: (s + w)^2 = s^2 + 2 w s + w^2, and this one swings",
    (-6.0, -3.0): "w g is in m^2/s: the stiffness is w^2",
    (-6.0, 0.0): "no stiffness: an error stops growing, and stays",
    (0.0, -9.0): "no damping: an error swings for ever",
}


def check_solve(exercise):
    """Typical mistakes are named; then the force equals the engine's on random chains."""
    rng = np.random.default_rng(0)
    d, rate, jac, share = *rng.normal(size=(2, 3)), rng.normal(size=(2, 6)), rng.uniform(2, 3, 6)
    tried = {"turning": ((d, rate), TURNING), "mobility": ((jac, share), MOBILITY)}
    for name, (arguments, mistakes) in tried.items():
        mine = np.asarray(getattr(exercise, name)(*arguments))
        for said, mistake in mistakes.items():
            wrong = np.asarray(mistake(*arguments))
            need(mine.shape != wrong.shape or not np.allclose(mine, wrong), f"{name}: {said}")
    spring = np.array([exercise.wanted(0.0, 1.0, 3.0), exercise.wanted(1.0, 0.0, 3.0)])
    for wrong, said in WANTED.items():
        need(not np.allclose(spring, wrong), f"wanted: {said}")
    for n in (1, 2, 3, 5, 8):
        d, v = rng.normal(size=(2, n, 3))
        lengths = np.sqrt(c.dot(d, d)) * rng.uniform(0.98, 1.02, n)
        pairs, m = [(k, k - 1) for k in range(n)], rng.uniform(0.1, 10.0, n)
        chain = make_system(np.cumsum(d, axis=0), v, m, pairs, lengths)
        for moving, w, drag in ((0, 0.0, 0.0), (1, 0.0, 0.0), (1, 20.0, 0.0), (1, 20.0, 0.2)):
            state = chain["q0"], moving * v
            f = chain["m"] * c.GRAVITY - drag * state[1]
            mine = exercise.rod_force(chain, *state, f, w)
            theirs = c.constraint_force(chain, *state, w, f)
            off = np.max(np.abs(mine - theirs)) / max(1.0, np.max(np.abs(theirs)))
            at = f"{'in motion' if moving else 'at rest'}, w {w:g} rad/s, drag {drag:g} N s/m"
            blame = "mobility" if not moving else "wanted" if w else "turning"
            said = f"{blame}: a chain of {n} {at}: off by {off:.0e} of the largest force"
            need(off <= 1e-12, said)
    explained(exercise.why())


def check_chaos(exercise):
    """same() sees the last bit, parted() a gap that never opens; the findings are what runs do."""
    noted(exercise)
    a = np.linspace(-1.0, 1.0, 12).reshape(4, 3)
    b = a.copy()
    need(exercise.same(a, b), "same: these two arrays are equal")
    b[2, 1] = np.nextafter(b[2, 1], 2.0)
    need(not exercise.same(a, b), "same: these two arrays differ, though in one last bit only")
    gap = np.array([0.0, 0.4, 0.9, 1.3, 0.2, 1.7])
    said = "parted: of [0, 0.4, 0.9, 1.3, 0.2, 1.7], dt 0.1, it is 0.3 s"
    need(near(exercise.parted(gap, 0.1), 0.3, 1e-9), said)
    need(exercise.parted(gap[:3], 0.1) == math.inf, "parted: [0, 0.4, 0.9] never passes a metre")
    found, double = exercise.found(), c.build_system("double")
    ends = [exercise.tip(exercise.turned(double, x)) - exercise.tip(double) for x in (1e-3, 1e-12)]
    wide, fine = (np.argmax(c.dot(gap, gap) > 1.0) * exercise.DT for gap in ends)
    said = f"1e-12: not {found['1e-12']} s: see the last line of the table"
    need(near(found["1e-12"], fine, 0.01), said)
    farther = fine + (fine - wide) / 9.0 * 12.0  # nine digits bought so much, and twelve more?
    said = f"1e-24: not {found['1e-24']} s: each factor of 1000 buys about as many seconds"
    need(near(found["1e-24"], farther, 0.3), said)
    explained(found["why"])


def check_cliff(exercise):
    """A bisection, not a search; a matrix that steps as the rule does; and the runs break there."""
    noted(exercise)
    calls = []
    edge = exercise.bisect(lambda x: calls.append(x) or x < math.sqrt(2.0), 0.0, 4.0, 1e-6)
    said = f"bisect: x < sqrt(2) holds up to 1.414214, not {edge}"
    need(abs(edge - math.sqrt(2.0)) <= 1e-6, said)
    said = f"bisect: {len(calls)} calls from an interval of 4 to 1e-6, where 22 halvings will do"
    need(len(calls) <= 24, said)
    for rule in c.STABILITY_LIMIT:
        step = c.INTEGRATORS[rule]
        x, v, z = 0.3, -0.7, 0.9
        after = np.array(step(x, v, 1.0, lambda x, v: -z * v - z**2 * x, 1.0))  # noqa: B023
        mine = np.asarray(exercise.step_matrix(rule, z))
        said = f"step_matrix: of {rule} at z = {z}, it takes (x, x') elsewhere than a step does"
        need(not np.allclose((x, v) @ mine, after), f"{said}: it is transposed")
        need(np.allclose(mine @ (x, v), after), said)
        cliff = exercise.bisect(lambda z: exercise.decays(rule, z), 0.01, 5.0, 1e-9)  # noqa: B023
        tried = exercise.bisect(lambda w: exercise.mends(rule, w), 1.0, 1000.0, 1.0)  # noqa: B023
        said = f"the runs of {rule} break at z = {exercise.DT * tried:.3f}, theory says {cliff:.3f}"
        need(near(exercise.DT * tried, cliff, 0.01), said)
    explained(exercise.why())


def check_linkage(exercise):
    """The mode shipped is the cheapest that will do; the scene is new, and does as claimed."""
    mode, hold, leg = exercise.ship(), c.hold_table(exercise.DT), c.build_system("jansen_leg")
    need(mode in hold, f"ship: {mode!r} is none of {', '.join(hold)}")
    off = exercise.worst(leg, mode) * np.min(leg["lengths"])
    need(off <= 1e-3, f"ship: under {mode} a rod of the leg is {1e3 * off:.2g} mm off")
    said = f"ship: {mode} solves more systems after each step; another will do with one"
    need(hold[mode].after is None, said)
    claim, (_, *remedies) = exercise.claim(), hold
    tried = {name: claim[name] for name in ("holds", "loses")}
    said = f"claim: {tried}; the remedies are {', '.join(remedies)}"
    need(set(tried.values()) <= set(remedies), said)
    system, scene = c.build_system(str(exercise.SCENE)), exercise.SCENE.name
    need(has_loop(tuple(system["pairs"])), f"{scene}: its rods close no loop; a linkage has one")
    for path in SCENES.glob("*.json"):
        particles = json.loads(path.read_text(encoding="utf-8"))["particles"]
        shipped = [particle["position"] for particle in particles]
        said = f"{scene}: these are the particles of {path.name}; make your own"
        need(not np.array_equal(system["q0"], shipped), said)
    share = {name: exercise.worst(system, remedy) for name, remedy in tried.items()}
    said = {k: f"{tried[k]}: worst rod error {100.0 * share[k]:.2g} %" for k in tried}
    need(share["holds"] <= exercise.SHARE, f"{said['holds']}: it does not hold your scene")
    need(share["loses"] > exercise.SHARE, f"{said['loses']}: it does hold it; make it harder")
    explained(claim["why"])


CHECKS = {"ex1_drift": check_drift, "ex2_solve": check_solve, "ex3_chaos": check_chaos}
CHECKS |= {"ex4_cliff": check_cliff, "ex5_linkage": check_linkage}


def pytest_generate_tests(metafunc):
    metafunc.parametrize("name", CHECKS)


def test_answer(name):
    import pytest  # here, since the scripts, which need none, end by these checks, too

    try:
        CHECKS[name](importlib.import_module(f"{FOLDER}.{name}"))
    except Blank as message:
        pytest.skip(str(message))
    except (Wrong, SceneError) as message:
        raise pytest.fail.Exception(f"{name}: {message}", pytrace=False) from None
