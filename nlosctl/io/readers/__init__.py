"""One reader per file format: its schema and its record batches."""
