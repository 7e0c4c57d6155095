"""Importers and map exporters at work on files."""
