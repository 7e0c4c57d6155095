"""Behind `sequential` and `suppress`: hypotheses grown row by row."""
