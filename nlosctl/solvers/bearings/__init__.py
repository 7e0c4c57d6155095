"""Solvers for bearings: likelihoods, searches, the status of a fix."""
