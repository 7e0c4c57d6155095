"""Importers and exporters of other programs' file formats, one file each: plugins like those of other packages."""
