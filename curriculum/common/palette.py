"""The colours of pages, pictures and recordings: on white and on dark, each legible as text.

They are chosen to be told apart in each kind of colour blindness, too.
"""

METHODS = [  # in the order of the table; a row of the reader's own takes the next one
    ("#005368", "#2ee5ff"),
    ("#422bd1", "#8169f0"),
    ("#534406", "#ffc900"),
    ("#bb3f9d", "#fa84c4"),
    ("#0c864b", "#1eb765"),
    ("#092800", "#c6d5b8"),
    ("#960f4b", "#e15ab4"),
    ("#4b690f", "#a5ff87"),
]
REFERENCE = "#727373", "#8b837a"
TOO_LONG = "#ca2837", "#e63e37"  # a piece of a rod, solid
TOO_SHORT = "#0072e5", "#88a8fe"  # dashed
INK = "#1f2328", "#e6edf3"
PAPER = "#ffffff", "#0d1117"  # the grounds that they are legible on


def places(methods):
    """{name: the place of its colours in METHODS}, of a chapter's methods in their order."""
    return {name: k % len(METHODS) for k, name in enumerate(methods)}
