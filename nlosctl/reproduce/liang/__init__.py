"""Figures and tables of Liang, Zeng and Li."""
