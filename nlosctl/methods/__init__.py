"""The built-in methods, one a file; found through entry points like any plugin's."""
