"""The Cramér-Rao bound of measurements."""
