"""Measurement models in three dimensions."""
