"""Tests on a proving ground: scenario files, campaigns of real runs, and weighted sets of scenarios.

`campaign` estimates a crash probability from real runs that a sampler chooses, `weighted_set` and `export`
write sets of scenarios with weights, and `scenarios` writes cut-ins as OpenSCENARIO files.
"""
