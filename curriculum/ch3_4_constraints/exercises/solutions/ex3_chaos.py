"""Exercise 3, answered: python -m curriculum.ch3_4_constraints.exercises.solutions.ex3_chaos"""

import math

from curriculum.ch3_4_constraints.exercises.solutions import run_solution

import numpy as np


def predict():
    return {"1e-12": 35.0}


def same(a, b):
    return a.tobytes() == b.tobytes()


def parted(gap, dt):
    wide = np.flatnonzero(gap > 1.0)
    return dt * float(wide[0]) if len(wide) else math.inf


def found():
    why = "A gap grows by the same factor in every second, so a factor buys seconds, not a share."
    return {"1e-12": 34.4, "1e-24": 60.0, "why": why}


if __name__ == "__main__":
    run_solution("ex3_chaos", globals())
