"""Scores of results against the truth: arrays in, numbers out."""
