"""What every other room uses: errors, files, tables, digests, arrays, registries and random generators."""
