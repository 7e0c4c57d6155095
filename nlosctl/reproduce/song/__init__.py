"""Figures of Song, Willett and Zhou."""
