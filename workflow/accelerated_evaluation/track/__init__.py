"""Tests on a proving ground: scenario files, campaigns of real runs, and weighted sets of scenarios."""
