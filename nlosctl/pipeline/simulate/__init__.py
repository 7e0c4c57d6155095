"""Scenarios as tables of measurements."""
