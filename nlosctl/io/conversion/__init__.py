"""Files of other programs to tables, tables to tables."""
