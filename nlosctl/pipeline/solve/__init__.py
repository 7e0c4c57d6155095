"""Solving: chunks to dense batches, methods, and estimates as tables."""
