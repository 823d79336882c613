"""What main says: tests/said has commands of each sort, and what they print."""

import pytest

from curriculum.make.__main__ import SAID
from curriculum.make.texts import said_again


@pytest.mark.parametrize("path", sorted(SAID.glob("*.txt")), ids=lambda path: path.stem)
def test_commands_print_what_they_are_expected_to(path):
    """`python -m curriculum.make said` makes these files again: read the difference."""
    expected = path.read_text(encoding="utf-8")
    assert expected.startswith("$ ") and said_again(expected) == expected
