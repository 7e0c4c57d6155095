"""Ranges as circles in the plane and spheres in space."""
