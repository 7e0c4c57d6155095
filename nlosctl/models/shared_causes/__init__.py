"""What rows have in common that is not exactly known: offsets and positions of sensors, headings, mirrors."""
