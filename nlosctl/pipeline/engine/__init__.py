"""Execution engines: parts of the input, processes, Dask, and the order of the results."""
