"""Figures and tables of Lenth."""
