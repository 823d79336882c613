"""What is under way, in a line on a terminal."""

import math
import sys
import time

SOON, OFTEN = 0.5, 0.1  # s: what takes longer is told of, and no more often than that


class Work:
    """What a program does, part by part, in a line that is gone in the end.

    plan(names) what is to come, and begin(name) each part; or go through `each` of them. What has
    one part goes `through` the items of that.
    """

    def __init__(self):
        self.plan()

    def plan(self, *names):
        """What is to come are these parts."""
        self.names, self.name, self.single = names, "", False
        self.begun, self.told, self.visible = time.monotonic(), -math.inf, False

    def begin(self, name, single=False):
        """Now begins a part; `single`: it is a single run, whose steps are shown as its own."""
        self.name, self.single, self.told = name, single, -math.inf
        self.names = self.names or (name,)
        self.tell()

    def each(self, names):
        """Each name in turn, as a part that is a run."""
        for name in names:
            self.begin(name, single=True)
            yield name
        self.wipe()

    def tell(self, what=""):
        """Show which part is under way and, in words, what is known of it."""
        seen = bool(sys.stderr) and sys.stderr.isatty()  # somebody may be looking on
        now = time.monotonic()
        if not seen or now < max(self.begun + SOON, self.told + OFTEN):
            return
        line = f"{self.name}{what}"
        if len(self.names) > 1:
            line = f"{self.names.index(self.name) + 1} of {len(self.names)}, {line}"
        # back to the line's start, so that an error writes over it
        print(f"{line[:79]}\033[K", end="\r", file=sys.stderr, flush=True)
        self.told, self.visible = now, True

    def wipe(self):
        """Leave no line: something is to be printed."""
        if self.visible:
            print("\033[K", end="\r", file=sys.stderr, flush=True)
        self.visible = False

    def through(self, name, items):
        """Each of the items, in turn, of what has one part."""
        self.plan(name)
        self.begin(name)
        for k, item in enumerate(items):
            yield item
            self.share(k + 1, len(items))

    def share(self, step, steps):
        """Tell which share of the steps of the part is done."""
        if step < steps:
            self.tell(f", {step / steps:.0%}")
        elif len(self.names) > 1:
            self.tell()
        else:
            self.wipe()

    def ticks(self, steps):
        """tick(step) of a run of so many steps, which is the work if none is planned.

        If the run is a part by itself, its share is shown; if it is one of many in a part, only
        that the part goes on.
        """
        if not self.names:
            self.plan("simulating")
            self.begin("simulating", single=True)
        if self.single:
            return lambda step: self.share(step, steps)
        several = len(self.names) > 1
        return lambda step: self.tell() if several else None


work = Work()
