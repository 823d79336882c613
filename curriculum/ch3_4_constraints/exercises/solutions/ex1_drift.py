"""Exercise 1, answered: python -m curriculum.ch3_4_constraints.exercises.solutions.ex1_drift"""

from curriculum.ch3_4_constraints.exercises.solutions import run_solution


def predict():
    return {"rod": "grows", "factor": 16, "heavy": "the same"}


def found():
    why = "Every step leaves along the tangent, which lies outside the circle, and none leads back."
    return {"rod": "grows", "factor": 15.9, "heavy": "the same", "why": why}


def expected_g(speeds, dt):
    return 0.5 * dt**2 * (speeds**2).sum()


if __name__ == "__main__":
    run_solution("ex1_drift", globals())
