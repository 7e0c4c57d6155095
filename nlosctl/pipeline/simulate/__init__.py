"""Scenarios to tables."""
