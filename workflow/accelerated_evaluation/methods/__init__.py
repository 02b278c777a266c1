"""Methods that estimate the probability of an event: one module a method."""
