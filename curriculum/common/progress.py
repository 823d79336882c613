"""What is under way, in a line on a terminal."""

import sys
import time

from curriculum.common.tracing.tape import current

SOON = 0.5  # s: what is done sooner needs no word


def each(names):
    """Each of the names; on a terminal in a line that the next replaces.

    Where nothing is compiled, each stands in a line of its own: what is printed there follows it.
    """
    begun = time.monotonic()
    terminal = sys.__stderr__  # None, where 2>&- has closed it; not what an editor shows
    seen = terminal and terminal is sys.stderr and terminal.isatty() and not current.plain
    for name in names:
        if current.plain:
            print(name, flush=True)
        elif seen and time.monotonic() > begun + SOON:
            print(f"{name}\033[K", end="\r", file=sys.stderr, flush=True)
        yield name
    if seen:
        print("\033[K", end="\r", file=sys.stderr, flush=True)
