"""Geometry on arrays: arrays in, arrays out."""
