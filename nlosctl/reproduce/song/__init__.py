"""Song, Willett and Zhou: figures."""
