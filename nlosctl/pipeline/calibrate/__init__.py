"""Calibration: offsets of sensors, estimated by passes over the input."""
