"""Sources that move within a snapshot: the times of rows for methods, and what has no model of motion."""
