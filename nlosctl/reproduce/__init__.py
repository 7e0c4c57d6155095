"""The tables and figures of the four papers: one file for each, and the one loop that runs them all."""
