"""Scripts with blanks. A blank says what belongs there; checks.py says whether it does."""
