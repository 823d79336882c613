"""Rods: what a scene is and how it moves, the true motion, and which scheme is right."""

from curriculum.ch3_4_constraints.rods.chapter import Chapter
from curriculum.ch3_4_constraints.rods.choice import choose
from curriculum.ch3_4_constraints.rods.loops import least_squares, solve_loops
from curriculum.ch3_4_constraints.rods.run import FastStep, Run, largest_force
from curriculum.ch3_4_constraints.rods.scenes import SHIPPED, load_scene
from curriculum.ch3_4_constraints.rods.systems import (
    check_run,
    check_system,
    energy_scale,
    has_loop,
    tolerance,
)
from curriculum.ch3_4_constraints.rods.truth import find_truth

__all__ = [
    "SHIPPED",
    "Chapter",
    "FastStep",
    "Run",
    "check_run",
    "check_system",
    "choose",
    "energy_scale",
    "find_truth",
    "has_loop",
    "largest_force",
    "least_squares",
    "load_scene",
    "solve_loops",
    "tolerance",
]
