"""Calibrations in a run: rows of one sensor share the error of its offset."""
