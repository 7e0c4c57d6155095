"""The built-in methods, one per file, registered as entry points like any plugin's."""
