"""Solvers for ranges."""
