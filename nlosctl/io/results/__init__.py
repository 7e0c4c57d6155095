"""Layouts of result tables, and reading them again."""
