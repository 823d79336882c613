"""What is under way, in a line on a terminal."""

import sys
import time

SOON = 0.5  # s: what is done sooner needs no word


def each(names, always=False):
    """Each of the names; on a terminal in a line that the next replaces, or `always` in its own."""
    begun = time.monotonic()
    terminal = sys.__stderr__  # None, where 2>&- has closed it; not what an editor shows
    seen = terminal and terminal is sys.stderr and terminal.isatty() and not always
    for name in names:
        if always:
            print(name, flush=True)
        elif seen and time.monotonic() > begun + SOON:
            print(f"{name}\033[K", end="\r", file=sys.stderr, flush=True)
        yield name
    if seen:
        print("\033[K", end="\r", file=sys.stderr, flush=True)
