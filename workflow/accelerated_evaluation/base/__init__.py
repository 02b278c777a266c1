"""Basic tools for all other packages: errors, files, tables, digests, arrays, registries and randomness."""
