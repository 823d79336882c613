"""compiled: a step that runs ahead of the loop around it."""

from itertools import accumulate, count, takewhile

import numpy as np

from curriculum.common.tracing.compare import Comparisons, changed, same
from curriculum.common.tracing.plainly import (
    OwnStep,
    Report,
    copied,
    in_range,
    nan_like,
    numbers,
    result_now,
    spread,
)
from curriculum.common.tracing.steps import CompiledSteps
from curriculum.common.tracing.tape import NotAState, Untraceable, collector_off, current
from curriculum.common.tracing.trace import parameters, several

BUILDS = 8  # times that a step is compiled: what changes more often may change at each step
FASTER = 8  # a stretch of steps is so many times as long as the one before
LONGEST = 2_000  # steps of a stretch, at most
SHARE = 8  # parts of a run: a stretch is no longer than one; if a state is edited, it is in vain


class Step:
    """The function step(*state, *others) -> state, which hands out what is ready.

    A stretch of steps is computed ahead. As long as the loop goes on from the result of the step
    before, with the same others, each call hands out the next one; else a new stretch begins from
    the state that has come in. `report`, a Report, says how the steps were taken.
    """

    def __init__(self, step, steps, notes=None):
        self.step = step
        self.steps = steps  # about how many there will be
        self.longest = min(max(1, steps // SHARE), LONGEST)  # steps of a stretch, at most
        self.report = Report()
        self.builder = Builder(step, steps, self.report)
        self.comparisons = Comparisons(steps)
        self.notes = notes  # function(*state), or None
        self.noted = []  # [(number of a step, the state it began with, what `notes` gave for that)]
        self.first = None  # copies of the arguments of the first step
        self.error = None  # the StepChanged that was raised: a reader's `except` may have taken it
        self.width = 0  # how many arrays a state is
        self.single = False  # whether it is one array, by itself
        self.others = Others((), 0)  # the arguments after the state that steps are computed with
        self.ready = iter(())  # of the stretch, what is left: (number, next_bytes, is_due, result)
        self.stretch = 0  # steps of it
        self.number = -1  # of the step that was handed out last
        self.next_bytes = None  # what comes in next, as bytes, if the loop goes on from that step

    def __call__(self, *arguments):
        others = self.others
        many = others.many
        try:
            goes_on = b"".join(arguments[:many]) == self.next_bytes and not current.plain
        except TypeError:  # a float, or an array whose entries do not lie side by side
            goes_on = False
        rest = arguments[many:]
        if goes_on and others.rest == others.comparable(rest):
            step = next(self.ready, None)
            if step:
                self.number, self.next_bytes, is_due, result = step
                return self.compare(result, OwnStep(self.step, arguments)) if is_due else result
        return self.begin(arguments)

    def begin(self, arguments):
        """Take a step that is not ready, or does not look like it; begin a stretch if need be."""
        number = self.number + 1
        own = OwnStep(self.step, arguments)
        if number == 0:  # only its own lines tell what is a state
            refuse_lists(arguments)
            self.first = list(map(copied, arguments))
            self.width = len(own.result)
            self.single = own.single
        state = arguments[: self.width]
        if not in_range(numbers(state)):
            self.report.fail("a state that came in is not a number below 1e100")
            return self.hand_out(number, nan_like(state))
        known = self.builder.run
        goes_on = self.note_arguments(number, state, arguments[self.width :])
        run = self.builder.run_for(state, self.others.copies)
        if run is None:
            return self.take(number, own)
        is_new = run is not known
        step = next(self.ready, None) if goes_on and not is_new else None
        if step is None:
            grown = FASTER * self.stretch if goes_on and not is_new else 1
            left = self.steps - number if number < self.steps else LONGEST
            self.stretch = min(grown, self.longest, left)
            self.ready = self.computed(run, state, number)
            step = next(self.ready, None)
        if step is None:  # it fails, and only its own lines can tell why
            return self.take(number, own)
        self.number, self.next_bytes, is_due, result = step
        return self.compare(result, own) if is_new or is_due else result

    def compare(self, ahead, own):
        """Hand out the step that was computed ahead, if its own lines say the same."""
        result = own.result
        if own.failure:
            return self.take(self.number, own)
        state = own.arguments[: self.width]
        if not same(several(ahead), result, state, self.builder.run.program.exact):
            self.error = changed(f"step {self.number}")
            raise self.error
        self.report.compared += 1
        self.note(self.number, state)
        return ahead

    def note(self, number, state):
        """Note what `notes` gives now for the state of a step, to be asked for again."""
        if self.notes:
            copies = list(map(copied, state))
            self.noted.append((number, copies, result_now(self.notes, copies)))

    def note_arguments(self, number, state, others):
        """Note the arguments of a step. Whether the loop goes on with it from the step before."""
        came = numbers(state).tobytes()
        goes_on = came + self.others.float_bytes == self.next_bytes
        now = contents(others)
        if number > 0 and not self.report.change:
            self.note_change(number, state, now)
        if number == 0 or now != self.others.contents:
            self.others = Others(others, self.width)
            self.builder.run = None
            goes_on = False
        return goes_on

    def note_change(self, number, state, others):
        """Note the first argument, if there is one, that is not the step before's."""
        names = parameters(self.step, len(state) + len(others))
        sizes = [8 * np.size(x) for x in state]
        ends = accumulate(sizes)
        before = [self.next_bytes[end - size : end] for size, end in zip(sizes, ends, strict=True)]
        before += self.others.contents
        now = [numbers([x]).tobytes() for x in state] + [*others]
        pairs = zip(names, now, before, strict=False)
        name = next((name for name, x, y in pairs if x != y), None)
        if name:
            self.report.change = number, name

    def computed(self, run, state, number):
        """A stretch of steps from a state, as `ready` has them; none if the first one fails."""
        columns = [x[1:] for x in run(state, self.stretch)]
        many = len(columns[0])
        self.report.time(many, run.seconds)
        next_bytes = bytes_of_rows(run.rows[1:], self.others.float_bytes)
        are_due = self.comparisons.are_due(number, many)
        results = columns[0] if self.single else zip(*columns, strict=True)
        return zip(count(number), next_bytes, are_due, results)

    def take(self, number, own):
        """Hand out the step of its own lines."""
        if self.comparisons.is_due(number):
            self.note(number, own.arguments[: self.width])
        result = own.result
        if not self.report.is_compiled:
            self.report.time(1, own.seconds)
        if own.failure:
            self.report.fail(own.failure)
        return self.hand_out(number, result)

    def hand_out(self, number, state):
        self.number = number
        self.next_bytes = numbers(state).tobytes() + self.others.float_bytes
        self.ready = iter(())
        return state[0] if self.single else state

    def done(self):
        """The Report of all steps, as the loop has ended. Raises StepChanged if a step has."""
        if self.error:
            raise self.error
        self.report.steps = self.number + 1
        return self.report

    def differing(self, columns, most):
        """The first of some steps that, taken again now, gives something else; None if none does.

        `columns`: the states that the loop has kept, (steps + 1, ...) each. Up to so many steps are
        taken, and as many of the results asked for again that were noted, by their own lines.
        """
        exact = self.builder.run.program.exact if self.builder.run else not self.report.program
        for n in spread(len(columns[0]) - 1, most):
            state = [x[n] for x in columns]
            own = OwnStep(self.step, [*state, *self.first[self.width :]])
            after = [x[n + 1] for x in columns]
            if not same(after, own.result, state, exact):
                return n
        for k in spread(len(self.noted), most):
            number, state, result = self.noted[k]
            if not np.array_equal(result_now(self.notes, state), result, equal_nan=True):
                return number
        return None


def refuse_lists(arguments):
    """Raise NotAState for a list, which no step takes for an array."""
    for x in arguments:
        if isinstance(x, list | tuple):
            raise NotAState(f"a state must be of arrays of float64, and not of {type(x).__name__}s")


class Others:
    """The arguments after a state of so many arrays: to compile with, and to know them again.

    Arrays of floats that come first are compared together with the state, as bytes in one piece.
    The rest are compared one by one.
    """

    def __init__(self, others, width):
        self.copies = list(map(copied, others))  # what a step is compiled with
        self.contents = contents(others)  # what all of them are compared by
        first = len([*takewhile(lambda x: getattr(x, "dtype", 0) == "float64", others)])
        self.many = width + first  # arguments of a step that are compared in one piece
        self.float_bytes = b"".join(self.contents[:first])  # of this piece, what follows the state
        self.rest = self.contents[first:]  # what those after the piece are compared by
        has_arrays = any(isinstance(x, np.ndarray) for x in others[first:])
        self.comparable = contents if has_arrays else tuple  # function(the rest of a call) -> that


def contents(arguments):
    """What arguments are compared by: the bytes of an array; what else there is, as it is."""
    return tuple(map(content, arguments))


def content(x):
    return x.tobytes() if isinstance(x, np.ndarray) else x


def bytes_of_rows(rows, end):
    """Of each row of floats its bytes, which end in those of `end`: a list."""
    end = np.frombuffer(end)
    rows = np.hstack([rows, np.broadcast_to(end, (len(rows), end.size))])
    return rows.view((np.void, rows.itemsize * rows.shape[1])).ravel().tolist()


class Builder:
    """Compiles a step, and again where its arguments change: BUILDS times at most."""

    def __init__(self, step, steps, report):
        self.step = step
        self.steps = steps
        self.report = report
        self.run = None  # the CompiledSteps; None if they are not for what has come in last
        self.builds = 0  # how often it was compiled, or tried
        self.can = True  # whether it may be compiled once more

    def run_for(self, state, others):
        """The CompiledSteps for these; None if nothing is compiled here, or it cannot be."""
        if self.run and not self.run.fits(state):
            self.run = None
        if current.plain or not self.can:
            return None
        if self.run is None and self.builds == BUILDS:
            self.give_up("its arguments keep changing")
        elif self.run is None:
            try:
                self.run = self.build(state, others)
            except Untraceable as why:
                self.give_up(f"{why}; to try it, what counts or draws was called once more")
        return self.run

    def give_up(self, why):
        self.can = False
        self.report.go_plain(why)

    def build(self, state, others):
        self.builds += 1
        alike = current.alike  # of a block: whether its steps are machine code, once that is known
        chosen = alike[0] if alike else None
        with collector_off():
            settings = {"others": others, "machine_code": chosen, "compares": False}
            run = CompiledSteps(self.step, state, self.steps, **settings)
        if alike == []:
            alike.append(run.machine_code)
        self.report.how = run.how
        self.report.program = run.program
        self.report.is_compiled = True
        return run


def compiled(step, steps, notes=None):
    """The function step(*state, *others) -> state, made fast for about so many steps: a Step.

    `notes`: a function(*state) whose results at some steps are noted, to be asked for again.

    As many of the first arguments as `step` returns are the state. The others may be new at each
    call, and where one changes, the step is compiled for it: BUILDS times at most, and then it runs
    plainly. What it reads besides must stay as it is: some of the first steps, the last, and one in
    each 25th part of the run, or in 2,000 steps, are compared with the step's own lines. Raises
    StepChanged where one of these differs, and NotAState where it returns other shapes than those
    of the state.
    """
    return Step(step, steps, notes)
