"""A file per command: it parses, calls a job and prints."""
