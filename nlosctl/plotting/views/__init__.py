"""The views of `plot`, a file each."""
