"""Folders of part files: names, slices, manifest, resume."""
