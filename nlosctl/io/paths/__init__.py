"""Inputs and outputs by name: paths, URLs, formats."""
