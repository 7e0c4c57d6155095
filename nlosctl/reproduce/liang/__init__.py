"""Liang, Wang, Song, and Gao: figures and tables."""
