"""Ground truth: the crash map, exact probabilities, and what they say of models and intervals."""
