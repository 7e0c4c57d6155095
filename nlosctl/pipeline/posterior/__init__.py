"""The posterior of the position on a grid of cells."""
