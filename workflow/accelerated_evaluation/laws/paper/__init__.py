"""The paper's laws: candidate families, piecewise mixtures, their fits, and the law of independent inputs."""
