"""Crash maps: where a vehicle crashes, and the exact probabilities that follow for a given law."""
