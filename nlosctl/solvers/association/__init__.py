"""Solvers for unlabelled bearings: sets of rows, one a sensor, that may be of one source; their choice, and fixes."""
