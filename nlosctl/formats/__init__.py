"""Importers and exporters of other programs' files: one file each, plugins like any other's."""
