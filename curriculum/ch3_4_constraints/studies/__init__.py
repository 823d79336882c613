"""Studies: short runnable files, one question each."""
