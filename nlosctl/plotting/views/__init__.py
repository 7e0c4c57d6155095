"""The views of `plot`, one file each, and their shared parts."""
