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
import pytest

FOLDER = "curriculum.ch3_4_constraints.exercises"


def need(true, otherwise):
    """Raise Wrong, saying what is otherwise, unless `true`."""
    if not true:
        raise Wrong(otherwise)


def near(x, y, tolerance):
    """Whether x is a number within `tolerance`, a share of y, of y."""
    return isinstance(x, (int, float, np.number)) and bool(abs(x - y) <= tolerance * abs(y))


def check_drift(exercise):
    """The prediction is the one noted before the run; what was found is what the runs do; and g is
    explained."""
    guess, note = exercise.predict(), exercise.NOTE
    if not note.exists():
        raise Blank(
            f"python -m {exercise.__name__} writes your guesses down, then shows what happens: run it"
        )
    noted = json.loads(note.read_text(encoding="utf-8"))
    need(
        guess == noted,
        f"before the run you wrote down {noted}; put that back: a wrong guess costs nothing",
    )
    found = exercise.found()
    pendulum, heavy = c.build_system("pendulum"), c.build_system("pendulum")
    heavy["m"] = 10.0 * heavy["m"]
    ran = exercise.naive(pendulum, "semi_implicit", 0.005, 4000)
    grows = np.all(np.diff(ran.violations) > 0.0)
    need(
        (found["rod"] == "grows") == grows,
        f"rod: not {found['rod']!r}: compare the errors from line to line",
    )
    double = c.build_system("double")
    worst = [
        exercise.naive(double, "rk4", dt, steps).violations.max()
        for dt, steps in ((0.01, 1000), (0.005, 2000))
    ]
    factor = worst[0] / worst[1]
    need(
        near(found["factor"], factor, 0.1),
        f"factor: not {found['factor']}: divide one error by the other",
    )
    ratio = exercise.naive(heavy, "semi_implicit", 0.005, 4000).violations[-1] / ran.violations[-1]
    same = abs(ratio - 1.0) < 1e-6
    need(
        (found["heavy"] == "the same") == same,
        f"heavy: not {found['heavy']!r}: compare the columns",
    )
    for steps in (200, 4000):
        v = ran.v[1 : steps + 1]
        g = c.constraint_terms(pendulum, ran.q[steps], ran.v[steps])[1][0]
        said = exercise.expected_g(np.sqrt(c.dot(v, v))[:, 0], 0.005)
        need(
            near(said, g, 1e-6),
            f"expected_g says {said} m^2 after {steps} steps, where the run has {g:.9f}",
        )


def check_solve(exercise):
    """The force equals the engine's on random chains whose rods are a little off, with and without
    drag."""
    rng = np.random.default_rng(0)
    for n in (1, 2, 3, 5, 8):
        d = rng.normal(size=(n, 3))
        lengths = np.sqrt(c.dot(d, d)) * rng.uniform(0.98, 1.02, n)
        pairs = [(k, k - 1) for k in range(n)]
        v = rng.normal(size=(n, 3))
        chain = make_system(np.cumsum(d, axis=0), v, rng.uniform(0.1, 10.0, n), pairs, lengths)
        for w, drag in ((0.0, 0.0), (20.0, 0.0), (20.0, 0.2)):
            f = chain["m"] * c.GRAVITY - drag * v
            mine = exercise.rod_force(chain, chain["q0"], v, f, w)
            theirs = c.constraint_force(chain, chain["q0"], v, w, f)
            off = np.max(np.abs(mine - theirs)) / max(1.0, np.max(np.abs(theirs)))
            need(
                off <= 1e-12,
                f"a chain of {n}, w {w:g} rad/s: off by {off:.0e} of the largest force, not by 1e-12",
            )


def check_chaos(exercise):
    """same() sees the last bit, parted() a gap that never opens, and the findings are what the runs
    do."""
    a = np.linspace(-1.0, 1.0, 12).reshape(4, 3)
    b = a.copy()
    need(exercise.same(a, b), "same: these two arrays are equal")
    b[2, 1] = np.nextafter(b[2, 1], 2.0)
    need(not exercise.same(a, b), "same: these two arrays differ, though in one last bit only")
    gap = np.array([0.0, 0.4, 0.9, 1.3, 0.2, 1.7])
    need(
        near(exercise.parted(gap, 0.1), 0.3, 1e-9),
        "parted: of [0, 0.4, 0.9, 1.3, 0.2, 1.7], dt 0.1, it is 0.3 s",
    )
    need(
        exercise.parted(gap[:3], 0.1) == math.inf,
        "parted: [0, 0.4, 0.9] never passes a metre: math.inf",
    )
    found, double = exercise.found(), c.build_system("double")
    start = exercise.tip(double)
    gaps = {
        x: np.linalg.norm(start - exercise.tip(exercise.turned(double, x)), axis=1)
        for x in (1e-3, 1e-12)
    }
    wide, fine = (np.argmax(gap > 1.0) * exercise.DT for gap in gaps.values())
    need(
        near(found["1e-12"], fine, 0.01),
        f"1e-12: not {found['1e-12']} s: see the last line of the table",
    )
    farther = (
        fine + (fine - wide) / 9.0 * 12.0
    )  # nine digits bought so many seconds, twelve more would
    message = f"1e-24: not {found['1e-24']} s: every factor of a thousand buys about the same number of seconds"
    need(near(found["1e-24"], farther, 0.3), message)


def check_cliff(exercise):
    """A bisection, not a search; the matrix has STABILITY_LIMIT for its edge; and the runs break
    there, too."""
    calls = []

    def below(x):
        calls.append(x)
        return x < math.sqrt(2.0)

    edge = exercise.bisect(below, 0.0, 4.0, 1e-6)
    need(
        abs(edge - math.sqrt(2.0)) <= 1e-6, f"bisect: x < sqrt(2) holds up to 1.414214, not {edge}"
    )
    need(
        len(calls) <= 24,
        f"bisect: {len(calls)} calls for an interval of 4 and a width of 1e-6; 22 halvings will do",
    )
    for rule, limit in c.STABILITY_LIMIT.items():
        z = exercise.bisect(lambda z, rule=rule: exercise.decays(rule, z), 0.01, 5.0, 1e-9)
        need(
            near(z, limit, 1e-6),
            f"step_matrix: its errors under {rule} decay up to z = {z:.6f}, not {limit:.6f}",
        )
        tried = exercise.DT * exercise.bisect(
            lambda w, rule=rule: exercise.mends(rule, w), 1.0, 1000.0, 1.0
        )
        need(
            near(tried, limit, 0.01),
            f"the runs of {rule} break at z = {tried:.3f}, theory says {limit:.3f}",
        )


def check_linkage(exercise):
    """The mode shipped is the cheapest that is good enough; the scene is a new one with a loop, and
    does as claimed."""
    mode, hold = exercise.ship(), c.hold_table(exercise.DT)
    need(mode in hold, f"ship: {mode!r} is none of {', '.join(hold)}")
    off = exercise.worst(leg := c.build_system(str(SCENES / "jansen_leg.json")), mode) * np.min(
        leg["lengths"]
    )
    need(off <= 1e-3, f"ship: under {mode} a rod of the leg is {1e3 * off:.2g} mm off")
    need(
        hold[mode].after is None,
        f"ship: {mode} solves more systems after each step; another will do with one",
    )
    claim, (_, *remedies) = exercise.claim(), hold
    need(
        set(claim.values()) <= set(remedies),
        f"claim: {claim}; the remedies are {', '.join(remedies)}",
    )
    system = c.build_system(str(exercise.SCENE))
    need(
        has_loop(tuple(system["pairs"])),
        f"{exercise.SCENE.name}: its rods close no loop; a linkage has one",
    )
    points = system["q0"].tolist()
    for path in SCENES.glob("*.json"):
        shipped = [
            particle["position"]
            for particle in json.loads(path.read_text(encoding="utf-8"))["particles"]
        ]
        need(
            points != shipped,
            f"{exercise.SCENE.name}: these are the particles of {path.name}; make your own",
        )
    shares = {name: exercise.worst(system, claim[name]) for name in ("holds", "loses")}
    said = {
        name: f"{claim[name]}: worst rod error {100.0 * share:.2g} %"
        for name, share in shares.items()
    }
    need(shares["holds"] <= exercise.SHARE, f"{said['holds']}: it does not hold your scene")
    need(
        shares["loses"] > exercise.SHARE,
        f"{said['loses']}: it does hold your scene; make it harder",
    )


CHECKS = {
    "ex1_drift": check_drift,
    "ex2_solve": check_solve,
    "ex3_chaos": check_chaos,
    "ex4_cliff": check_cliff,
    "ex5_linkage": check_linkage,
}


@pytest.mark.parametrize("name", CHECKS)
def test_answer(name):
    try:
        CHECKS[name](importlib.import_module(f"{FOLDER}.{name}"))
    except Blank as message:
        pytest.skip(str(message))
    except (Wrong, SceneError) as message:
        raise pytest.fail.Exception(f"{name}: {message}", pytrace=False) from None
