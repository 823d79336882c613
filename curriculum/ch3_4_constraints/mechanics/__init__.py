"""What a scene is, how it moves, and the exact motion to compare with."""

from curriculum.ch3_4_constraints.mechanics import systems
from curriculum.ch3_4_constraints.mechanics.loops import least_squares, solver
from curriculum.ch3_4_constraints.mechanics.outcome import Outcome
from curriculum.ch3_4_constraints.mechanics.reference import find_reference
from curriculum.ch3_4_constraints.mechanics.scene_files import SHIPPED, load_scene

__all__ = ["SHIPPED", "Outcome", "find_reference", "least_squares"]
__all__ += ["load_scene", "solver", "systems"]
