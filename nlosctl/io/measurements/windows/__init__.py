"""Snapshots from times."""
