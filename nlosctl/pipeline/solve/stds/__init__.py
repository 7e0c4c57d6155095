"""Unknown standard deviations: their factors, estimated from residuals."""
