"""Solvers for measurements with outliers: the mixture likelihood, its modes, its posterior."""
