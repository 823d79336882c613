"""A function of small arrays, called once on symbols, becomes code with the same bits."""

from curriculum.common.tracing.ahead import compiled
from curriculum.common.tracing.many import vmap
from curriculum.common.tracing.plainly import Report
from curriculum.common.tracing.steps import CompiledSteps
from curriculum.common.tracing.symbols import ordered
from curriculum.common.tracing.tape import NotAState, StepChanged, Untraceable, plain
from curriculum.common.tracing.trace import fori_loop, while_loop

__all__ = ["CompiledSteps", "NotAState", "Report", "StepChanged", "Untraceable", "compiled"]
__all__ += ["fori_loop", "ordered", "plain", "vmap", "while_loop"]
