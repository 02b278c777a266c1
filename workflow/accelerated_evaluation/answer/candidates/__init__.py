"""Candidate laws: fitted to the records, scored on held-out records, and weighted."""
