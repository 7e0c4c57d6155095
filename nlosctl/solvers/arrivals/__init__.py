"""Solvers for arrival times."""
