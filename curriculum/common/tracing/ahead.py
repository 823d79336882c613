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
FASTER = 8  # a stretch is so many times as long as the one before,
LONGEST = 2_000  # but so many steps at most,
SHARE = 8  # and one of so many parts of the run: if the loop edits a state, the rest is in vain


class Step:
    """The function step(*state, *others) -> state, which hands out what is ready.

    Each step that is ready has its number, the bytes that come in if the loop goes on from its
    result, whether it is to be compared, and this result. `report`, a Report, says how the steps
    were taken.
    """

    def __init__(self, step, steps, notes=None):
        self.step = step
        self.steps = steps
        self.longest = min(max(1, steps // SHARE), LONGEST)  # steps of a stretch
        self.report = Report()
        self.builder = Builder(step, steps, self.report)
        self.comparisons = Comparisons(steps)
        self.notes = notes
        self.noted = []  # [(number of a step, its state, what `notes` gave for it)]
        self.first = None  # copies of the arguments of the first step
        self.error = None  # the StepChanged that was raised: a reader's `except` may have taken it
        self.width = 0  # how many arrays a state is
        self.single = False  # whether it is one array, by itself
        self.others = Others((), 0)
        self.ready = iter(())
        self.stretch = 0  # so many were made ready at once
        self.number = -1  # of the last step
        self.expected = None  # the bytes that come in, if the loop goes on from it

    def __call__(self, *arguments):
        others = self.others
        many = others.many
        try:
            goes_on = b"".join(arguments[:many]) == self.expected and not current.plain
        except TypeError:  # a float, or an array whose entries do not lie side by side
            goes_on = False
        rest = arguments[many:]
        if goes_on and others.rest == others.look(rest):
            step = next(self.ready, None)
            if step:
                self.number, self.expected, is_due, result = step
                return self.compare(result, OwnStep(self.step, arguments)) if is_due else result
        return self.begin(arguments)

    def begin(self, arguments):
        """Take a step that is not ready, or does not look like it; make those after it ready."""
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
        goes_on = self.look(number, state, arguments[self.width :])
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
        self.number, self.expected, is_due, result = step
        return self.compare(result, own) if is_new or is_due else result

    def compare(self, ahead, own):
        """Hand out the step that was computed ahead, if its own lines say the same."""
        result = own.result
        if own.failure:
            return self.take(self.number, own)
        state = own.arguments[: self.width]
        if not same(several(ahead), result, state, self.builder.run.exact):
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

    def look(self, number, state, others):
        """Note what others have come in. Whether the loop goes on from the step before."""
        came = numbers(state).tobytes()
        goes_on = came + self.others.tail == self.expected
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
        before = [self.expected[end - size : end] for size, end in zip(sizes, ends, strict=True)]
        before += self.others.contents
        now = [numbers([x]).tobytes() for x in state] + [*others]
        pairs = zip(names, now, before, strict=False)
        name = next((name for name, x, y in pairs if x != y), None)
        if name:
            self.report.change = number, name

    def computed(self, run, state, number):
        """A stretch of steps from a state, as they are to be ready; none if the first one fails."""
        columns = [x[1:] for x in run(state, self.stretch)]
        many = len(columns[0])
        self.report.time(many, run.seconds)
        bytes_in = bytes_of_rows(run.rows[1:], self.others.tail)
        are_due = self.comparisons.are_due(number, many)
        results = columns[0] if self.single else zip(*columns, strict=True)
        return zip(count(number), bytes_in, are_due, results)

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
        self.expected = numbers(state).tobytes() + self.others.tail
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
        exact = self.builder.run.exact if self.builder.run else not self.report.program
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
    """The arguments after the state: what a step is compiled with, and how later ones are known."""

    def __init__(self, others, width):
        self.copies = list(map(copied, others))
        self.contents = contents(others)
        first = len([*takewhile(lambda x: getattr(x, "dtype", 0) == "float64", others)])
        self.many = width + first  # the state and these are compared at once, by their bytes
        self.tail = b"".join(self.contents[:first])
        self.rest = self.contents[first:]  # the rest as `look` has it
        self.look = contents if any(isinstance(x, np.ndarray) for x in others[first:]) else tuple


def contents(arguments):
    """What arguments are compared by: the bytes of an array; what else there is, as it is."""
    return tuple(map(content, arguments))


def content(x):
    return x.tobytes() if isinstance(x, np.ndarray) else x


def bytes_of_rows(rows, tail):
    """The bytes of each row, and those of a tail."""
    tail = np.frombuffer(tail)
    rows = np.hstack([rows, np.broadcast_to(tail, (len(rows), tail.size))])
    return rows.view((np.void, rows.itemsize * rows.shape[1])).ravel().tolist()


class Builder:
    """Compiles a step, and again where its arguments change: BUILDS times at most."""

    def __init__(self, step, steps, report):
        self.step = step
        self.steps = steps
        self.report = report
        self.run = None  # the CompiledSteps, unless the others have changed
        self.builds = 0
        self.can = True

    def run_for(self, state, others):
        """The CompiledSteps for these; None if nothing is compiled here, or it cannot be."""
        if self.run and not self.run.fits(state):
            self.run = None
        if current.plain or not self.can:
            return None
        if self.run is None:
            try:
                self.run = self.build(state, others)
            except Untraceable as why:
                self.can = False
                self.report.go_plain(why)
        return self.run

    def build(self, state, others):
        self.builds += 1
        if self.builds > BUILDS:
            raise Untraceable("its arguments keep changing")
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
    call, and where one changes, the step is compiled for it. What it reads besides must stay as it
    is: some of the first steps, the last, and one in each 25th part of the run, or in 2,000 steps,
    are compared with the step's own lines. Raises StepChanged where one of these differs, and
    NotAState where it returns other shapes than those of the state.
    """
    return Step(step, steps, notes)
