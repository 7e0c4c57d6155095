"""Optimization shared by all likelihoods."""
