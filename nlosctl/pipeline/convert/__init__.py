"""Files of other programs as measurements, and estimates as maps."""
