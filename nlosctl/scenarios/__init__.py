"""Simulated worlds: measurements with their truth, one file per scenario."""
