"""Checks an exercise: an answer is right, or wrong by so much, and then there is a hint.

Once all are right, the last line can be handed in. It is the same for everybody.
"""

import sys
import traceback
import zlib
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

import constraints as c
from curriculum.ch3_4_constraints.solutions import ex4_cliff
from curriculum.ch3_4_constraints.studies.xpbd import xpbd_step
from curriculum.common.cli import Parser, run_script


def blank(what):
    """Stands where an answer belongs: replace the whole call."""
    caller, _ = traceback.extract_stack(limit=2)
    raise NotImplementedError(f"{Path(caller.filename).name}, line {caller.lineno}: {what}")


def random_chain():
    """A chain of five rods of 1 m, none of which is right, and whose particles move anyhow."""
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, 5, 3))
    m = rng.uniform(0.3, 3.0, (5, 1))
    return c.build_system("chain", links=5) | {"q0": q, "v0": v, "m": m}


# A check takes the module of an exercise and yields, for one answer after the other, what it is,
# the answer, what is right, how far off it may be (a share of what is right), and a hint.
def drift(exercise):
    """Of exercise 1: both guesses, and the line that gives g in m^2."""
    guess = exercise.guess()
    let_go, thrown, coarse, fine = exercise.main()
    pendulum = c.build_system("pendulum")
    grown = c.rod_lengths(pendulum, thrown.q[-1])[0] - pendulum["lengths"][0]
    right = "grows" if grown > 0.0 else "shrinks"
    yield "the rod of a bob that is thrown", guess["rod"], right, 0, "see the last column"
    factor = coarse.violations.max() / fine.violations.max()
    yield "half the step", guess["factor"], factor, 0.1, "divide one error by the other"
    _, (g,), _, _ = c.constraint_terms(pendulum, let_go.q[-1], let_go.v[-1])
    speeds = np.linalg.norm(let_go.v[1:, 0], axis=1)
    hint = "a tangent of length dt |v| ends outside the circle: by Pythagoras, how far? Add them up"
    yield "expected_g", exercise.expected_g(speeds, let_go.dt), g, 1e-6, hint


def solve(exercise):
    """Of exercise 2: the force (N, 3) in N with each of its two blanks."""
    chain = random_chain()
    q = chain["q0"]
    v = chain["v0"]
    f = c.external_force(chain, q, v)
    hints = {
        ("jdotv", 0.0): "gddot = d . (a_i - a_j) + what? Apply the product rule to d . d_dot",
        ("target", 20.0): "g = e^(-w t), twice: what are gdot and gddot, and what is their sum?",
    }
    for (what, w), hint in hints.items():
        mine = exercise.rod_force(chain, q, v, f, w)
        right = c.constraint_force(chain, q, v, w)
        yield f"{what}: the force on a random chain, w = {w:g}", mine, right, 1e-10, hint
    exercise.main()


def chaos(exercise):
    """Of exercise 3: both guesses, in s."""
    guess = exercise.guess()
    times = exercise.main()
    wide = times[1e-3]
    near = times[1e-12]
    yield "1e-12 rad", guess[1e-12], near, 0.02, "see the last line of the table"
    far = near + (near - wide) / 9.0 * 12.0
    hint = "what has each factor of 1000 bought? 1e-24 is four more of them"
    yield "1e-24 rad", guess[1e-24], far, 0.3, hint


def cliff(exercise):
    """Of exercise 4, for each integrator: its matrix (2, 2), its guess, and its cliff as dt w."""
    guess = exercise.guess()
    hint = "its first column is a step from g = 1, gdot = 0; its second from g = 0, gdot = 1"
    for name in exercise.NAMES:
        step_fn = c.INTEGRATORS[name]
        mine = exercise.step_matrix(step_fn, 0.9)
        right = ex4_cliff.step_matrix(step_fn, 0.9)
        yield f"step_matrix, of {name}", mine, right, 1e-12, hint
    for name, (experiment, theory, full) in exercise.main().items():
        right = "later" if theory > full else "earlier"
        hint = "compare its theory with that of full damping"
        yield f"the cliff of {name}", guess[name], right, 0, hint
        hint = "it runs what step_matrix describes: has one of them been changed?"
        yield f"theory and experiment of {name}", theory, experiment, 0.001, hint


def xpbd(exercise):
    """Of exercise 5: q and v (2, N, 3) after a sub-step."""
    chain = random_chain()
    mine = exercise.substep(chain, chain["q0"], chain["v0"], 0.01)
    right = np.array(xpbd_step(chain, chain["q0"], chain["v0"], 0.01))
    hint = "each rod begins where those before it have left its ends; in the end, v = move / h"
    yield "substep, of a random chain", mine, right, 1e-12, hint
    exercise.main()


def off_by(answer, right):
    """How far off an answer is, as a share of the largest right number; NaN: not of its kind."""
    if isinstance(right, str):
        return 0.0 if answer == right else np.nan
    if np.shape(answer) != np.shape(right):
        return np.nan
    return np.max(np.abs(answer - right)) / np.max(np.abs(right))


def verdict(check, exercise):
    """Print what is right, up to the first answer that is wrong; 1 if there is one, else 0."""
    rights = []
    try:
        for what, answer, right, allowed, hint in check(exercise):
            off = off_by(answer, right)
            if not off <= allowed:
                size = f"not {answer}" if np.isnan(off) else f"off by {off:.1e} of what is right"
                print(f"wrong: {what}: {size}\nhint: {hint}")
                return 1
            print(f"right: {what}")
            rights.append(right)
    except NotImplementedError as where:
        print(where)
    else:
        print(solved_line(Path(exercise.__file__).stem, rights))
    return 0


def solved_line(name, rights):
    """What is handed in: the exercise, its last figure, and a code made of all that was right.

    Whoever has changed the mechanics of constraints.py has another code.
    """
    figure = np.max(np.abs(rights[-1]))
    code = zlib.crc32("\n".join(map(rounded, rights)).encode())
    return f"solved {name} {figure:.3g} {code:08x}"


def rounded(right):
    """What is right as a text: so many digits are the same on every machine."""
    if isinstance(right, str):
        return right
    largest = np.max(np.abs(right))
    shares = np.round(np.ravel(right) / largest, 2) + 0.0  # no -0
    return f"{largest:.2g} {shares.tolist()}"


def judge(check):
    """Run and check the exercise that is the script. --solved: with the answers."""
    exercise = sys.modules["__main__"]
    parser = Parser(exercise.__doc__)
    parser.add_argument("--solved", action="store_true", help="put the answers in the blanks")
    if parser.parse_args().solved:
        fill_in(exercise)
    run_script(partial(verdict, check, exercise))


def fill_in(exercise):
    """Put the answers in place of the blanks of a module."""
    name = Path(exercise.__file__).stem
    answers = import_module(f"curriculum.ch3_4_constraints.solutions.{name}")
    vars(exercise).update({key: x for key, x in vars(answers).items() if key[0] != "_"})
