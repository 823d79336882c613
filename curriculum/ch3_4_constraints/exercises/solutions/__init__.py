"""The exercises with their blanks filled in."""
