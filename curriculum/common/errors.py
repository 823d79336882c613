"""The one error that is answered by a line: a wish that cannot be met as it is put."""


class Refused(ValueError):
    """What cannot be done as it is asked for; its message names that, and what is allowed."""
