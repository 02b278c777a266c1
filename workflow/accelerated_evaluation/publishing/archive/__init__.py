"""Archives of a study: provenance, RO-Crate and a folder for a LaTeX paper."""
