"""Iterations that every likelihood shares."""
