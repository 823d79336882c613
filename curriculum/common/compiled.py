"""A step that computes many ahead, compiled: the same numbers, hundreds of times sooner."""

import contextlib
import math
import sys
import time

from curriculum.common import llvm
from curriculum.common.bytecode import LARGE, Bytecode
from curriculum.common.crowds import mapped
from curriculum.common.native import Native
from curriculum.common.pure import Memory
from curriculum.common.steps import HALVINGS, Block, Plain
from curriculum.common.tape import Tape, Untraceable
from curriculum.common.traced import Single, Traced, moves

import numpy as np

BLOCK = 1 << 19  # numbers in a block of states, unless these are few
FIRST = 16  # steps of the first two blocks, which tell what a step costs
LONG = 3_000_000  # operations in a block, at most; a loop counts as one turn
QUICKER = 20  # times as many operations are in a block of machine code, which takes no longer
LOADING, COMPILING = 0.06, 24e-6  # s: to load llvmlite, and for each operation
# machine code is made if the steps left take so many times as long: the quick, then the best
QUICK, BEST = 1.5, 6.0
# times as many steps: then what is compiled is compared again; and where plain steps take long
OFTEN, SELDOM = 4, 32
SOON_DONE = 1000  # calls of numpy in a plain step that takes not long; of these two are compared


class Compiled(Plain):
    """What Plain is, compiled: its blocks are long.

    What was compiled is compared with the plain step at first, after FIRST steps, since a start may
    be at rest, whenever they are OFTEN times as many, SELDOM where that takes long, and in the end.
    Where they differ, or the step cannot be traced, steps are plain. With `only` that raises
    Untraceable, since it would take too long, and only one block is compared. `steps`: how many are
    to come. `how` says how steps are done; `source` is the code; `taken` steps took `seconds`,
    counted from zero where that changes. `lies`: why what was compiled was given up, or None.
    `halvings`: how often, at most, a step that fails is halved.
    """

    def __init__(
        self, step_fn, m, force, dt, measure, steps=0, watch=None, only=False, halvings=HALVINGS
    ):
        super().__init__(step_fn, m, force, dt, measure)
        self.given, self.only, self.halvings = (step_fn, m, force), only, halvings
        self.single, self.how = None, ""  # until the step is traced
        self.uses = steps or math.inf  # if that is not known yet
        self.measure_all, self.compared = mapped(measure, steps, again=True), False
        self.watch = mapped(watch, uses=steps) if watch else None
        self.measure_memory = None  # what `measure` keeps, as it was when a block was measured
        self.done = self.done_before = 0  # steps computed in this run, and in those before it
        self.start(dt, steps)

    def start(self, dt, steps):
        """Begin a run of so many steps of so many seconds, of the same system."""
        self.dt = float(dt)  # Python's own are quicker than numpy's
        self.done_before, self.done = self.done_before + self.done, 0
        self.steps, self.due = steps, 0  # those left; how many done call for a comparison
        self.taken, self.seconds = 0, 0.0
        self.block = None  # the latest
        self.most = math.inf  # steps of a block: few where the loop changes what it is handed

    @property
    def source(self):
        """The code that a step has become."""
        return self.single.traced.source if self.single else f"# {self.how}"

    def trace(self, q, v):
        """Trace the step; or find out why that cannot be done."""
        try:
            self.single = Single(Traced(*self.given, moves(q, v), uses=self.uses), self.halvings)
        except Untraceable as why:
            self.give_up(why)
            return
        self.how = "compiled to Python"
        if self.single.size > LARGE and llvm.available():
            with contextlib.suppress(llvm.Unavailable):
                self.single.machine = Bytecode(self.single.traced.program)
                self.how = "compiled to bytecode"
        self.single.prepare()

    def give_up(self, why):
        """Go on plainly."""
        self.lies = why if self.single else None
        self.single, self.why = None, str(why)
        self.how = f"{Plain.how}, which is slower: {why}"
        self.block, self.taken, self.seconds = None, 0, 0.0

    def confirm(self):
        """Go on plainly if what the step depends on was changed by the loop that takes the steps.

        It is asked behind each block. The first is one state long, so that a clock is noticed; what
        is changed later has come too late for the others of its block: ValueError.
        """
        if self.block is None:
            return
        handed, whole, self.block = self.block.handed(), len(self.block.v), None
        self.steps -= handed
        self.most = math.inf if handed == whole else 2 * handed  # the loop changes the state
        with Tape.lock:  # while others trace, nothing is as it is
            changed = self.single.traced.changed() or self.measure_memory.changed()
        if changed and handed > 1:
            ahead = "was changed while steps were computed ahead"
            raise ValueError(f"{changed} {ahead}: run them plainly, by way=Plain or --plain")
        if changed:
            self.give_up(f"the loop changes {changed}")

    def ahead(self, q, v):
        """The Block of states that follow q, v."""
        self.confirm()
        if not self.how:
            self.trace(q, v)
        if not self.single and self.only:
            raise Untraceable(f"steps are not compiled: {self.why}")
        if not self.single:
            return super().ahead(q, v)
        if not self.single.traced.fits(q, v):  # the loop has moved what stood still
            self.compared = False
            self.due = 0
            self.trace(q, v)
            return self.ahead(q, v)
        clock = time.perf_counter()
        start = self.single.traced.columns(q, v)[:, 0]
        try:
            rows, why, halved = self.single(start, self.count(len(start)), self.dt)
        except Untraceable as reason:  # found out by the lines as they stand
            self.give_up(reason)
            return self.ahead(q, v)
        spent, count = time.perf_counter() - clock, len(rows)
        if why and not count:
            raise why
        self.done += count
        if self.comparison_is_due(count, halved) and self.differs(start, rows, halved):
            self.give_up("it does something else when it is compiled")
            return self.ahead(q, v)
        self.taken, self.seconds = self.taken + count, self.seconds + spent
        # the first steps of a long one are slow, and with a Stop the next block begins
        if self.done >= FIRST and not why:
            self.improve(spent / count, self.steps - count)
        self.block = self.measured(rows, halved)
        return self.block

    def comparison_is_due(self, count, halved):
        """Whether a block of so many steps, some of them `halved`, is to be compared."""
        if self.only and self.compared:
            return False
        due = self.done >= self.due or count >= self.steps  # the last block, too
        if due:
            often = OFTEN if self.soon_done() else SELDOM
            self.due = often * self.done if self.done >= FIRST else FIRST
            self.compared = not halved
        return due

    def soon_done(self):
        """Whether a plain step takes not long."""
        return self.single.traced.numpy_calls < SOON_DONE

    def measured(self, rows, halved):
        """The Block of rows (count, entries)."""
        traced = self.single.traced
        states = traced.states(rows)
        measured = self.measure_all(*states, traced.moving, rows.T)
        with Tape.lock:
            if self.measure_memory is None or self.measure_memory.changed():  # since confirm
                self.measure_memory = Memory(self.measure)  # for the next confirm
        return Block(*states, measured, halved)

    def count(self, entries):
        """How many steps the next block has; never by the clock, so that runs are alike."""
        if not self.done:  # see confirm
            return 1
        first, states = FIRST, BLOCK // entries
        if not self.soon_done():  # so few blocks are compared
            first = FIRST * SELDOM
            states = max(first, states)
        most = min(self.steps, self.most, first - 1 if self.done < FIRST else math.inf)
        work = LONG * QUICKER if self.single.machine else LONG
        return max(1, min(most, states, work // self.single.size))

    def differs(self, start, rows, halved):
        """Whether the last step of a block (count, entries) is another than the plain one or, in a
        long block of short steps, the middle one; where the last is not finite, the first. Those
        `halved`, by number, were taken in halves, and the plain one must want that, too.
        """
        last = len(rows) - 1 if np.isfinite(rows[-1]).all() else 0
        for k in {last, last // 2} if len(rows) > FIRST and self.soon_done() else {last}:
            before = rows[k - 1] if k else start
            if self.single.traced.differs(before, rows[k], self.dt, k in halved):
                return True
        return False

    def improve(self, pace, left):
        """Machine code where `left` steps of `pace` s repay it: the soonest made, then the best."""
        machine = self.single.machine
        begun = isinstance(machine, Native)
        if begun and machine.best:
            return
        cost = COMPILING * self.single.size + LOADING * ("llvmlite.binding" not in sys.modules)
        if not begun:  # where there were runs before, as many steps will follow
            left += self.done_before
        worth = left * pace > (BEST if begun else QUICK) * cost
        if worth and llvm.available():  # which looks at files
            with contextlib.suppress(llvm.Unavailable):  # it goes on as it is
                self.single.machine = Native(self.single.traced.program, best=begun)
                self.how, self.taken, self.seconds = "compiled to machine code", 0, 0.0
        if llvm.FAILED and not self.single.machine:
            self.how = f"compiled to Python; {llvm.FAILED[0]}"
