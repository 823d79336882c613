"""Command lines that answer a mistake with one line: the flag, the value, and what is allowed."""

import argparse
import math


class Parser(argparse.ArgumentParser):
    """argparse, except that an error is a single line and no flag may be abbreviated."""

    def __init__(self, **settings):
        super().__init__(allow_abbrev=False, **settings)

    def error(self, message):
        """Print the line to stderr and exit with status 2."""
        self.exit(2, f"{self.prog}: error: {message}\n")


def number(kind, low, include_low=True, high=math.inf):
    """An argparse type: a finite `kind` (int or float), >= `low` (> unless `include_low`) and < `high`."""
    allowed = f"a {'whole' if kind is int else 'finite'} number {'>=' if include_low else '>'} {low}"
    allowed += f" and < {high}" if high < math.inf else ""

    def parse(text):
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not (low <= value < high) or (value == low and not include_low):
            raise argparse.ArgumentTypeError(f"must be {allowed}, not {text!r}")
        return value

    return parse
