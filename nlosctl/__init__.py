"""Localize radio, acoustic and radar sources from files of measurements when some paths are not line of sight."""

__version__ = "0.1.0"
