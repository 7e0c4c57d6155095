"""What a sensor should read at a position: residual, Jacobian, information."""
