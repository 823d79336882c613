"""A function of small arrays, called once on symbols, becomes code with the same bits."""

from curriculum.common.tracing.ahead import CompiledSteps, compiled
from curriculum.common.tracing.arrays import ordered
from curriculum.common.tracing.many import fori_loop, vmap
from curriculum.common.tracing.tape import StepFailed, Untraceable, plain
from curriculum.common.tracing.trace import while_loop

__all__ = [
    "CompiledSteps",
    "StepFailed",
    "Untraceable",
    "compiled",
    "fori_loop",
    "ordered",
    "plain",
    "vmap",
    "while_loop",
]
