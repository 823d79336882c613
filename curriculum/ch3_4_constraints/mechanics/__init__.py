"""What a scene is, how it moves, and the exact motion to compare with."""

from curriculum.ch3_4_constraints.mechanics.outcome import Outcome
from curriculum.ch3_4_constraints.mechanics.reference import find_reference

__all__ = ["Outcome", "find_reference"]
