"""Files of calibrations, and rows as they are after a calibration."""
