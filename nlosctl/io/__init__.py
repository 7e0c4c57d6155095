"""Files in, files out: reading, checking and writing tables, scenes and their schemas."""
