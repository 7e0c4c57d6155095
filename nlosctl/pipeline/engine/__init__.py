"""Parts of the input, processes, Dask, and the order of their results."""
