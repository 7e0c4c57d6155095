"""Behind `mixture-ml`: the mixture likelihood, its modes, its posterior."""
