"""A plugin that fails on import, as one that was built for another library does."""

raise ImportError("libfoo.so.3: cannot open shared object file")
