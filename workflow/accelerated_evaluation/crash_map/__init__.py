"""Crash maps: the set of cut-ins in which a vehicle crashes, and exact probabilities under a given law."""
