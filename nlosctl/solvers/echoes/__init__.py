"""Solvers for unlabelled echoes: candidates, their assignment, clusters."""
