"""Files in, files out: the only importer of pyarrow in the package, beside what calls it."""
