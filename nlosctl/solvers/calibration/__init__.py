"""Offsets of sensors, estimated together with the positions of all snapshots."""
