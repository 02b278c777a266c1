"""Maximum likelihood: piecewise mixtures, EM, candidate families and their comparison."""
