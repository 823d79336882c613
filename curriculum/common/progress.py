"""What is under way, in a line on a terminal."""

import sys
import time

SOON = 0.5  # s: what is done sooner needs no word


def each(names, always=False):
    """Each of the names; on a terminal in a line that the next replaces, or `always` in its own."""
    begun = time.monotonic()
    seen = sys.stderr and sys.stderr.isatty() and not always  # 2>&- leaves no stderr
    for name in names:
        if always:
            print(name, flush=True)
        elif seen and time.monotonic() > begun + SOON:
            print(f"{name}\033[K", end="\r", file=sys.stderr, flush=True)
        yield name
    if seen:
        print("\033[K", end="\r", file=sys.stderr, flush=True)
