"""What a scene is, how it moves, and the exact motion to compare with."""

from curriculum.ch3_4_constraints.mechanics.loops import least_squares, solve_loops
from curriculum.ch3_4_constraints.mechanics.outcome import Outcome
from curriculum.ch3_4_constraints.mechanics.reference import find_reference
from curriculum.ch3_4_constraints.mechanics.scenes import SHIPPED, load_scene
from curriculum.ch3_4_constraints.mechanics.systems import (
    check_run,
    check_system,
    conserves,
    has_loop,
    m_g_L,
    tolerance,
)

__all__ = ["SHIPPED", "Outcome", "check_run", "check_system", "conserves"]
__all__ += ["find_reference", "has_loop", "least_squares", "load_scene", "m_g_L", "solve_loops"]
__all__ += ["tolerance"]
