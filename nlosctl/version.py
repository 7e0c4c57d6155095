"""The version: of the distribution, of `nlosctl --version`, and in the provenance of every result."""

__version__ = "0.1.0"
