"""Measurement models: residuals, derivatives and information at a position."""
