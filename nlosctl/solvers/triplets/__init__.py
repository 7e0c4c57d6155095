"""Solvers for triplets."""
