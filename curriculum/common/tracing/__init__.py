"""A function of small arrays, called once on symbols, becomes code with the same bits."""

from curriculum.common.tracing.ahead import CompiledSteps, compiled
from curriculum.common.tracing.arrays import ordered
from curriculum.common.tracing.many import vmap
from curriculum.common.tracing.tape import StepChanged, Untraceable, plain
from curriculum.common.tracing.trace import fori_loop, while_loop

__all__ = ["CompiledSteps", "StepChanged", "Untraceable", "compiled", "fori_loop"]
__all__ += ["ordered", "plain", "vmap", "while_loop"]
