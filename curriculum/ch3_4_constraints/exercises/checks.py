"""Runs an exercise and judges it: some functions before the run, which could not bear a wrong one.

Then a check takes its module, and what its main returned. It raises Blank where something is left
to do, Wrong where an answer is not so. What is right it asks of the engine, or of theory.
"""

import json
import sys
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import constraints as c
from curriculum.ch3_4_constraints.studies._runs import make_system
from curriculum.ch3_4_constraints.systems import SceneError
from curriculum.common.cli import run_script
from curriculum.common.elimination import has_loop
from curriculum.common.files import write_whole

import numpy as np


class Blank(Exception):
    """Something is left to do; the message says where, and what."""


class Wrong(Exception):
    """An answer that is not so; the message says why."""


def blank(what):
    """Stands where an answer belongs: replace it, the call and all."""
    place = sys._getframe(1)
    raise Blank(f"{Path(place.f_code.co_filename).name}, line {place.f_lineno}: {what}")


def need(true, otherwise):
    """Raise Wrong, saying what is otherwise, unless `true`."""
    if not true:
        raise Wrong(otherwise)


def near(x, y, tolerance):
    """Whether x is a number within `tolerance`, a share of y, of y; "16" is a number, too."""
    try:
        return bool(abs(float(x) - y) <= tolerance * abs(y))
    except (TypeError, ValueError):
        return False


def means(guess, word):
    """Whether a guess is that word: "Grow" is "grows", and "same" is "the same"."""
    plain = str(guess).strip().lower().removeprefix("the ").removesuffix("s")
    return plain == word.removeprefix("the ").removesuffix("s")


def check_drift(exercise, shown):
    """The answers are what theory says, and g is explained."""
    found, (g, line) = exercise.answer(), shown
    rod, factor, heavy = (f"{key}: not {found[key]!r}" for key in ("rod", "factor", "heavy"))
    # tangents lie outside, rk4 is of order 4, and a bob's mass cancels from the solve
    need(means(found["rod"], "grows"), f"{rod}: compare the errors from line to line")
    need(near(found["factor"], 2**4, 0.1), f"{factor}: divide one error by the other")
    need(means(found["heavy"], "the same"), f"{heavy}: compare the columns")
    two, right = exercise.expected_g(np.array([1.0, 2.0]), 0.01), 2.5e-4
    need(np.ndim(two) == 0, "expected_g is to return one number: add up what each step leaves")
    for said, wrong in (
        ("twice as much: g has a factor 1/2", 2.0 * right),
        ("that is the rod error in m: g is (d . d - 1) / 2", np.sqrt(1.0 + 2.0 * right) - 1.0),
        ("a step counts with the speed after it: the last one counts, too", 0.5e-4),
        ("the speeds: square them", 1.5e-4),
        ("that is the way gone, in m: g is in m^2", 0.03),
        ("a dt is missing: the tangent is dt |v| long", 0.025),
        ("every step adds to g: the sum of all", 2e-4),
    ):
        need(not near(two, wrong, 1e-6), f"expected_g: {said}")
    need(near(line, g, 1e-6), f"expected_g says {line} m^2 after 20 s, and the run has {g:.9f}")
    said = f"of two steps of 0.01 s, at 1 and 2 m/s, {right:g} m^2, not {two}"
    need(near(two, right, 1e-6), f"expected_g: {said}")


MISTAKES = {  # of exercise 2: a function, what is to be said of a typical wrong answer, and that
    "turning: zero: right at rest, wrong in motion. gddot = d . a + something": lambda *_: 0.0,
    "turning: the other sign: in gddot, on the left, it has a plus": lambda d, rate: -(rate @ rate),
    "turning: twice as much: g has a factor 1/2": lambda d, rate: 2.0 * (rate @ rate),
    "turning: half as much: the product rule gives d . a + rate . rate": lambda _, rate: (
        0.5 * (rate @ rate)
    ),
    "turning: the speed: gddot is in m^2/s^2, so square it": lambda _, rate: np.sqrt(rate @ rate),
    "turning: over |d|: that is an acceleration; gddot is |d| times it": lambda d, rate: (
        rate @ rate / np.sqrt(d @ d)
    ),
    "turning: d . d: what turns d is rate": lambda d, rate: d @ d,
    "turning: d . rate is gdot: differentiate once more": lambda d, rate: d @ rate,
    "mobility: right where all masses are 1 kg: the mass is missing": lambda j, share: j @ j.T,
    "mobility: it multiplies by the mass: M^-1 divides by it": lambda j, share: (j / share) @ j.T,
    "mobility: the other sign: the minus stands on the right already": lambda j, share: (
        -(j * share) @ j.T
    ),
    "wanted: nothing: right at w = 0 only. The spring is missing": lambda *_: 0.0,
    "wanted: both signs wrong: each must act against": lambda g, gdot, w: 2.0 * w * gdot + w**2 * g,
    "wanted: damping must act against gdot": lambda g, gdot, w: 2.0 * w * gdot - w**2 * g,
    "wanted: stiffness must act against g": lambda g, gdot, w: -2.0 * w * gdot + w**2 * g,
    "wanted: half the damping: this one swings": lambda g, gdot, w: -w * gdot - w**2 * g,
    "wanted: no damping: this one swings for ever": lambda g, gdot, w: -(w**2) * g,
    "wanted: no stiffness: an error stays where it is": lambda g, gdot, w: -2.0 * w * gdot,
    "wanted: g and gdot changed places: gdot wants 2 w, and g w^2": lambda g, gdot, w: (
        -2.0 * w * g - w**2 * gdot
    ),
    "wanted: -w g is gdot of e^(-wt): differentiate that once more": lambda g, gdot, w: -w * g,
    "wanted: w g: the unit of gddot is that of w^2 g": lambda g, gdot, w: -2.0 * w * gdot - w * g,
    "wanted: this dies like e^(-wt/2), half as fast as it is to": lambda g, gdot, w: (
        -w * gdot - w**2 * g / 4.0
    ),
    "wanted: gdot wants 2 w, and g wants w^2": lambda g, gdot, w: -w * gdot - w * g,
}


def early_solve(exercise):
    """Typical mistakes are named."""
    rng = np.random.default_rng(0)
    tried = {"turning": rng.normal(size=(2, 3)), "wanted": (*rng.normal(size=(2, 3)), 3.0)}
    tried["mobility"] = rng.normal(size=(2, 6)), rng.uniform(2.0, 3.0, 6)
    for said, mistake in MISTAKES.items():
        name = said.partition(":")[0]
        mine, wrong = getattr(exercise, name)(*tried[name]), mistake(*tried[name])
        need(not np.allclose(mine, wrong), said)
    need(not np.any(exercise.wanted(D, D, 0.0)), "wanted: at w = 0 it is to be zero")


def check_solve(exercise, _):
    """The force equals the engine's on random chains."""
    rng = np.random.default_rng(0)
    for n in (1, 2, 5, 8):
        d, v, f = rng.normal(size=(3, n, 3))
        lengths = np.linalg.norm(d, axis=1) * rng.uniform(0.98, 1.02, n)
        pairs, m = [(k, k - 1) for k in range(n)], rng.uniform(0.1, 10.0, n)
        chain = make_system(np.cumsum(d, axis=0), v, m, pairs, lengths)
        for blame, speed, w in (("mobility", 0, 0.0), ("turning", 1, 0.0), ("wanted", 1, 20.0)):
            mine = exercise.rod_force(chain, chain["q0"], speed * v, f, w)
            theirs = c.constraint_force(chain, chain["q0"], speed * v, w, f)
            off = np.max(np.abs(mine - theirs)) / max(1.0, np.max(np.abs(theirs)))
            at = f"{'in motion' if speed else 'at rest'}, w {w:g} rad/s"
            said = f"{blame}: a chain of {n} {at}: off by {off:.0e} of the largest force"
            need(off <= 1e-12, said)


def early_chaos(exercise):
    """same() sees the last bit, parted() a gap that never opens."""
    a = np.linspace(-1.0, 1.0, 12).reshape(4, 3)
    b = np.where(a == a[2, 1], np.nextafter(a, 2.0), a)
    need(exercise.same(a, a.copy()), "same: these two arrays are equal")
    need(not exercise.same(a, b), "same: these two arrays differ, though in one last bit only")
    gap = np.array([0.0, 0.4, 0.9, 1.3, 0.2, 1.7])
    found = exercise.parted(gap, 0.1)
    need(near(found, 0.3, 1e-9), f"parted: of {gap}, dt 0.1, it is 0.3 s, not {found} s")
    try:
        never = exercise.parted(gap[:3], 0.1)
    except (IndexError, StopIteration, ValueError):  # as of the first of none
        never = None
    need(never == np.inf, "parted: [0, 0.4, 0.9] never passes a metre, so the time is np.inf")


def check_chaos(exercise, shown):
    """The answers are what runs do."""
    found = exercise.answer()
    wide, fine = (shown[f"{angle} rad higher"] for angle in ("1e-03", "1e-12"))
    said = f"1e-12: not {found['1e-12']} s: see the last line of the table"
    need(near(found["1e-12"], fine, 0.02), said)
    farther = fine + (fine - wide) / 9.0 * 12.0  # nine digits bought so much, and twelve more?
    same = "by the table a factor of 1000 buys about the same time again; there are four more"
    said = f"1e-24: not {found['1e-24']} s: {same}"
    need(near(found["1e-24"], farther, 0.3), said)


def early_bisect(exercise):
    """A bisection, not a search, which would take very long on runs."""
    calls = []
    edge = exercise.bisect(lambda x: calls.append(x) or x < np.sqrt(2.0), 0.0, 4.0, 1e-6)
    said = f"bisect: x < sqrt(2) holds up to 1.414214, not {edge}"
    need(abs(edge - np.sqrt(2.0)) <= 1e-6, said)
    said = f"bisect: {len(calls)} calls from an interval of 4 to 1e-6, where 22 halvings will do"
    need(len(calls) <= 24, said)


def early_matrix(exercise):
    """A matrix that steps as the rule does."""
    x, z = np.array([0.3, -0.7]), 0.9
    for rule in c.STABILITY_LIMIT:
        after = c.INTEGRATORS[rule](*x, 1.0, lambda x, v: -z * v - z**2 * x, 1.0)
        mine = np.asarray(exercise.step_matrix(rule, z))
        said = f"step_matrix: of {rule} at z = {z}, it takes (g, gdot) elsewhere than a step does"
        need(not np.allclose(x @ mine, after), f"{said}: it is transposed")
        twice = c.INTEGRATORS[rule](*x, 1.0, lambda x, v: -2.0 * z * v - z**2 * x, 1.0)
        full = "this is full damping, 2 z; here it is half of that"
        need(not np.allclose(mine @ x, twice), f"step_matrix: of {rule}: {full}")
        spring = f"step_matrix: of {rule}: that is the spring, d/dt of (g, gdot); the rule makes"
        need(not np.allclose(mine, [[0.0, 1.0], [-(z**2), -z]]), f"{spring} a step of it")
        need(np.allclose(mine @ x, after), f"{said}; a step is 1 s, and z stands in the spring")


def check_cliff(exercise, shown):
    """The answers follow from the table."""
    found = exercise.answer()
    need(isinstance(found, dict), f"answer: a dict of rules, as the blank had it, not {found!r}")
    for rule, limit in c.STABILITY_LIMIT.items():
        so, guess = "sooner" if shown[rule] < limit else "later", found.get(rule)
        need(means(guess, so), f"{rule}: not {guess!r}: compare its z with that of full damping")


def check_linkage(exercise, shown):
    """The mode shipped is the cheapest that will do; the scene's loop tells remedies apart."""
    mode, leg, hold = exercise.ship(), c.build_system("jansen_leg"), c.hold_table(exercise.DT)
    mode = mode.strip().lower() if isinstance(mode, str) else mode
    need(mode in hold, f"ship: {mode!r}: the modes are {', '.join(hold)}")
    off = exercise.worst(leg, mode) * np.min(leg["lengths"])
    seconds = exercise.DT * exercise.STEPS
    said = f"ship: under {mode} a rod of the leg is {1e3 * off:.2g} mm off within {seconds:g} s"
    need(off <= 1e-3, f"{said}, and at least as far within the 20 s of the command")
    said = f"ship: {mode} solves more systems after each step; another will do with one"
    need(hold[mode].after is None, said)
    system, scene = c.build_system(str(exercise.SCENE)), exercise.SCENE.name
    need(has_loop(system["pairs"]), f"{scene}: its rods close no loop; a linkage has one")
    held = [share <= exercise.SHARE for mode, share in shown.items() if mode != "none"]
    need(any(held), f"{scene}: no remedy holds it; be gentler")
    if all(held):
        raise Blank(f"{scene}: every remedy holds it; edit it until one does not")


D, J = np.ones(3), np.eye(2, 6)
RETURNS = {  # of an exercise: a function, what it is tried with, shapes that are right, in words
    "ex1_drift": [("expected_g", (D, 1.0), [()], "one number: add up what each step leaves")],
    "ex2_solve": [
        ("turning", (D, D), [()], "one number"),
        ("mobility", (J, np.ones(6)), [(2, 2)], "(2, 2) where J is (2, 6): one row a rod"),
        ("wanted", (D, D, 1.0), [(3,), ()], "(3,) of three rods: one number a rod"),
    ],
    "ex3_chaos": [
        ("same", (D, D), [()], "one True or False"),
        ("parted", (2.0 * D, 1.0), [()], "one number"),
    ],
    "ex4_cliff": [
        ("bisect", (lambda x: x < 1.0, 0.0, 4.0, 1.0), [()], "one number"),
        ("step_matrix", ("euler", 0.1), [(2, 2)], "(2, 2)"),
    ],
}


def where_it_stopped(function, given, why):
    """In one line: where the function stopped, why, and which shapes it was given."""
    code, trace = function.__code__, traceback.extract_tb(why.__traceback__)
    line = [x.lineno for x in trace if x.filename == code.co_filename][-1]
    shapes = zip(code.co_varnames, map(np.shape, given), strict=False)
    had = ", ".join(f"{name} is {shape}" for name, shape in shapes if shape)
    said = f"{Path(code.co_filename).name}, line {line}: {' '.join(str(why).split())}"
    return f"{said}; {had}" if had else said


def check_returns(exercise, tries):
    """What comes back has a right shape: a run that meets a wrong one blames a line of its own."""
    for name, given, shapes, words in tries:
        function = getattr(exercise, name)
        try:
            found = function(*given)
        except Blank:  # the run ends there, once it has shown what comes before
            continue
        except Exception as why:  # as numpy's, that two shapes do not fit
            raise Wrong(where_it_stopped(function, given, why)) from why
        need(found is not None, f"{name} returns nothing: its last line is to begin with return")
        said = f"{name}: an array of shape {np.shape(found)}, must be {words}"
        need(np.shape(found) in shapes, said)


EARLY = {"ex2_solve": [early_solve], "ex3_chaos": [early_chaos]}
EARLY |= {"ex4_cliff": [early_bisect, early_matrix]}
CHECKS = {"ex1_drift": check_drift, "ex2_solve": check_solve, "ex3_chaos": check_chaos}
CHECKS |= {"ex4_cliff": check_cliff, "ex5_linkage": check_linkage}


def check_before_run(name, exercise):
    """What a run would stop at, or never come to an end by, is told of first."""
    check_returns(exercise, RETURNS.get(name, []))
    for early in EARLY.get(name, []):
        with suppress(Blank):  # the run says so, once it has shown what comes before
            early(exercise)


def first_guess(note, guess):
    """What was guessed before the first run: the file `note` keeps it, whatever follows."""
    if not note.exists():
        write_whole(note, json.dumps(guess, default=str))  # be it inf, or of numpy's
    return json.loads(note.read_text(encoding="utf-8"))


def solved(exercise, answers):
    """The module of an exercise, with what stands in the module `answers` for its blanks."""
    vars(exercise).update({key: x for key, x in vars(answers).items() if key[0] != "_"})
    return exercise


def judge(main):
    """As a script: the guess is noted, then it is run and judged, up to the first blank or mistake,
    of which only the last makes the exit status 1. --solved takes the answers, and notes nothing.
    """

    def script():
        exercise, told = sys.modules[main.__module__], "--solved" in sys.argv
        name = Path(exercise.__file__).stem
        if told:
            solved(exercise, import_module(f"{__package__}.solutions.{name}"))
        try:
            if hasattr(exercise, "answer"):
                note, guess = c.HERE / f"outputs/guess_{name}.json", exercise.answer()
                print(f"you wrote down {guess if told else first_guess(note, guess)}")
                print("" if told else f"(to guess again, delete {note.relative_to(c.HERE)})\n")
            check_before_run(name, exercise)
            CHECKS[name](exercise, exercise.main())
        except (Blank, Wrong, SceneError) as message:
            print(message)
            return int(not isinstance(message, Blank))
        except NameError as why:  # as of a guess without its quotes
            at = traceback.extract_tb(why.__traceback__)[-1]
            print(f"{Path(at.filename).name}, line {at.lineno}: {why}; a word stands in quotes")
            return 1
        print(f"{name}.py: solved. One question is left; solutions/README.md answers it:")
        print(exercise.WHY)
        return 0

    run_script(script)
