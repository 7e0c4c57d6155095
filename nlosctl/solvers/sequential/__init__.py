"""Sequential estimation: hypotheses extended row by row."""
