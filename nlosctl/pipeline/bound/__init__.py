"""The Cramér-Rao bound of the snapshots of a file."""
