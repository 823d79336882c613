"""Exercise 5, answered: python -m curriculum.ch3_4_constraints.exercises.solutions.ex5_linkage"""

from pathlib import Path

from curriculum.ch3_4_constraints.exercises.solutions import run_solution

SCENE = Path(__file__).with_name("my_linkage.json")


def ship():
    return "impulse"


def claim():
    why = "It flies in circles, so each step leaves them by more than a slow spring takes back."
    return {"holds": "impulse", "loses": "baumgarte", "why": why}


if __name__ == "__main__":
    run_solution("ex5_linkage", globals())
