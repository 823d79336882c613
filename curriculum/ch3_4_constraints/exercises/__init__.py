"""Predict, then run: the exercises of chapter 3.4."""
