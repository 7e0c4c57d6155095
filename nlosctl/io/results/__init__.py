"""Layouts of result tables, and readers of results."""
