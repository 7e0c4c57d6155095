"""Simulated worlds: arrays and truth."""
