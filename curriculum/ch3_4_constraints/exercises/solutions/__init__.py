"""The answers, each put over the blanks of a copy of its exercise."""

from importlib.util import find_spec, module_from_spec

from curriculum.ch3_4_constraints.exercises import run


def solve(name, answers):
    """A copy of the exercise `name` with the functions of `answers`, a module's, for its own."""
    spec = find_spec(f"curriculum.ch3_4_constraints.exercises.{name}")
    exercise = module_from_spec(spec)
    spec.loader.exec_module(exercise)
    blanks = vars(exercise).keys() - {"run", "main", "blank"}
    vars(exercise).update({key: answers[key] for key in blanks & answers.keys() if key[0] != "_"})
    return exercise


def run_solution(name, answers):
    """As a script: the exercise with these answers, noted beside those of the reader."""
    exercise = solve(name, answers)
    if hasattr(exercise, "NOTE"):
        exercise.NOTE = exercise.NOTE.with_name(f"guess_{name}_solved.json")
    run(exercise.main)
