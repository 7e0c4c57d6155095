"""What rows share that is not exactly known: offsets of a calibration, places of sensors, headings, mirrors."""
