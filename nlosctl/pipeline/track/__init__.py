"""Tracks: paths through the fixes or the measurements of moving sources."""
