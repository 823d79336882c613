"""CompiledSteps: many steps at once, as Python or as machine code."""

import numpy as np

from curriculum.common.tracing import llvm, python
from curriculum.common.tracing.compare import changed, same
from curriculum.common.tracing.plainly import LARGE, OwnStep, in_range, numbers
from curriculum.common.tracing.trace import split, trace_loop, work


class CompiledSteps:
    """run(state, steps, *scalars) -> columns, of step(*state, *others, *scalars) -> state.

    The columns hold every state, from the first on, to where a step fails or numbers get LARGE; so
    do `rows`. They took this thread so many `seconds`. It is for states that it `fits`. Machine
    code is built if that is asked for or, where `machine_code` is None, if so many `steps` repay
    it. Raises Untraceable; and if it `compares`, StepChanged where its first step is not that of
    its own lines.
    """

    def __init__(self, step, state, steps, scalars=0, others=(), machine_code=None, compares=True):
        live = live_of(state)
        self.step = step
        self.others = others
        self.compares = compares
        self.shapes = list(map(np.shape, state))
        self.mask = numbers(live) != 0.0
        program, loop = trace_loop(step, live, scalars, others)
        self.program = program
        operations = work(program.tape, steps)
        if machine_code is None:
            machine_code = llvm.repays(operations, program.tape.lines)
        self.machine_code = machine_code
        self.how = "machine code"
        self.write = llvm.written(program, operations) if machine_code else None
        if self.write is None:
            self.how = "compiled to Python"
            self.write = python.written(python.source_of(program), loop.places)
            if machine_code:
                self.how += f", as llvmlite fails: {llvm.FAILED[0]}"

    def __call__(self, state, steps, *scalars):
        rows = np.full((steps + 1, self.mask.size), 0.0)  # touched now, not while it is timed
        rows[0] = numbers(state)
        done, self.seconds = self.write(np.append(rows[0, self.mask], scalars), rows[1:])
        if self.compares and done:
            self.compare(state, scalars, split(rows[1:2], self.shapes))
        self.rows = rows[: done + 1]
        if not in_range(self.rows):
            self.rows = rows[: np.argmin(np.all(np.abs(self.rows) < LARGE, axis=1))]
        return split(self.rows, self.shapes)

    def compare(self, state, scalars, after):
        """Raise StepChanged unless these columns, of a row, are what the step's own lines give."""
        own = OwnStep(self.step, [*state, *self.others, *scalars])
        result = own.result
        if not own.failure and not same([x[0] for x in after], result, state, self.program.exact):
            raise changed("a step")
        self.compares = False

    def fits(self, state):
        """Whether a state has the shapes and the zeros for which it was compiled."""
        return list(map(np.shape, state)) == self.shapes and not numbers(state)[~self.mask].any()


def live_of(state):
    """Masks of the arrays of a state: what is not always zero; a coordinate that all lack is."""
    if min(map(np.ndim, state)) < 2 or len({np.shape(x)[1:] for x in state}) > 1:
        return [np.ones(np.shape(x), bool) for x in state]
    along = np.any([np.any(x, axis=0) for x in state], axis=0)
    along = along | ~np.any(along)  # of zeros alone nothing would be left to compute
    return [np.broadcast_to(along, np.shape(x)) for x in state]
